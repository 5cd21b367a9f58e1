// Groups of similar patches of a grid or a volume, each filtered as one: the second step of non-local Bayes (Lebrun, Buades, Morel 2013).
//
// A pilot, a first result, says which patches are alike, and by their mean m and covariance C how these vary. With Cn the
// covariance of the noise, a noisy patch y of the group becomes m + C (C + Cn)^-1 (y - m), each channel by itself; what all groups
// say of a sample is averaged. Ours: m is the pilot's, not that of the noisy patches; distance in place counts a little, so that
// ties do not depend on an order; groups are weighted by the noise that they leave; what is added up is the change of the pilot.
//
// References of one tile write into its surroundings. Tiles are done in turns, two along each axis, so that no two of a turn touch,
// and sums do not depend on threads. A grid of two axes is a volume of one slice.
#pragma once
#include <cmath>

#include "grid_loops.h"
#include "memory.h"
#include "team.h"

namespace meshflow {

struct GroupOptions {
    i64 deep;     // slices of a patch: 1 on a grid of two axes
    i64 side;     // rows and columns of a patch
    i64 stride;   // from one reference to the next, samples
    i64 reach;    // how far from its reference a member may be along each axis, samples
    i64 members;  // of a group, where so many are in reach; a few more where distances are the same
    double near;  // what a squared sample of distance in place counts, in squares of the noise
    double loss;  // the share of the noise that is counted: less than 1 for a pilot that has lost what varies
    // Of a window of a larger grid: the slice, row and column of the larger one where it begins, and the larger one's sizes. References
    // and tiles are those of the larger grid, so that sums have the same terms in the same order. Sizes of 0: it is no window.
    i64 front, top, left, slices, rows, columns;
};

}  // namespace meshflow

namespace meshflow::groups {

using grid::least;
using grid::most;

// Patches and samples of a sum of products in registers, and the largest group.
constexpr i64 ROWS = 4, LANES = 16, MOST_MEMBERS = 256;
// Distances are compared in parts of the noise's square, and no further than FAR of them: rounding decides on no tie.
constexpr double PARTS = 1024.0, FAR = 2e9;
constexpr i32 NOT_THERE = 2100000000;

// The upper blocks of x' x, x of (inner, wide): out[r][c] = sum over t of x[t][r] * x[t][c]; rows in fours, columns in sixteens.
template <class T> LOOP void squares_of(i64 rows, i64 inner, i64 wide, const T* x, T* out) {
    for (i64 r = 0; r < rows; r += ROWS)
        for (i64 c = r / LANES * LANES; c < wide; c += LANES) {
            T one[LANES] = {}, two[LANES] = {}, three[LANES] = {}, four[LANES] = {};
            const T *a = x + r, *b = x + c;
            for (i64 t = 0; t < inner; ++t, a += wide, b += wide) {
                const T f = a[0], g = a[1], h = a[2], i = a[3];
                SIMD for (int j = 0; j < LANES; ++j) one[j] += f * b[j], two[j] += g * b[j], three[j] += h * b[j], four[j] += i * b[j];
            }
            T* to = out + r * wide + c;
            SIMD for (int j = 0; j < LANES; ++j)
                to[j] = one[j], to[wide + j] = two[j], to[2 * wide + j] = three[j], to[3 * wide + j] = four[j];
        }
}

// out[r][c] = sum over t of left[r][t] * right[t][c], all rows `wide` apart. Four terms of a row are added at once: with sums of
// four rows in registers, as above, compilers find no SIMD here, and it takes seven times as long.
template <class T> LOOP void product(i64 rows, i64 inner, i64 wide, const T* left, const T* right, T* out) {
    for (i64 r = 0; r < rows; ++r) {
        const T *a = left + r * wide, *b = right;
        T* to = out + r * wide;
        for (i64 c = 0; c < wide; ++c) to[c] = T(0);
        i64 t = 0;
        for (; t + 4 <= inner; t += 4, b += 4 * wide) {
            const T f = a[t], g = a[t + 1], h = a[t + 2], i = a[t + 3];
            SIMD for (i64 c = 0; c < wide; ++c)
                to[c] = (((to[c] + f * b[c]) + g * b[wide + c]) + h * b[2 * wide + c]) + i * b[3 * wide + c];
        }
        for (; t < inner; ++t, b += wide) {
            const T f = a[t];
            SIMD for (i64 c = 0; c < wide; ++c) to[c] += f * b[c];
        }
    }
}

// The inverse of a symmetric positive definite matrix (d, wide) in its place, by Gauss and Jordan. A pivot that rounding or a
// covariance that is none has made too small is as large as `least_pivot`.
LOOP inline void inverted(i64 d, i64 wide, double least_pivot, double* a) {
    for (i64 k = 0; k < d; ++k) {
        double* pivot = a + k * wide;
        const double one = 1.0 / (pivot[k] > least_pivot ? pivot[k] : least_pivot);
        pivot[k] = 1.0;
        SIMD for (i64 j = 0; j < wide; ++j) pivot[j] *= one;
        for (i64 i = 0; i < d; ++i) {
            if (i == k) continue;
            double* row = a + i * wide;
            const double factor = row[k];
            row[k] = 0.0;
            SIMD for (i64 j = 0; j < wide; ++j) row[j] -= factor * pivot[j];
        }
    }
}

// The n-th smallest of keys, counted from 0, by bisection: to count those below a number is a loop for SIMD, whereas to exchange
// them costs a branch that no processor foresees.
inline i32 nth(i64 count, i64 n, const i32* keys) {
    i32 low = keys[0], high = keys[0];
    for (i64 i = 0; i < count; ++i) low = keys[i] < low ? keys[i] : low, high = keys[i] > high ? keys[i] : high;
    while (low < high) {
        const i32 middle = low + (high - low) / 2;
        i32 below = 0;
        for (i64 i = 0; i < count; ++i) below += keys[i] <= middle;
        if (below > n) high = middle;
        else low = middle + 1;
    }
    return low;
}

// Whether a patch at a place, of the places 0 to last along an axis, is a reference: counted from both ends, as a mirror has it.
INLINE bool is_reference(i64 at, i64 last, i64 stride) { return (2 * at <= last ? at : last - at) % stride == 0; }

// The squared distances of a row of the reference to that of each of n patches, added. Compilers find SIMD over the patches where
// the side is known, and where it is not only with the loop over it outside; the sums are the same.
template <int SIDE, class T> LOOP void add_distances_of(i64 n, i64 side, const T* reference, const T* row, T* far) {
    if constexpr (SIDE > 0) {
        SIMD for (i64 c = 0; c < n; ++c) {
            T sum = far[c];
            UNROLL for (int j = 0; j < SIDE; ++j) {
                const T step = row[c + j] - reference[j];
                sum += step * step;
            }
            far[c] = sum;
        }
    } else {
        for (i64 j = 0; j < side; ++j) {
            const T own = reference[j];
            SIMD for (i64 c = 0; c < n; ++c) {
                const T step = row[c + j] - own;
                far[c] += step * step;
            }
        }
    }
}
template <class T> INLINE void add_distances(i64 n, i64 side, const T* reference, const T* row, T* far) {
    if (side == 5) add_distances_of<5>(n, side, reference, row, far);
    else if (side == 4) add_distances_of<4>(n, side, reference, row, far);
    else add_distances_of<0>(n, side, reference, row, far);
}

// What all tiles share. z: slices; d: samples of a patch; wide: the same, padded; thick, tile: slices and side of a tile; layers, box:
// slices and side of its window, padded. Places are those of the arrays; where the larger grid begins they are below zero.
template <class T> struct Task {
    i64 k, z, h, w;
    const T *values, *pilot;
    const u8* missing;
    const double* noise;
    bool white;
    double least_pivot;
    GroupOptions o;
    T *sum, *weight;
    i64 d, wide, thick, tile, layers, box;
    i64 room() const { return layers * box * box; }  // of a window of one channel
};

// The room of one thread: patches (members, wide) of one channel; covariance and filter (d, wide); distances of a row; the window
// (k, layers, box, box) of a tile; its patches of which all samples are there; keys, and where members are in the window.
template <class T> struct Room {
    T *noisy, *pilot, *change, *covariance, *filter, *far, *values, *piloted;
    double *inverse, *mean;
    i32 *keys, *where;
    u8* whole;
    i64 slice, row, column, deep, high, broad;  // where the window begins, and its samples
    i64 members;
};

// Whether all samples of a patch are there.
template <class T> bool is_whole(const Task<T>& q, i64 slice, i64 row, i64 column) {
    for (i64 e = 0; q.missing && e < q.o.deep; ++e)
        for (i64 a = 0; a < q.o.side; ++a)
            for (i64 b = 0; b < q.o.side; ++b)
                if (q.missing[((slice + e) * q.h + row + a) * q.w + column + b]) return false;
    return true;
}

// The window of a tile: samples that are missing are 0.
template <class T> void copy_window(const Task<T>& q, i64 front, i64 top, i64 left, Room<T>& room) {
    const i64 reach = q.o.reach, side = q.o.side, box = q.box, size = q.z * q.h * q.w;
    room.slice = most(0, front - reach), room.row = most(0, top - reach), room.column = most(0, left - reach);
    room.deep = least(q.z, front + q.thick + reach + q.o.deep - 1) - room.slice;
    room.high = least(q.h, top + q.tile + reach + side - 1) - room.row;
    room.broad = least(q.w, left + q.tile + reach + side - 1) - room.column;
    for (i64 i = 0; i < q.k * q.room(); ++i) room.values[i] = room.piloted[i] = T(0);
    for (i64 i = 0; i < q.room(); ++i) room.whole[i] = 0;
    for (i64 e = 0; e < room.deep; ++e)
        for (i64 r = 0; r < room.high; ++r) {
            const i64 from = ((room.slice + e) * q.h + room.row + r) * q.w + room.column;
            for (i64 c = 0; c < q.k; ++c) {
                const i64 to = c * q.room() + (e * box + r) * box;
                for (i64 j = 0; j < room.broad; ++j) {
                    if (q.missing && q.missing[from + j]) continue;
                    room.values[to + j] = q.values[c * size + from + j];
                    room.piloted[to + j] = q.pilot[c * size + from + j];
                }
            }
        }
    for (i64 e = 0; e + q.o.deep <= room.deep; ++e)
        for (i64 r = 0; r + side <= room.high; ++r)
            for (i64 j = 0; j + side <= room.broad; ++j)
                room.whole[(e * box + r) * box + j] = is_whole(q, room.slice + e, room.row + r, room.column + j);
}

// The members of the group of a reference at z, y, x of the window: where, and how many.
template <class T> void find_members(const Task<T>& q, i64 z, i64 y, i64 x, Room<T>& room) {
    const i64 side = q.o.side, reach = q.o.reach, box = q.box;
    const i64 z0 = most(0, z - reach), z1 = least(room.deep - q.o.deep, z + reach);
    const i64 y0 = most(0, y - reach), y1 = least(room.high - side, y + reach), high = y1 - y0 + 1;
    const i64 x0 = most(0, x - reach), wide = least(room.broad - side, x + reach) - x0 + 1, n = (wide + 7) / 8 * 8;
    i64 found = 0, there = 0;
    for (i64 e = z0; e <= z1; ++e)
        for (i64 r = y0; r <= y1; ++r, found += wide) {
            for (i64 j = 0; j < n; ++j) room.far[j] = T(0);
            for (i64 c = 0; c < q.k; ++c)
                for (i64 s = 0; s < q.o.deep; ++s)
                    for (i64 i = 0; i < side; ++i)
                        add_distances(n, side, room.piloted + c * q.room() + ((z + s) * box + y + i) * box + x,
                                      room.piloted + c * q.room() + ((e + s) * box + r + i) * box + x0, room.far);
            const u8* whole = room.whole + (e * box + r) * box + x0;
            for (i64 j = 0; j < wide; ++j) {
                const double off = double((e - z) * (e - z) + (r - y) * (r - y) + (x0 + j - x) * (x0 + j - x));
                const double key = (double(room.far[j]) + q.o.near * off) * PARTS;
                room.keys[found + j] = whole[j] ? static_cast<i32>(key < FAR ? key : FAR) : NOT_THERE;
                there += whole[j];
            }
        }
    const i32 bound = nth(found, least(q.o.members, there) - 1, room.keys);
    room.members = 0;
    for (i64 i = 0; i < found && room.members < MOST_MEMBERS; ++i)
        if (room.keys[i] <= bound) {
            const i64 slice = z0 + i / (high * wide), row = y0 + i / wide % high;
            room.where[room.members++] = static_cast<i32>((slice * box + row) * box + x0 + i % wide);
        }
}

// The patches of a group in one channel, noisy and pilot, less the mean of the pilot's.
template <class T> void gather(const Task<T>& q, i64 channel, Room<T>& room) {
    const i64 side = q.o.side, box = q.box, d = q.d, wide = q.wide;
    for (i64 j = 0; j < d; ++j) room.mean[j] = 0.0;
    for (i64 i = 0; i < room.members; ++i) {
        const i64 at = channel * q.room() + room.where[i];
        T *a = room.noisy + i * wide, *b = room.pilot + i * wide;
        for (i64 s = 0; s < q.o.deep * side; ++s) {
            const i64 from = at + (s / side * box + s % side) * box;
            for (i64 j = 0; j < side; ++j) a[s * side + j] = room.values[from + j], b[s * side + j] = room.piloted[from + j];
        }
        for (i64 j = 0; j < d; ++j) room.mean[j] += double(b[j]);
        for (i64 j = d; j < wide; ++j) a[j] = b[j] = T(0);
    }
    for (i64 j = 0; j < d; ++j) room.mean[j] /= double(room.members);
    for (i64 i = 0; i < room.members; ++i)
        for (i64 j = 0; j < d; ++j) room.noisy[i * wide + j] -= T(room.mean[j]), room.pilot[i * wide + j] -= T(room.mean[j]);
}

// The filter (C + Cn)^-1 C, transposed as it is multiplied from the right; what it leaves of the noise of a sample, squared.
template <class T> double find_filter(const Task<T>& q, Room<T>& room) {
    const i64 d = q.d, wide = q.wide;
    squares_of((d + ROWS - 1) / ROWS * ROWS, room.members, wide, room.pilot, room.covariance);
    const double one = 1.0 / double(room.members - 1), loss = q.o.loss;
    for (i64 r = 0; r < d; ++r)
        for (i64 c = 0; c < wide; ++c) {
            const double variance = c < d ? double(room.covariance[r <= c ? r * wide + c : c * wide + r]) : 0.0;
            room.inverse[r * wide + c] = c < d ? one * variance + loss * q.noise[r * d + c] : 0.0;
        }
    inverted(d, wide, loss * q.least_pivot, room.inverse);
    double left = 0;
    for (i64 r = 0; r < d; ++r)
        for (i64 c = 0; c < wide; ++c) {
            double share = q.white ? room.inverse[r * wide + c] : 0.0;
            if (!q.white && c < d)
                for (i64 t = 0; t < d; ++t) share += room.inverse[r * wide + t] * q.noise[t * d + c];
            const double value = (r == c ? 1.0 : 0.0) - loss * share;
            left += value * value;
            room.filter[r * wide + c] = T(value);
        }
    return left / double(d);
}

// What the members of a group become, less the pilot, added to the sums of one channel.
template <class T> void add_changes(const Task<T>& q, i64 channel, T weight, const Room<T>& room) {
    const i64 side = q.o.side, box = q.box;
    for (i64 i = 0; i < room.members; ++i) {
        const T *e = room.change + i * q.wide, *b = room.pilot + i * q.wide;
        const i64 line = room.where[i] / box, slice = channel * q.z + room.slice + line / box;
        const i64 at = (slice * q.h + room.row + line % box) * q.w + room.column + room.where[i] % box;
        for (i64 s = 0; s < q.o.deep * side; ++s) {
            const i64 from = at + (s / side * q.h + s % side) * q.w;
            T *to = q.sum + from, *by = q.weight + from;
            for (i64 j = 0; j < side; ++j) to[j] += weight * (e[s * side + j] - b[s * side + j]), by[j] += weight;
        }
    }
}

// A reference at z, y, x of the window.
template <class T> void reference(const Task<T>& q, i64 z, i64 y, i64 x, Room<T>& room) {
    find_members(q, z, y, x, room);
    if (room.members < 2) return;
    for (i64 c = 0; c < q.k; ++c) {
        gather(q, c, room);
        const double leaves = find_filter(q, room) + 1.0 / double(room.members);
        product(room.members, q.d, q.wide, room.noisy, room.filter, room.change);
        add_changes(q, c, T(1.0 / leaves), room);
    }
}

// All references of a tile.
template <class T> void tile(const Task<T>& q, i64 front, i64 top, i64 left, Room<T>& room) {
    const GroupOptions& o = q.o;
    const i64 last_slice = o.slices - o.deep, last_row = o.rows - o.side, last_column = o.columns - o.side;
    copy_window(q, front, top, left, room);
    for (i64 slice = most(0, front); slice < least(front + q.thick, q.z - o.deep + 1); ++slice) {
        if (!is_reference(slice + o.front, last_slice, o.stride)) continue;
        for (i64 row = most(0, top); row < least(top + q.tile, q.h - o.side + 1); ++row) {
            if (!is_reference(row + o.top, last_row, o.stride)) continue;
            for (i64 column = most(0, left); column < least(left + q.tile, q.w - o.side + 1); ++column) {
                const i64 z = slice - room.slice, y = row - room.row, x = column - room.column;
                if (is_reference(column + o.left, last_column, o.stride) && room.whole[(z * q.box + y) * q.box + x])
                    reference(q, z, y, x, room);
            }
        }
    }
}

}  // namespace meshflow::groups

namespace meshflow {

// values and pilot (k, z, h, w) in units of their noise, of the covariance (d, d) within a patch; out may be the pilot.
template <class T>
i64 patch_groups(i64 k, i64 z, i64 h, i64 w, i64 d, const T* values, const T* pilot, const u8* missing, const double* noise,
                 const GroupOptions* options, T* out, Stop stop, i32 threads) {
    using namespace groups;
    GroupOptions o = *options;
    if (!o.slices) o.slices = z, o.rows = h, o.columns = w;
    if (o.front < 0 || o.top < 0 || o.left < 0 || o.front + z > o.slices || o.top + h > o.rows || o.left + w > o.columns) return BAD_SIZES;
    if (o.deep < 1 || o.side < 1 || o.stride < 1 || o.reach < 1 || o.members < 2 || o.members > MOST_MEMBERS ||
        d != o.deep * o.side * o.side || o.deep > z || o.side > h || o.side > w)
        return BAD_SIZES;
    const i64 wide = (d + LANES - 1) / LANES * LANES, apart = 2 * o.reach + most(o.deep, o.side);
    const i64 tall = o.slices > 1 ? apart : most(32, apart), thick = o.slices > 1 ? apart : 1;
    const i64 box = (tall + 2 * o.reach + o.side + 7) / 8 * 8 + 8, layers = least(z, thick + 2 * o.reach + o.deep - 1);
    const i64 span = 2 * o.reach + 1, offsets = span * span * least(span, z), n = k * z * h * w, volume = layers * box * box;
    const i64 numbers_each = 3 * MOST_MEMBERS * wide + 2 * (d + ROWS) * wide + box + 2 * k * volume, doubles_each = d * wide + d;
    const Memory<T> sum(n), weight(n), numbers(threads * numbers_each);
    const Memory<double> doubles(threads * doubles_each);
    const Memory<i32> integers(threads * 2 * offsets);
    const Memory<u8> flags(threads * volume);
    if (!sum || !weight || !numbers || !doubles || !integers || !flags) return NO_MEMORY;
    for (i64 i = 0; i < n; ++i) sum[i] = weight[i] = T(0);
    bool white = true;
    double least_pivot = noise[0];
    for (i64 i = 0; i < d * d; ++i) white = white && noise[i] == (i % (d + 1) ? 0.0 : 1.0);
    least_pivot *= 1e-6;
    const Task<T> q{k,           z, h,         w,            values, pilot, missing, noise, white,
                    least_pivot, o, sum.get(), weight.get(), d,      wide,  thick,   tall,  layers, box};
    // The tiles of the larger grid that its window touches, by their numbers.
    const i64 deepest = o.front / thick, through = (o.front + z - 1) / thick + 1;
    const i64 highest = o.top / tall, down = (o.top + h - 1) / tall + 1, leftmost = o.left / tall, across = (o.left + w - 1) / tall + 1;
    for (i64 turn = 0; turn < 8; ++turn) {
        const i64 first_slice = deepest + (deepest + turn / 4) % 2, first_row = highest + (highest + turn / 2) % 2;
        const i64 first_column = leftmost + (leftmost + turn) % 2;
        const i64 slices = most(0, through - first_slice + 1) / 2, rows = most(0, down - first_row + 1) / 2;
        const i64 columns = most(0, across - first_column + 1) / 2;
        const bool done = parallel_for(
            slices * rows * columns, threads,
            [&](i64 part, i32 who) {
                T* at = numbers.get() + who * numbers_each;
                Room<T> room;
                room.noisy = at, room.pilot = at += MOST_MEMBERS * wide, room.change = at += MOST_MEMBERS * wide;
                room.covariance = at += MOST_MEMBERS * wide, room.filter = at += (d + ROWS) * wide;
                room.far = at += (d + ROWS) * wide, room.values = at += box, room.piloted = at + k * volume;
                room.inverse = doubles.get() + who * doubles_each, room.mean = room.inverse + d * wide;
                room.keys = integers.get() + who * 2 * offsets, room.where = room.keys + offsets;
                room.whole = flags.get() + who * volume;
                const i64 slice = 2 * (part / (rows * columns)) + first_slice, row = 2 * (part / columns % rows) + first_row;
                const i64 column = 2 * (part % columns) + first_column;
                tile(q, slice * thick - o.front, row * tall - o.top, column * tall - o.left, room);
            },
            stop);
        if (!done) return CANCELLED;
    }
    for (i64 i = 0; i < n; ++i) out[i] = weight[i] > T(0) ? pilot[i] + sum[i] / weight[i] : pilot[i];
    return 0;
}

}  // namespace meshflow
