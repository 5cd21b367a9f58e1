// A tile of a grid: its task, its rows, and the loops over a row of samples, which do not depend on the metric.
#pragma once
#include <cstring>
#include <initializer_list>

#include "grid_cells.h"
#include "grid_triangle.h"
#include "memory.h"

namespace meshflow {

// The parameters of a flow on a grid, without its arrays (meshflow/kernels/grid.py).
struct GridOptions {
    double sharpness, gamma, floor, scale, small;  // scale: alpha^2; small: the length below which a pull is rounding
    double across, down;                           // 1 / pitch of a pinhole's even grid, else 0
    i64 first_sheet, last_sheet;                   // triangulations that are averaged: 0 forward, 1 backward; last not included
    i64 mass, projection, lines, gaps;             // MassKind; whether the indicator is the projection; LinesKind; missing triangles
    i64 by_forms;                                  // whether the slow loops are used although there are fast ones
    i64 evened;                                    // whether samples count by their areas in both triangulations (EvenedMass)
};

// keep u + dt rate + one (a - u) + two (b - u) + three c.
struct GridBlend {
    double keep, dt, one, two, three;
};

}  // namespace meshflow

namespace meshflow::grid {

enum MassKind : i64 { BARYCENTRIC = 0, VORONOI = 1, RING = 2 };
enum LinesKind : i64 { CHANNELS = 0, LINES = 1, PINHOLE = 2 };

template <class T> struct Mix {
    T keep, dt, one, two, three;
};

// One coordinate of origins or directions: constant along rows or columns where a step is 0.
template <class T> struct Part {
    const T* at;
    i64 down, right;
};

template <class T> struct Task {
    i64 k, h, w;
    const T* u;
    const T* geometry;  // (h, 7), columns of Ground
    Codes codes;
    int first_sheet, last_sheet;
    T sharpness, gamma, floor, scale, small, across, down;
    int quarters;  // four times gamma, or ANY
    MassKind mass;
    bool projection;
    LinesKind lines;
    Part<T> origins[3], directions[3];
    const T* pace;        // (h, w), factors of time, or null
    const T* taps;        // the Gaussian of patches, from its middle outwards
    i64 far;              // taps beside the middle; -1 without patches
    bool gaps;            // triangles are missing
    bool by_forms;
    bool evened;          // see EvenedMass
    const u8* held;       // (h, w), samples that do not move, or null
    T* out;               // null: nothing moves
    const T *a, *b, *c;
    Mix<T> mix;
    int terms;  // number of terms besides keep and dt: 0, 1 (one), 2 (all)

    T thirds() const { return mass == RING ? T(3) : T(1); }
    Ground<T> ground(i64 r) const { return Ground<T>::of(geometry + 7 * r); }
    const T* to_read(const T* array, i64 at) const { return array ? array + at : u + at; }
    bool indicated() const { return quarters != 0; }
    // Whether rows r - 1 and r of cells, and the ground below them, are equal.
    bool level(i64 r) const {
        for (int side = evened ? 0 : first_sheet; side < (evened ? 2 : last_sheet); ++side)
            if (!codes.same(side, r)) return false;
        const T* g = geometry + 7 * r + 4;
        return g[-7] == g[0] && g[0] == g[7];
    }
};

// Rows and columns of samples, last not included.
struct Tile {
    i64 begin, end, left, right;
};

// The purpose of a sweep: to move samples, or to compute the area, or the bound of the triangles.
enum Asked { MOVED, AREA, BOUND };

// The result of a sweep that does not move samples.
struct Measured {
    double area = 0, fastest = 0;
};

// --- rows of a tile --------------------------------------------------------------------------------------------------------------

// Sample `left + j` of the grid is at index j of a row. EDGE numbers on either side may be read; absent ones are zero.
constexpr i64 EDGE = 32;

// The distance of rows: an odd number of sixteens, because the rows would compete for the same cache lines if it divided a page.
INLINE i64 wide_for(i64 n) { return ((n + 2 * EDGE + 15) / 16 | 1) * 16; }

template <class T> struct Room {
    T* next;
    i64 wide;
    T* take(i64 rows = 1) {
        T* at = next + EDGE;
        next += rows * wide;
        return at;
    }
    // A row of double precision.
    static constexpr i64 DOUBLE = sizeof(double) / sizeof(T);
    double* take_doubles() { return reinterpret_cast<double*>(take(DOUBLE) - EDGE) + EDGE; }
};

template <class T> INLINE void zero(T* row, i64 from, i64 to) {
    if (to > from) std::memset(row + from, 0, static_cast<std::size_t>(to - from) * sizeof(T));
}

// Contributions of border edges to the opposite corners: half the pull of the conormal of a border edge is minus the pull on the
// corner opposite to the edge. x: the code.
template <class T> struct Bordered {
    T own_here, beside_here, own_below, beside_below;
    static INLINE Bordered of(Lane<T> x, T on_q, T on_r, T to_n, T to_o) {
        const T p_to = where<1>(x, -(on_q + on_r)), q_to = where<2>(x, on_q), r_to = where<3>(x, on_r);
        const T s_to = where<5>(x, -(to_n + to_o)), n_on = where<6>(x, to_n), o_on = where<7>(x, to_o);
        return {(q_to + r_to) + (s_to + n_on), p_to + r_to, (p_to + q_to) + (n_on + o_on), s_to + o_on};
    }
};

// Contributions of the elements of a row of cells to the four samples at their corners. own: to the ends of the edge along a
// column, here and below; beside: to Q here and N below.
template <class T> struct Corners {
    T *own_here, *beside_here, *own_below, *beside_below;
    static Corners of(Room<T>& room) {
        T *a = room.take(), *b = room.take(), *c = room.take(), *d = room.take();
        return {a, b, c, d};
    }
    void clear(i64 from, i64 to) const {
        for (T* row : {own_here, beside_here, own_below, beside_below}) zero(row, from, to);
    }
    // Adds the pulls on the far corners of element i (Q and R of its upper triangle, N and the one above S of its lower one), and
    // minus their sums at P and S; with Borders also the contributions of border edges.
    template <bool Borders> INLINE void pull(i64 i, [[maybe_unused]] Lane<T> code, T on_q, T on_r, T to_n, T to_o) const {
        const T here = to_o - (on_q + on_r), under = on_r - (to_n + to_o);
        if constexpr (Borders) {
            const Bordered<T> by = Bordered<T>::of(code, on_q, on_r, to_n, to_o);
            own_here[i] = here + by.own_here, beside_here[i] = on_q + by.beside_here;
            own_below[i] = under + by.own_below, beside_below[i] = to_n + by.beside_below;
        } else {
            own_here[i] = here, beside_here[i] = on_q, own_below[i] = under, beside_below[i] = to_n;
        }
    }
    INLINE Corners shifted(i64 by) const { return {own_here + by, beside_here + by, own_below + by, beside_below + by}; }
};

template <class L> LOOP void widened(i64 n, const u8* code, L* to) {
    SIMD for (i64 j = 0; j < n; ++j) to[j] = code[j];
}

// Contributions of a row of cells to the samples around it: pulls on each coordinate, and thirds of area.
template <class T> struct Cells {
    i64 wide;  // distance of coordinates
    Corners<T> pulls;
    T *upper, *lower;
    Lane<T>* code;
    static Cells of(Room<T>& room, i64 coordinates) {
        T *a = room.take(coordinates), *b = room.take(coordinates), *c = room.take(coordinates), *d = room.take(coordinates);
        T *u = room.take(), *l = room.take();
        return {room.wide, {a, b, c, d}, u, l, reinterpret_cast<Lane<T>*>(room.take())};
    }
    static i64 rows(i64 coordinates) { return 4 * coordinates + 3; }
    INLINE Cells shifted(i64 by) const { return {wide, pulls.shifted(by), upper + by, lower + by, code + by}; }
    void clear(i64 coordinates, i64 from, i64 to) const {
        for (i64 k = 0; k < coordinates; ++k) pulls.shifted(k * wide).clear(from, to);
        zero(upper, from, to), zero(lower, from, to);
    }
};

// --- contributions of cells, gathered by samples -------------------------------------------------------------------------------

// Fresh: the samples below have no contributions yet.
template <bool Fresh, class T> LOOP void gather_corners(i64 from, i64 to, i64 e, const Corners<T>& c, T* here, T* below) {
    const T *a = c.own_here, *b = c.beside_here, *d = c.own_below, *f = c.beside_below;
    SIMD for (i64 j = from; j < to; ++j) {
        here[j] += a[j] + b[j - e];
        below[j] = (Fresh ? T(0) : below[j]) + (d[j] + f[j + e]);
    }
}
template <class T> INLINE void gather_corners(bool fresh, i64 from, i64 to, i64 e, const Corners<T>& c, T* here, T* below) {
    if (fresh) gather_corners<true>(from, to, e, c, here, below);
    else gather_corners<false>(from, to, e, c, here, below);
}

// Thirds of areas: the upper triangle contributes to P, Q, R, the lower one to S, N and the corner above S.
template <bool Fresh, class T> LOOP void gather_thirds(i64 n, i64 e, const T* upper, const T* lower, T* here, T* below) {
    SIMD for (i64 j = 0; j < n; ++j) {
        const T both = upper[j] + lower[j];
        here[j] += both + upper[j - e];
        below[j] = (Fresh ? T(0) : below[j]) + (both + lower[j + e]);
    }
}
template <class T> INLINE void gather_thirds(bool fresh, i64 n, i64 e, const T* upper, const T* lower, T* here, T* below) {
    if (fresh) gather_thirds<true>(n, e, upper, lower, here, below);
    else gather_thirds<false>(n, e, upper, lower, here, below);
}

template <class T> LOOP void presence(i64 from, i64 to, const u8* code, T above, T under, T* upper, T* lower) {
    SIMD for (i64 j = from; j < to; ++j) {
        upper[j] = code[j] & 1 ? above : T(0);
        lower[j] = code[j] & 16 ? under : T(0);
    }
}
template <class T> LOOP void filled(i64 from, i64 to, T above, T under, T* upper, T* lower) {
    SIMD for (i64 j = from; j < to; ++j) upper[j] = above, lower[j] = under;
}

// Masses of the flat grid: thirds of the existing triangles, in separate rows.
template <class T> struct FlatMass {
    T *upper, *lower, *here, *below;
    static FlatMass of(Room<T>& room) {
        T *a = room.take(), *b = room.take(), *c = room.take(), *d = room.take();
        return {a, b, c, d};
    }
    void gather(const Task<T>& t, const Tile& tile, bool fresh, int side, i64 r, i64 first, i64 last) {
        const u8* code = t.codes.row(side, r);
        const T above = t.geometry[7 * r + 4], under = t.geometry[7 * r + 11];
        for_runs(code, t.codes.kinds(side, r), t.w, first, last, [&](Kind kind, i64 from, i64 to) {
            from -= tile.left, to -= tile.left;
            if (kind == PLAIN) filled(from, to, above, under, upper, lower);
            else if (kind == NONE) zero(upper, from, to), zero(lower, from, to);
            else presence(from, to, code + tile.left, above, under, upper, lower);
        });
        gather_thirds(fresh, tile.right - tile.left, side ? -1 : 1, upper, lower, here, below);
    }
};

template <class T> LOOP void evened_areas(i64 n, const T* one, const T* two, T* area) {
    SIMD for (i64 j = 0; j < n; ++j) {
        const T larger = T(0.75) * (one[j] > two[j] ? one[j] : two[j]), half = T(0.5) * (one[j] + two[j]);
        area[j] = half > larger ? half : larger;
    }
}

// Masses of the flat grid where its two triangulations alternate. If each rate divided by the areas of its own triangulation, a
// sample whose areas differ (at corners of the grid, and of holes) would weigh differently from rate to rate, and no mean would be
// conserved. So both rates divide by the mean of the two areas: then they conserve what both triangulations together conserve. A
// sample weighs at least 3/4 of its larger area, which it does not reach where one triangulation has less than half of the other:
// no rate is more than 4/3 as fast, and explicit steps stay stable.
template <class T> struct EvenedMass {
    FlatMass<T> other;
    T* area;
    static EvenedMass of(Room<T>& room) {
        const FlatMass<T> flat = FlatMass<T>::of(room);
        return {flat, room.take()};
    }
    static constexpr i64 ROWS = 5;
    void gather(const Task<T>& t, const Tile& tile, i64 r, i64 first, i64 last) {
        other.gather(t, tile, true, 1 - t.first_sheet, r, first, last);
    }
};

// Neighbours of a sample at an end of a row; the absent one is not used by any triangle.
template <class T> INLINE void neighbours(const Task<T>& t, i64 k, i64 r, i64 j, T* around) {
    const T* row = t.u + (k * t.h + r) * t.w;
    for (i64 s = -1; s < 2; ++s) around[s + 1] = row[j + s < 0 || j + s >= t.w ? j : j + s];
}

// --- a row of samples moves -----------------------------------------------------------------------------------------------------

// s / (thirds M), where s = (part / whole)^gamma is the edge indicator, clipped to least and 1; zero if there is no triangle.
template <int Quarters, class T>
LOOP void paces(i64 n, T gamma, T least, T thirds, const T* part, const T* whole, const T* mass, T* pace) {
    SIMD for (i64 j = 0; j < n; ++j) {
        const T inverse = T(1) / (thirds * mass[j]);
        if constexpr (Quarters == 0) pace[j] = mass[j] > T(0) ? inverse : T(0);
        else {
            T ratio = part[j] / whole[j];
            ratio = ratio > T(1) || !(whole[j] > T(0)) ? T(1) : ratio;
            pace[j] = mass[j] > T(0) ? power<Quarters>(ratio < least ? least : ratio, gamma) * inverse : T(0);
        }
    }
}
template <class T>
void paces_of(int quarters, i64 n, T gamma, T least, T thirds, const T* part, const T* whole, const T* mass, T* pace) {
    switch (quarters) {
        case 0: return paces<0>(n, gamma, least, thirds, part, whole, mass, pace);
        case 4: return paces<4>(n, gamma, least, thirds, part, whole, mass, pace);
        case -2: return paces<-2>(n, gamma, least, thirds, part, whole, mass, pace);
        case -4: return paces<-4>(n, gamma, least, thirds, part, whole, mass, pace);
        case -8: return paces<-8>(n, gamma, least, thirds, part, whole, mass, pace);
        default: return paces<ANY>(n, gamma, least, thirds, part, whole, mass, pace);
    }
}

template <class T> LOOP void stay(i64 n, const u8* held, T* pace) {
    SIMD for (i64 j = 0; j < n; ++j) pace[j] = held[j] ? T(0) : pace[j];
}

// By differences, so that samples at rest do not change in any bit.
template <int Terms, class T> INLINE T blended(const Mix<T>& mix, T u, T a, T b, T c, T pace, T pull) {
    T by = -(mix.dt * pace * pull);
    if constexpr (Terms > 0) by = mix.one * (a - u) + by;
    if constexpr (Terms > 1) by += mix.two * (b - u) + mix.three * c;
    return mix.keep * u + by;
}

template <int Terms, class T>
LOOP void moved(i64 n, const Mix<T> mix, const T* u, const T* a, const T* b, const T* c, const T* pull, const T* pace, T* out) {
    SIMD for (i64 j = 0; j < n; ++j)
        out[j] = blended<Terms>(mix, u[j], Terms > 0 ? a[j] : T(0), Terms > 1 ? b[j] : T(0), Terms > 1 ? c[j] : T(0), pace[j], pull[j]);
}

// The same from the pulls of the last triangulation. `given`: the previous contributions to the samples of this row, replaced by
// those to the row below; with Added plus those in `below`.
template <int Terms, bool Added, class T>
LOOP void moved_by_cells(i64 n, i64 e, const Mix<T> mix, const T* u, const T* a, const T* b, const T* c, const Corners<T> pulls,
                         T* given, const T* below, const T* pace, T* out) {
    SIMD for (i64 j = 0; j < n; ++j) {
        const T pull = given[j] + (pulls.own_here[j] + pulls.beside_here[j - e]), on = pulls.own_below[j] + pulls.beside_below[j + e];
        given[j] = Added ? below[j] + on : on;
        out[j] = blended<Terms>(mix, u[j], Terms > 0 ? a[j] : T(0), Terms > 1 ? b[j] : T(0), Terms > 1 ? c[j] : T(0), pace[j], pull);
    }
}
// For a row outside of the tile: its contributions to the row below.
template <class T> LOOP void passed_on(i64 n, i64 e, const Corners<T> pulls, T* given, const T* below) {
    SIMD for (i64 j = 0; j < n; ++j) given[j] = below[j] + (pulls.own_below[j] + pulls.beside_below[j + e]);
}

// Moves channel q of a row of samples by its pull.
template <class T> void move_row(const Task<T>& t, const Tile& tile, i64 q, i64 r, const T* pull, const T* pace) {
    const i64 at = (q * t.h + r) * t.w + tile.left, n = tile.right - tile.left;
    const T *x = t.to_read(t.a, at), *y = t.to_read(t.b, at), *z = t.to_read(t.c, at);
    const auto go = [&](auto loop) { loop(n, t.mix, t.u + at, x, y, z, pull, pace, t.out + at); };
    if (t.terms == 0) go(moved<0, T>);
    else if (t.terms == 1) go(moved<1, T>);
    else go(moved<2, T>);
}

template <class T>
void move_row_by_cells(const Task<T>& t, const Tile& tile, i64 q, i64 r, i64 e, const Corners<T>& pulls, bool added, T* given,
                       const T* below, const T* pace) {
    const i64 at = (q * t.h + r) * t.w + tile.left, n = tile.right - tile.left;
    const T *x = t.to_read(t.a, at), *y = t.to_read(t.b, at), *z = t.to_read(t.c, at);
    const auto go = [&](auto loop) { loop(n, e, t.mix, t.u + at, x, y, z, pulls, given, below, pace, t.out + at); };
    if (t.terms == 0) added ? go(moved_by_cells<0, true, T>) : go(moved_by_cells<0, false, T>);
    else if (t.terms == 1) added ? go(moved_by_cells<1, true, T>) : go(moved_by_cells<1, false, T>);
    else added ? go(moved_by_cells<2, true, T>) : go(moved_by_cells<2, false, T>);
}

template <class T> LOOP double greatest_product(i64 n, const T* a, const T* b) {
    return greatest_of(n, [&](i64 j) { return a[j] * b[j]; });
}

// The area of the triangles of elements from to to - 1.
template <class T> LOOP double area_of(i64 from, i64 to, const T* upper, const T* lower) {
    Sum sum;
    sum_over(sum, to - from, [&](i64 j) { return double(upper[from + j]) + double(lower[from + j]); });
    return 3.0 * sum.total();
}

}  // namespace meshflow::grid
