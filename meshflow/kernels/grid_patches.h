// Lengths in the space of patches: each sample has its neighbourhood as coordinates, but patches are not stored.
//
// With a, b the differences of the channels along the legs of a triangle, the products a . a, b . b and a . b of all triangles of
// its kind are filtered with a Gaussian before they enter |u|^2, |v|^2 and u . v. A mean of positive semidefinite forms is
// positive semidefinite, so every triangle has a valid metric and the bound of the step holds. (Separately filtered squared edge
// lengths would violate the triangle inequality.) The mean is over existing triangles only.
//
// A ring buffer of rows, filtered along the row, is kept for each triangulation; the requested row is their mean along the
// columns. The row leg of a lower triangle is that of the upper one below it, and both triangles of an element share the column
// leg. Where all triangles exist, away from the borders of the grid, the means are therefore shared, too.
#pragma once
#include <initializer_list>

#include "grid_channels.h"

namespace meshflow::grid {

constexpr i64 WIDEST = 15;  // taps beside the middle

// --- filters along a row, and across rows --------------------------------------------------------------------------------------

template <int FAR, class T> LOOP void along_row(i64 from, i64 to, const T* taps, const T* x, T* out) {
    SIMD for (i64 j = from; j < to; ++j) {
        T sum = taps[0] * x[j];
        UNROLL for (int d = 1; d <= FAR; ++d) sum += taps[d] * (x[j - d] + x[j + d]);
        out[j] = sum;
    }
}
template <class T> LOOP void more_of_row(i64 from, i64 to, i64 d, T tap, const T* x, T* out) {
    SIMD for (i64 j = from; j < to; ++j) out[j] += tap * (x[j - d] + x[j + d]);
}
template <class T> void filtered(i64 far, i64 from, i64 to, const T* taps, const T* x, T* out) {
    switch (far) {
        case 0: return along_row<0>(from, to, taps, x, out);
        case 1: return along_row<1>(from, to, taps, x, out);
        case 2: return along_row<2>(from, to, taps, x, out);
        case 3: return along_row<3>(from, to, taps, x, out);
        default: along_row<4>(from, to, taps, x, out);
    }
    for (i64 d = 5; d <= far; ++d) more_of_row(from, to, d, taps[d], x, out);
}

template <int FAR, class T> LOOP void across_rows(i64 from, i64 to, const T* taps, const T* const* rows, T* out) {
    const T* row[2 * FAR + 1];
    for (int d = 0; d <= 2 * FAR; ++d) row[d] = rows[d];
    SIMD for (i64 j = from; j < to; ++j) {
        T sum = taps[0] * row[FAR][j];
        UNROLL for (int d = 1; d <= FAR; ++d) sum += taps[d] * (row[FAR - d][j] + row[FAR + d][j]);
        out[j] = sum;
    }
}
template <class T> LOOP void more_of_rows(i64 from, i64 to, T tap, const T* over, const T* under, T* out) {
    SIMD for (i64 j = from; j < to; ++j) out[j] += tap * (over[j] + under[j]);
}
template <class T> void across(i64 far, i64 from, i64 to, const T* taps, const T* const* rows, T* out) {
    switch (far) {
        case 0: return across_rows<0>(from, to, taps, rows, out);
        case 1: return across_rows<1>(from, to, taps, rows, out);
        case 2: return across_rows<2>(from, to, taps, rows, out);
        case 3: return across_rows<3>(from, to, taps, rows, out);
        default: across_rows<4>(from, to, taps, rows + (far - 4), out);
    }
    for (i64 d = 5; d <= far; ++d) more_of_rows(from, to, taps[d], rows[far - d], rows[far + d], out);
}

// --- products of the legs -----------------------------------------------------------------------------------------------------------

template <bool First, class T> LOOP void squares_along(i64 e, i64 from, i64 to, const T* top, T* uu) {
    SIMD for (i64 j = from; j < to; ++j) {
        const T a = top[j + e] - top[j];
        uu[j] = (First ? T(0) : uu[j]) + a * a;
    }
}
template <bool First, class T>
LOOP void products(i64 e, i64 from, i64 to, const T* top, const T* bottom, T* vv, T* uv, T* xy) {
    SIMD for (i64 j = from; j < to; ++j) {
        const T a = top[j + e] - top[j], b = bottom[j] - top[j], c = bottom[j - e] - bottom[j];
        vv[j] = (First ? T(0) : vv[j]) + b * b;
        uv[j] = (First ? T(0) : uv[j]) + a * b;
        xy[j] = (First ? T(0) : xy[j]) - c * b;
    }
}
template <class T> LOOP void kept_where(i64 from, i64 to, const u8* code, u8 bit, T* row) {
    SIMD for (i64 j = from; j < to; ++j) row[j] = code[j] & bit ? row[j] : T(0);
}
template <class T> LOOP void ones_where(i64 from, i64 to, const u8* code, u8 bit, T* row) {
    SIMD for (i64 j = from; j < to; ++j) row[j] = code[j] & bit ? T(1) : T(0);
}
template <class T> LOOP void share_of(i64 from, i64 to, T by, const T* weights, T* share) {
    SIMD for (i64 j = from; j < to; ++j) {
        const T weight = by * weights[j], inverse = T(1) / weight;
        share[j] = weight > T(0) ? inverse : T(0);
    }
}

// The filtered sums for a row of elements, of the upper and the lower triangles.
template <class T> struct Sums {
    const T *uu, *vv, *uv, *share;
    INLINE Sums shifted(i64 by) const { return {uu + by, vv + by, uv + by, share + by}; }
};

template <class T> class Patches {
  public:
    static i64 rows(const Task<T>& t) { return (2 * t.far + 3) * STREAMS * (t.last_sheet - t.first_sheet) + 2 * STREAMS + 2 + 7; }

    // Elements first to last - 1, by their index in the tile.
    Patches(const Task<T>& task, const Tile& tile, i64 first, i64 last, Room<T>& room)
        : t(task), left(tile.left), first_(first), last_(last), far(task.far), depth(2 * task.far + 3) {
        for (int side = t.first_sheet; side < t.last_sheet; ++side) {
            ring[side] = room.take(depth * STREAMS), after[side] = room.take();
            next[side] = -1, after_at[side] = -1;
        }
        wide = room.wide, raw = room.take(STREAMS), sums = room.take(STREAMS);
        none = room.take(), share[0] = room.take(), share[1] = room.take(), ends[0] = room.take(), ends[1] = room.take();
        from = most(first_ - far - 1, -left), to = least(last_ + far + 1, t.w - left);
    }

    // The sums of row r of cells, of upper (0) and lower (1) triangles; rows are requested in order. Calls
    // work(begin, end, upper, lower) from left to right for elements begin to end - 1 whose sums are stored in the same rows.
    template <class F> void measure(int side, i64 r, const F& work) {
        advance(side, r);
        if (t.gaps) {
            for (int s = 0; s < STREAMS; ++s) average(side, r, s, first_, last_, sums + s * wide);
            share_of(first_, last_, T(1), sums + UPPER_THERE * wide, share[0]);
            share_of(first_, last_, T(1), sums + LOWER_THERE * wide, share[1]);
            const Sums<T> upper{stream(UU), stream(VV), stream(UV), share[0]}, lower{stream(XX), stream(YY), stream(XY), share[1]};
            return work(first_, last_, upper, lower);
        }
        shares(side, r);
        const i64 e = side ? -1 : 1, rows = t.h - 1;
        T *uu = stream(UU), *xx = stream(XX);
        if (after_at[side] == r) exchange_rows(side, uu);
        else average(side, r, UU, first_, last_, uu);
        for (int s : {VV, UV, XY}) average(side, r, s, first_, last_, stream(s));
        // For lower triangles: the legs along the row below, which start at N.
        const bool middle = r >= far && r + 1 + far <= rows - 1;
        const T* along = nullptr;
        if (middle) {
            average(side, r + 1, UU, first_ - 1, last_ + 1, after[side]);
            after_at[side] = r + 1, along = after[side] - e;
        } else {
            average_of_lower(side, r, first_ - 1, last_ + 1, xx);
            along = xx - e;
        }
        const Sums<T> upper{uu, stream(VV), stream(UV), share[0]};
        const Sums<T> lower{along, stream(VV), stream(XY), share[1]}, at_end{along, stream(YY), stream(XY), share[1]};
        // Near the ends of the grid the two triangles of an element have different neighbours along the columns.
        const i64 begin = most(first_, least(last_, far + 1 - left)), end = least(last_, most(begin, t.w - far - 1 - left));
        const auto beside = [&](i64 a, i64 b) {
            if (a < b) average(side, r, YY, a, b, stream(YY)), work(a, b, upper, at_end);
        };
        beside(first_, begin);
        if (begin < end) work(begin, end, upper, lower);
        beside(end, last_);
    }

  private:
    enum Stream { UU, VV, UV, XX, YY, XY, UPPER_THERE, LOWER_THERE, STREAMS };

    T* stream(int s) const { return sums + s * wide; }
    T* at(int side, i64 r, int s) const { return ring[side] + ((r % depth) * STREAMS + s) * wide; }
    void exchange_rows(int side, T*& uu) {
        std::memcpy(uu + first_, after[side] + first_, static_cast<std::size_t>(last_ - first_) * sizeof(T));
    }

    // The mean of a stream along the columns at row r, over the existing rows first to last.
    void average_rows(int side, i64 r, int s, i64 top, i64 bottom, i64 a, i64 b, T* out) const {
        const T* rows[2 * WIDEST + 1];
        for (i64 d = -far; d <= far; ++d) rows[far + d] = r + d < top || r + d > bottom ? none : at(side, r + d, s);
        across(far, a, b, t.taps, rows, out);
    }
    void average(int side, i64 r, int s, i64 a, i64 b, T* out) const { average_rows(side, r, s, 0, t.h - 2, a, b, out); }
    void average_of_lower(int side, i64 r, i64 a, i64 b, T* out) const { average_rows(side, r + 1, UU, 1, t.h - 1, a, b, out); }

    // Fills the ring buffer up to the rows that row r of cells needs.
    void advance(int side, i64 r) {
        if (next[side] < 0) next[side] = most(r - far, 0);
        // One row more than the means along the columns need: the legs of lower triangles are stored in the row below.
        const i64 last = least(r + far + 1, t.gaps ? t.h - 2 : t.h - 1);
        for (; next[side] <= last; ++next[side]) fill(side, next[side]);
    }

    // The samples, from one beside the elements; absent ones are zero.
    const T* samples(i64 k, i64 r) const { return t.u + (k * t.h + r) * t.w + left; }

    void fill(int side, i64 r) {
        const i64 e = side ? -1 : 1, rows = t.h - 1;
        // The elements at the ends of a row have one triangle and no sample beside them: their products are computed separately.
        const i64 begin = most(from, 1 - left), end = least(to, t.w - 1 - left);
        T *uu = raw + UU * wide, *vv = raw + VV * wide, *uv = raw + UV * wide, *xy = raw + XY * wide, *yy = raw + YY * wide;
        for (i64 k = 0; k < t.k; ++k) {
            const T *top = samples(k, r), *bottom = r < rows ? samples(k, r + 1) : top;
            if (begin < end) {
                if (k == 0) squares_along<true>(e, begin, end, top, uu);
                else squares_along<false>(e, begin, end, top, uu);
                if (r < rows) {
                    if (k == 0) products<true>(e, begin, end, top, bottom, vv, uv, xy);
                    else products<false>(e, begin, end, top, bottom, vv, uv, xy);
                }
            }
            for (i64 j : {-left, t.w - 1 - left})
                if (j >= from && j < to) {
                    const bool upper = j + e + left >= 0 && j + e + left < t.w, lower = !upper;
                    const T a = upper ? top[j + e] - top[j] : T(0), b = bottom[j] - top[j];
                    const T c = lower ? bottom[j - e] - bottom[j] : T(0);
                    uu[j] = (k ? uu[j] : T(0)) + a * a, vv[j] = (k ? vv[j] : T(0)) + b * b;
                    uv[j] = (k ? uv[j] : T(0)) + a * b, xy[j] = (k ? xy[j] : T(0)) - c * b;
                }
        }
        const i64 low = first_ - 1, high = last_ + 1;  // means of row legs are also needed beside the elements
        if (!t.gaps) {
            filtered(far, low, high, t.taps, uu, at(side, r, UU));
            if (r == rows) return;
            // The element at one end has no upper triangle, that at the other end no lower one.
            const i64 absent = (side ? 0 : t.w - 1) - left, other = (side ? t.w - 1 : 0) - left;
            const bool near = absent >= from && absent < to, beside = other >= from && other < to;
            const T kept = near ? vv[absent] : T(0);
            if (near) vv[absent] = T(0);
            for (int s : {VV, UV, XY}) filtered(far, first_, last_, t.taps, raw + s * wide, at(side, r, s));
            if (near) vv[absent] = kept;
            if (beside) vv[other] = T(0);
            const i64 zone = least(last_, far + 1 - left), tail = most(first_, t.w - far - 1 - left);
            if (first_ < zone) filtered(far, first_, zone, t.taps, vv, at(side, r, YY));
            if (most(tail, zone) < last_) filtered(far, most(most(tail, zone), first_), last_, t.taps, vv, at(side, r, YY));
            return;
        }
        const u8* code = t.codes.row(side, r) + left;
        T *xx = raw + XX * wide;
        for (i64 k = 0; k < t.k; ++k) {
            const T* bottom = samples(k, r + 1);
            if (begin < end) {
                if (k == 0) squares_along<true>(-e, begin, end, bottom, xx);
                else squares_along<false>(-e, begin, end, bottom, xx);
            }
            for (i64 j : {-left, t.w - 1 - left})
                if (j >= from && j < to) {
                    const bool lower = j - e + left >= 0 && j - e + left < t.w;
                    const T c = lower ? bottom[j - e] - bottom[j] : T(0);
                    xx[j] = (k ? xx[j] : T(0)) + c * c;
                }
        }
        std::memcpy(yy + from, vv + from, static_cast<std::size_t>(to - from) * sizeof(T));
        ones_where(from, to, code, u8(1), raw + UPPER_THERE * wide), ones_where(from, to, code, u8(16), raw + LOWER_THERE * wide);
        for (int s : {UU, VV, UV}) kept_where(from, to, code, u8(1), raw + s * wide);
        for (int s : {XX, YY, XY}) kept_where(from, to, code, u8(16), raw + s * wide);
        for (int s = 0; s < STREAMS; ++s) filtered(far, first_, last_, t.taps, raw + s * wide, at(side, r, s));
    }

    // One over the sums of the weights of row r of cells, if all triangles exist.
    void shares(int side, i64 r) {
        T down = t.taps[0];
        for (i64 d = 1; d <= far; ++d)
            down += t.taps[d] * (T(r - d >= 0 ? 1 : 0) + T(r + d <= t.h - 2 ? 1 : 0));
        if (shared_side == side && shared_down == down) return;
        if (shared_side != side) {
            for (int lower = 0; lower < 2; ++lower) {
                T* ones = raw;  // overwritten before it is read
                zero(ones, from - far - 1, to + far + 1);
                const i64 absent = (side != lower ? 0 : t.w - 1) - left;
                for (i64 j = from; j < to; ++j) ones[j] = j == absent ? T(0) : T(1);
                filtered(far, first_, last_, t.taps, ones, ends[lower]);
                zero(ones, from, to);
            }
        }
        for (int lower = 0; lower < 2; ++lower) share_of(first_, last_, down, ends[lower], share[lower]);
        shared_side = side, shared_down = down;
    }

    const Task<T>& t;
    i64 left, first_, last_, far, depth, from, to, wide;
    T *ring[2] = {}, *after[2] = {}, *raw, *sums, *none, *share[2], *ends[2];
    i64 next[2], after_at[2];
    int shared_side = -1;
    T shared_down = T(0);
};

// --- cells measured in patches -----------------------------------------------------------------------------------------------------

// The form from mean products. The squared minors of means are not a sum of squares, so their difference is clipped at zero.
template <class W, class T> INLINE Form<T> mean_form(T uu, T vv, T uv, T share, const Ground<T>& g, T q, T scale) {
    const T a = uu * share, b = vv * share, c = uv * share, minors = a * b - c * c;
    return Form<T>::template over_ground<W>(a, b, c, minors > T(0) ? minors : T(0), g, q, scale);
}

// One channel, with the parameters of channel_cells.
template <class W, Kind KIND, class T>
LOOP void patch_cells(const Task<T>& t, i64 e, i64 from, i64 to, [[maybe_unused]] const Lane<T>* code, const T* top, const T* bottom,
                      const Ground<T> above, const Ground<T> under, const Sums<T> up, const Sums<T> low, const Cells<T> f) {
    const T q = t.sharpness, scale = t.scale;
    SIMD for (i64 j = from; j < to; ++j) {
        Lane<T> x = WHOLE;
        if constexpr (KIND != PLAIN) x = code[j];
        const Form<T> m = mean_form<W>(up.uu[j], up.vv[j], up.uv[j], up.share[j], above, q, scale).template if_there<UPPER_BIT>(x);
        const Form<T> n = mean_form<W>(low.uu[j], low.vv[j], low.uv[j], low.share[j], under, q, scale).template if_there<LOWER_BIT>(x);
        const T a = top[j + e] - top[j], b = bottom[j] - top[j], c = bottom[j - e] - bottom[j];
        f.pulls.template pull<KIND == BORDERS>(j, x, m.on_q(a, b), m.on_r(a, b), n.on_q(c, -b), n.on_r(c, -b));
        f.upper[j] = m.third, f.lower[j] = n.third;
    }
}

template <class T>
using PatchCells = void (*)(const Task<T>&, i64, i64, i64, const Lane<T>*, const T*, const T*, const Ground<T>, const Ground<T>,
                            const Sums<T>, const Sums<T>, const Cells<T>);
template <class T> struct PatchLoops {
    PatchCells<T> plain, holes, borders;
};
template <class T, class W> PatchLoops<T> patch_loops() {
    return {patch_cells<W, PLAIN, T>, patch_cells<W, HOLES, T>, patch_cells<W, BORDERS, T>};
}

// All contributions of row r of cells of one triangulation, as in channel_row.
template <class T>
void patch_row(const Task<T>& t, const PatchLoops<T>& loops, Patches<T>& patches, const Tile& tile, int side, i64 r,
               const Cells<T>& f) {
    const u8 *code = t.codes.row(side, r), *kinds = t.codes.kinds(side, r);
    const i64 e = side ? -1 : 1, left = tile.left;
    const T *top = t.u + r * t.w, *bottom = top + t.w;
    const Ground<T> above = t.ground(r), under = t.ground(r + 1);
    patches.measure(side, r, [&](i64 begin, i64 end, const Sums<T>& up, const Sums<T>& low) {
        for_runs(code, kinds, t.w, left + begin, left + end, [&](Kind kind, i64 from, i64 to) {
            const i64 i = from - left, n = to - from;
            if (kind == NONE) return f.clear(1, i, i + n);
            const Cells<T> at = f.shifted(i);
            if (kind != PLAIN) widened(n, code + from, at.code);
            const PatchCells<T> loop = kind == PLAIN ? loops.plain : kind == HOLES ? loops.holes : loops.borders;
            const Sums<T> upper = up.shifted(i), lower = low.shifted(i);
            if (from > 0 && to < t.w) return loop(t, e, 0, n, at.code, top + from, bottom + from, above, under, upper, lower, at);
            T around[2][3];
            neighbours(t, 0, r, from, around[0]), neighbours(t, 0, r + 1, from, around[1]);
            loop(t, e, 0, 1, at.code, around[0] + 1, around[1] + 1, above, under, upper, lower, at);
        });
    });
}

template <class T> Measured patch_tile(const Task<T>& t, const PatchLoops<T>& loops, const Tile& tile, Room<T> room) {
    const i64 first = most(tile.left - 1, 0) - tile.left, last = least(tile.right + 1, t.w) - tile.left;
    Patches<T> patches(t, tile, first, last, room);
    return channel_tile(t, MOVED, tile, room, [&](int side, i64 r, const Cells<T>& f) {
        patch_row(t, loops, patches, tile, side, r, f);
    });
}

}  // namespace meshflow::grid
