// The interface of the flow on a grid for Python: rate, area, bound, and the weights of an implicit step.
#pragma once
#include "grid_select.h"
#include "team.h"

namespace meshflow::grid {

// Bytes of a row of the widest tile. Narrower tiles would fit in the L1 cache, but prefetching of the next rows then fails: at
// 2048 x 2048 one rate took 1.15 times as long with a quarter of it.
constexpr i64 WIDEST_TILE = 1 << 14;
constexpr i64 FEW = 100000;  // largest number of values of a grid for one thread only

INLINE int quarters_of(double gamma) {
    for (double known : {-2.0, -1.0, -0.5, 0.0, 1.0})
        if (gamma == known) return static_cast<int>(4.0 * known);
    return ANY;
}

// Whether the layout of lines is valid. where (6, 3): the index of the first number, and the steps down and to the right.
template <class T> bool placed(Task<T>& t, i64 l, const T* lines, const i64* where) {
    if (t.lines == CHANNELS) return true;
    for (int i = 0; i < 6; ++i) {
        const i64 first = where[3 * i], down = where[3 * i + 1], right = where[3 * i + 2];
        if (first < 0 || down < 0 || right < 0 || right > 1 || down > l || first + (t.h - 1) * down + (t.w - 1) * right >= l)
            return false;
        (i < 3 ? t.origins[i] : t.directions[i - 3]) = {lines + first, down, right};
    }
    return true;
}

// Whether one thread does a kernel with so many numbers.
INLINE bool alone(i64 numbers, i32 threads) { return threads == 1 || numbers < FEW; }

// The tiles of a grid, of numbers of type T. For sums they must depend on its size only, so that these do not depend on the number
// of threads. What is no sum does not depend on tiles: a thread alone takes all rows at once, since the first rows of a tile need
// those above it, and its work space must be cleared.
struct Cut {
    i64 high, wide, rows, columns, h, w, top = 0, left = 0;
    template <class T> static Cut of(i64 h, i64 w, bool all_rows) {
        constexpr i64 most_wide = WIDEST_TILE / static_cast<i64>(sizeof(T));
        const i64 columns = (w + most_wide - 1) / most_wide;
        const i64 wide = least(w, ((w + columns - 1) / columns + BLOCK - 1) / BLOCK * BLOCK);
        const i64 high = all_rows ? h : most(16, least(128, (h + 7) / 8));
        return {high, wide, (h + high - 1) / high, (w + wide - 1) / wide, h, w};
    }
    i64 parts() const { return rows * columns; }
    Tile tile(i64 part) const {
        const i64 r = part / columns * high, c = part % columns * wide;
        return {top + r, top + least(r + high, h), left + c, left + least(c + wide, w)};
    }
};

// Calls work(tile, room, part) for all tiles, each with work space for so many rows, initialized to zero.
template <class T, class F> i64 over_tiles(const Cut& cut, i64 rows, i64 numbers, i32 threads, const F& work) {
    const i64 wide = wide_for(cut.wide), size = (rows + 1) * wide + 64;
    const i64 seats = alone(numbers, threads) ? 1 : least(threads, cut.parts());
    Memory<T> memory(seats * size);
    if (!memory) return NO_MEMORY;
    parallel_for(cut.parts(), static_cast<i32>(seats), [&](i64 part, i32 who) {
        T* begin = memory.get() + who * size;
        while (reinterpret_cast<std::uintptr_t>(begin) % 64) ++begin;
        std::memset(begin, 0, static_cast<std::size_t>((rows + 1) * wide) * sizeof(T));
        work(cut.tile(part), Room<T>{begin, wide}, part);
    });
    return 0;
}

// Which loops a flow uses: those for channels, for rays, or for forms.
template <class T> bool fast(const Task<T>& t) {
    return !t.by_forms && t.mass != VORONOI && !(t.projection && t.indicated()) && (t.lines != CHANNELS || t.k <= (t.far > 0 ? 1 : MOST_CHANNELS));
}

template <class T> struct Asking {
    Task<T> task;
    double sharpness;
    i64 result = 0;

    Asking(i64 k, i64 h, i64 w, i64 m, i64 b, i64 l, i64 p, const T* u, const T* geometry, const u8* codes, const u8* kinds,
           const i32* row_of, const u8* held, const T* lines, const i64* where, const T* pace, const T* taps,
           const GridOptions& o)
        : task{}, sharpness(o.sharpness) {
        task.k = k, task.h = h, task.w = w, task.u = u, task.geometry = geometry;
        task.codes = {codes, kinds, row_of, h, w};
        task.first_sheet = static_cast<int>(o.first_sheet), task.last_sheet = static_cast<int>(o.last_sheet);
        task.sharpness = T(o.sharpness), task.gamma = T(o.gamma), task.floor = T(o.floor), task.scale = T(o.scale);
        task.small = T(o.small), task.across = T(o.across), task.down = T(o.down), task.quarters = quarters_of(o.gamma);
        task.mass = static_cast<MassKind>(o.mass), task.projection = o.projection != 0;
        task.lines = static_cast<LinesKind>(o.lines);
        task.pace = pace, task.taps = taps, task.far = p - 1, task.gaps = o.gaps != 0, task.by_forms = o.by_forms != 0, task.held = held;
        task.evened = o.evened != 0;
        const bool sheets = o.first_sheet >= 0 && o.first_sheet < o.last_sheet && o.last_sheet <= 2;
        const bool kinds_known = o.mass >= 0 && o.mass <= 2 && o.lines >= 0 && o.lines <= 2;
        const bool evens = !task.evened || (o.last_sheet - o.first_sheet == 1 && o.lines == CHANNELS);
        if (k < 1 || h < 2 || w < 2 || m < 1 || b != blocks_of(w) || p > WIDEST + 1 || !sheets || !kinds_known ||
            (o.lines != CHANNELS && (k != 1 || p > 1)) || !evens || !placed(task, l, lines, where))
            result = BAD_SIZES;
    }
};

}  // namespace meshflow::grid

namespace meshflow {

// out = keep u + dt rate + ...; the parameters are declared in meshflow/kernels/grid.py.
template <class T>
i64 grid_rate(i64 k, i64 h, i64 w, i64 m, i64 b, i64 l, i64 p, const T* u, const T* geometry, const u8* codes, const u8* kinds,
              const i32* row_of, const u8* held, const T* lines, const i64* where, const T* pace, const T* taps,
              const GridOptions* options, T* out, const T* one, const T* two, const T* three, const GridBlend* blend,
              i32 threads) {
    using namespace grid;
    Asking<T> asking(k, h, w, m, b, l, p, u, geometry, codes, kinds, row_of, held, lines, where, pace, taps, *options);
    if (asking.result) return asking.result;
    Task<T>& t = asking.task;
    t.out = out, t.a = one, t.b = two, t.c = three;
    t.mix = {T(blend->keep), T(blend->dt), T(blend->one), T(blend->two), T(blend->three)};
    t.terms = two || three ? 2 : one ? 1 : 0;
    const i64 numbers = k * h * w;
    const Cut cut = Cut::of<T>(h, w, alone(numbers, threads));
    if (!fast(t)) {
        const FormLoops<T> loops = form_loops_for<T>(asking.sharpness);
        return over_tiles<T>(cut, FormTile<T>::rows(t), numbers, threads, [&](const Tile& tile, Room<T> room, i64) {
            FormTile<T>(t, loops, MOVED, tile, room, {}).run();
        });
    }
    if (t.lines != CHANNELS)
        return over_tiles<T>(cut, ray_room(t), numbers, threads,
                             [&](const Tile& tile, Room<T> room, i64) { ray_tile(t, MOVED, tile, room); });
    if (t.far > 0) {
        const PatchLoops<T> loops = patch_loops_for<T>(asking.sharpness);
        return over_tiles<T>(cut, channel_room(t) + Patches<T>::rows(t), numbers, threads,
                             [&](const Tile& tile, Room<T> room, i64) { patch_tile(t, loops, tile, room); });
    }
    const ChannelLoops<T> loops = channel_loops_for<T>(k, asking.sharpness);
    return over_tiles<T>(cut, channel_room(t), numbers, threads, [&](const Tile& tile, Room<T> room, i64) {
        channel_tile(t, MOVED, tile, room, [&](int side, i64 r, const Cells<T>& f) {
            channel_row(t, loops, tile, side, r, f);
        });
    });
}

// The area (asked: 1), or the bound of the triangles (2), in a window: its first row, that after the last one, and its columns
// likewise. found[0]: the area; found[1]: for one channel without patches the largest s M_flat / M, else the largest bound of a
// triangle times the factor of time at its corners.
template <class T>
i64 grid_measured(i64 k, i64 h, i64 w, i64 m, i64 b, i64 l, i64 p, const T* u, const T* geometry, const u8* codes,
                  const u8* kinds, const i32* row_of, const u8* held, const T* lines, const i64* where, const T* pace,
                  const T* taps, const GridOptions* options, i64 asked, const i64* window, double* found, i32 threads) {
    using namespace grid;
    Asking<T> asking(k, h, w, m, b, l, p, u, geometry, codes, kinds, row_of, held, lines, where, pace, taps, *options);
    if (asking.result) return asking.result;
    if (asked != AREA && asked != BOUND) return BAD_SIZES;
    const i64 top = window[0], bottom = window[1], left = window[2], right = window[3];
    if (top < 0 || top >= bottom || bottom > h || left < 0 || left >= right || right > w) return BAD_SIZES;
    const Task<T>& t = asking.task;
    const Asked what = static_cast<Asked>(asked);
    const i64 numbers = k * (bottom - top) * (right - left);
    Cut cut = Cut::of<T>(bottom - top, right - left, what == BOUND && alone(numbers, threads));
    cut.top = top, cut.left = left;
    Memory<Measured> parts(cut.parts());
    if (!parts) return NO_MEMORY;
    i64 done;
    if (!fast(t) || t.far > 0 || (t.lines == CHANNELS && k > 1)) {
        const FormLoops<T> loops = form_loops_for<T>(asking.sharpness);
        done = over_tiles<T>(cut, FormTile<T>::rows(t), numbers, threads, [&](const Tile& tile, Room<T> room, i64 part) {
            parts[part] = FormTile<T>(t, loops, what, tile, room, {}).run();
        });
    } else if (t.lines != CHANNELS) {
        done = over_tiles<T>(cut, ray_room(t), numbers, threads, [&](const Tile& tile, Room<T> room, i64 part) {
            parts[part] = ray_tile(t, what, tile, room);
        });
    } else {
        const ChannelLoops<T> loops = channel_loops_for<T>(k, asking.sharpness);
        done = over_tiles<T>(cut, channel_room(t), numbers, threads, [&](const Tile& tile, Room<T> room, i64 part) {
            parts[part] = channel_tile(t, what, tile, room, [&](int side, i64 r, const Cells<T>& f) {
                channel_row(t, loops, tile, side, r, f);
            });
        });
    }
    found[0] = found[1] = 0;
    for (i64 i = 0; i < cut.parts() && !done; ++i) {
        found[0] += parts[i].area;
        found[1] = parts[i].fastest > found[1] ? parts[i].fastest : found[1];
    }
    return done;
}

// The weights of all edges of an implicit step, each stored at its first sample, and s / M |d|^2: see grid::Weights.
template <class T>
i64 grid_weights(i64 k, i64 h, i64 w, i64 m, i64 b, i64 l, i64 p, const T* u, const T* geometry, const u8* codes,
                 const u8* kinds, const i32* row_of, const u8* held, const T* lines, const i64* where, const T* pace,
                 const T* taps, const GridOptions* options, T* edges, T* inverses, i32 threads) {
    using namespace grid;
    Asking<T> asking(k, h, w, m, b, l, p, u, geometry, codes, kinds, row_of, held, lines, where, pace, taps, *options);
    if (asking.result) return asking.result;
    const Task<T>& t = asking.task;
    const FormLoops<T> loops = form_loops_for<T>(asking.sharpness);
    return over_tiles<T>(Cut::of<T>(h, w, alone(k * h * w, threads)), FormTile<T>::rows(t), k * h * w, threads,
                         [&](const Tile& tile, Room<T> room, i64) {
                             FormTile<T>(t, loops, MOVED, tile, room, {edges, inverses}).run();
                         });
}

}  // namespace meshflow
