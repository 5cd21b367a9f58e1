// Cells of a volume, cut into tetrahedra: the formula of one channel, and the loop over a row of cells.
//
// A cell is cut into the six tetrahedra of Freudenthal (1942): each is a path from one end of a main diagonal to the other along
// the three axes, in one of their six orders. Its legs a, b, c along the axes are at right angles on the ground, so that its
// gradient is (a / x, b / y, c / z) whatever the order, with x, y, z the spacing. Lifted by the contrast alpha into R^4 its volume is
//
//     V = V0 W,   W^2 = 1 + alpha^2 (a^2 / x^2 + b^2 / y^2 + c^2 / z^2),   V0 = x y z / 6,
//
// with sharpness V0 W^q, and the gradient of the volume along a leg is (V0 / x^2) a / W^q: the flow of one channel runs along the
// edges of the grid alone, with nothing to cancel.
//
// Which of the four main diagonals: in the frame of a diagonal it joins corner 0 and corner 7. Bit 0 of a corner is its place
// along x, bit 1 along y, bit 2 along z. Another diagonal exchanges the rows of the cell at the two places along y, or along z.
#pragma once
#include <utility>

#include "grid_rows.h"

namespace meshflow {

// The parameters of a flow of a volume (meshflow/kernels/volume.py).
struct VolumeOptions {
    double sharpness, gamma, scale;      // scale: alpha^2
    double x, y, z;                      // the spacing
    i64 first_diagonal, last_diagonal;   // main diagonals that are averaged, bit 0: along y, bit 1: along z; last not included
    i64 ring, by_forms;                  // whether masses are whole rings; whether one channel takes the loop for several
};

}  // namespace meshflow

namespace meshflow::volume {

using grid::Lane;
using grid::Mix;

constexpr int CORNERS = 8, ORDERS = 6, DIAGONALS = 4;
// The orders of the axes, one for each tetrahedron.
constexpr int ORDER[ORDERS][3] = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};
// The number of tetrahedra at each corner.
constexpr int AT_CORNER[CORNERS] = {6, 2, 2, 2, 2, 2, 2, 6};

// The ground of a cell.
template <class T> struct Ground {
    T ax, ay, az;  // (alpha / x)^2, ...
    T kx, ky, kz;  // V0 / x^2, ...
    T quarter;     // V0 / 4: the part of a tetrahedron that each of its corners has
    T over_x, over_y, over_z, whole, scale;
    static Ground of(const VolumeOptions& o) {
        const double v = o.x * o.y * o.z / 6, x = o.x * o.x, y = o.y * o.y, z = o.z * o.z;
        return {T(o.scale / x), T(o.scale / y), T(o.scale / z), T(v / x), T(v / y), T(v / z), T(v / 4),
                T(1 / o.x), T(1 / o.y), T(1 / o.z), T(v), T(o.scale)};
    }
};

// Contributions of a row of cells to the samples at its eight corners. That of cell i to corner c is at [c][i + (c & 1)]: the index
// of the sample. Elsewhere they are zero.
template <class T> struct Corners {
    T* at[CORNERS];
    static Corners of(grid::Room<T>& room) {
        Corners c;
        for (T*& row : c.at) row = room.take();
        return c;
    }
};

// x where the mask is all ones, else zero.
template <class T> INLINE T kept(Lane<T> mask, T x) { return std::bit_cast<T>(std::bit_cast<Lane<T>>(x) & mask); }

// The four rows of samples of a row of cells in the frame of its diagonal: bit 0 of the index is the place along y, bit 1 along z.
template <class A> struct Rows {
    const A* at[4];
};

// Pulls of n cells, and with Weighed the quarters of the volumes of their tetrahedra. there: masks, read with Gaps only.
template <class W, bool Weighed, bool Gaps, class T>
LOOP void one_channel(i64 n, T q, const Ground<T> g, const Rows<T> u, [[maybe_unused]] const Rows<Lane<T>> there,
                      const Corners<T> pulls, [[maybe_unused]] const Corners<T> masses) {
    const T *a = u.at[0], *b = u.at[1], *c = u.at[2], *d = u.at[3];
    T *p0 = pulls.at[0], *p1 = pulls.at[1], *p2 = pulls.at[2], *p3 = pulls.at[3];
    T *p4 = pulls.at[4], *p5 = pulls.at[5], *p6 = pulls.at[6], *p7 = pulls.at[7];
    SIMD for (i64 i = 0; i < n; ++i) {
        // Legs: x of the row, y and z where they begin.
        const T xa = a[i + 1] - a[i], xb = b[i + 1] - b[i], xc = c[i + 1] - c[i], xd = d[i + 1] - d[i];
        const T ya = b[i] - a[i], yb = b[i + 1] - a[i + 1], yc = d[i] - c[i], yd = d[i + 1] - c[i + 1];
        const T za = c[i] - a[i], zb = c[i + 1] - a[i + 1], zc = d[i] - b[i], zd = d[i + 1] - b[i + 1];
        const T sa = T(1) + g.ax * (xa * xa), sd = g.ax * (xd * xd), s3 = T(1) + g.ay * (ya * ya), s5 = T(1) + g.az * (za * za);
        const T e0 = W::expansion(sa + (g.ay * (yb * yb) + g.az * (zd * zd)), q);
        const T e1 = W::expansion(sa + (g.az * (zb * zb) + g.ay * (yd * yd)), q);
        const T e2 = W::expansion(s3 + (g.ax * (xb * xb) + g.az * (zd * zd)), q);
        const T e3 = W::expansion(s3 + (g.az * (zc * zc) + sd), q);
        const T e4 = W::expansion(s5 + (g.ax * (xc * xc) + g.ay * (yd * yd)), q);
        const T e5 = W::expansion(s5 + (g.ay * (yc * yc) + sd), q);
        T g0 = T(1) / e0, g1 = T(1) / e1, g2 = T(1) / e2, g3 = T(1) / e3, g4 = T(1) / e4, g5 = T(1) / e5;
        T v0 = e0, v1 = e1, v2 = e2, v3 = e3, v4 = e4, v5 = e5;
        if constexpr (Gaps) {
            const Lane<T>*m = there.at[0], *k = there.at[1], *l = there.at[2], *o = there.at[3];
            const Lane<T> ends = m[i] & o[i + 1], t0 = ends & m[i + 1] & k[i + 1], t1 = ends & m[i + 1] & l[i + 1];
            const Lane<T> t2 = ends & k[i] & k[i + 1], t3 = ends & k[i] & o[i], t4 = ends & l[i] & l[i + 1], t5 = ends & l[i] & o[i];
            g0 = kept(t0, g0), g1 = kept(t1, g1), g2 = kept(t2, g2), g3 = kept(t3, g3), g4 = kept(t4, g4), g5 = kept(t5, g5);
            if constexpr (Weighed)
                v0 = kept(t0, v0), v1 = kept(t1, v1), v2 = kept(t2, v2), v3 = kept(t3, v3), v4 = kept(t4, v4), v5 = kept(t5, v5);
        }
        const T fa = g.kx * xa * (g0 + g1), fb = g.kx * xb * g2, fc = g.kx * xc * g4, fd = g.kx * xd * (g3 + g5);
        const T ha = g.ky * ya * (g2 + g3), hb = g.ky * yb * g0, hc = g.ky * yc * g5, hd = g.ky * yd * (g1 + g4);
        const T ka = g.kz * za * (g4 + g5), kb = g.kz * zb * g1, kc = g.kz * zc * g3, kd = g.kz * zd * (g0 + g2);
        p0[i] = -(fa + ha + ka), p1[i + 1] = fa - (hb + kb), p2[i] = ha - (fb + kc), p3[i + 1] = (fb + hb) - kd;
        p4[i] = ka - (fc + hc), p5[i + 1] = (fc + kb) - hd, p6[i] = (hc + kc) - fd, p7[i + 1] = fd + hd + kd;
        if constexpr (Weighed) {
            const T s01 = v0 + v1, s23 = v2 + v3, s45 = v4 + v5, all = g.quarter * (s01 + s23 + s45);
            masses.at[0][i] = all, masses.at[7][i + 1] = all;
            masses.at[1][i + 1] = g.quarter * s01, masses.at[2][i] = g.quarter * s23, masses.at[4][i] = g.quarter * s45;
            masses.at[3][i + 1] = g.quarter * (v0 + v2), masses.at[5][i + 1] = g.quarter * (v1 + v4);
            masses.at[6][i] = g.quarter * (v3 + v5);
        }
    }
}

// The step-th corner of the path of a tetrahedron, and the lower end of its leg along an axis.
constexpr int on_path(int diagonal, int order, int step) {
    int corner = diagonal << 1;
    for (int s = 0; s < step; ++s) corner ^= 1 << ORDER[order][s];
    return corner;
}
constexpr int lower_end(int diagonal, int order, int axis) {
    int step = 0;
    while (ORDER[order][step] != axis) ++step;
    return on_path(diagonal, order, step) & ~(1 << axis);
}

// A cell with all four diagonals: each leg is read once, and its flow is its difference times the sum over the six tetrahedra that
// have it. By corner, or by axis and lower end of a leg.
template <class W, bool Weighed, class T> struct WholeCell {
    T leg[3][CORNERS], square[3][CORNERS], sum[3][CORNERS], mass[CORNERS], count[CORNERS];
    Lane<T> is[CORNERS];

    template <int C> INLINE void read(i64 i, const Ground<T>& g, const Rows<T>& u, const Rows<Lane<T>>& there) {
        constexpr int r = C >> 1, end = C & 1;
        const T from = u.at[r][i + end];
        if constexpr (!(C & 1)) leg[0][C] = u.at[r][i + 1] - from, square[0][C] = g.ax * (leg[0][C] * leg[0][C]), sum[0][C] = 0;
        if constexpr (!(C & 2)) leg[1][C] = u.at[r | 1][i + end] - from, square[1][C] = g.ay * (leg[1][C] * leg[1][C]), sum[1][C] = 0;
        if constexpr (!(C & 4)) leg[2][C] = u.at[r | 2][i + end] - from, square[2][C] = g.az * (leg[2][C] * leg[2][C]), sum[2][C] = 0;
        mass[C] = 0, count[C] = 0;
        is[C] = there.at[r][i + end];
    }
    template <int N> INLINE void add(T q) {
        constexpr int D = N / ORDERS, O = N % ORDERS;
        constexpr int x = lower_end(D, O, 0), y = lower_end(D, O, 1), z = lower_end(D, O, 2);
        constexpr int a = on_path(D, O, 0), b = on_path(D, O, 1), c = on_path(D, O, 2), d = on_path(D, O, 3);
        const T root = W::expansion(T(1) + (square[0][x] + (square[1][y] + square[2][z])), q);
        const Lane<T> all = (is[a] & is[d]) & (is[b] & is[c]);
        const T by = kept(all, T(1) / root), one = kept(all, T(1));
        count[a] += one, count[b] += one, count[c] += one, count[d] += one;
        sum[0][x] += by, sum[1][y] += by, sum[2][z] += by;
        [[maybe_unused]] const T volume = kept(all, root);
        if constexpr (Weighed) mass[a] += volume, mass[b] += volume, mass[c] += volume, mass[d] += volume;
    }
    template <int C> INLINE T pull(const Ground<T>& g) const {
        constexpr int x = C & ~1, y = C & ~2, z = C & ~4;
        const T fx = g.kx * leg[0][x] * sum[0][x], fy = g.ky * leg[1][y] * sum[1][y], fz = g.kz * leg[2][z] * sum[2][z];
        return (C & 1 ? fx : -fx) + ((C & 2 ? fy : -fy) + (C & 4 ? fz : -fz));
    }
};

// As one_channel, of all four diagonals together, in the frame of the first, with gaps. counts: the tetrahedra at each corner.
template <class W, bool Weighed, class T>
LOOP void every_diagonal(i64 n, T q, const Ground<T> g, const Rows<T> u, const Rows<Lane<T>> there, const Corners<T> pulls,
                         [[maybe_unused]] const Corners<T> masses, const Corners<T> counts) {
    [&]<int... C, int... N>(std::integer_sequence<int, C...>, std::integer_sequence<int, N...>) {
        SIMD for (i64 i = 0; i < n; ++i) {
            WholeCell<W, Weighed, T> cell;
            (cell.template read<C>(i, g, u, there), ...);
            (cell.template add<N>(q), ...);
            ((pulls.at[C][i + (C & 1)] = cell.template pull<C>(g)), ...);
            if constexpr (Weighed) ((masses.at[C][i + (C & 1)] = g.quarter * cell.mass[C]), ...);
            ((counts.at[C][i + (C & 1)] = cell.count[C]), ...);
        }
    }(std::make_integer_sequence<int, CORNERS>{}, std::make_integer_sequence<int, DIAGONALS * ORDERS>{});
}

// The number of tetrahedra that exist, at each corner.
template <class T> LOOP void flat_counts(i64 n, const Rows<Lane<T>> there, const Corners<T> counts) {
    const Lane<T>*m = there.at[0], *k = there.at[1], *l = there.at[2], *o = there.at[3];
    SIMD for (i64 i = 0; i < n; ++i) {
        const Lane<T> ends = m[i] & o[i + 1];
        const T v0 = kept(ends & m[i + 1] & k[i + 1], T(1)), v1 = kept(ends & m[i + 1] & l[i + 1], T(1));
        const T v2 = kept(ends & k[i] & k[i + 1], T(1)), v3 = kept(ends & k[i] & o[i], T(1));
        const T v4 = kept(ends & l[i] & l[i + 1], T(1)), v5 = kept(ends & l[i] & o[i], T(1));
        const T s01 = v0 + v1, s23 = v2 + v3, s45 = v4 + v5, all = s01 + s23 + s45;
        counts.at[0][i] = all, counts.at[7][i + 1] = all;
        counts.at[1][i + 1] = s01, counts.at[2][i] = s23, counts.at[4][i] = s45;
        counts.at[3][i + 1] = v0 + v2, counts.at[5][i + 1] = v1 + v4, counts.at[6][i] = v3 + v5;
    }
}

template <class T> LOOP void widened(i64 n, const u8* there, Lane<T>* to) {
    SIMD for (i64 i = 0; i < n; ++i) to[i] = there[i] ? Lane<T>(-1) : Lane<T>(0);
}

// Adds the contributions to the two corners of one row of samples. Fresh: they are the first ones.
template <bool Fresh, class T> LOOP void gathered(i64 n, const T* here, const T* beside, T* sum) {
    SIMD for (i64 i = 0; i < n; ++i) sum[i] = (Fresh ? T(0) : sum[i]) + (here[i] + beside[i]);
}

// Moves a row of samples; with Added by the contributions here and beside, too.
template <int Terms, bool Added, class T>
LOOP void moved(i64 n, const Mix<T> mix, const T* u, const T* a, const T* b, const T* c, const T* pull, const T* here, const T* beside,
                const T* pace, T* out) {
    SIMD for (i64 i = 0; i < n; ++i) {
        const T by = Added ? pull[i] + (here[i] + beside[i]) : pull[i];
        out[i] = grid::blended<Terms>(mix, u[i], Terms > 0 ? a[i] : T(0), Terms > 1 ? b[i] : T(0), Terms > 1 ? c[i] : T(0), pace[i], by);
    }
}

}  // namespace meshflow::volume
