// Connectivity of a mesh: the corners around each vertex, border edges and inner edges, the sparsity pattern of its matrices.
#pragma once
#include "mesh_corners.h"
#include "memory.h"

namespace meshflow {

// The start of the corners of each vertex, first (n + 1,), and the corners (c,) in increasing order; c = 3 m.
inline i64 corners_around(i64 m, i64 c, i64 n, const i32* faces, i64* first, i32* corners) {
    if (c != 3 * m) return OUT_OF_RANGE;
    for (i64 i = 0; i <= n; ++i) first[i] = 0;
    for (i64 at = 0; at < c; ++at) ++first[faces[at] + 1];
    for (i64 i = 0; i < n; ++i) first[i + 1] += first[i];
    // Each assignment advances first[i], which finally is the end of the corners of i.
    for (i64 at = 0; at < c; ++at) corners[first[faces[at]]++] = static_cast<i32>(at);
    for (i64 i = n; i > 0; --i) first[i] = first[i - 1];
    first[0] = 0;
    return 0;
}

// Calls visit(other end, opposite corner) for the two sides that meet at a corner of vertex i. A triangle with a repeated vertex
// has no sides.
template <class F> void for_sides(i64 i, Corner at, const i32* faces, const F& visit) {
    const i32 j = faces[at.b], k = faces[at.d];
    if (j == i || k == i || j == k) return;
    visit(j, at.d), visit(k, at.b);
}

// Marks (c,) the corners opposite to edges of one triangle only. One array of stamps is used for all fans, which may have any
// size.
inline i64 mark_border(i64 n, i64 c, i64 m, const i64* first, const i32* corners, const i32* faces, u8* lonely) {
    if (c != 3 * m || !are_around(first, corners, 0, n, c)) return OUT_OF_RANGE;
    const Memory<i32> stamp(n), times(n);
    if (!stamp || !times) return NO_MEMORY;
    for (i64 i = 0; i < n; ++i) stamp[i] = -1;
    for (i64 at = 0; at < c; ++at) lonely[at] = 0;
    for (i64 i = 0; i < n; ++i) {
        const auto around = [&](const auto& visit) {
            for (i64 t = first[i]; t < first[i + 1]; ++t) for_sides(i, Corner(corners[t]), faces, visit);
        };
        around([&](i32 other, std::uint32_t) {
            times[other] = stamp[other] == i ? times[other] + 1 : 1;
            stamp[other] = static_cast<i32>(i);
        });
        around([&](i32 other, std::uint32_t opposite) {
            if (other > i && times[other] == 1) lonely[opposite] = 1;
        });
    }
    return 0;
}

// Sorts in place: short rows by insertion, long ones (the fan of an apex) by a heap.
template <class I> void sort(I* numbers, i64 count) {
    if (count <= 48) {
        for (i64 i = 1; i < count; ++i) {
            const I number = numbers[i];
            i64 at = i;
            for (; at > 0 && numbers[at - 1] > number; --at) numbers[at] = numbers[at - 1];
            numbers[at] = number;
        }
        return;
    }
    const auto sift = [&](i64 at, i64 end) {
        const I number = numbers[at];
        for (i64 child; (child = 2 * at + 1) < end; at = child) {
            if (child + 1 < end && numbers[child] < numbers[child + 1]) ++child;
            if (numbers[child] <= number) break;
            numbers[at] = numbers[child];
        }
        numbers[at] = number;
    };
    for (i64 at = count / 2; at-- > 0;) sift(at, count);
    for (i64 end = count; --end > 0;) {
        const I greatest = numbers[0];
        numbers[0] = numbers[end];
        sift(0, end);
        numbers[end] = greatest;
    }
}

// Writes the vertex i and all vertices that share a triangle with it to row, sorted and unique; returns their number.
inline i64 list_row(i64 i, const i64* first, const i32* corners, const i32* faces, i32* row) {
    i64 many = 0;
    row[many++] = static_cast<i32>(i);
    for (i64 t = first[i]; t < first[i + 1]; ++t) {
        const Corner at(corners[t]);
        row[many++] = faces[at.b], row[many++] = faces[at.d];
    }
    sort(row, many);
    i64 kept = 1;
    for (i64 at = 1; at < many; ++at)
        if (row[at] != row[kept - 1]) row[kept++] = row[at];
    return kept;
}

// Calls work(i, row, count) for all vertices with their rows from list_row; work returns false if an index is out of range.
template <class F> i64 for_rows(i64 n, i64 c, const i64* first, const i32* corners, const i32* faces, i32 threads, const F& work) {
    std::atomic<bool> room{true};
    const i64 done = checked_blocks(n, threads, [&](i64 begin, i64 end) {
        if (!are_around(first, corners, begin, end, c)) return false;
        i64 widest = 0;
        for (i64 i = begin; i < end; ++i) widest = first[i + 1] - first[i] > widest ? first[i + 1] - first[i] : widest;
        const Memory<i32> row(2 * widest + 1);
        if (!row) {
            room.store(false, std::memory_order_relaxed);
            return true;
        }
        for (i64 i = begin; i < end; ++i)
            if (!work(i, row.get(), list_row(i, first, corners, faces, row.get()))) return false;
        return true;
    });
    return room.load(std::memory_order_relaxed) ? done : i64(NO_MEMORY);
}

// Calls visit(i, k, corner, corner) for every edge of exactly two triangles, with the corners opposite to it, the lower one first.
// i is its lower vertex, and k its number there, in the order of the other ends.
template <class F> i64 for_shared_sides(i64 n, i64 c, const i64* first, const i32* corners, const i32* faces, i32 threads,
                                        const F& visit) {
    std::atomic<bool> room{true};
    const i64 done = checked_blocks(n, threads, [&](i64 begin, i64 end) {
        if (!are_around(first, corners, begin, end, c)) return false;
        i64 widest = 0;
        for (i64 i = begin; i < end; ++i) widest = first[i + 1] - first[i] > widest ? first[i + 1] - first[i] : widest;
        const Memory<i64> sides(2 * widest + 1);
        if (!sides) {
            room.store(false, std::memory_order_relaxed);
            return true;
        }
        for (i64 i = begin; i < end; ++i) {
            i64 many = 0;
            for (i64 t = first[i]; t < first[i + 1]; ++t)
                for_sides(i, Corner(corners[t]), faces, [&](i32 other, std::uint32_t opposite) {
                    if (other > i) sides[many++] = (i64(other) << 32) + i64(opposite);
                });
            sort(sides.get(), many);
            i64 k = 0;
            for (i64 at = 0, next; at < many; at = next) {
                for (next = at + 1; next < many && sides[next] >> 32 == sides[at] >> 32;) ++next;
                if (next == at + 2 && !visit(i, k++, sides[at] & INT32_MAX, sides[at + 1] & INT32_MAX)) return false;
            }
        }
        return true;
    });
    return room.load(std::memory_order_relaxed) ? done : i64(NO_MEMORY);
}

// The start of the edges of two triangles, by their lower vertices, start (n + 1,). Returns how many there are.
inline i64 count_shared(i64 n, i64 c, i64 m, const i64* first, const i32* corners, const i32* faces, i64* start, i32 threads) {
    if (c != 3 * m) return OUT_OF_RANGE;
    for (i64 i = 0; i <= n; ++i) start[i] = 0;
    const i64 done = for_shared_sides(n, c, first, corners, faces, threads, [&](i64 i, i64 k, i64, i64) {
        start[i + 1] = k + 1;
        return true;
    });
    if (done < 0) return done;
    for (i64 i = 0; i < n; ++i) start[i + 1] += start[i];
    return start[n];
}

// The two corners opposite to each of these edges, one (e,) and other (e,).
inline i64 list_shared(i64 n, i64 c, i64 m, i64 e, const i64* first, const i32* corners, const i32* faces, const i64* start,
                       i64* one, i64* other, i32 threads) {
    if (c != 3 * m || !are_rising(start, 0, n, e)) return OUT_OF_RANGE;
    return for_shared_sides(n, c, first, corners, faces, threads, [&](i64 i, i64 k, i64 left, i64 right) {
        const i64 at = start[i] + k;
        if (at >= start[i + 1]) return false;
        one[at] = left, other[at] = right;
        return true;
    });
}

// The start of the rows of the pattern, indptr (n + 1,): each vertex with all that share a triangle with it. Returns the number
// of entries.
inline i64 pattern_rows(i64 n, i64 c, i64 m, const i64* first, const i32* corners, const i32* faces, i32* indptr, i32 threads) {
    if (c != 3 * m) return OUT_OF_RANGE;
    indptr[0] = 0;
    const i64 done = for_rows(n, c, first, corners, faces, threads, [&](i64 i, const i32*, i64 count) {
        indptr[i + 1] = static_cast<i32>(count);
        return true;
    });
    if (done < 0) return done;
    i64 entries = 0;
    for (i64 i = 0; i < n; ++i) {
        entries += indptr[i + 1];
        if (entries > INT32_MAX) return OUT_OF_RANGE;
        indptr[i + 1] = static_cast<i32>(entries);
    }
    return entries;
}

// The columns of the pattern, indices (e,), sorted in each row. slots (c, 2): the positions in the row of the entries for the two
// neighbours of each corner, FARTHER if a byte cannot hold it. diagonal (n,): the positions of the diagonal entries.
inline i64 pattern_entries(i64 n, i64 c, i64 m, i64 e, const i64* first, const i32* corners, const i32* faces, const i32* indptr,
                           i32* indices, u8* slots, i32* diagonal, i32 threads) {
    if (c != 3 * m || !are_rising(indptr, 0, n, e)) return OUT_OF_RANGE;
    return for_rows(n, c, first, corners, faces, threads, [&](i64 i, const i32* row, i64 count) {
        const i32 base = indptr[i];
        if (indptr[i + 1] - base != count) return false;
        for (i64 at = 0; at < count; ++at) indices[base + at] = row[at];
        diagonal[i] = base + static_cast<i32>(place_in_row(row, count, static_cast<i32>(i)));
        const auto slot = [&](i32 vertex) {
            const i64 place = place_in_row(row, count, vertex);
            return static_cast<u8>(place < FARTHER ? place : FARTHER);
        };
        for (i64 t = first[i]; t < first[i + 1]; ++t) {
            const Corner at(corners[t]);
            slots[2 * t] = slot(faces[at.b]), slots[2 * t + 1] = slot(faces[at.d]);
        }
        return true;
    });
}

}  // namespace meshflow
