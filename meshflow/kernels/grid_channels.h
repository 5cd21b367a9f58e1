// One, two or three channels over a plane: the loop over a row of cells, for each weight, and the sweep down a tile.
//
// In any metric the contributions of a triangle to its two far corners sum to minus that to its corner with the right angle.
// Those of borders are added element by element, so that every sample gathers four numbers.
#pragma once
#include "grid_rows.h"

namespace meshflow::grid {

constexpr i64 MOST_CHANNELS = 3;
// The number of elements whose roots and divisions are computed in a loop of their own. Both have a long latency, and
// out-of-order execution does not reach far enough to overlap them with those of later elements.
constexpr i64 TOGETHER = 128;

// Pulls and thirds of area of elements from to to - 1. top, bottom: the first channel of the two rows of samples; the next one is
// `plane` further.
template <class W, Kind KIND, class T>
LOOP void channel_cells(const Task<T>& t, i64 e, i64 from, i64 to, [[maybe_unused]] const Lane<T>* code, const T* top,
                        const T* bottom, i64, const Ground<T> above, const Ground<T> under, const Cells<T> f) {
    const T q = t.sharpness;
    SIMD for (i64 j = from; j < to; ++j) {
        Lane<T> x = WHOLE;
        if constexpr (KIND != PLAIN) x = code[j];
        const T a = top[j + e] - top[j], b = bottom[j] - top[j], c = bottom[j - e] - bottom[j];
        Pull<T> m, n;
        pair_over_ground<W>(a, b, c, above, under, q, x, m, n);
        f.pulls.template pull<false>(j, x, m.on_q, m.on_r, n.on_q, n.on_r);
        f.upper[j] = m.third, f.lower[j] = n.third;
    }
}

// The same with borders, in two loops over a few elements.
template <class W, class T>
LOOP void bordered_cells(const Task<T>& t, i64 e, i64 from, i64 to, const Lane<T>* code, const T* top, const T* bottom, i64,
                         const Ground<T> above, const Ground<T> under, const Cells<T> f) {
    const T q = t.sharpness;
    T to_q[TOGETHER], on_b[TOGETHER], to_n[TOGETHER], on_d[TOGETHER];
    for (i64 begin = from; begin < to; begin += TOGETHER) {
        const i64 end = least(begin + TOGETHER, to);
        SIMD for (i64 j = begin; j < end; ++j) {
            const Lane<T> x = code[j];
            const T a = top[j + e] - top[j], b = bottom[j] - top[j], c = bottom[j - e] - bottom[j];
            Pull<T> m, n;
            pair_over_ground<W>(a, b, c, above, under, q, x, m, n);
            to_q[j - begin] = m.on_q, on_b[j - begin] = m.on_r, to_n[j - begin] = n.on_q, on_d[j - begin] = n.on_r;
            f.upper[j] = m.third, f.lower[j] = n.third;
        }
        SIMD for (i64 j = begin; j < end; ++j)
            f.pulls.template pull<true>(j, code[j], to_q[j - begin], on_b[j - begin], to_n[j - begin], on_d[j - begin]);
    }
}

// The legs of the triangles of element j, of several channels.
template <int K, class T> struct Legs {
    T a[K], b[K], c[K], back[K];  // back: -b, from S up
    static INLINE Legs of(const T* top, const T* bottom, i64 plane, i64 j, i64 e) {
        Legs legs;
        UNROLL for (int k = 0; k < K; ++k) {
            const T *here = top + k * plane, *below = bottom + k * plane;
            legs.a[k] = here[j + e] - here[j], legs.b[k] = below[j] - here[j], legs.c[k] = below[j - e] - below[j];
            legs.back[k] = here[j] - below[j];
        }
        return legs;
    }
};

// Several channels, in two loops over a few elements.
template <class W, int K, Kind KIND, class T>
LOOP void several_cells(const Task<T>& t, i64 e, i64 from, i64 to, [[maybe_unused]] const Lane<T>* code, const T* top,
                        const T* bottom, i64 plane, const Ground<T> above, const Ground<T> under, const Cells<T> f) {
    const T q = t.sharpness, scale = t.scale;
    T upper[2][TOGETHER], lower[2][TOGETHER];
    for (i64 begin = from; begin < to; begin += TOGETHER) {
        const i64 end = least(begin + TOGETHER, to);
        SIMD for (i64 j = begin; j < end; ++j) {
            Lane<T> x = WHOLE;
            if constexpr (KIND != PLAIN) x = code[j];
            const Legs<K, T> l = Legs<K, T>::of(top, bottom, plane, j, e);
            const T bb = squared(l.b);
            const Share<T> m = share_over_ground<UPPER_BIT, W>(l.a, squared(l.a), l.b, bb, above, q, scale, x, f.upper[j]);
            const Share<T> n = share_over_ground<LOWER_BIT, W>(l.c, squared(l.c), l.back, bb, under, q, scale, x, f.lower[j]);
            upper[0][j - begin] = m.half, upper[1][j - begin] = m.scaled;
            lower[0][j - begin] = n.half, lower[1][j - begin] = n.scaled;
        }
        SIMD for (i64 j = begin; j < end; ++j) {
            Lane<T> x = WHOLE;
            if constexpr (KIND == BORDERS) x = code[j];
            const Legs<K, T> l = Legs<K, T>::of(top, bottom, plane, j, e);
            T on_q[K], on_r[K], to_n[K], to_o[K];
            pulls_over_ground(l.a, l.b, {upper[0][j - begin], upper[1][j - begin]}, above, on_q, on_r);
            pulls_over_ground(l.c, l.back, {lower[0][j - begin], lower[1][j - begin]}, under, to_n, to_o);
            UNROLL for (int k = 0; k < K; ++k)
                f.pulls.template pull<KIND == BORDERS>(k * f.wide + j, x, on_q[k], on_r[k], to_n[k], to_o[k]);
        }
    }
}

template <class T>
using ChannelCells = void (*)(const Task<T>&, i64, i64, i64, const Lane<T>*, const T*, const T*, i64, const Ground<T>, const Ground<T>,
                              const Cells<T>);
// The loops of a metric for the kinds of blocks.
template <class T> struct ChannelLoops {
    ChannelCells<T> plain, holes, borders;
};
template <class T, class W, int K> ChannelLoops<T> channel_loops() {
    if constexpr (K == 1) return {channel_cells<W, PLAIN, T>, channel_cells<W, HOLES, T>, bordered_cells<W, T>};
    // For several channels the loops for borders are also used for holes, which have no borders there.
    else return {several_cells<W, K, PLAIN, T>, several_cells<W, K, BORDERS, T>, several_cells<W, K, BORDERS, T>};
}

// All contributions of row r of cells of one triangulation.
template <class T>
void channel_row(const Task<T>& t, const ChannelLoops<T>& loops, const Tile& tile, int side, i64 r, const Cells<T>& f) {
    const u8* code = t.codes.row(side, r);
    const i64 plane = t.h * t.w, e = side ? -1 : 1;
    const T *top = t.u + r * t.w, *bottom = top + t.w;
    const Ground<T> above = t.ground(r), under = t.ground(r + 1);
    const auto run = [&](Kind kind, i64 from, i64 to) {
        const i64 i = from - tile.left, n = to - from;
        const Cells<T> at = f.shifted(i);
        if (kind == NONE) return f.clear(t.k, i, i + n);
        if (kind != PLAIN) widened(n, code + from, at.code);
        const ChannelCells<T> loop = kind == PLAIN ? loops.plain : kind == HOLES ? loops.holes : loops.borders;
        if (from > 0 && to < t.w) return loop(t, e, 0, n, at.code, top + from, bottom + from, plane, above, under, at);
        T around[2][3 * MOST_CHANNELS];
        for (i64 k = 0; k < t.k; ++k)
            neighbours(t, k, r, from, around[0] + 3 * k), neighbours(t, k, r + 1, from, around[1] + 3 * k);
        loop(t, e, 0, 1, at.code, around[0] + 1, around[1] + 1, 3, above, under, at);
    };
    for_runs(code, t.codes.kinds(side, r), t.w, most(tile.left - 1, 0), least(tile.right + 1, t.w), run);
}

template <class T> i64 channel_room(const Task<T>& t) { return Cells<T>::rows(t.k) + 2 * t.k + 7 + EvenedMass<T>::ROWS; }

// The area of the triangles of a tile. cells_of(side, r, cells): the contributions of a row of cells.
template <class T, class F> Measured channel_area(const Task<T>& t, const Tile& tile, Room<T> room, const F& cells_of) {
    const Cells<T> f = Cells<T>::of(room, t.k);
    Measured found;
    for (i64 r = tile.begin; r < least(tile.end, t.h - 1); ++r)
        for (int side = t.first_sheet; side < t.last_sheet; ++side)
            cells_of(side, r, f), found.area += area_of(0, tile.right - tile.left, f.upper, f.lower);
    return found;
}

// Rows begin to end of a tile: each row of cells once, and the one above the first.
template <class T, class F> Measured channel_tile(const Task<T>& t, Asked asked, const Tile& tile, Room<T> room, const F& cells_of) {
    if (asked == AREA) return channel_area(t, tile, room, cells_of);
    const i64 n = tile.right - tile.left, start = most(tile.begin - 1, 0), wide = room.wide;
    const i64 first = most(tile.left - 1, 0), last = least(tile.right + 1, t.w);
    const Cells<T> f = Cells<T>::of(room, t.k);
    T *given = room.take(t.k), *below = room.take(t.k), *mass = room.take(), *mass_below = room.take(), *pace = room.take();
    FlatMass<T> flat = FlatMass<T>::of(room);
    EvenedMass<T> evened = EvenedMass<T>::of(room);
    const bool measuring = asked != MOVED, several = t.last_sheet - t.first_sheet > 1;
    // With gamma = -1 and barycentric masses, s / M is one over the flat mass.
    const bool light = t.quarters == -4 && !measuring;
    Measured found;
    for (i64 r = start; r < tile.end; ++r) {
        const bool cells = r < t.h - 1, alike = r - 2 >= start && cells && t.level(r) && t.level(r - 1);
        exchange(mass, mass_below);
        if (!alike) exchange(flat.here, flat.below), exchange(evened.other.here, evened.other.below);
        for (int side = t.first_sheet; side < t.last_sheet && cells; ++side) {
            const bool fresh = side == t.first_sheet;
            const i64 e = side ? -1 : 1;
            cells_of(side, r, f);
            for (i64 k = 0; k < t.k && side + 1 < t.last_sheet; ++k)
                gather_corners<true>(0, n, e, f.pulls.shifted(k * wide), given + k * wide, below + k * wide);
            if (!light) gather_thirds(fresh, n, e, f.upper, f.lower, mass, mass_below);
            if (t.indicated() && !alike) flat.gather(t, tile, fresh, side, r, first, last);
        }
        if (t.evened && !alike) {
            if (cells) evened.gather(t, tile, r, first, last);
            evened_areas(n, flat.here, evened.other.here, evened.area);
        }
        if (!cells) f.clear(t.k, -1, n + 1);
        const i64 e = t.last_sheet == 2 ? -1 : 1;
        if (r >= tile.begin && !(light && alike && !t.held)) {
            const T* area = t.evened ? evened.area : flat.here;
            if (light) paces<0>(n, t.gamma, T(0), t.thirds(), area, area, area, pace);
            else paces_of(t.quarters, n, t.gamma, T(0), t.thirds(), flat.here, mass, mass, pace);
            if (t.held && !measuring) stay(n, t.held + r * t.w + tile.left, pace);
        }
        if (measuring && r >= tile.begin) {
            const double fast = greatest_product(n, pace, flat.here);
            found.fastest = fast > found.fastest ? fast : found.fastest;
        }
        for (i64 k = 0; k < t.k; ++k) {
            const i64 i = k * wide;
            if (r < tile.begin || measuring) passed_on(n, e, f.pulls.shifted(i), given + i, below + i);
            else move_row_by_cells(t, tile, k, r, e, f.pulls.shifted(i), several, given + i, below + i, pace);
        }
    }
    return found;
}

}  // namespace meshflow::grid
