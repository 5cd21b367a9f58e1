// Corners of a mesh: corner c is corner c % 3 of triangle c / 3. Loops gather over the corners of a vertex, so that no two threads
// write to one place and the sum does not depend on their number.
//
// The gate checks faces. Arrays derived from them (the corners around a vertex, positions of matrix entries) are checked here
// block by block, while they are in the cache.
#pragma once
#include <atomic>

#include "team.h"

namespace meshflow {

constexpr i64 MESH_BLOCK = 1 << 11;  // least number of vertices or triangles for a thread

// The corner c and the next ones of its triangle, b and d, as indices over all corners of the mesh.
struct Corner {
    std::uint32_t c, b, d;
    explicit Corner(i32 number) : c(static_cast<std::uint32_t>(number)) {
        const std::uint32_t turn = c % 3;
        b = turn == 2 ? c - 2 : c + 1;
        d = turn == 0 ? c + 2 : c - 1;
    }
    std::uint32_t triangle() const { return c / 3; }
};

// Whether all numbers are indices below a bound.
inline bool are_below(const i32* numbers, i64 count, i64 bound) {
    std::uint32_t most = 0;
    for (i64 i = 0; i < count; ++i) {
        const std::uint32_t number = static_cast<std::uint32_t>(numbers[i]);
        most = most < number ? number : most;
    }
    return count <= 0 || static_cast<i64>(most) < bound;
}

// Whether first[begin] to first[end] are nondecreasing, and between 0 and a limit.
template <class I> bool are_rising(const I* first, i64 begin, i64 end, i64 limit) {
    bool rising = first[begin] >= 0 && static_cast<i64>(first[end]) <= limit;
    for (i64 i = begin; i < end; ++i) rising &= first[i] <= first[i + 1];
    return rising;
}

// Whether the corners around the vertices begin to end - 1 are valid indices below their total number.
inline bool are_around(const i64* first, const i32* corners, i64 begin, i64 end, i64 many) {
    return are_rising(first, begin, end, many) && are_below(corners + first[begin], first[end] - first[begin], many);
}

// Calls work(begin, end) for n elements in blocks; work returns false if an index is out of range.
template <class F> i64 checked_blocks(i64 n, i32 threads, const F& work) {
    std::atomic<bool> sound{true};
    parallel_blocks(n, MESH_BLOCK, threads, [&](i64 begin, i64 end, i64, i32) {
        if (!work(begin, end)) sound.store(false, std::memory_order_relaxed);
    });
    if (sound.load(std::memory_order_relaxed)) return 0;
    return OUT_OF_RANGE;
}

// The index of a vertex in a sorted row of vertices; 0 for an empty row.
constexpr i64 FARTHER = 255;  // a slot without a position, which must be searched for
inline i64 place_in_row(const i32* row, i64 count, i32 vertex) {
    i64 low = 0;
    for (i64 left = count; left > 1;) {
        const i64 half = left / 2;
        low += row[low + half] <= vertex ? half : 0;
        left -= half;
    }
    return low;
}

}  // namespace meshflow
