// Copies of arrays, and checks of their values.
#pragma once
#include "team.h"

namespace meshflow {

constexpr i64 BLOCK = 1 << 16;  // least number of samples for a thread

// target[i] = source[i]: the reference for the speed of loops over memory.
template <class T> i64 copied(i64 n, const T* source, T* target, i32 threads) {
    parallel_blocks(n, BLOCK, threads, [&](i64 first, i64 last, i64, i32) {
        for (i64 i = first; i < last; ++i) target[i] = source[i];
    });
    return 0;
}

// The count of n numbers that are below 0, or not below a bound.
template <class I> i64 outside(i64 n, const I* numbers, i64 bound) {
    i64 count = 0;
    for (i64 i = 0; i < n; ++i) count += numbers[i] < 0 || static_cast<i64>(numbers[i]) >= bound;
    return count;
}

}  // namespace meshflow
