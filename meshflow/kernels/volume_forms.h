// Tetrahedra of several channels: the formula of tetrahedron.h, with p_c = alpha (a_c / x, b_c / y, c_c / z) of the legs along the axes,
// in double precision: engines give these loops numbers of that type.
#pragma once
#include "tetrahedron.h"
#include "volume_cells.h"

namespace meshflow::volume {

constexpr i64 TOGETHER = 64;  // cells whose metrics are held at once

// The metric of each of the six tetrahedra of some cells: P, then adj(I + s P) V0 / sqrt(det); xx, yy, zz, yz, xz, xy.
template <class T> struct Forms {
    T of[ORDERS][6][TOGETHER];
};

// The leg of tetrahedron `order` along its step-th axis goes from one corner to another.
constexpr int from_corner(int order, int step) {
    int corner = 0;
    for (int i = 0; i < step; ++i) corner |= 1 << ORDER[order][i];
    return corner;
}
constexpr int to_corner(int order, int step) { return from_corner(order, step) | 1 << ORDER[order][step]; }
constexpr int step_along(int order, int axis) {
    return ORDER[order][0] == axis ? 0 : ORDER[order][1] == axis ? 1 : 2;
}
// The values at a corner of cells from i on.
template <class A> INLINE const A* corner(const Rows<A>& u, int at, i64 i) { return u.at[at >> 1] + (at & 1) + i; }

// The legs of a tetrahedron along x, y and z.
template <int ORDER_, class A> struct Legs {
    const A *x0, *x1, *y0, *y1, *z0, *z1;
    static INLINE Legs of(const Rows<A>& u, i64 i) {
        constexpr int x = step_along(ORDER_, 0), y = step_along(ORDER_, 1), z = step_along(ORDER_, 2);
        return {corner(u, from_corner(ORDER_, x), i), corner(u, to_corner(ORDER_, x), i),
                corner(u, from_corner(ORDER_, y), i), corner(u, to_corner(ORDER_, y), i),
                corner(u, from_corner(ORDER_, z), i), corner(u, to_corner(ORDER_, z), i)};
    }
};

// Adds p p^T of one channel.
template <int ORDER_, class T>
LOOP void add_products(i64 i, i64 n, const Ground<T>& g, const Rows<T> u, T (&form)[6][TOGETHER]) {
    const Legs<ORDER_, T> l = Legs<ORDER_, T>::of(u, i);
    SIMD for (i64 j = 0; j < n; ++j) {
        const T x = (l.x1[j] - l.x0[j]) * g.over_x, y = (l.y1[j] - l.y0[j]) * g.over_y, z = (l.z1[j] - l.z0[j]) * g.over_z;
        form[0][j] += g.scale * (x * x), form[1][j] += g.scale * (y * y), form[2][j] += g.scale * (z * z);
        form[3][j] += g.scale * (y * z), form[4][j] += g.scale * (x * z), form[5][j] += g.scale * (x * y);
    }
}

// The factor of the flow of each tetrahedron from P, in place, and a quarter of its volume; zero where it does not exist.
template <class W, int ORDER_, class T>
LOOP void metrics(i64 i, i64 n, T q, const Ground<T>& g, const Rows<Lane<T>> there, T (&form)[6][TOGETHER], T (&quarter)[TOGETHER]) {
    const Lane<T>*m = nullptr, *k = nullptr, *l = nullptr, *o = nullptr;
    if (there.at[0]) {
        m = corner(there, 0, i), k = corner(there, to_corner(ORDER_, 0), i);
        l = corner(there, to_corner(ORDER_, 1), i), o = corner(there, 7, i);
    }
    SIMD for (i64 j = 0; j < n; ++j) {
        T xx = form[0][j], yy = form[1][j], zz = form[2][j], yz = form[3][j], xz = form[4][j], xy = form[5][j];
        const T root = lifted<W>(q, g.whole, xx, yy, zz, yz, xz, xy);
        form[0][j] = xx, form[1][j] = yy, form[2][j] = zz, form[3][j] = yz, form[4][j] = xz, form[5][j] = xy;
        quarter[j] = g.quarter * root;
    }
    if (!m) return;
    SIMD for (i64 j = 0; j < n; ++j) {
        const Lane<T> mask = m[j] & k[j] & l[j] & o[j];
        UNROLL for (int e = 0; e < 6; ++e) form[e][j] = kept(mask, form[e][j]);
        quarter[j] = kept(mask, quarter[j]);
    }
}

// Adds the pulls of a tetrahedron of one channel to its corners.
template <int ORDER_, class T>
LOOP void add_pulls(i64 i, i64 n, const Ground<T>& g, const Rows<T> u, const T (&form)[6][TOGETHER], const Corners<T>& pulls) {
    const Legs<ORDER_, T> l = Legs<ORDER_, T>::of(u, i);
    T* at[4];
    for (int step = 0; step < 4; ++step) {
        const int c = step < 3 ? from_corner(ORDER_, step) : 7;
        at[step] = pulls.at[c] + (c & 1) + i;
    }
    SIMD for (i64 j = 0; j < n; ++j) {
        const T x = (l.x1[j] - l.x0[j]) * g.over_x, y = (l.y1[j] - l.y0[j]) * g.over_y, z = (l.z1[j] - l.z0[j]) * g.over_z;
        const T on[3] = {(form[0][j] * x + (form[5][j] * y + form[4][j] * z)) * g.over_x,
                         (form[1][j] * y + (form[5][j] * x + form[3][j] * z)) * g.over_y,
                         (form[2][j] * z + (form[4][j] * x + form[3][j] * y)) * g.over_z};
        const T first = on[ORDER[ORDER_][0]], second = on[ORDER[ORDER_][1]], third = on[ORDER[ORDER_][2]];
        at[0][j] -= first, at[1][j] += first - second, at[2][j] += second - third, at[3][j] += third;
    }
}

template <int ORDER_, class T> LOOP void add_quarters(i64 i, i64 n, const T (&quarter)[TOGETHER], const Corners<T>& masses) {
    T* at[4];
    for (int step = 0; step < 4; ++step) {
        const int c = step < 3 ? from_corner(ORDER_, step) : 7;
        at[step] = masses.at[c] + (c & 1) + i;
    }
    SIMD for (i64 j = 0; j < n; ++j) {
        const T v = quarter[j];
        at[0][j] += v, at[1][j] += v, at[2][j] += v, at[3][j] += v;
    }
}

template <class F> INLINE void each_order(const F& work) {
    work.template operator()<0>(), work.template operator()<1>(), work.template operator()<2>();
    work.template operator()<3>(), work.template operator()<4>(), work.template operator()<5>();
}

// The metrics of n cells from i on. rows(c): the rows of channel c.
template <class W, class T, class F>
void forms_of(i64 i, i64 n, i64 channels, T q, const Ground<T>& g, const F& rows, const Rows<Lane<T>>& there, Forms<T>& forms,
              T (&quarters)[ORDERS][TOGETHER]) {
    std::memset(&forms, 0, sizeof forms);
    each_order([&]<int O>() {
        for (i64 c = 0; c < channels; ++c) add_products<O>(i, n, g, rows(c), forms.of[O]);
        metrics<W, O>(i, n, q, g, there, forms.of[O], quarters[O]);
    });
}

}  // namespace meshflow::volume
