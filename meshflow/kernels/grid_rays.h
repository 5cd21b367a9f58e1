// Samples on lines in space, p = o + u d. Only forces along the lines matter: one number for each corner of a triangle.
#pragma once
#include "grid_rows.h"

namespace meshflow::grid {

// Samples of a row: their positions, and the directions in which they move.
template <class T> struct PlacedRow {
    const T *p[3], *d[3];
    INLINE Vector<T> at(i64 j) const { return {p[0][j], p[1][j], p[2][j]}; }
    INLINE Vector<T> ray(i64 j) const { return {d[0][j], d[1][j], d[2][j]}; }
};
// Pinhole: u (x, y, 1), x by column and y by row.
template <class T> struct PinholeRow {
    const T *u, *x;
    T y;
    INLINE Vector<T> at(i64 j) const { return {u[j] * x[j], u[j] * y, u[j]}; }
    INLINE Vector<T> ray(i64 j) const { return {x[j], y, T(1)}; }
};

template <class T> INLINE T magnitude(T x) { return x < T(0) ? -x : x; }

// Pulls of elements along the rays of their corners, and thirds of area.
template <bool Coded, class T>
LOOP void ray_cells(i64 e, i64 from, i64 to, const u8* code, const PlacedRow<T> top, const PlacedRow<T> bottom,
                    const Corners<T> pulls, T* upper, T* lower) {
    SIMD for (i64 j = from; j < to; ++j) {
        const Vector<T> p = top.at(j), o = bottom.at(j), a = top.at(j + e) - p, b = o - p, c = bottom.at(j - e) - o, d = p - o;
        const Spanned<T> m = Spanned<T>::of(a, b), n = Spanned<T>::of(c, d);
        T one = std::sqrt(m.square), two = std::sqrt(n.square);
        if constexpr (Coded) one = code[j] & 1 ? one : T(0), two = code[j] & 16 ? two : T(0);
        Vector<T> on_q, on_r, to_n, to_o;
        m.pulls(a, b, one, on_q, on_r), n.pulls(c, d, two, to_n, to_o);
        const Vector<T> here = top.ray(j), under = bottom.ray(j);
        pulls.own_here[j] = (to_o - (on_q + on_r)).dot(here), pulls.beside_here[j] = on_q.dot(top.ray(j + e));
        pulls.own_below[j] = (on_r - (to_n + to_o)).dot(under), pulls.beside_below[j] = to_n.dot(bottom.ray(j - e));
        upper[j] = one * T(1.0 / 6), lower[j] = two * T(1.0 / 6);
    }
}

// The same for a pinhole with an even grid.
template <bool Coded, class T>
LOOP void pinhole_cells(i64 e, i64 from, i64 to, const u8* code, const PinholeRow<T> top, const PinholeRow<T> bottom, T across,
                        T down, const Corners<T> pulls, T* upper, T* lower) {
    const T signed_across = e > 0 ? across : -across, half = T(0.5) / magnitude(across * down), sixth = half / T(3);
    SIMD for (i64 j = from; j < to; ++j) {
        const T p = top.u[j], o = bottom.u[j];
        Facing<T> m = Facing<T>::of(p, top.u[j + e], o, top.x[j], top.y, signed_across, down, half);
        Facing<T> n = Facing<T>::of(o, bottom.u[j - e], p, bottom.x[j], bottom.y, -signed_across, -down, half);
        if constexpr (Coded) {
            const bool has = code[j] & 1, lower = code[j] & 16;
            m = {has ? m.on_p : T(0), has ? m.on_q : T(0), has ? m.on_r : T(0), has ? m.length : T(0)};
            n = {lower ? n.on_p : T(0), lower ? n.on_q : T(0), lower ? n.on_r : T(0), lower ? n.length : T(0)};
        }
        pulls.own_here[j] = m.on_p + n.on_r, pulls.beside_here[j] = m.on_q;
        pulls.own_below[j] = m.on_r + n.on_p, pulls.beside_below[j] = n.on_q;
        upper[j] = sixth * m.length, lower[j] = sixth * n.length;
    }
}

// Adds the contributions of border edges to the pulls on the corners of elements.
template <class Row, class T>
LOOP void ray_borders(i64 e, i64 from, i64 to, const u8* code, const Row top, const Row bottom, const Corners<T> pulls) {
    SIMD for (i64 j = from; j < to; ++j) {
        const u8 x = code[j];
        const Vector<T> p = top.at(j), o = bottom.at(j), a = top.at(j + e) - p, b = o - p, c = bottom.at(j - e) - o, d = p - o;
        const Spanned<T> m = Spanned<T>::of(a, b), n = Spanned<T>::of(c, d);
        Vector<T> on_q, on_r, to_n, to_o;
        const T one = std::sqrt(m.square), two = std::sqrt(n.square);
        m.pulls(a, b, x & 1 ? one : T(0), on_q, on_r), n.pulls(c, d, x & 16 ? two : T(0), to_n, to_o);
        const Bordered<T> bx = Bordered<T>::of(x, on_q.x, on_r.x, to_n.x, to_o.x);
        const Bordered<T> by = Bordered<T>::of(x, on_q.y, on_r.y, to_n.y, to_o.y);
        const Bordered<T> bz = Bordered<T>::of(x, on_q.z, on_r.z, to_n.z, to_o.z);
        const Vector<T> here = top.ray(j), under = bottom.ray(j);
        pulls.own_here[j] += Vector<T>{bx.own_here, by.own_here, bz.own_here}.dot(here);
        pulls.beside_here[j] += Vector<T>{bx.beside_here, by.beside_here, bz.beside_here}.dot(top.ray(j + e));
        pulls.own_below[j] += Vector<T>{bx.own_below, by.own_below, bz.own_below}.dot(under);
        pulls.beside_below[j] += Vector<T>{bx.beside_below, by.beside_below, bz.beside_below}.dot(bottom.ray(j - e));
    }
}

// The projected areas of triangles along the lines of their corners, times 6 |d|.
template <class T>
LOOP void seen_cells(i64 e, i64 from, i64 to, const PlacedRow<T> top, const PlacedRow<T> bottom, const T* upper, const T* lower,
                     const Corners<T> seen) {
    SIMD for (i64 j = from; j < to; ++j) {
        const Vector<T> p = top.at(j), o = bottom.at(j), here = top.ray(j), under = bottom.ray(j);
        Vector<T> m = (top.at(j + e) - p).cross(o - p), n = (bottom.at(j - e) - o).cross(p - o);
        const bool has = upper[j] > T(0), low = lower[j] > T(0);
        m = {has ? m.x : T(0), has ? m.y : T(0), has ? m.z : T(0)}, n = {low ? n.x : T(0), low ? n.y : T(0), low ? n.z : T(0)};
        seen.own_here[j] = magnitude(here.dot(m)) + magnitude(here.dot(n));
        seen.beside_here[j] = magnitude(top.ray(j + e).dot(m));
        seen.own_below[j] = magnitude(under.dot(m)) + magnitude(under.dot(n));
        seen.beside_below[j] = magnitude(bottom.ray(j - e).dot(n));
    }
}
// For a pinhole with an even grid d . (a x b) is X Y times the depths of the other two corners.
template <class T>
LOOP void pinhole_seen(i64 e, i64 from, i64 to, const PinholeRow<T> top, const PinholeRow<T> bottom, T across, T down,
                       const T* upper, const T* lower, const Corners<T> seen) {
    const T area = T(1) / magnitude(across * down);
    SIMD for (i64 j = from; j < to; ++j) {
        const T has = upper[j] > T(0) ? area : T(0), low = lower[j] > T(0) ? area : T(0);
        const T p = top.u[j], q = top.u[j + e], o = bottom.u[j], n = bottom.u[j - e];
        seen.own_here[j] = magnitude(q * o) * has + magnitude(o * n) * low;
        seen.beside_here[j] = magnitude(p * o) * has;
        seen.own_below[j] = magnitude(p * q) * has + magnitude(n * p) * low;
        seen.beside_below[j] = magnitude(o * p) * low;
    }
}

// The bounds of decay of the triangles of elements.
template <class T>
LOOP void decays(i64 e, i64 from, i64 to, const u8* code, const PlacedRow<T> top, const PlacedRow<T> bottom, T* upper, T* lower) {
    SIMD for (i64 j = from; j < to; ++j) {
        const Vector<T> p = top.at(j), o = bottom.at(j);
        const T m = Spanned<T>::of(top.at(j + e) - p, o - p).decay(), n = Spanned<T>::of(bottom.at(j - e) - o, p - o).decay();
        upper[j] = code[j] & 1 ? m : T(0), lower[j] = code[j] & 16 ? n : T(0);
    }
}

// pace / (thirds M |d|^2), where the coordinate along d has the unit |d|; zero if there is no triangle.
template <bool Paced, class T>
LOOP void over_rays(i64 n, T thirds, const T* x, const T* y, const T* z, const T* mass, const T* pace, T* out) {
    SIMD for (i64 j = 0; j < n; ++j) {
        const T square = (x[j] * x[j] + y[j] * y[j] + z[j] * z[j]) * (thirds * mass[j]);
        const T by = (Paced ? pace[j] : T(1)) / square;
        out[j] = square > T(0) ? by : T(0);
    }
}
// Converts the result of seen_cells to thirds of area, in place.
template <class T> LOOP void seen_thirds(i64 n, const T* x, const T* y, const T* z, T* seen) {
    SIMD for (i64 j = 0; j < n; ++j) {
        const T length = std::sqrt(x[j] * x[j] + y[j] * y[j] + z[j] * z[j]), third = seen[j] / (T(6) * length);
        seen[j] = length > T(0) ? third : T(0);
    }
}
// Multiplies by (part / whole)^gamma, clipped to least and 1, in place.
template <int Quarters, class T> LOOP void sped(i64 n, T gamma, T least, const T* part, const T* whole, T* out) {
    SIMD for (i64 j = 0; j < n; ++j) {
        T ratio = part[j] / whole[j];
        ratio = ratio > T(1) || !(whole[j] > T(0)) ? T(1) : ratio;
        out[j] *= power<Quarters>(ratio < least ? least : ratio, gamma);
    }
}
template <class T> void sped_of(int quarters, i64 n, T gamma, T least, const T* part, const T* whole, T* out) {
    switch (quarters) {
        case 0: return;
        case 4: return sped<4>(n, gamma, least, part, whole, out);
        case -2: return sped<-2>(n, gamma, least, part, whole, out);
        case -4: return sped<-4>(n, gamma, least, part, whole, out);
        case -8: return sped<-8>(n, gamma, least, part, whole, out);
        default: return sped<ANY>(n, gamma, least, part, whole, out);
    }
}
// A sample seen exactly edge-on has no projected area; this avoids a division by zero for gamma < 0.
constexpr double EDGE_ON = 1e-6;

// The largest bound of the triangles of a row of cells times the factor of time at their corners, in the rows above and below.
template <class A, class B> LOOP double foremost(i64 n, i64 e, const A* upper, const A* lower, const B* above, const B* below) {
    return greatest_of(n, [&](i64 j) {
        const double a = double(above[j]), b = double(below[j]), c = double(above[j + e]), d = double(below[j - e]);
        const double shared = a > b ? a : b, one = double(upper[j]) * (shared > c ? shared : c);
        const double two = double(lower[j]) * (shared > d ? shared : d);
        return one > two ? one : two;
    });
}

// --- positions -------------------------------------------------------------------------------------------------------------------

template <class T> LOOP void spread(i64 n, const Part<T> part, i64 r, i64 left, T* to) {
    const T* from = part.at + r * part.down + left * part.right;
    if (part.right)
        for (i64 j = 0; j < n; ++j) to[j] = from[j];
    else
        for (i64 j = 0; j < n; ++j) to[j] = from[0];
}
template <class T> LOOP void reached(i64 n, const T* u, const T* d, T* p) {
    SIMD for (i64 j = 0; j < n; ++j) p[j] += u[j] * d[j];
}

// The samples of a row, with one more on either side of the tile; absent ones are zero.
template <class T> struct Places {
    T *p[3], *d[3];
    static Places of(Room<T>& room) {
        Places at;
        for (T*& row : at.p) row = room.take();
        for (T*& row : at.d) row = room.take();
        return at;
    }
    void place(const Task<T>& t, const Tile& tile, i64 r, i64 margin) const {
        const i64 first = most(tile.left - margin, 0), last = least(tile.right + margin, t.w), at = first - tile.left;
        for (int c = 0; c < 3; ++c) {
            spread(last - first, t.origins[c], r, first, p[c] + at);
            spread(last - first, t.directions[c], r, first, d[c] + at);
            reached(last - first, t.u + r * t.w + first, d[c] + at, p[c] + at);
        }
    }
    // For a pinhole only u and y differ from row to row: the depth u (stored in p[2]), and d = (x, y, 1).
    void begin_pinhole(const Task<T>& t, const Tile& tile, i64 margin) const {
        const i64 first = most(tile.left - margin, 0), last = least(tile.right + margin, t.w), at = first - tile.left;
        spread(last - first, t.directions[0], 0, first, d[0] + at);
        for (i64 j = at; j < last - tile.left; ++j) d[2][j] = T(1);
    }
    void place_pinhole(const Task<T>& t, const Tile& tile, i64 r, i64 margin) const {
        const i64 first = most(tile.left - margin, 0), last = least(tile.right + margin, t.w), at = first - tile.left;
        std::memcpy(p[2] + at, t.u + r * t.w + first, static_cast<std::size_t>(last - first) * sizeof(T));
        spread(last - first, t.directions[1], r, first, d[1] + at);
    }
    PlacedRow<T> row() const { return {{p[0], p[1], p[2]}, {d[0], d[1], d[2]}}; }
};

// --- a tile -----------------------------------------------------------------------------------------------------------------------

template <class T> i64 ray_room(const Task<T>&) { return 12 + 3 + 4 + 4 + 2 + 6 + 1 + 8; }

template <class T> Measured ray_tile(const Task<T>& t, Asked asked, const Tile& tile, Room<T> room) {
    const i64 n = tile.right - tile.left, start = most(tile.begin - 1, 0), margin = asked == BOUND ? 2 : 1;
    const i64 first = most(tile.left - margin, 0), last = least(tile.right + margin, t.w);
    const bool pinhole = t.lines == PINHOLE, seeing = asked == MOVED ? t.indicated() : asked == BOUND && t.gamma < T(0);
    const bool celled = asked != BOUND || seeing;
    Places<T> here = Places<T>::of(room), next = Places<T>::of(room);
    const Corners<T> pulls = Corners<T>::of(room), seen = Corners<T>::of(room);
    T *upper = room.take(), *lower = room.take(), *pull = room.take(), *pull_below = room.take();
    T *mass = room.take(), *mass_below = room.take(), *sight = room.take(), *sight_below = room.take(), *pace = room.take();
    // Bounds of the triangles of the row of cells above this row of samples, and factors of time of the row above and of this one.
    T* bounds[4] = {room.take(), room.take(), room.take(), room.take()};
    T *speed = room.take(), *speed_above = room.take();
    Measured found;
    // Samples whose masses are needed: with BOUND one more on either side.
    const i64 ahead = asked == BOUND ? 1 : 0;
    const bool facing = pinhole && asked != BOUND;
    const auto place = [&](const Places<T>& row, i64 r) {
        if (facing) row.place_pinhole(t, tile, r, margin);
        else row.place(t, tile, r, margin);
    };
    if (facing) here.begin_pinhole(t, tile, margin), next.begin_pinhole(t, tile, margin);
    place(next, start);
    for (i64 r = start; r < least(tile.end + ahead, t.h); ++r) {
        const bool cells = r < t.h - 1;
        exchange(here, next), exchange(pull, pull_below), exchange(mass, mass_below), exchange(sight, sight_below);
        exchange(speed, speed_above);
        if (cells) place(next, r + 1);
        for (int side = t.first_sheet; side < t.last_sheet && cells && celled; ++side) {
            const i64 e = side ? -1 : 1;
            const u8* code = t.codes.row(side, r) + tile.left;
            const PlacedRow<T> top = here.row(), bottom = next.row();
            const PinholeRow<T> high{here.p[2], here.d[0], here.d[1][0]}, low{next.p[2], next.d[0], next.d[1][0]};
            for_runs(t.codes.row(side, r), t.codes.kinds(side, r), t.w, first, last, [&](Kind kind, i64 from, i64 to) {
                from -= tile.left, to -= tile.left;
                if (kind == NONE) {
                    pulls.clear(from, to), zero(upper, from, to), zero(lower, from, to), seen.clear(from, to);
                    return;
                }
                if (pinhole) {
                    const auto loop = kind == PLAIN ? pinhole_cells<false, T> : pinhole_cells<true, T>;
                    loop(e, from, to, code, high, low, t.across, t.down, pulls, upper, lower);
                    if (seeing) pinhole_seen(e, from, to, high, low, t.across, t.down, upper, lower, seen);
                    if (kind == BORDERS) ray_borders(e, from, to, code, high, low, pulls);
                } else {
                    const auto loop = kind == PLAIN ? ray_cells<false, T> : ray_cells<true, T>;
                    loop(e, from, to, code, top, bottom, pulls, upper, lower);
                    if (seeing) seen_cells(e, from, to, top, bottom, upper, lower, seen);
                    if (kind == BORDERS) ray_borders(e, from, to, code, top, bottom, pulls);
                }
            });
            const bool fresh = side == t.first_sheet;
            if (asked == AREA) {
                if (r >= tile.begin) found.area += area_of(0, n, upper, lower);
                continue;
            }
            gather_corners(fresh, i64(-ahead), n + ahead, e, pulls, pull, pull_below);
            gather_thirds(fresh, n + 2 * ahead, e, upper - ahead, lower - ahead, mass - ahead, mass_below - ahead);
            if (seeing) gather_corners(fresh, i64(-ahead), n + ahead, e, seen, sight, sight_below);
        }
        const T *x = here.d[0] - ahead, *y = here.d[1] - ahead, *z = here.d[2] - ahead;
        const i64 m = n + 2 * ahead;
        const T* time = t.pace ? t.pace + r * t.w + tile.left : nullptr;
        if (asked == MOVED && r >= tile.begin) {
            if (time) over_rays<true>(n, t.thirds(), x, y, z, mass, time, pace);
            else over_rays<false>(n, t.thirds(), x, y, z, mass, mass, pace);
            if (seeing) {
                seen_thirds(n, x, y, z, sight);
                sped_of(t.quarters, n, t.gamma, T(EDGE_ON), sight, mass, pace);
            }
            if (t.held) stay(n, t.held + r * t.w + tile.left, pace);
            move_row(t, tile, 0, r, pull, pace);
        }
        if (asked == BOUND) {
            const i64 from = most(tile.left - 1, 0) - tile.left, to = least(tile.right + 1, t.w) - tile.left;
            for (i64 j = from; j < to; ++j) speed[j] = (time ? time[j] : T(1)) / t.thirds();
            if (seeing) {
                seen_thirds(m, x, y, z, sight - 1);
                sped_of(t.quarters, m, t.gamma, T(EDGE_ON), sight - 1, mass - 1, speed - 1);
            }
            if (r > tile.begin)
                for (int side = t.first_sheet; side < t.last_sheet; ++side) {
                    const double fast = foremost(n, side ? -1 : 1, bounds[2 * side], bounds[2 * side + 1], speed_above, speed);
                    found.fastest = fast > found.fastest ? fast : found.fastest;
                }
            for (int side = t.first_sheet; side < t.last_sheet && cells; ++side)
                decays(side ? i64(-1) : i64(1), 0, n, t.codes.row(side, r) + tile.left, here.row(), next.row(), bounds[2 * side],
                       bounds[2 * side + 1]);
        }
    }
    return found;
}

}  // namespace meshflow::grid
