#include "arrays.h"

MESHFLOW_KERNEL(copied)

// The gate itself uses these functions, so they cannot be called through it.
MESHFLOW_API meshflow::i64 outside_int32(meshflow::i64 n, const meshflow::i32* numbers, meshflow::i64 bound) {
    return meshflow::outside(n, numbers, bound);
}
MESHFLOW_API meshflow::i64 outside_int64(meshflow::i64 n, const meshflow::i64* numbers, meshflow::i64 bound) {
    return meshflow::outside(n, numbers, bound);
}
