// The sweep through a tile of a volume: every row of cells once, and those before its first rows and planes.
//
// A sample gathers from the eight cells around it: those of the plane of cells above it first, in each plane the row before it first,
// and in each row what lies before it and behind it together. This order depends on nothing but the place of the sample, so that
// results do not depend on tiles or threads.
#pragma once
#include "grid.h"
#include "volume_forms.h"

namespace meshflow::volume {

using grid::Room;

template <class T> struct Task {
    i64 k, d, h, w;
    const T* u;
    const u8 *there, *held;  // (d, h, w) or null: all samples are there, none is held
    VolumeOptions options;
    Ground<T> ground;
    T sharpness, gamma;
    int quarters;  // four times gamma, or ANY
    T *out;
    const T *a, *b, *c;
    Mix<T> mix;
    int terms;
    T* edges;  // (directions, d, h, w), or null
    i64 directions;
    T* inverses;  // (d, h, w), s / M, or null

    bool several() const { return k > 1 || options.by_forms; }
    i64 row(i64 z, i64 y) const { return (z * h + y) * w; }
};

// Planes and rows of samples, last not included.
struct Tile {
    i64 top, bottom, begin, end;
};

enum Asked { MOVED, AREA, BOUND };

struct Measured {
    double area = 0, fastest = 0, expansion = 0;
};

// The loop over a row of cells, for each weight.
template <class T> struct Loops {
    void (*one[2][2])(i64, T, const Ground<T>, const Rows<T>, const Rows<Lane<T>>, const Corners<T>, const Corners<T>);
    // Of all diagonals together, with masses or without them; null where no loop of its own is worth its size.
    void (*every[2])(i64, T, const Ground<T>, const Rows<T>, const Rows<Lane<T>>, const Corners<T>, const Corners<T>, const Corners<T>);
    void (*several)(const Task<T>&, const Rows<T>&, const Rows<Lane<T>>&, const Corners<T>*, const Corners<T>&, double*);
    void (*edges)(const Task<T>&, const Rows<T>&, const Rows<Lane<T>>&, i64, const Tile&, i64, i64);
};

// The rows of channel c, given those of the first one.
template <class T> INLINE Rows<T> rows_of_channel(const Task<T>& t, const Rows<T>& u, i64 c) {
    const i64 plane = c * t.d * t.h * t.w;
    return {u.at[0] + plane, u.at[1] + plane, u.at[2] + plane, u.at[3] + plane};
}

template <class W, class T>
void several_cells(const Task<T>& t, const Rows<T>& u, const Rows<Lane<T>>& there, const Corners<T>* pulls, const Corners<T>& masses,
                   double* expansion) {
    Forms<T> forms;
    T quarters[ORDERS][TOGETHER];
    const auto rows = [&](i64 c) { return rows_of_channel(t, u, c); };
    for (i64 i = 0; i < t.w - 1; i += TOGETHER) {
        const i64 n = grid::least(TOGETHER, t.w - 1 - i);
        forms_of<W>(i, n, t.k, t.sharpness, t.ground, rows, there, forms, quarters);
        each_order([&]<int O>() {
            for (i64 c = 0; c < t.k; ++c) add_pulls<O>(i, n, t.ground, rows(c), forms.of[O], pulls[c]);
            add_quarters<O>(i, n, quarters[O], masses);
            if (!expansion) return;
            const double most = grid::greatest_of(n, [&](i64 j) { return double(quarters[O][j]) / double(t.ground.quarter); });
            *expansion = most > *expansion ? most : *expansion;
        });
    }
}

// The directions of edges, half of the neighbours of a sample (volume.py): along x, y, z, then the others.
constexpr int DIRECTION[13][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, 1, 1}, {0, -1, 1}, {1, 0, 1}, {-1, 0, 1},
                                  {1, 1, 0}, {-1, 1, 0}, {1, 1, 1}, {-1, 1, 1}, {1, -1, 1}, {-1, -1, 1}};

// An edge of a tetrahedron in the grid: its first end in the order of the samples, the place of that end in the cell, its direction.
struct Edge {
    int first, direction;
    // Between the p-th and the r-th corner of the path of an order, in the frame of a diagonal.
    static Edge of(int order, int p, int r, i64 diagonal) {
        const auto place = [&](int steps) {
            int corner = static_cast<int>(diagonal) << 1;
            for (int s = 0; s < steps; ++s) corner ^= 1 << ORDER[order][s];
            return corner;
        };
        int first = place(p), second = place(r), by[3];
        for (int axis = 0; axis < 3; ++axis) by[axis] = (second >> axis & 1) - (first >> axis & 1);
        if (by[2] < 0 || (by[2] == 0 && (by[1] < 0 || (by[1] == 0 && by[0] < 0)))) {
            first = second;
            for (int& step : by) step = -step;
        }
        int e = 0;
        while (by[0] != DIRECTION[e][0] || by[1] != DIRECTION[e][1] || by[2] != DIRECTION[e][2]) ++e;
        return {first, e};
    }
    // Where its weights are written, for the cells of a row; null outside of the tile.
    template <class T> T* target(const Task<T>& t, const Tile& tile, i64 z, i64 y) const {
        const i64 at_z = z + (first >> 2 & 1), at_y = y + (first >> 1 & 1);
        if (at_z < tile.top || at_z >= tile.bottom || at_y < tile.begin || at_y >= tile.end) return nullptr;
        return t.edges + direction * t.d * t.h * t.w + t.row(at_z, at_y) + (first & 1);
    }
};

// V0 / W^q of a tetrahedron of one channel; zero where it does not exist.
template <class W, int ORDER_, class T>
LOOP void conductances(i64 i, i64 n, T q, const Ground<T>& g, const Rows<T>& u, const Rows<Lane<T>>& there, T* to) {
    const Legs<ORDER_, T> l = Legs<ORDER_, T>::of(u, i);
    SIMD for (i64 j = 0; j < n; ++j) {
        const T x = l.x1[j] - l.x0[j], y = l.y1[j] - l.y0[j], z = l.z1[j] - l.z0[j];
        to[j] = g.whole / W::expansion(T(1) + (g.ax * (x * x) + (g.ay * (y * y) + g.az * (z * z))), q);
    }
    if (!there.at[0]) return;
    const Lane<T>*m = corner(there, 0, i), *k = corner(there, to_corner(ORDER_, 0), i);
    const Lane<T>*o = corner(there, to_corner(ORDER_, 1), i), *p = corner(there, 7, i);
    SIMD for (i64 j = 0; j < n; ++j) to[j] = kept(m[j] & k[j] & o[j] & p[j], to[j]);
}

// Adds the weights of the edges of a row of cells, minus the entries of the stiffness, each at its first sample if that is in the tile.
// Of one channel the weight of a leg is its flow over its difference, and diagonals have none; of several they are the cotangents.
template <class W, class T>
void edge_cells(const Task<T>& t, const Rows<T>& u, const Rows<Lane<T>>& there, i64 diagonal, const Tile& tile, i64 z, i64 y) {
    Forms<T> forms;
    T quarters[ORDERS][TOGETHER];
    const T over[3] = {t.ground.over_x, t.ground.over_y, t.ground.over_z};
    constexpr int entry[3][3] = {{0, 5, 4}, {5, 1, 3}, {4, 3, 2}};
    for (i64 i = 0; i < t.w - 1; i += TOGETHER) {
        const i64 n = grid::least(TOGETHER, t.w - 1 - i);
        if (t.directions == 3)
            each_order([&]<int O>() { conductances<W, O>(i, n, t.sharpness, t.ground, u, there, quarters[O]); });
        else
            forms_of<W>(i, n, t.k, t.sharpness, t.ground, [&](i64 c) { return rows_of_channel(t, u, c); }, there, forms, quarters);
        for (int o = 0; o < ORDERS; ++o)
            for (int p = 0; p < 3; ++p)
                for (int r = p + 1; r < (t.directions == 3 ? p + 2 : 4); ++r) {
                    const Edge edge = Edge::of(o, p, r, diagonal);
                    T* to = edge.target(t, tile, z, y);
                    if (!to) continue;
                    const auto form = [&](int m, int l, i64 j) {
                        if (m < 0 || l > 2) return T(0);
                        const int x = ORDER[o][m], v = ORDER[o][l];
                        return forms.of[o][entry[x][v]][j] * over[x] * over[v];
                    };
                    for (i64 j = 0; j < n; ++j) {
                        if (t.directions == 3) to[i + j] += quarters[o][j] * over[edge.direction] * over[edge.direction];
                        else to[i + j] -= (form(p - 1, r - 1, j) + form(p, r, j)) - (form(p - 1, r, j) + form(p, r - 1, j));
                    }
                }
    }
}

template <class W, class T> Loops<T> loops_with() {
    Loops<T> loops = {{{one_channel<W, false, false, T>, one_channel<W, false, true, T>},
                       {one_channel<W, true, false, T>, one_channel<W, true, true, T>}},
                      {},
                      several_cells<W, T>,
                      edge_cells<W, T>};
    // In single precision q 1, and q 1.5 with gamma -1, which has no masses: a wheel has room for so many.
    if constexpr (std::is_same_v<T, float> && std::is_same_v<W, grid::Weight<2>>)
        loops.every[0] = loops.every[1] = every_diagonal<W, true, T>;
    if constexpr (std::is_same_v<T, float> && std::is_same_v<W, grid::Weight<3>>) loops.every[0] = every_diagonal<W, false, T>;
    return loops;
}
template <class T> Loops<T> loops_for(double sharpness) {
    return grid::with_weight(sharpness, []<class W>(W) { return loops_with<W, T>(); });
}

// The tiles: they depend on the size of the volume only, so that sums do not depend on the number of threads.
struct Cut {
    i64 deep, high, planes, rows, d, h;
    static Cut of(i64 k, i64 d, i64 h, i64 w) {
        constexpr i64 held = 1 << 14;  // numbers of a plane of sums, which stays in the cache
        const i64 high = grid::least(h, grid::most(8, grid::least(64, held / (k * w)))), deep = grid::least(d, 32);
        return {deep, high, (d + deep - 1) / deep, (h + high - 1) / high, d, h};
    }
    i64 parts() const { return planes * rows; }
    Tile tile(i64 part) const {
        const i64 z = part / rows * deep, y = part % rows * high;
        return {z, grid::least(z + deep, d), y, grid::least(y + high, h)};
    }
};

template <class T> LOOP void scaled(i64 n, T by, const T* from, T* to) {
    SIMD for (i64 i = 0; i < n; ++i) to[i] = by * from[i];
}

template <class T> LOOP void filled(i64 n, T all, T* to) {
    SIMD for (i64 i = 0; i < n; ++i) to[i] = all;
}
template <class T> LOOP void ended(i64 n, T own, T beside, T* to) {
    SIMD for (i64 i = 0; i < n; ++i) to[i] = own + beside;
    to[0] = own, to[n - 1] = beside;
}

// Two planes of sums of the rows of a tile, one for each plane of samples that the cells lie between.
template <class T> struct Sums {
    T* at;
    i64 rows, wide;
    static Sums of(Room<T>& room, i64 rows) { return {room.take(2 * rows), rows, room.wide}; }
    T* row(i64 z, i64 y) const { return at + ((z & 1) * rows + y) * wide; }
};

template <class T> class Sweep {
  public:
    Sweep(const Task<T>& task, const Loops<T>& loops, Asked asked, const Tile& tile, Room<T> room)
        : t(task), loops_(loops), asked_(asked), tile_(tile), rows_(tile.end - tile.begin),
          light_(asked == MOVED && task.quarters == -4), together_(together(task, asked) && loops.every[!light_]) {
        for (i64 c = 0; c < t.k; ++c) pulls_[c] = Corners<T>::of(room);
        masses_ = Corners<T>::of(room), counts_ = Corners<T>::of(room);
        mass_ = Sums<T>::of(room, rows_), flat_ = Sums<T>::of(room, rows_);
        for (Lane<T>*& row : lanes_) row = reinterpret_cast<Lane<T>*>(room.take());
        pace_ = room.take(), flat_row_ = room.take();
        sums_ = Sums<T>::of(room, rows_ * t.k);
    }
    static constexpr i64 MOST = 256;  // channels
    static i64 rows(const Task<T>& t, const Cut& cut) { return CORNERS * (t.k + 2) + 2 * cut.high * (t.k + 2) + 4 + 2; }

    Measured run() {
        for (i64 z = grid::most(tile_.top - 1, 0); z < tile_.bottom; ++z)
            for (i64 y = grid::most(tile_.begin - 1, 0); y < tile_.end; ++y) {
                const bool own = z >= tile_.top && y >= tile_.begin;
                last_ = -1;
                if (z < t.d - 1 && y < t.h - 1) cells(z, y, own);
                if (own && asked_ != AREA) finish(z, y);
            }
        return found_;
    }

  private:
    // Whether all diagonals can be moved at once.
    static bool together(const Task<T>& t, Asked asked) {
        const bool every = t.options.last_diagonal - t.options.first_diagonal == DIAGONALS;
        return every && t.there && asked != AREA && !t.several() && !t.edges;
    }

    void cells(i64 z, i64 y, bool own) {
        const auto& o = t.options;
        const i64 step = together_ ? DIAGONALS : 1;
        for (i64 diagonal = o.first_diagonal; diagonal < o.last_diagonal; diagonal += step) {
            Rows<T> u;
            i64 at_z[4], at_y[4];
            for (int r = 0; r < 4; ++r) {
                at_y[r] = y + ((r ^ diagonal) & 1), at_z[r] = z + ((r ^ diagonal) >> 1 & 1);
                u.at[r] = t.u + t.row(at_z[r], at_y[r]);
            }
            const Rows<Lane<T>> there = gaps_in(at_z, at_y);
            if (t.edges) loops_.edges(t, u, there, diagonal, tile_, z, y);
            if (t.several()) {
                for (i64 c = 0; c < t.k; ++c) cleared(pulls_[c]);
                cleared(masses_);
                loops_.several(t, u, there, pulls_, masses_, asked_ == BOUND ? &found_.expansion : nullptr);
            } else if (together_) {
                loops_.every[!light_](t.w - 1, t.sharpness, t.ground, u, there, pulls_[0], masses_, counts_);
            } else loops_.one[!light_][there.at[0] != nullptr](t.w - 1, t.sharpness, t.ground, u, there, pulls_[0], masses_);
            if (t.there && !together_) counted(there);
            if (asked_ == AREA && own) {
                grid::Sum sum;
                grid::sum_over(sum, t.w - 1, [&](i64 i) { return masses_.at[0][i]; });
                found_.area += 4.0 * sum.total();
            }
            for (int r = 0; r < 4 && asked_ != AREA; ++r) {
                if (at_z[r] < tile_.top || at_z[r] >= tile_.bottom || at_y[r] < tile_.begin || at_y[r] >= tile_.end) continue;
                const bool fresh = diagonal == o.first_diagonal && z == grid::most(at_z[r] - 1, 0) && y == grid::most(at_y[r] - 1, 0);
                // The last cells of a row of samples: their pulls are added where it moves.
                const bool last = diagonal + step == o.last_diagonal && at_z[r] == z && at_y[r] == y && !fresh;
                if (last) last_ = r;
                gather(r, at_z[r], at_y[r] - tile_.begin, fresh, last);
            }
        }
    }

    // The masks of four rows of samples; null where none of them is missing, and not all diagonals are moved at once.
    Rows<Lane<T>> gaps_in(const i64* at_z, const i64* at_y) {
        Rows<Lane<T>> there = {};
        bool gaps = together_;
        for (int r = 0; r < 4 && t.there && !gaps; ++r)
            gaps = std::memchr(t.there + t.row(at_z[r], at_y[r]), 0, static_cast<std::size_t>(t.w)) != nullptr;
        for (int r = 0; r < 4 && gaps; ++r)
            widened<T>(t.w, t.there + t.row(at_z[r], at_y[r]), lanes_[r]), there.at[r] = lanes_[r];
        return there;
    }

    // The numbers of tetrahedra of a row of cells at its corners.
    void counted(const Rows<Lane<T>>& there) {
        if (there.at[0]) flat_counts(t.w - 1, there, counts_);
        else for (int c = 0; c < CORNERS; ++c) filled(t.w - 1, T(AT_CORNER[c]), counts_.at[c] + (c & 1));
    }

    void gather(int r, i64 z, i64 y, bool fresh, bool last) {
        const auto add = fresh ? gathered<true, T> : gathered<false, T>;
        for (i64 c = 0; c < t.k && !last; ++c) add(t.w, pulls_[c].at[2 * r], pulls_[c].at[2 * r + 1], sums_.row(z, c * rows_ + y));
        if (!light_) add(t.w, masses_.at[2 * r], masses_.at[2 * r + 1], mass_.row(z, y));
        if (t.there) add(t.w, counts_.at[2 * r], counts_.at[2 * r + 1], flat_.row(z, y));
    }

    void cleared(const Corners<T>& corners) {
        for (T* row : corners.at) grid::zero(row, 0, t.w);
    }

    // The masses of the ground of a row of samples where none is missing.
    const T* ground_masses(i64 z, i64 y) {
        int own = 0, beside = 0;
        for (int r = 0; r < 4; ++r) {
            const i64 row = y - (r & 1), plane = z - (r >> 1);
            if (row < 0 || plane < 0 || row >= t.h - 1 || plane >= t.d - 1) continue;
            for (i64 diagonal = t.options.first_diagonal; diagonal < t.options.last_diagonal; ++diagonal)
                own += AT_CORNER[2 * (r ^ diagonal)], beside += AT_CORNER[2 * (r ^ diagonal) + 1];
        }
        same_ = own == own_ && beside == beside_;
        if (!same_) ended(t.w, t.ground.quarter * T(own), t.ground.quarter * T(beside), flat_row_);
        own_ = own, beside_ = beside;
        return flat_row_;
    }

    void finish(i64 z, i64 y) {
        const i64 n = t.w, at = t.row(z, y), row = y - tile_.begin;
        T *mass = mass_.row(z, row), *flat = flat_.row(z, row);
        if (t.there) scaled(n, t.ground.quarter, flat, flat_row_);
        const T* ground = t.there ? flat_row_ : ground_masses(z, y);
        const T whole = t.options.ring ? T(4) : T(1);
        if (!light_) grid::paces_of(t.quarters, n, t.gamma, T(0), whole, ground, mass, mass, pace_);
        else if (t.there || t.held || !same_) grid::paces<0>(n, t.gamma, T(0), whole, ground, ground, ground, pace_);
        if (asked_ == BOUND) {
            const double fastest = grid::greatest_product(n, pace_, ground);
            found_.fastest = fastest > found_.fastest ? fastest : found_.fastest;
        } else {
            if (t.inverses) std::memcpy(t.inverses + at, pace_, static_cast<std::size_t>(n) * sizeof(T));
            if (t.held) grid::stay(n, t.held + at, pace_);
            for (i64 c = 0; c < t.k && t.out; ++c) move(c, at, sums_.row(z, c * rows_ + row));
        }
    }

    void move(i64 c, i64 row, const T* pull) {
        const i64 at = c * t.d * t.h * t.w + row;
        const auto read = [&](const T* array) { return (array ? array : t.u) + at; };
        const T *here = last_ < 0 ? nullptr : pulls_[c].at[2 * last_], *beside = last_ < 0 ? nullptr : pulls_[c].at[2 * last_ + 1];
        const auto go = [&](auto loop) {
            loop(t.w, t.mix, t.u + at, read(t.a), read(t.b), read(t.c), pull, here, beside, pace_, t.out + at);
        };
        if (t.terms == 0) last_ < 0 ? go(moved<0, false, T>) : go(moved<0, true, T>);
        else if (t.terms == 1) last_ < 0 ? go(moved<1, false, T>) : go(moved<1, true, T>);
        else last_ < 0 ? go(moved<2, false, T>) : go(moved<2, true, T>);
    }

    const Task<T>& t;
    const Loops<T>& loops_;
    Asked asked_;
    Tile tile_;
    i64 rows_;
    bool light_, together_, same_ = false;
    int last_ = -1;  // the row of the present cells whose pulls are not yet added; -1: none
    int own_ = -1, beside_ = -1;
    Corners<T> pulls_[MOST], masses_, counts_;
    Sums<T> sums_, mass_, flat_;
    Lane<T>* lanes_[4];
    T *pace_, *flat_row_;
    Measured found_;
};

}  // namespace meshflow::volume
