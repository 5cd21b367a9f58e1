// Conjugate gradients for all columns of a sparse system at once (Hestenes and Stiefel), with Jacobi preconditioning.
//
// Sums are taken over blocks of rows and then over the blocks, both in their order, so that they do not depend on the number of
// threads. Columns go four at a time, so that a row of the matrix is read once for all of them.
#pragma once
#include <atomic>

#include "memory.h"
#include "team.h"

namespace meshflow {

constexpr i64 CG_BLOCK = 2048;  // rows of a sum

// A matrix (n, n), CSR; vectors (n, k), and the directions (n, wide), of which columns beyond k are not used.
struct Rows {
    i64 n, k, wide;
    const i32 *first, *columns;
    const double *values, *jacobi;

    bool are_sound(i64 e) const {
        bool sound = first[0] >= 0 && first[n] <= e;
        for (i64 i = 0; i < n; ++i) sound &= first[i] <= first[i + 1];
        return sound && wide >= k;
    }
};

// work.operator()<K>(c) for the columns from c on, K of them.
template <class F> void for_columns(i64 k, const F& work) {
    i64 c = 0;
    for (; c + 4 <= k; c += 4) work.template operator()<4>(c);
    if (k - c == 3) work.template operator()<3>(c);
    if (k - c == 2) work.template operator()<2>(c);
    if (k - c == 1) work.template operator()<1>(c);
}

// q = A p of the columns c to c + K - 1 in the rows begin to end - 1; their p . q into dots. False for a column out of range.
// LOADED: columns of p that are multiplied, K or more; the others are not kept, but four numbers are one vector.
template <int K, int LOADED> bool product_block(const Rows& a, i64 c, i64 begin, i64 end, const double* p, double* q, double* dots) {
    double dot[K] = {};
    for (i64 i = begin; i < end; ++i) {
        double sum[LOADED] = {};
        for (i64 e = a.first[i]; e < a.first[i + 1]; ++e) {
            const std::uint32_t j = static_cast<std::uint32_t>(a.columns[e]);
            if (j >= a.n) return false;
            const double w = a.values[e], *x = p + a.wide * j + c;
            for (int t = 0; t < LOADED; ++t) sum[t] += w * x[t];
        }
        for (int t = 0; t < K; ++t) q[a.k * i + c + t] = sum[t], dot[t] += sum[t] * p[a.wide * i + c + t];
    }
    for (int t = 0; t < K; ++t) dots[c + t] = dot[t];
    return true;
}

template <int K> bool product_block(const Rows& a, i64 c, i64 begin, i64 end, const double* p, double* q, double* dots) {
    if constexpr (K == 3)
        if (a.wide >= c + 4) return product_block<3, 4>(a, c, begin, end, p, q, dots);
    return product_block<K, K>(a, c, begin, end, p, q, dots);
}

// r -= alpha q; r . D^-1 r and r . r into rho and size.
template <int K> void descend_block(const Rows& a, i64 c, i64 begin, i64 end, double* r, const double* q, const double* alpha,
                                    double* rho, double* size) {
    double sum[K] = {}, square[K] = {};
    for (i64 i = begin; i < end; ++i)
        for (int t = 0; t < K; ++t) {
            const i64 at = a.k * i + c + t;
            r[at] -= alpha[c + t] * q[at];
            square[t] += r[at] * r[at];
            sum[t] += a.jacobi[i] * r[at] * r[at];
        }
    for (int t = 0; t < K; ++t) rho[c + t] = sum[t], size[c + t] = square[t];
}

// x += alpha p, then p = D^-1 r + beta p.
template <int K> void turn_block(const Rows& a, i64 c, i64 begin, i64 end, double* x, const double* r, double* p,
                                 const double* alpha, const double* beta) {
    for (i64 i = begin; i < end; ++i)
        for (int t = 0; t < K; ++t) {
            const i64 at = a.k * i + c + t, way = a.wide * i + c + t;
            x[at] += alpha[c + t] * p[way];
            p[way] = a.jacobi[i] * r[at] + beta[c + t] * p[way];
        }
}

// sums (k,) of blocks (b, 2, k), their first or second half, in their order.
inline void added(i64 b, i64 k, const double* blocks, i64 half, double* sums) {
    for (i64 c = 0; c < k; ++c) sums[c] = 0.0;
    for (i64 at = 0; at < b; ++at)
        for (i64 c = 0; c < k; ++c) sums[c] += blocks[(2 * at + half) * k + c];
}

// q = A p.
inline i64 matrix_product(i64 n, i64 e, i64 k, const i32* first, const i32* columns, const double* values, const double* p,
                          double* q, i32 threads) {
    const Rows a{n, k, k, first, columns, values, nullptr};
    const Memory<double> dots(((n + CG_BLOCK - 1) / CG_BLOCK) * k);
    if (!dots) return NO_MEMORY;
    if (!a.are_sound(e)) return OUT_OF_RANGE;
    std::atomic<bool> sound{true};
    parallel_blocks(n, CG_BLOCK, threads, [&](i64 begin, i64 end, i64 block, i32) {
        for_columns(k, [&]<int K>(i64 c) {
            if (!product_block<K>(a, c, begin, end, p, q, dots.get() + block * k)) sound.store(false, std::memory_order_relaxed);
        });
    });
    if (!sound.load(std::memory_order_relaxed)) return OUT_OF_RANGE;
    return 0;
}

// Up to `most` iterations from x, the residual r, the direction p, and their sums rho = r . D^-1 r, size = r . r (k,), all of
// which are what they are afterwards; q is room to work in. Ends where size is at most goal (k,) in every column. Returns how
// many iterations it took.
inline i64 conjugate_gradients(i64 n, i64 e, i64 k, i64 wide, const i32* first, const i32* columns, const double* values,
                               const double* jacobi, const double* goal, double* x, double* r, double* p, double* q, double* rho,
                               double* size, i64 most, i32 threads) {
    const Rows a{n, k, wide, first, columns, values, jacobi};
    const i64 blocks = (n + CG_BLOCK - 1) / CG_BLOCK;
    const Memory<double> room(2 * blocks * k + 3 * k);
    if (!room) return NO_MEMORY;
    if (!a.are_sound(e)) return OUT_OF_RANGE;
    double *alpha = room.get(), *beta = alpha + k, *curvature = beta + k, *sums = curvature + k;
    std::atomic<bool> sound{true};
    for (i64 done = 0; done < most; ++done) {
        bool ended = true;
        for (i64 c = 0; c < k; ++c) ended &= size[c] <= goal[c];
        if (ended) return done;
        parallel_blocks(n, CG_BLOCK, threads, [&](i64 begin, i64 end, i64 block, i32) {
            for_columns(k, [&]<int K>(i64 c) {
                if (!product_block<K>(a, c, begin, end, p, q, sums + 2 * block * k)) sound.store(false, std::memory_order_relaxed);
            });
        });
        if (!sound.load(std::memory_order_relaxed)) return OUT_OF_RANGE;
        added(blocks, k, sums, 0, curvature);
        for (i64 c = 0; c < k; ++c) alpha[c] = curvature[c] > 0.0 ? rho[c] / curvature[c] : 0.0;
        parallel_blocks(n, CG_BLOCK, threads, [&](i64 begin, i64 end, i64 block, i32) {
            double* to = sums + 2 * block * k;
            for_columns(k, [&]<int K>(i64 c) { descend_block<K>(a, c, begin, end, r, q, alpha, to, to + k); });
        });
        for (i64 c = 0; c < k; ++c) beta[c] = rho[c];
        added(blocks, k, sums, 0, rho), added(blocks, k, sums, 1, size);
        for (i64 c = 0; c < k; ++c) beta[c] = beta[c] > 0.0 ? rho[c] / beta[c] : 0.0;
        parallel_blocks(n, CG_BLOCK, threads, [&](i64 begin, i64 end, i64, i32) {
            for_columns(k, [&]<int K>(i64 c) { turn_block<K>(a, c, begin, end, x, r, p, alpha, beta); });
        });
    }
    return most;
}

}  // namespace meshflow
