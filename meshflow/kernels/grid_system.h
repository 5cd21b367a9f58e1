// Matrix-free conjugate gradients on a grid, and the size of a linear combination of arrays.
#pragma once
#include "grid_loops.h"
#include "memory.h"
#include "team.h"

namespace meshflow::grid {

// Rows are processed in bands whose height depends on the size of the grid only; therefore sums do not depend on threads.
constexpr i64 BAND = 1 << 16, FEW_NUMBERS = 100000;

// sums (what, k): work(k, first row, last row, partial sums of the band), added in the order of the bands.
template <class F> i64 over_bands(i64 k, i64 h, i64 w, i64 what, double* sums, i32 threads, const F& work) {
    const i64 high = most(1, BAND / w), bands = (h + high - 1) / high;
    Memory<double> parts(k * bands * what);
    if (!parts) return NO_MEMORY;
    parallel_for(k * bands, k * h * w < FEW_NUMBERS ? 1 : threads, [&](i64 part, i32) {
        const i64 first = part % bands * high;
        work(part / bands, first, least(first + high, h), parts.get() + part * what);
    });
    for (i64 q = 0; q < k; ++q)
        for (i64 i = 0; i < what; ++i) {
            double total = 0;
            for (i64 band = 0; band < bands; ++band) total += parts[(q * bands + band) * what + i];
            sums[i * k + q] = total;
        }
    return 0;
}

// Weights of the edges that begin in a row: to the right, down, down left and down right.
template <class T> struct Edges {
    const T *right, *down, *left, *slant;
};

// weight p - dt (sum of edge weights times the other ends), for the inner samples of a row, or with End for one end.
template <bool End, class T>
LOOP void system_row(i64 from, i64 to, i64 w, const T* weight, const Edges<T> e, const Edges<T> f, const T* over, const T* p,
                     const T* under, T dt, T* out) {
    SIMD for (i64 j = from; j < to; ++j) {
        const bool before = !End || j > 0, after = !End || j < w - 1;
        T sum = e.down[j] * under[j] + f.down[j] * over[j];
        if (before) sum += e.right[j - 1] * p[j - 1] + (e.left[j] * under[j - 1] + f.slant[j - 1] * over[j - 1]);
        if (after) sum += e.right[j] * p[j + 1] + (e.slant[j] * under[j + 1] + f.left[j + 1] * over[j + 1]);
        out[j] = weight[j] * p[j] - dt * sum;
    }
}

template <class T> LOOP void descended_row(i64 n, T a, const T* p, const T* q, T* x, T* r) {
    SIMD for (i64 j = 0; j < n; ++j) x[j] += a * p[j], r[j] -= a * q[j];
}
template <class T> LOOP void turned_row(i64 n, T b, const T* r, const T* weight, T* p) {
    SIMD for (i64 j = 0; j < n; ++j) p[j] = r[j] / weight[j] + b * p[j];
}

}  // namespace meshflow::grid

namespace meshflow {

// q = (mass + dt stiffness) p, where weight is the diagonal of the matrix; p . q of each channel.
template <class T>
i64 grid_multiplied(i64 k, i64 h, i64 w, const T* p, T* q, const T* weight, const T* edges, double dt, double* dots, i32 threads) {
    using namespace grid;
    Memory<T> none(w);
    if (!none) return NO_MEMORY;
    for (i64 j = 0; j < w; ++j) none[j] = T(0);
    return over_bands(k, h, w, 1, dots, threads, [&](i64 c, i64 first, i64 last, double* found) {
        double total = 0;
        for (i64 r = first; r < last; ++r) {
            const i64 at = (c * h + r) * w, plane = h * w;
            const T *here = p + at, *e = edges + r * w, *over = r > 0 ? here - w : here, *under = r < h - 1 ? here + w : here;
            const Edges<T> own{e, r < h - 1 ? e + plane : none.get(), r < h - 1 ? e + 2 * plane : none.get(),
                               r < h - 1 ? e + 3 * plane : none.get()};
            const Edges<T> above{none.get(), r > 0 ? e - w + plane : none.get(), r > 0 ? e - w + 2 * plane : none.get(),
                                 r > 0 ? e - w + 3 * plane : none.get()};
            system_row<true>(0, 1, w, weight + r * w, own, above, over, here, under, T(dt), q + at);
            system_row<false>(1, w - 1, w, weight + r * w, own, above, over, here, under, T(dt), q + at);
            if (w > 1) system_row<true>(w - 1, w, w, weight + r * w, own, above, over, here, under, T(dt), q + at);
            Sum sum;
            sum_over(sum, w, [&](i64 j) { return double(here[j]) * double(q[at + j]); });
            total += sum.total();
        }
        found[0] = total;
    });
}

// x += alpha p and r -= alpha q; r . r and r . (r / weight) of each channel.
template <class T>
i64 grid_descended(i64 k, i64 h, i64 w, const double* alpha, const T* p, const T* q, T* x, T* r, const T* weight, double* dots,
                   i32 threads) {
    using namespace grid;
    return over_bands(k, h, w, 2, dots, threads, [&](i64 c, i64 first, i64 last, double* found) {
        double squares = 0, scaled = 0;
        for (i64 row = first; row < last; ++row) {
            const i64 at = (c * h + row) * w;
            const T *left = r + at, *by = weight + row * w;
            descended_row(w, T(alpha[c]), p + at, q + at, x + at, r + at);
            Sum one, two;
            sum_over(one, w, [&](i64 j) { return double(left[j]) * double(left[j]); });
            sum_over(two, w, [&](i64 j) { return double(left[j]) * double(left[j] / by[j]); });
            squares += one.total(), scaled += two.total();
        }
        found[0] = squares, found[1] = scaled;
    });
}

// p = r / weight + beta p.
template <class T>
i64 grid_turned(i64 k, i64 h, i64 w, const double* beta, const T* r, const T* weight, T* p, i32 threads) {
    using namespace grid;
    Memory<double> nothing(k);
    if (!nothing) return NO_MEMORY;
    return over_bands(k, h, w, 1, nothing.get(), threads, [&](i64 c, i64 first, i64 last, double* found) {
        for (i64 row = first; row < last; ++row) {
            const i64 at = (c * h + row) * w;
            turned_row(w, T(beta[c]), r + at, weight + row * w, p + at);
        }
        found[0] = 0;
    });
}

// The sum of factor times array. found[0]: the sum of squares over the samples of every so many rows; found[1]: the largest
// square.
template <class T>
i64 grid_size(i64 k, i64 h, i64 w, const double* factors, const T* a, const T* b, const T* c, const T* d, i64 every,
              double* found, i32 threads) {
    using namespace grid;
    if (every < 1) return BAD_SIZES;
    const T* given[4] = {a, b, c, d};
    const i64 rows = (h + every - 1) / every, high = most(1, BAND / w), bands = (rows + high - 1) / high;
    Memory<double> parts(2 * bands);
    if (!parts) return NO_MEMORY;
    parallel_for(bands, k * rows * w < FEW_NUMBERS ? 1 : threads, [&](i64 band, i32) {
        constexpr i64 PIECE = 512;
        T sum[PIECE], squares[PIECE];
        double total = 0, greatest = 0;
        for (i64 r = band * high * every; r < least((band + 1) * high * every, h); r += every)
            for (i64 first = 0; first < w; first += PIECE) {
                const i64 n = least(PIECE, w - first);
                for (i64 q = 0; q < k; ++q) {
                    const i64 at = (q * h + r) * w + first;
                    bool begun = false;
                    for (int i = 0; i < 4; ++i) {
                        if (!given[i]) continue;
                        const T factor = T(factors[i]), *x = given[i] + at;
                        if (begun)
                            for (i64 j = 0; j < n; ++j) sum[j] += factor * x[j];
                        else
                            for (i64 j = 0; j < n; ++j) sum[j] = factor * x[j];
                        begun = true;
                    }
                    if (!begun)
                        for (i64 j = 0; j < n; ++j) sum[j] = T(0);
                    for (i64 j = 0; j < n; ++j) squares[j] = (q ? squares[j] : T(0)) + sum[j] * sum[j];
                }
                Sum part;
                sum_over(part, n, [&](i64 j) { return double(squares[j]); });
                total += part.total();
                const double most = greatest_of(n, [&](i64 j) { return squares[j]; });
                greatest = most > greatest ? most : greatest;
            }
        parts[2 * band] = total, parts[2 * band + 1] = greatest;
    });
    found[0] = found[1] = 0;
    for (i64 i = 0; i < bands; ++i)
        found[0] += parts[2 * i], found[1] = parts[2 * i + 1] > found[1] ? parts[2 * i + 1] : found[1];
    if (found[0] != found[0]) found[1] = found[0];  // not a number
    return 0;
}

}  // namespace meshflow
