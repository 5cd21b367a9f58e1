// One, two or three channels over a plane: the loop over a row of cells, for each weight, and the sweep down a tile.
//
// Every triangle gives to its two far corners what it takes from its right-angled one, so all that happens is flows along the
// edges of rows and columns, in any metric.
#pragma once
#include "grid_rows.h"

namespace meshflow::grid {

constexpr i64 MOST_CHANNELS = 3;

// Flows and thirds of area of elements from to to - 1; top, bottom: the first channel of the rows of samples, the next one `plane`
// further.
template <class W, int K, Kind KIND, class T>
LOOP void channel_cells(const Task<T>& t, i64 e, i64 from, i64 to, [[maybe_unused]] const Lane<T>* code, const T* top,
                        const T* bottom, i64 plane, const Ground<T> above, const Ground<T> under, const Flows<T> f) {
    const T q = t.sharpness, scale = t.scale;
    SIMD for (i64 j = from; j < to; ++j) {
        T a[K], b[K], c[K];
        UNROLL for (int k = 0; k < K; ++k) {
            const T *x = top + k * plane, *y = bottom + k * plane;
            a[k] = x[j + e] - x[j], b[k] = y[j] - x[j], c[k] = y[j - e] - y[j];
        }
        Pull<T, K> m, n;
        pair_over_ground<W, K>(a, b, c, above, under, q, scale, m, n);
        if constexpr (KIND == PLAIN) {
            UNROLL for (int k = 0; k < K; ++k) {
                const i64 i = k * f.wide + j;
                f.to_q[i] = m.on_q[k], f.to_n[i] = n.on_q[k], f.down[i] = m.on_r[k] - n.on_r[k];
            }
            f.upper[j] = m.third, f.lower[j] = n.third;
        } else {
            const Lane<T> x = code[j];
            const bool has = x & 1, lower = x & 16;
            UNROLL for (int k = 0; k < K; ++k) {
                const i64 i = k * f.wide + j;
                const T on_q = has ? m.on_q[k] : T(0), on_r = has ? m.on_r[k] : T(0);
                const T to_n = lower ? n.on_q[k] : T(0), to_o = lower ? n.on_r[k] : T(0);
                f.to_q[i] = on_q, f.to_n[i] = to_n, f.down[i] = on_r - to_o;
                if constexpr (KIND == BORDERS) f.borders.put(i, Bordered<T>::of(x, on_q, on_r, to_n, to_o, T(0)));
            }
            f.upper[j] = has ? m.third : T(0), f.lower[j] = lower ? n.third : T(0);
        }
    }
}

template <class T>
using ChannelCells = void (*)(const Task<T>&, i64, i64, i64, const Lane<T>*, const T*, const T*, i64, const Ground<T>, const Ground<T>,
                              const Flows<T>);
// The loops of a metric, by the kind of the blocks they are for.
template <class T> struct ChannelLoops {
    ChannelCells<T> plain, holes, borders;
};
template <class T, class W, int K> ChannelLoops<T> channel_loops() {
    // Of several channels those for borders do for holes, too: borders are none there.
    constexpr Kind with_holes = K == 1 ? HOLES : BORDERS;
    return {channel_cells<W, K, PLAIN, T>, channel_cells<W, K, with_holes, T>, channel_cells<W, K, BORDERS, T>};
}

// All flows of row r of cells of one triangulation.
template <class T>
void channel_row(const Task<T>& t, const ChannelLoops<T>& loops, const Tile& tile, int side, i64 r, const Flows<T>& f,
                 BorderRanges<T>& ranges) {
    const u8* code = t.codes.row(side, r);
    const i64 plane = t.h * t.w, e = side ? -1 : 1;
    const T *top = t.u + r * t.w, *bottom = top + t.w;
    const Ground<T> above = t.ground(r), under = t.ground(r + 1);
    const auto run = [&](Kind kind, i64 from, i64 to) {
        const i64 i = from - tile.left, n = to - from;
        const Flows<T> at = f.shifted(i);
        if (kind == NONE) return f.clear(t.k, i, i + n);
        if (kind == BORDERS) ranges.add(i, i + n);
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

template <class T> i64 channel_room(const Task<T>& t) { return Flows<T>::rows(t.k) + 2 * t.k + 7; }

// Rows begin to end of a tile: each row of cells once, and the one above them.
// cells_of(side, r, flows, ranges): all flows of a row of cells.
template <class T, class Cells> Measured channel_tile(const Task<T>& t, const Tile& tile, Room<T> room, const Cells& cells_of) {
    const i64 n = tile.right - tile.left, start = most(tile.begin - 1, 0), wide = room.wide;
    const i64 first = most(tile.left - 1, 0), last = least(tile.right + 1, t.w);
    const Flows<T> f = Flows<T>::of(room, t.k);
    T *given = room.take(t.k), *below = room.take(t.k), *mass = room.take(), *mass_below = room.take(), *pace = room.take();
    FlatMass<T> flat = FlatMass<T>::of(room);
    const bool measuring = !t.out;
    // With gamma = -1 and a mass of thirds, s / M is one over the flat mass.
    const bool light = t.quarters == -4 && !measuring;
    Measured found;
    for (i64 r = start; r < tile.end; ++r) {
        const bool cells = r < t.h - 1, alike = r - 2 >= start && cells && t.level(r) && t.level(r - 1);
        bool added = false;
        exchange(mass, mass_below);
        if (!alike) exchange(flat.here, flat.below);
        for (int side = t.first_sheet; side < t.last_sheet && cells; ++side) {
            const bool fresh = side == t.first_sheet;
            const i64 e = side ? -1 : 1;
            BorderRanges<T> ranges{f.borders, wide, t.k, n, e, given, below, wide};
            cells_of(side, r, f, ranges);
            added |= ranges.to >= ranges.from;
            ranges.give();
            if (side + 1 < t.last_sheet) {
                for (i64 k = 0; k < t.k; ++k) {
                    const i64 i = k * wide;
                    gather_flows(n, e, f.to_q + i, f.to_n + i, f.down + i, given + i, below + i);
                }
                added = true;
            }
            if (!light) gather_thirds(fresh, n, e, f.upper, f.lower, mass, mass_below);
            if (t.indicated() && !alike) flat.gather(t, tile, fresh, side, r, first, last);
            if (measuring && r >= tile.begin) found.area += area_of(0, n, f.upper, f.lower);
        }
        if (!cells) f.clear(t.k, -1, n + 1);
        const i64 e = t.last_sheet == 2 ? -1 : 1;
        if (r >= tile.begin && !(light && alike && !t.held)) {
            if (light) paces<0>(n, t.gamma, T(0), t.thirds(), flat.here, flat.here, flat.here, pace);
            else paces_of(t.quarters, n, t.gamma, T(0), t.thirds(), flat.here, mass, mass, pace);
            if (t.held && !measuring) stay(n, t.held + r * t.w + tile.left, pace);
        }
        if (measuring && r >= tile.begin) {
            const double fast = greatest_product(n, pace, flat.here);
            found.fastest = fast > found.fastest ? fast : found.fastest;
        }
        for (i64 k = 0; k < t.k; ++k) {
            const i64 i = k * wide;
            if (r < tile.begin || measuring) passed_on(n, e, f.to_n + i, f.down + i, given + i, below + i);
            else move_row_by_flows(t, tile, k, r, e, f, added, given + i, below + i, pace);
            if (added) zero(below + i, 0, n);
        }
    }
    return found;
}

}  // namespace meshflow::grid
