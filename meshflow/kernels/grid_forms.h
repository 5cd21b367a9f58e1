// Any number of coordinates, by the quadratic forms of their triangles: only |u|^2, |v|^2 and u . v over 4T of a triangle are
// stored. These loops are used where cotangents are needed (Voronoi masses, the projection indicator, bounds, the weights of an
// implicit step), and for more channels than the fast loops support.
#pragma once
#include "grid_patches.h"
#include "grid_rays.h"

namespace meshflow::grid {

// Rows of forms of the upper (0) and the lower (1) triangles.
template <class T> struct FormRows {
    T *uu[2], *vv[2], *uv[2], *third[2];
    static FormRows of(Room<T>& room) {
        FormRows f;
        for (int i = 0; i < 2; ++i) f.uu[i] = room.take(), f.vv[i] = room.take(), f.uv[i] = room.take(), f.third[i] = room.take();
        return f;
    }
    INLINE Form<T> at(int lower, i64 j) const { return {uu[lower][j], vv[lower][j], uv[lower][j], third[lower][j]}; }
    INLINE void put(int lower, i64 j, const Form<T>& f) const {
        uu[lower][j] = f.uu, vv[lower][j] = f.vv, uv[lower][j] = f.uv, third[lower][j] = f.third;
    }
};

// --- products of single samples ---------------------------------------------------------------------------------------------------

template <bool First, class T>
LOOP void leg_products(i64 e, i64 from, i64 to, const T* top, const T* bottom, const FormRows<T> f) {
    SIMD for (i64 j = from; j < to; ++j) {
        const T a = top[j + e] - top[j], b = bottom[j] - top[j], c = bottom[j - e] - bottom[j];
        f.uu[0][j] = (First ? T(0) : f.uu[0][j]) + a * a, f.uu[1][j] = (First ? T(0) : f.uu[1][j]) + c * c;
        f.vv[0][j] = (First ? T(0) : f.vv[0][j]) + b * b, f.vv[1][j] = (First ? T(0) : f.vv[1][j]) + b * b;
        f.uv[0][j] = (First ? T(0) : f.uv[0][j]) + a * b, f.uv[1][j] = (First ? T(0) : f.uv[1][j]) - c * b;
        if constexpr (First) f.third[0][j] = T(0), f.third[1][j] = T(0);
    }
}
// The squared minors of two coordinates.
template <class T>
LOOP void minor_squares(i64 e, i64 from, i64 to, const T* top, const T* bottom, const T* high, const T* low, const FormRows<T> f) {
    SIMD for (i64 j = from; j < to; ++j) {
        const T a = top[j + e] - top[j], b = bottom[j] - top[j], c = bottom[j - e] - bottom[j];
        const T x = high[j + e] - high[j], y = low[j] - high[j], z = low[j - e] - low[j];
        const T one = a * y - x * b, two = c * y - z * b;
        f.third[0][j] += one * one, f.third[1][j] += two * two;
    }
}

template <class W, class T>
LOOP void forms_over_ground(i64 from, i64 to, const Ground<T> above, const Ground<T> under, T q, T scale, const FormRows<T> f) {
    SIMD for (i64 j = from; j < to; ++j) {
        const Form<T> m = f.at(0, j), n = f.at(1, j);
        f.put(0, j, Form<T>::template over_ground<W>(m.uu, m.vv, m.uv, m.third, above, q, scale));
        f.put(1, j, Form<T>::template over_ground<W>(n.uu, n.vv, n.uv, n.third, under, q, scale));
    }
}
template <class T> LOOP void forms_in_space(i64 from, i64 to, const FormRows<T> f) {
    SIMD for (i64 j = from; j < to; ++j) {
        const Form<T> m = f.at(0, j), n = f.at(1, j);
        f.put(0, j, Form<T>::in_space(m.uu, m.vv, m.uv, m.third)), f.put(1, j, Form<T>::in_space(n.uu, n.vv, n.uv, n.third));
    }
}
template <class W, class T>
LOOP void forms_of_means(i64 from, i64 to, const Ground<T> above, const Ground<T> under, T q, T scale, const Sums<T> up,
                         const Sums<T> low, const FormRows<T> f) {
    SIMD for (i64 j = from; j < to; ++j) {
        f.put(0, j, mean_form<W>(up.uu[j], up.vv[j], up.uv[j], up.share[j], above, q, scale));
        f.put(1, j, mean_form<W>(low.uu[j], low.vv[j], low.uv[j], low.share[j], under, q, scale));
    }
}
template <class T> LOOP void forms_there(i64 from, i64 to, const u8* code, const FormRows<T> f) {
    SIMD for (i64 j = from; j < to; ++j) {
        const bool has = code[j] & 1, low = code[j] & 16;
        const Form<T> m = f.at(0, j), n = f.at(1, j);
        f.put(0, j, {has ? m.uu : T(0), has ? m.vv : T(0), has ? m.uv : T(0), has ? m.third : T(0)});
        f.put(1, j, {low ? n.uu : T(0), low ? n.vv : T(0), low ? n.uv : T(0), low ? n.third : T(0)});
    }
}

// The loops that know the weight.
template <class T> struct FormLoops {
    void (*over_ground)(i64, i64, const Ground<T>, const Ground<T>, T, T, const FormRows<T>);
    void (*of_means)(i64, i64, const Ground<T>, const Ground<T>, T, T, const Sums<T>, const Sums<T>, const FormRows<T>);
};
template <class T, class W> FormLoops<T> form_loops() { return {forms_over_ground<W, T>, forms_of_means<W, T>}; }

// --- contributions of forms ----------------------------------------------------------------------------------------------------

// Differences along the legs: of a coordinate that moves, or, for a fixed coordinate, the same for all elements of a row.
template <class T> struct Moving {
    const T *top, *bottom;
    INLINE T a(i64 j, i64 e) const { return top[j + e] - top[j]; }
    INLINE T b(i64 j) const { return bottom[j] - top[j]; }
    INLINE T c(i64 j, i64 e) const { return bottom[j - e] - bottom[j]; }
};
template <class T> struct Still {
    T along, down, under;
    INLINE T a(i64, i64) const { return along; }
    INLINE T b(i64) const { return down; }
    INLINE T c(i64, i64) const { return under; }
};

template <bool Borders, class Legs, class T>
LOOP void form_pulls(i64 e, i64 from, i64 to, const u8* code, const Legs legs, const FormRows<T> forms, const Corners<T> pulls) {
    SIMD for (i64 j = from; j < to; ++j) {
        const T a = legs.a(j, e), b = legs.b(j), c = legs.c(j, e);
        const Form<T> m = forms.at(0, j), n = forms.at(1, j);
        pulls.template pull<Borders>(j, code[j], m.on_q(a, b), m.on_r(a, b), n.on_q(c, -b), n.on_r(c, -b));
    }
}

// The shares of the areas of triangles that belong to their corners, for Voronoi masses.
template <class T> LOOP void voronoi_cells(i64 from, i64 to, const FormRows<T> f, const Corners<T> shares) {
    SIMD for (i64 j = from; j < to; ++j) {
        T at[2][3];
        UNROLL for (int i = 0; i < 2; ++i) {
            const Form<T> m = f.at(i, j);
            const T cot_p = T(2) * m.uv, cot_q = T(2) * (m.uu - m.uv), cot_r = T(2) * (m.vv - m.uv), area = T(3) * m.third;
            at[i][0] = voronoi_share(cot_p, cot_q, cot_r, area), at[i][1] = voronoi_share(cot_q, cot_r, cot_p, area);
            at[i][2] = voronoi_share(cot_r, cot_p, cot_q, area);
        }
        shares.own_here[j] = at[0][0] + at[1][2], shares.beside_here[j] = at[0][1];
        shares.own_below[j] = at[0][2] + at[1][0], shares.beside_below[j] = at[1][1];
    }
}

// The largest eigenvalue of the stiffness of a triangle over its smallest mass: (t + sqrt(t^2 - 3/4)) / mass, t half the sum of
// the cotangents. For a single triangle with barycentric masses it is exact.
template <bool Voronoi, class T>
LOOP void form_bounds(i64 n, double thirds, const T* row_uu, const T* row_vv, const T* row_uv, const T* third, double* out) {
    SIMD for (i64 j = 0; j < n; ++j) {
        const double uu = row_uu[j], vv = row_vv[j], uv = row_uv[j], area = 3.0 * double(third[j]);
        const double p = 2.0 * uv, q = 2.0 * (uu - uv), r = 2.0 * (vv - uv), half = 0.5 * (p + q + r);
        double least_mass = area / thirds;
        if constexpr (Voronoi) {
            const double x = voronoi_share(p, q, r, area), y = voronoi_share(q, r, p, area), z = voronoi_share(r, p, q, area);
            least_mass = x < y ? (x < z ? x : z) : (y < z ? y : z);
        }
        const double rest = half * half - 0.75, fastest = (half + std::sqrt(rest > 0.0 ? rest : 0.0)) / least_mass;
        out[j] = area > 0.0 ? fastest : 0.0;
    }
}
template <class T> void form_bounds_of(i64 n, MassKind kind, const FormRows<T>& f, double* upper, double* lower) {
    const double thirds = kind == RING ? 1.0 : 3.0;
    for (int i = 0; i < 2; ++i) {
        double* to = i ? lower : upper;
        if (kind == VORONOI) form_bounds<true>(n, thirds, f.uu[i], f.vv[i], f.uv[i], f.third[i], to);
        else form_bounds<false>(n, thirds, f.uu[i], f.vv[i], f.uv[i], f.third[i], to);
    }
}

template <class T> LOOP void speeds(i64 from, i64 to, const T* pace, const T* time, double* speed) {
    if (time)
        SIMD for (i64 j = from; j < to; ++j) speed[j] = double(pace[j] * time[j]);
    else
        SIMD for (i64 j = from; j < to; ++j) speed[j] = double(pace[j]);
}

// --- a row of samples ---------------------------------------------------------------------------------------------------------------

// The product of pull and ray, stored in place of the pull on x; lengths of the pull along the ray and of the whole pull.
template <class T>
LOOP void pulled_along(i64 n, const T* x, const T* y, const T* z, T* pull_x, const T* pull_y, const T* pull_z, T* part, T* whole) {
    SIMD for (i64 j = 0; j < n; ++j) {
        const T a = pull_x[j], b = pull_y[j], c = pull_z[j], length = std::sqrt(x[j] * x[j] + y[j] * y[j] + z[j] * z[j]);
        const T product = x[j] * a + y[j] * b + z[j] * c, along = magnitude(product) / length;
        pull_x[j] = product, part[j] = length > T(0) ? along : T(0), whole[j] = std::sqrt(a * a + b * b + c * c);
    }
}
template <class T> LOOP void squares_added(i64 n, T scale, const T* pull, T* squares) {
    SIMD for (i64 j = 0; j < n; ++j) squares[j] += scale * (pull[j] * pull[j]);
}
// |P B| and |B| times the mass, from the squared pull free2 of the channels and the pulls on the positions x and y.
template <class T> LOOP void projected(i64 n, const T* free2, const T* x, const T* y, T* part, T* whole) {
    SIMD for (i64 j = 0; j < n; ++j) {
        part[j] = std::sqrt(free2[j]);
        whole[j] = std::sqrt(free2[j] + (x[j] * x[j] + y[j] * y[j]));
    }
}
// Sets the indicator to 1 where the pull is rounding: |B| h below small, h = sqrt M.
template <class T> LOOP void straight(i64 n, T small, T thirds, const T* mass, T* part, T* whole) {
    SIMD for (i64 j = 0; j < n; ++j) {
        const bool curved = whole[j] > small * std::sqrt(thirds * mass[j]);
        part[j] = curved ? part[j] : T(1), whole[j] = curved ? whole[j] : T(1);
    }
}
template <class T> LOOP void all(i64 n, T value, T* row) {
    SIMD for (i64 j = 0; j < n; ++j) row[j] = value;
}
template <class T> LOOP void shared(i64 n, const T* part, const T* whole, T* row) {
    SIMD for (i64 j = 0; j < n; ++j) row[j] *= whole[j] > T(0) ? part[j] / whole[j] : T(1);
}
template <class T> LOOP void over_mass(i64 n, T thirds, const T* mass, T* pace) {
    SIMD for (i64 j = 0; j < n; ++j) {
        const T by = T(1) / (thirds * mass[j]);
        pace[j] *= mass[j] > T(0) ? by : T(0);
    }
}
template <class T> LOOP void over_lengths(i64 n, const T* x, const T* y, const T* z, T* pace) {
    SIMD for (i64 j = 0; j < n; ++j) {
        const T square = x[j] * x[j] + y[j] * y[j] + z[j] * z[j], by = T(1) / square;
        pace[j] *= square > T(0) ? by : T(0);
    }
}
template <class T> LOOP void times(i64 n, const T* factor, T* row) {
    SIMD for (i64 j = 0; j < n; ++j) row[j] *= factor[j];
}
template <class T> LOOP void added_to(i64 n, const T* one, const T* two, T* to) {
    SIMD for (i64 j = 0; j < n; ++j) to[j] += one[j] + two[j];
}

// --- a tile --------------------------------------------------------------------------------------------------------------------------

// The output for the weights of an implicit step: (4, h, w), of the edges to the right, down, down left and down right; and
// s / M |d|^2 (h, w).
template <class T> struct Weights {
    T *edges = nullptr, *inverses = nullptr;
};

template <class T> class FormTile {
  public:
    static i64 coordinates(const Task<T>& t) { return t.lines != CHANNELS ? 3 : t.k; }
    static i64 still(const Task<T>& t) { return t.lines == CHANNELS && t.projection && t.indicated() ? 2 : 0; }
    static i64 rows(const Task<T>& t) {
        const i64 c = coordinates(t), all = c + still(t);
        const i64 places = t.lines != CHANNELS ? 12 : 2 * c;
        return places + 8 + 4 + 4 + EvenedMass<T>::ROWS + 2 * all + 9 + 2 + 1 + 10 * Room<T>::DOUBLE + (t.far > 0 ? Patches<T>::rows(t) : 0);
    }

    // reach: the number of measured elements beside the tile: 1, or 2 if the samples beside it are needed.
    FormTile(const Task<T>& task, const FormLoops<T>& of_weight, Asked what, const Tile& of, Room<T> room, const Weights<T>& to)
        : t(task), loops(of_weight), asked(what), tile(of), weights(to), reach(what == BOUND ? 2 : 1), wide(room.wide),
          n(of.right - of.left), ahead(reach - 1), first(most(of.left - reach, 0) - of.left),
          last(least(of.right + reach, task.w) - of.left), coords(coordinates(task)), stills(still(task)),
          in_space(task.lines != CHANNELS), seeing(in_space && t.indicated() && !t.projection),
          here(places(room)), next(places(room)), forms(FormRows<T>::of(room)), 
          corners(Corners<T>::of(room)), flat(FlatMass<T>::of(room)),
          evened(EvenedMass<T>::of(room)) {
        pulls = room.take(coords + stills), pulls_below = room.take(coords + stills);
        mass = room.take(), mass_below = room.take(), area = room.take(), area_below = room.take();
        sight = room.take(), sight_below = room.take(), part = room.take(), whole = room.take(), pace = room.take();
        for (T*& row : onward) row = room.take();
        free2 = room.take();
        for (int i = 0; i < 4; ++i) bounds[i] = room.take_doubles(), bounds_above[i] = room.take_doubles();
        speed = room.take_doubles(), speed_above = room.take_doubles();
        patch_room = room;
    }

    Measured run() {
        if (t.far <= 0) return sweep([&](int side, i64 r) { measure_samples(side, r); });
        Patches<T> patches(t, tile, first, last, patch_room);
        return sweep([&](int side, i64 r) {
            const Ground<T> above = t.ground(r), under = t.ground(r + 1);
            patches.measure(side, r, [&](i64 begin, i64 end, const Sums<T>& up, const Sums<T>& low) {
                loops.of_means(begin, end, above, under, t.sharpness, t.scale, up, low, forms);
            });
        });
    }

  private:
    struct Row {
        Places<T> space;
        T* channels;
        const T* coordinate(i64 q, i64 step) const { return channels ? channels + q * step : space.p[q]; }
    };
    Row places(Room<T>& room) const {
        if (t.lines != CHANNELS) return {Places<T>::of(room), nullptr};
        return {{}, room.take(t.k)};
    }
    void place(const Row& row, i64 r) const {
        if (in_space) return row.space.place(t, tile, r, reach + 1);
        const i64 from = most(tile.left - reach - 1, 0), to = least(tile.right + reach + 1, t.w);
        for (i64 q = 0; q < t.k; ++q)
            std::memcpy(row.channels + q * wide + (from - tile.left), t.u + (q * t.h + r) * t.w + from,
                        static_cast<std::size_t>(to - from) * sizeof(T));
    }

    template <class Measure> Measured sweep(const Measure& measure) {
        Measured found;
        const i64 start = most(tile.begin - 1, 0);
        place(next, start);
        const bool pulling = t.out || (asked != AREA && t.projection && t.indicated());
        for (i64 r = start; r < least(tile.end + ahead, t.h); ++r) {
            const bool cells = r < t.h - 1;
            exchange(here, next), exchange(pulls, pulls_below), exchange(mass, mass_below), exchange(area, area_below);
            exchange(sight, sight_below), exchange(speed, speed_above);
            for (int i = 0; i < 4; ++i) exchange(bounds[i], bounds_above[i]);
            const bool alike = r - 2 >= start && cells && t.level(r) && t.level(r - 1);
            if (!alike) exchange(flat.here, flat.below), exchange(evened.other.here, evened.other.below);
            if (cells) place(next, r + 1);
            if (weights.edges && r >= tile.begin && !cells) keep_last(r);
            for (int side = t.first_sheet; side < t.last_sheet && cells; ++side) {
                const bool fresh = side == t.first_sheet;
                measure(side, r);
                mask(side, r);
                if (asked == BOUND) form_bounds_of(n, t.mass, forms, bounds[2 * side], bounds[2 * side + 1]);
                if (r >= tile.begin && r < tile.end) found.area += area_of(0, n, forms.third[0], forms.third[1]);
                if (asked == AREA) continue;
                if (weights.edges) keep(side, r);
                if (fresh) clear_below();
                if (pulling) pull(side, r);
                weigh(side, r);
                if (t.indicated() && !t.projection && !in_space && !alike)
                    gather_flat(fresh, side, r);
            }
            if (t.evened && !alike && cells && asked != AREA) gather_evened(r);
            if (asked == AREA || (asked == MOVED && r < tile.begin)) continue;
            indicate();
            const T* time = t.pace ? t.pace + r * t.w + tile.left : nullptr;
            if (asked == BOUND) {
                const i64 from = most(tile.left - 1, 0) - tile.left, to = least(tile.right + 1, t.w) - tile.left;
                speeds(from, to, pace, time, speed);
                if (r > tile.begin)
                    for (int side = t.first_sheet; side < t.last_sheet; ++side) {
                        const double here_most =
                            foremost(n, side ? -1 : 1, bounds_above[2 * side], bounds_above[2 * side + 1], speed_above, speed);
                        found.fastest = here_most > found.fastest ? here_most : found.fastest;
                    }
                continue;
            }
            invert(time);
            if (weights.inverses && r >= tile.begin)
                std::memcpy(weights.inverses + r * t.w + tile.left, pace, static_cast<std::size_t>(n) * sizeof(T));
            if (t.out && r >= tile.begin) {
                if (t.held) stay(n, t.held + r * t.w + tile.left, pace);
                for (i64 q = 0; q < t.k; ++q) move_row(t, tile, q, r, pulls + q * wide, pace);
            }
        }
        return found;
    }
    void measure_samples(int side, i64 r) {
        const i64 e = side ? -1 : 1;
        for (i64 q = 0; q < coords; ++q) {
            const T *top = here.coordinate(q, wide), *bottom = next.coordinate(q, wide);
            if (q == 0) leg_products<true>(e, first, last, top, bottom, forms);
            else leg_products<false>(e, first, last, top, bottom, forms);
            for (i64 p = 0; p < q; ++p)
                minor_squares(e, first, last, here.coordinate(p, wide), next.coordinate(p, wide), top, bottom, forms);
        }
        if (in_space) forms_in_space(first, last, forms);
        else loops.over_ground(first, last, t.ground(r), t.ground(r + 1), t.sharpness, t.scale, forms);
    }
    template <class F> void runs(int side, i64 r, const F& work) const {
        for_runs(t.codes.row(side, r), t.codes.kinds(side, r), t.w, tile.left + first, tile.left + last,
                 [&](Kind kind, i64 from, i64 to) { work(kind, from - tile.left, to - tile.left); });
    }
    void mask(int side, i64 r) const {
        const u8* code = t.codes.row(side, r) + tile.left;
        runs(side, r, [&](Kind kind, i64 from, i64 to) {
            if (kind != PLAIN) forms_there(from, to, code, forms);
        });
    }
    void clear_below() const {
        for (i64 q = 0; q < coords + stills; ++q) zero(pulls_below + q * wide, -ahead, n + ahead);
        for (T* row : {mass_below, area_below, sight_below}) zero(row, -ahead, n + ahead);
    }
    template <class Legs> void pull_of(int side, i64 r, i64 q, const Legs& legs) const {
        const i64 e = side ? -1 : 1;
        const u8* code = t.codes.row(side, r) + tile.left;
        T *to = pulls + q * wide - ahead, *below = pulls_below + q * wide - ahead;
        form_pulls<false>(e, first, last, code, legs, forms, corners);
        runs(side, r, [&](Kind kind, i64 from, i64 until) {
            if (kind == BORDERS) form_pulls<true>(e, from, until, code, legs, forms, corners);
        });
        gather_corners<false>(0, n + 2 * ahead, e, corners.shifted(-ahead), to, below);
    }
    void pull(int side, i64 r) const {
        for (i64 q = 0; q < coords; ++q) pull_of(side, r, q, Moving<T>{here.coordinate(q, wide), next.coordinate(q, wide)});
        if (!stills) return;
        // From P the legs point right (left for backward diagonals) and down; from S they point back.
        const T x = t.geometry[7 * r + 5], y = t.geometry[7 * r + 6], z = t.geometry[7 * r + 12], sign = T(side ? -1 : 1);
        pull_of(side, r, coords, Still<T>{sign * x, T(0), -(sign * z)});
        pull_of(side, r, coords + 1, Still<T>{T(0), y, T(0)});
    }
    void weigh(int side, i64 r) const {
        const i64 e = side ? -1 : 1, m = n + 2 * ahead;
        const T *up = forms.third[0] - ahead, *low = forms.third[1] - ahead;
        if (t.mass == VORONOI) {
            voronoi_cells(first, last, forms, corners);
            gather_corners<false>(-ahead, n + ahead, e, corners, mass, mass_below);
            gather_thirds<false>(m, e, up, low, area - ahead, area_below - ahead);
        } else {
            gather_thirds<false>(m, e, up, low, mass - ahead, mass_below - ahead);
        }
        if (!seeing) return;
        (void)r;
        seen_cells(e, first, last, here.space.row(), next.space.row(), forms.third[0], forms.third[1], corners);
        gather_corners<false>(-ahead, n + ahead, e, corners, sight, sight_below);
    }
    Tile wider() const { return {tile.begin, tile.end, tile.left - ahead, tile.right + ahead}; }
    FlatMass<T> ahead_of(const FlatMass<T>& rows) const {
        return {rows.upper - ahead, rows.lower - ahead, rows.here - ahead, rows.below - ahead};
    }
    void gather_flat(bool fresh, int side, i64 r) {
        ahead_of(flat).gather(t, wider(), fresh, side, r, tile.left + first, tile.left + last);
    }
    void gather_evened(i64 r) {
        EvenedMass<T>{ahead_of(evened.other), evened.area}.gather(t, wider(), r, tile.left + first, tile.left + last);
    }
    // s of the samples, times the factor of time.
    void indicate() {
        const i64 m = n + 2 * ahead;
        T *x = here.space.d[0] - (in_space ? ahead : 0), *y = here.space.d[1] - (in_space ? ahead : 0),
          *z = here.space.d[2] - (in_space ? ahead : 0), *speed = pace - ahead;
        const T* true_area = (t.mass == VORONOI ? area : mass) - ahead;
        if (in_space && (asked == MOVED || t.projection))
            pulled_along(m, x, y, z, pulls - ahead, pulls + wide - ahead, pulls + 2 * wide - ahead, part - ahead, whole - ahead);
        all(m, T(1), speed);
        if (!t.indicated()) return;
        if (!t.projection && in_space) {
            seen_thirds(m, x, y, z, sight - ahead);
            return sped_of(t.quarters, m, t.gamma, T(EDGE_ON), sight - ahead, true_area, speed);
        }
        if (!t.projection) {
            sped_of(t.quarters, m, t.gamma, T(0), flat.here - ahead, true_area, speed);
            if (!t.evened) return;
            evened_areas(m, flat.here - ahead, evened.other.here - ahead, evened.area - ahead);
            return shared(m, flat.here - ahead, evened.area - ahead, speed);
        }
        if (!in_space) {
            zero(free2, -ahead, n + ahead);
            for (i64 q = 0; q < coords; ++q) squares_added(m, t.scale, pulls + q * wide - ahead, free2 - ahead);
            projected(m, free2 - ahead, pulls + coords * wide - ahead, pulls + (coords + 1) * wide - ahead, part - ahead,
                      whole - ahead);
        }
        straight(m, t.small, t.thirds(), mass - ahead, part - ahead, whole - ahead);
        sped_of(t.quarters, m, t.gamma, t.floor, part - ahead, whole - ahead, speed);
    }
    // s / M |d|^2, from s.
    void invert(const T* time) const {
        over_mass(n, t.thirds(), mass, pace);
        if (in_space) over_lengths(n, here.space.d[0], here.space.d[1], here.space.d[2], pace);
        if (time) times(n, time, pace);
    }
    // The weights of the edges that begin in row r, and those along the row below, half the cotangents opposite to them.
    void keep(int side, i64 r) const {
        const i64 plane = t.h * t.w, e = side ? -1 : 1, o = side ? 1 : 0;
        const i64 from = 0, to = n;
        T *right = weights.edges + r * t.w + tile.left, *down = right + plane, *slant = right + (2 + side) * plane;
        const T *uu = forms.uu[0], *vv = forms.vv[0], *uv = forms.uv[0], *xx = forms.uu[1], *yy = forms.vv[1], *xy = forms.uv[1];
        T* kept = onward[side];
        if (r >= tile.begin)
            for (i64 j = from; j < to; ++j) {
                right[j] += kept[j] + (vv[j + o] - uv[j + o]);
                down[j] += (uu[j] - uv[j]) + (xx[j] - xy[j]);
                slant[j] = uv[j - e] + xy[j];
            }
        for (i64 j = from; j < to; ++j) kept[j] = yy[j + 1 - o] - xy[j + 1 - o];
    }
    void keep_last(i64 r) const {
        T* right = weights.edges + r * t.w + tile.left;
        for (int side = t.first_sheet; side < t.last_sheet; ++side)
            for (i64 j = 0; j < n; ++j) right[j] += onward[side][j];
    }

    const Task<T>& t;
    const FormLoops<T>& loops;
    Asked asked;
    Tile tile;
    Weights<T> weights;
    i64 reach, wide, n, ahead, first, last, coords, stills;
    bool in_space, seeing;
    Row here, next;
    FormRows<T> forms;
    Corners<T> corners;
    FlatMass<T> flat;
    EvenedMass<T> evened;
    T *pulls, *pulls_below, *mass, *mass_below, *area, *area_below, *sight, *sight_below, *part, *whole, *pace, *onward[2], *free2;
    double *bounds[4], *bounds_above[4], *speed, *speed_above;
    Room<T> patch_room{};
};

}  // namespace meshflow::grid
