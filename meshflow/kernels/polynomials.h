// Chebyshev polynomials of a sparse matrix, one degree at a time, and sums of them.
#pragma once
#include "conjugate_gradients.h"

namespace meshflow {

// From T_{j-1} (before) and T_j (now), (n, k), of a matrix A in CSR, the next one, scale A T_j - twice T_j - T_{j-1}, which replaces
// T_{j-1}. Terms (p, 2) times T_j and the next one are added to the sums (p, n, k), in this order, so that a sum depends neither on
// the number of threads nor on the other sums.
inline i64 chebyshev_degree(i64 n, i64 e, i64 p, i64 k, const i32* first, const i32* columns, const double* values, double scale,
                            double twice, const double* terms, const double* now, double* before, double* sums, i32 threads) {
    if (!rows_rise(n, first, e)) return OUT_OF_RANGE;
    return for_blocks_of_rows(n, threads, [&](i64 begin, i64 end, i64) {
        const i32 *row = columns + first[begin], *last = columns + first[end];
        std::uint32_t most = 0;
        for (const i32* at = row; at < last; ++at) {
            const std::uint32_t j = static_cast<std::uint32_t>(*at);
            most = most < j ? j : most;
        }
        if (row < last && most >= n) return false;
        for_columns(k, [&]<int K>(i64 c) {
            for (i64 i = begin; i < end; ++i) {
                double product[K] = {};
                for (i64 at = first[i]; at < first[i + 1]; ++at) {
                    const double value = values[at];
                    const double* x = now + k * i64(columns[at]) + c;
                    for (int t = 0; t < K; ++t) product[t] += value * x[t];
                }
                for (int t = 0; t < K; ++t) {
                    const i64 own = k * i + c + t;
                    before[own] = scale * product[t] - twice * now[own] - before[own];
                }
            }
        });
        for (i64 s = 0; s < p; ++s) {
            const double one = terms[2 * s], other = terms[2 * s + 1];
            double* sum = sums + s * n * k;
            if (one == 0.0 && other == 0.0) continue;
            for (i64 at = begin * k; at < end * k; ++at) sum[at] = sum[at] + one * now[at] + other * before[at];
        }
        return true;
    });
}

}  // namespace meshflow
