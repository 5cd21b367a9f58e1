// Conjugate gradients for all columns of a sparse system at once (Hestenes and Stiefel), with Jacobi preconditioning.
//
// The time of an iteration is that of reading the matrix, so the matrix is packed first. It is scaled to a unit diagonal, which
// need not be read (this is also Jacobi's preconditioning); rows are reordered so that neighbours are close; and entries between
// two rows of the same block are stored once, because the matrix is symmetric. Sums are taken over blocks of rows and then over
// the blocks in a fixed order, so that they do not depend on the number of threads. Up to four columns are processed at a time.
#pragma once
#include <atomic>

#include "memory.h"
#include "team.h"

namespace meshflow {

constexpr i64 CG_BLOCK = 1024;  // rows of a block and of a sum

inline bool rows_rise(i64 n, const i32* first, i64 e) {
    bool rising = first[0] >= 0 && first[n] <= e;
    for (i64 i = 0; i < n; ++i) rising &= first[i] <= first[i + 1];
    return rising;
}

// Calls work.operator()<K>(c) for groups of K columns that start at c.
template <class F> void for_columns(i64 k, const F& work) {
    i64 c = 0;
    for (; c + 4 <= k; c += 4) work.template operator()<4>(c);
    if (k - c == 3) work.template operator()<3>(c);
    if (k - c == 2) work.template operator()<2>(c);
    if (k - c == 1) work.template operator()<1>(c);
}

// Calls work(begin, end, block) for the blocks of n rows; work returns false if an index is out of range.
template <class F> i64 for_blocks_of_rows(i64 n, i32 threads, const F& work) {
    std::atomic<bool> sound{true};
    parallel_blocks(n, CG_BLOCK, threads, [&](i64 begin, i64 end, i64 block, i32) {
        if (!work(begin, end, block)) sound.store(false, std::memory_order_relaxed);
    });
    if (sound.load(std::memory_order_relaxed)) return 0;
    return OUT_OF_RANGE;
}

// q = A p of n rows in CSR, for k columns.
inline i64 matrix_product(i64 n, i64 e, i64 k, const i32* first, const i32* columns, const double* values, const double* p,
                          double* q, i32 threads) {
    if (!rows_rise(n, first, e)) return OUT_OF_RANGE;
    return for_blocks_of_rows(n, threads, [&](i64 begin, i64 end, i64) {
        bool sound = true;
        for_columns(k, [&]<int K>(i64 c) {
            for (i64 i = begin; i < end && sound; ++i) {
                double sum[K] = {};
                for (i64 at = first[i]; at < first[i + 1]; ++at) {
                    const std::uint32_t j = static_cast<std::uint32_t>(columns[at]);
                    if (j >= n) {
                        sound = false;
                        break;
                    }
                    for (int t = 0; t < K; ++t) sum[t] += values[at] * p[k * j + c + t];
                }
                for (int t = 0; t < K; ++t) q[k * i + c + t] = sum[t];
            }
        });
        return sound;
    });
}

// --- packing -----------------------------------------------------------------------------------------------------------------

// Reordered rows of a matrix: row r is row order[r] of the matrix, and where[order[r]] = r. Null: the order of the matrix.
struct Ordered {
    i64 n;
    const i32 *order, *where, *first, *columns;

    // Calls visit(entry, column r) for row r; returns false if an index is out of range.
    template <class F> bool row(i64 r, const F& visit) const {
        const std::uint32_t i = static_cast<std::uint32_t>(order ? order[r] : static_cast<i32>(r));
        if (i >= n) return false;
        for (i64 at = first[i]; at < first[i + 1]; ++at) {
            std::uint32_t j = static_cast<std::uint32_t>(columns[at]);
            if (j >= n) return false;
            if (where) j = static_cast<std::uint32_t>(where[j]);
            if (j >= n) return false;
            visit(at, static_cast<i64>(j));
        }
        return true;
    }
};

// The start of the entries of each packed row: near (n + 1,), whose other row is later in the same block; far (n + 1,), whose
// other row is in another block. Also the diagonal (n,) of the matrix in the packed order.
inline i64 pack_rows(i64 n, i64 e, const i32* first, const i32* columns, const double* values, const i32* order, const i32* where,
                     i32* near, i32* far, double* diagonal, i32 threads) {
    if (!rows_rise(n, first, e) || !order != !where) return OUT_OF_RANGE;
    const Ordered rows{n, order, where, first, columns};
    near[0] = far[0] = 0;
    const i64 done = for_blocks_of_rows(n, threads, [&](i64 begin, i64 end, i64) {
        for (i64 r = begin; r < end; ++r) {
            double own = 0.0;
            i32 inside = 0, outside = 0;
            const bool sound = rows.row(r, [&](i64 at, i64 j) {
                if (j == r) own += values[at];
                else if (j < begin || j >= end) ++outside;
                else if (j > r) ++inside;
            });
            if (!sound) return false;
            near[r + 1] = inside, far[r + 1] = outside, diagonal[r] = own;
        }
        return true;
    });
    if (done < 0) return done;
    for (i64 r = 0; r < n; ++r) near[r + 1] += near[r], far[r + 1] += far[r];
    return 0;
}

// The packed entries: near ones by the indices of both their rows in the block, pairs (a, 2); far ones by the index of their row
// in the block, far_rows (b,), and the packed row that is their column, far_columns (b,). Values are multiplied by scale (n,), in
// the packed order, of both rows.
inline i64 pack_entries(i64 n, i64 e, i64 a, i64 b, const i32* first, const i32* columns, const double* values, const i32* order,
                        const i32* where, const double* scale, const i32* near, const i32* far, std::uint16_t* pairs,
                        double* near_values, std::uint16_t* far_rows, i32* far_columns, double* far_values, i32 threads) {
    if (!rows_rise(n, first, e) || !order != !where || !rows_rise(n, near, a) || !rows_rise(n, far, b)) return OUT_OF_RANGE;
    const Ordered rows{n, order, where, first, columns};
    return for_blocks_of_rows(n, threads, [&](i64 begin, i64 end, i64) {
        for (i64 r = begin; r < end; ++r) {
            i64 inside = near[r], outside = far[r];
            bool room = true;
            const std::uint16_t place = static_cast<std::uint16_t>(r - begin);
            const bool sound = rows.row(r, [&](i64 at, i64 j) {
                const double value = values[at] * (scale[r] * scale[j]);
                if (j < begin || j >= end) {
                    if (!(room = outside < far[r + 1])) return;
                    far_rows[outside] = place, far_columns[outside] = static_cast<i32>(j), far_values[outside++] = value;
                } else if (j > r) {
                    if (!(room = inside < near[r + 1])) return;
                    pairs[2 * inside] = place, pairs[2 * inside + 1] = static_cast<std::uint16_t>(j - begin);
                    near_values[inside++] = value;
                }
            });
            if (!sound || !room || inside != near[r + 1] || outside != far[r + 1]) return false;
        }
        return true;
    });
}

// target[r] = scale[r] source[order[r]]; or back, target[order[r]] += scale[r] source[r]. order (n,) is a permutation.
inline i64 pack_vectors(i64 n, i64 k, const i32* order, const double* scale, const double* source, double* target, i64 back,
                        i32 threads) {
    return for_blocks_of_rows(n, threads, [&](i64 begin, i64 end, i64) {
        for (i64 r = begin; r < end; ++r) {
            const i64 i = order ? static_cast<i64>(static_cast<std::uint32_t>(order[r])) : r;
            if (i >= n) return false;
            for (i64 c = 0; c < k; ++c) {
                if (back) target[k * i + c] += scale[r] * source[k * r + c];
                else target[k * r + c] = scale[r] * source[k * i + c];
            }
        }
        return true;
    });
}

// --- iterations --------------------------------------------------------------------------------------------------------------

struct Packed {
    i64 n, k;
    const i32 *near, *far;
    const std::uint16_t* pairs;
    const double* near_values;
    const std::uint16_t* far_rows;
    const i32* far_columns;
    const double* far_values;

    // Whether all entries of a block are in range.
    bool are_sound(i64 begin, i64 end) const {
        std::uint32_t place = 0, column = 0;
        const auto raise = [](std::uint32_t& most, std::uint32_t number) { most = most < number ? number : most; };
        for (i64 at = 2 * i64(near[begin]); at < 2 * i64(near[end]); ++at) raise(place, pairs[at]);
        for (i64 at = far[begin]; at < far[end]; ++at) raise(place, far_rows[at]);
        for (i64 at = far[begin]; at < far[end]; ++at) raise(column, static_cast<std::uint32_t>(far_columns[at]));
        return place < end - begin && column < n;
    }
};

// q = A p of the columns c to c + K - 1 in the rows of a block, and their p . q in dots. Each near entry is added to both of its
// rows. A loop over entries instead of rows avoids branch mispredictions, which cost more than the products.
template <int K> void packed_product(const Packed& a, i64 c, i64 begin, i64 end, const double* p, double* q, double* dots) {
    constexpr int LANES = K == 3 ? 4 : K;  // four numbers fill a vector register
    double x[CG_BLOCK * LANES], y[CG_BLOCK * LANES];
    const i64 k = a.k, many = end - begin;
    for (i64 i = 0; i < many; ++i)
        for (int t = 0; t < LANES; ++t) x[LANES * i + t] = y[LANES * i + t] = t < K ? p[k * (begin + i) + c + t] : 0.0;
    for (i64 at = a.near[begin]; at < a.near[end]; ++at) {
        const i64 i = LANES * i64(a.pairs[2 * at]), j = LANES * i64(a.pairs[2 * at + 1]);
        const double w = a.near_values[at];
        double of_i[LANES], of_j[LANES];
        for (int t = 0; t < LANES; ++t) of_i[t] = y[i + t] + w * x[j + t];
        for (int t = 0; t < LANES; ++t) of_j[t] = y[j + t] + w * x[i + t];
        for (int t = 0; t < LANES; ++t) y[i + t] = of_i[t];
        for (int t = 0; t < LANES; ++t) y[j + t] = of_j[t];
    }
    for (i64 at = a.far[begin]; at < a.far[end]; ++at) {
        const i64 i = LANES * i64(a.far_rows[at]), j = k * a.far_columns[at] + c;
        for (int t = 0; t < K; ++t) y[i + t] += a.far_values[at] * p[j + t];
    }
    double dot[LANES] = {};
    for (i64 i = 0; i < many; ++i)
        for (int t = 0; t < LANES; ++t) dot[t] += x[LANES * i + t] * y[LANES * i + t];
    for (i64 i = 0; i < many; ++i)
        for (int t = 0; t < K; ++t) q[k * (begin + i) + c + t] = y[LANES * i + t];
    for (int t = 0; t < K; ++t) dots[c + t] = dot[t];
}

// r -= alpha q; rho = r . r, and size = r . r weighted by the diagonal of the matrix before scaling.
template <int K> void descend(i64 k, i64 c, i64 begin, i64 end, const double* __restrict diagonal, double* __restrict r,
                              const double* __restrict q, const double* alpha, double* rho, double* size) {
    double by[K], sum[K] = {}, weighted[K] = {};
    for (int t = 0; t < K; ++t) by[t] = alpha[c + t];
    for (i64 i = begin; i < end; ++i) {
        const double weight = diagonal[i];
        for (int t = 0; t < K; ++t) {
            const i64 at = k * i + c + t;
            const double left = r[at] - by[t] * q[at], square = left * left;
            r[at] = left, sum[t] += square, weighted[t] += weight * square;
        }
    }
    for (int t = 0; t < K; ++t) rho[c + t] = sum[t], size[c + t] = weighted[t];
}

// x += alpha p, then p = r + beta p.
template <int K> void turn(i64 k, i64 c, i64 begin, i64 end, double* __restrict x, const double* __restrict r, double* __restrict p,
                           const double* alpha, const double* beta) {
    double by[K], keep[K];
    for (int t = 0; t < K; ++t) by[t] = alpha[c + t], keep[t] = beta[c + t];
    for (i64 i = begin; i < end; ++i)
        for (int t = 0; t < K; ++t) {
            const i64 at = k * i + c + t;
            const double before = p[at];
            x[at] += by[t] * before;
            p[at] = r[at] + keep[t] * before;
        }
}

// sums (k,) over blocks (b, 2, k), of their first or second half, in order.
inline void added(i64 b, i64 k, const double* blocks, i64 half, double* sums) {
    for (i64 c = 0; c < k; ++c) sums[c] = 0.0;
    for (i64 at = 0; at < b; ++at)
        for (i64 c = 0; c < k; ++c) sums[c] += blocks[(2 * at + half) * k + c];
}

// Up to `most` iterations of the packed system from x, the residual r and the direction p, all (n, k), and the sums rho = r . r
// and size (k,). All of these are updated; q is work space. Ends when size is at most goal (k,) in every column. Returns the
// number of iterations.
inline i64 conjugate_gradients(i64 n, i64 a, i64 b, i64 k, const i32* near, const i32* far, const std::uint16_t* pairs,
                               const double* near_values, const std::uint16_t* far_rows, const i32* far_columns,
                               const double* far_values, const double* diagonal, const double* goal, double* x, double* r, double* p,
                               double* q, double* rho, double* size, i64 most, i32 threads) {
    if (!rows_rise(n, near, a) || !rows_rise(n, far, b)) return OUT_OF_RANGE;
    const Packed matrix{n, k, near, far, pairs, near_values, far_rows, far_columns, far_values};
    const auto are_sound = [&](i64 begin, i64 end, i64) { return matrix.are_sound(begin, end); };
    if (for_blocks_of_rows(n, threads, are_sound) < 0) return OUT_OF_RANGE;
    const i64 blocks = (n + CG_BLOCK - 1) / CG_BLOCK;
    const Memory<double> room(2 * blocks * k + 3 * k);
    if (!room) return NO_MEMORY;
    double *alpha = room.get(), *beta = alpha + k, *curvature = beta + k, *sums = curvature + k;
    for (i64 done = 0; done < most; ++done) {
        bool ended = true;
        for (i64 c = 0; c < k; ++c) ended &= size[c] <= goal[c];
        if (ended) return done;
        parallel_blocks(n, CG_BLOCK, threads, [&](i64 begin, i64 end, i64 block, i32) {
            for_columns(k, [&]<int K>(i64 c) { packed_product<K>(matrix, c, begin, end, p, q, sums + 2 * block * k); });
        });
        added(blocks, k, sums, 0, curvature);
        for (i64 c = 0; c < k; ++c) alpha[c] = curvature[c] > 0.0 ? rho[c] / curvature[c] : 0.0;
        parallel_blocks(n, CG_BLOCK, threads, [&](i64 begin, i64 end, i64 block, i32) {
            double* to = sums + 2 * block * k;
            for_columns(k, [&]<int K>(i64 c) { descend<K>(k, c, begin, end, diagonal, r, q, alpha, to, to + k); });
        });
        for (i64 c = 0; c < k; ++c) beta[c] = rho[c];
        added(blocks, k, sums, 0, rho), added(blocks, k, sums, 1, size);
        for (i64 c = 0; c < k; ++c) beta[c] = beta[c] > 0.0 ? rho[c] / beta[c] : 0.0;
        parallel_blocks(n, CG_BLOCK, threads, [&](i64 begin, i64 end, i64, i32) {
            for_columns(k, [&]<int K>(i64 c) { turn<K>(k, c, begin, end, x, r, p, alpha, beta); });
        });
    }
    return most;
}

}  // namespace meshflow
