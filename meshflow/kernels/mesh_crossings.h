// Triangles of a mesh that cross each other.
#pragma once
#include "memory.h"
#include "mesh_corners.h"
#include "mesh_normals.h"

namespace meshflow {

inline double least_of(double a, double b) { return a < b ? a : b; }
inline double most_of(double a, double b) { return a > b ? a : b; }

// Whether the segment from p to q crosses the triangle a, b, c. Touching is no crossing, nor is a segment in its plane.
inline bool crosses(Point p, Point q, Point a, Point b, Point c) {
    const Point normal = cross(minus(b, a), minus(c, a));
    const double here = dot(normal, minus(p, a)), there = dot(normal, minus(q, a));
    if (!((here > 0.0 && there < 0.0) || (here < 0.0 && there > 0.0))) return false;
    const Point way = minus(q, p), to_a = minus(a, p), to_b = minus(b, p), to_c = minus(c, p);
    const double one = dot(way, cross(to_a, to_b)), two = dot(way, cross(to_b, to_c)), three = dot(way, cross(to_c, to_a));
    return (one > 0.0 && two > 0.0 && three > 0.0) || (one < 0.0 && two < 0.0 && three < 0.0);
}

// The box of a triangle, and the cells of a regular grid that it touches.
struct Box { double low[3], high[3]; };

inline Box box_of(const double* points, const i32* face) {
    Box box;
    for (int k = 0; k < 3; ++k) {
        const double a = points[3 * face[0] + k], b = points[3 * face[1] + k], c = points[3 * face[2] + k];
        box.low[k] = least_of(a, least_of(b, c)), box.high[k] = most_of(a, most_of(b, c));
    }
    return box;
}

struct CellGrid {
    double start[3], edge;
    i64 count[3];
    i64 cell(i64 i, i64 j, i64 k) const { return (i * count[1] + j) * count[2] + k; }
    i64 along(double x, int k) const {
        const double at = (x - start[k]) / edge;
        return !(at > 0.0) ? 0 : at >= static_cast<double>(count[k]) ? count[k] - 1 : static_cast<i64>(at);
    }
    template <class F> void for_cells(const Box& box, const F& visit) const {
        const i64 low[3] = {along(box.low[0], 0), along(box.low[1], 1), along(box.low[2], 2)};
        const i64 high[3] = {along(box.high[0], 0), along(box.high[1], 1), along(box.high[2], 2)};
        for (i64 i = low[0]; i <= high[0]; ++i)
            for (i64 j = low[1]; j <= high[1]; ++j)
                for (i64 k = low[2]; k <= high[2]; ++k) visit(cell(i, j, k));
    }
};

// Whether two triangles that share no edge cross. Those with a common corner do if the opposite side of one crosses the other.
inline bool are_crossing(const double* points, const i32* one, const i32* other) {
    int shared = 0, mine = -1, its = -1;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            if (one[i] == other[j]) ++shared, mine = i, its = j;
    if (shared > 1) return false;
    const Point a[3] = {vector_at(points, one[0]), vector_at(points, one[1]), vector_at(points, one[2])};
    const Point b[3] = {vector_at(points, other[0]), vector_at(points, other[1]), vector_at(points, other[2])};
    for (int i = 0; i < 3; ++i) {
        if ((shared == 0 || i == mine) && crosses(a[(i + 1) % 3], a[(i + 2) % 3], b[0], b[1], b[2])) return true;
        if ((shared == 0 || i == its) && crosses(b[(i + 1) % 3], b[(i + 2) % 3], a[0], a[1], a[2])) return true;
    }
    return false;
}

// The smallest grid whose lists have at most 16 m entries, with cells of at least the mean size of the boxes.
inline bool fit_grid(i64 m, const Box* boxes, CellGrid& grid) {
    double high[3] = {}, size = 0.0;
    for (i64 f = 0; f < m; ++f) {
        const Box& box = boxes[f];
        double widest = 0.0;
        for (int k = 0; k < 3; ++k) {
            if (f == 0 || box.low[k] < grid.start[k]) grid.start[k] = box.low[k];
            if (f == 0 || box.high[k] > high[k]) high[k] = box.high[k];
            widest = most_of(widest, box.high[k] - box.low[k]);
        }
        size += widest;
    }
    grid.edge = size / static_cast<double>(m);
    if (!(grid.edge > 0.0) || !(grid.edge < 1e300)) return false;
    for (;; grid.edge *= 1.5) {
        double cells = 1.0, entries = 0.0;
        for (int k = 0; k < 3; ++k) {
            const double many = (high[k] - grid.start[k]) / grid.edge + 1.0;
            cells *= many, grid.count[k] = many < 1e9 ? static_cast<i64>(many) : 1;
        }
        if (!(cells <= 64.0 * static_cast<double>(m) + 1e5)) continue;
        for (i64 f = 0; f < m; ++f) {
            const Box& box = boxes[f];
            double touched = 1.0;
            for (int k = 0; k < 3; ++k) touched *= static_cast<double>(grid.along(box.high[k], k) - grid.along(box.low[k], k) + 1);
            entries += touched;
        }
        if (entries <= 16.0 * static_cast<double>(m) || cells <= 8.0) return true;
    }
}

// The pairs of triangles that cross each other, in the order of the lists of cells in which their boxes meet; those with a common
// edge are left out. Returns how many there are; the first k of them are written to pairs (k, 2).
inline i64 crossing_pairs(i64 n, i64 m, i64 k, const double* points, const i32* faces, i32* pairs, i32 threads) {
    if (n < 0 || m == 0) return 0;
    const Memory<Box> boxes(m);
    if (!boxes) return NO_MEMORY;
    parallel_blocks(m, MESH_BLOCK, threads, [&](i64 begin, i64 end, i64, i32) {
        for (i64 f = begin; f < end; ++f) boxes[f] = box_of(points, faces + 3 * f);
    });
    CellGrid grid;
    if (!fit_grid(m, boxes.get(), grid)) return 0;
    // Most cells are empty. Several share a list, in which each triangle says by a number from which of them it is.
    int bits = 10;
    while ((i64(1) << bits) < 2 * m) ++bits;
    const i64 lists = i64(1) << bits;
    const Memory<i64> first(lists + 1), found(lists + 1);
    if (!first || !found) return NO_MEMORY;
    for (i64 c = 0; c <= lists; ++c) first[c] = 0, found[c] = 0;
    for (i64 f = 0; f < m; ++f) grid.for_cells(boxes[f], [&](i64 c) { ++first[(c & (lists - 1)) + 1]; });
    for (i64 c = 0; c < lists; ++c) first[c + 1] += first[c];
    struct Entry { i32 triangle, which; };
    const Memory<Entry> list(first[lists]);
    if (!list) return NO_MEMORY;
    for (i64 f = 0; f < m; ++f)
        grid.for_cells(boxes[f], [&](i64 c) {
            list[first[c & (lists - 1)]++] = {static_cast<i32>(f), static_cast<i32>(c >> bits)};
        });
    for (i64 c = lists; c > 0; --c) first[c] = first[c - 1];
    first[0] = 0;
    const auto in_list = [&](i64 at, const auto& visit) {
        for (i64 s = first[at]; s < first[at + 1]; ++s) {
            const Entry mine = list[s];
            const Box& one = boxes[mine.triangle];
            for (i64 t = s + 1; t < first[at + 1]; ++t) {
                const i32 its = list[t].triangle;
                const Box& other = boxes[its];
                bool apart = mine.which != list[t].which;
                for (int d = 0; d < 3; ++d) apart |= one.low[d] > other.high[d] || other.low[d] > one.high[d];
                if (apart) continue;
                // Boxes meet in several cells; the pair belongs to the one with the low corner of the common part.
                i64 low[3];
                for (int d = 0; d < 3; ++d) low[d] = grid.along(most_of(one.low[d], other.low[d]), d);
                if (grid.cell(low[0], low[1], low[2]) != (i64(mine.which) << bits) + at) continue;
                if (are_crossing(points, faces + 3 * mine.triangle, faces + 3 * its)) visit(mine.triangle, its);
            }
        }
    };
    parallel_blocks(lists, 1 << 10, threads, [&](i64 begin, i64 end, i64, i32) {
        for (i64 c = begin; c < end; ++c) in_list(c, [&](i32, i32) { ++found[c + 1]; });
    });
    for (i64 c = 0; c < lists; ++c) found[c + 1] += found[c];
    parallel_blocks(lists, 1 << 10, threads, [&](i64 begin, i64 end, i64, i32) {
        for (i64 c = begin; c < end; ++c) {
            if (found[c + 1] == found[c]) continue;
            i64 at = found[c];
            in_list(c, [&](i32 one, i32 other) {
                if (at < k) pairs[2 * at] = one, pairs[2 * at + 1] = other;
                ++at;
            });
        }
    });
    return found[lists];
}

// Whether (e,) the normals (m, 3) of the triangles of each pair (e, 2) have a cosine below a number.
inline i64 folded_pairs(i64 m, i64 e, const double* normals, const i64* pairs, double cosine, u8* folded, i32 threads) {
    return checked_blocks(e, threads, [&](i64 begin, i64 end) {
        for (i64 at = begin; at < end; ++at) {
            const i64 one = pairs[2 * at], other = pairs[2 * at + 1];
            if (one < 0 || one >= m || other < 0 || other >= m) return false;
            folded[at] = dot(vector_at(normals, one), vector_at(normals, other)) < cosine;
        }
        return true;
    });
}

}  // namespace meshflow
