// Triangles in blocks that fit the cache of a core, so that cotangents, masses and gradients in R^3 are never written to memory.
//
// A block owns neighbouring vertices and has a copy, with local indices, of every triangle with one of them. So each vertex is
// read about once in any order of the mesh, no two threads write to the same place, and sums do not depend on the number of
// threads.
#pragma once
#include <cmath>

#include "mesh_corners.h"
#include "memory.h"
#include "mesh_triangle.h"

namespace meshflow {

// Calls visit(block) once for each block that owns a corner of a triangle.
template <class F> void for_blocks(const i32* face, const i32* block, const F& visit) {
    const i32 a = block[face[0]], b = block[face[1]], c = block[face[2]];
    visit(a);
    if (b != a) visit(b);
    if (c != a && c != b) visit(c);
}

// The start of the triangles of each block, first (b + 1,). block (n,): the owner of each vertex. Returns their total number.
inline i64 count_blocks(i64 m, i64 n, i64 b, const i32* faces, const i32* block, i64* first) {
    if (!are_below(block, n, b)) return OUT_OF_RANGE;
    for (i64 i = 0; i <= b; ++i) first[i] = 0;
    for (i64 f = 0; f < m; ++f) for_blocks(faces + 3 * f, block, [&](i32 at) { ++first[at + 1]; });
    for (i64 i = 0; i < b; ++i) first[i + 1] += first[i];
    return first[b];
}

// Numbers the vertices of each block: first those that it owns, runs of `size` of order (n,), then those around them.
//
// vertices (v,), v = 3 t + n: of all blocks, which begin at start (b + 1,). triangles (t, 3): of all blocks, which begin at
// first (b + 1,), with local indices. Returns the largest number of vertices of a block.
inline i64 number_blocks(i64 m, i64 n, i64 b, i64 v, i64 t, const i32* faces, const i32* order, const i32* block, i64 size,
                         const i64* first, i32* vertices, i64* start, std::uint16_t* triangles) {
    if (size < 1 || v != 3 * t + n || b != (n + size - 1) / size || !are_below(block, n, b) || !are_below(order, n, n) ||
        !are_rising(first, 0, b, t) || first[b] != t)
        return OUT_OF_RANGE;
    const Memory<i32> held(t), place(n), of(n);
    const Memory<i64> next(b);
    if (!held || !place || !of || !next) return NO_MEMORY;
    for (i64 i = 0; i < b; ++i) next[i] = first[i];
    for (i64 i = 0; i < n; ++i) of[i] = -1;
    bool sound = true;
    for (i64 f = 0; f < m; ++f)
        for_blocks(faces + 3 * f, block, [&](i32 at) {
            if (next[at] < first[at + 1]) held[next[at]++] = static_cast<i32>(f);
            else sound = false;
        });
    for (i64 at = 0; at < b; ++at) sound &= next[at] == first[at + 1];
    if (!sound) return OUT_OF_RANGE;
    i64 most = 0, base = 0;
    for (i64 at = 0; at < b; ++at) {
        i64 found = 0;
        const auto meet = [&](i32 i) {
            if (of[i] != at) vertices[base + found] = i, place[i] = static_cast<i32>(found++), of[i] = static_cast<i32>(at);
            return place[i];
        };
        start[at] = base;
        for (i64 i = at * size; i < n && i < (at + 1) * size; ++i) meet(order[i]);
        for (i64 k = first[at]; k < first[at + 1]; ++k)
            for (int c = 0; c < 3; ++c) triangles[3 * k + c] = static_cast<std::uint16_t>(meet(faces[3 * held[k] + c]));
        base += found;
        most = found > most ? found : most;
    }
    start[b] = base;
    return most;
}

// --- several triangles of a block at once: loops over LANES are compiled to vector instructions --------------------------------

constexpr int LANES = 8;

// The corners of LANES triangles, and derived quantities.
struct Lanes {
    double at[3][3][LANES];  // corner, coordinate
    double cot[3][LANES], area[LANES];

    void measure() {
        for (int l = 0; l < LANES; ++l) {
            const Angles<double> angles =
                angles_of(form_of<double, 3>([&](int c, i64 q) { return at[c][q][l]; }, 3));
            for (int c = 0; c < 3; ++c) cot[c][l] = angles.cot[c];
            area[l] = angles.area;
        }
    }
};

// out = keep X - dt M^-1 L X (n, 3). inverse (n,) or null: dt / M. sharpest (b,): the largest cotangent of each block, infinite
// if a triangle has no area. held (n,): vertices that do not move.
template <Mass KIND> i64 march(i64 n, i64 b, i64 v, i64 t, const i32* vertices, const i64* start, const i64* owned,
                               const std::uint16_t* triangles, const i64* first, const double* points, const u8* held, double keep,
                               double dt, double* out, double* inverse, double* sharpest, i32 threads) {
    std::atomic<i64> failed{0};
    parallel_for(b, threads, [&](i64 block, i32) {
        const i64 base = start[block], many = start[block + 1] - base, begin = first[block], end = first[block + 1];
        if (base < 0 || many < 0 || base + many > v || begin < 0 || end < begin || end > t || owned[block] < 0 ||
            owned[block] > many || !are_below(vertices + base, many, n)) {
            failed.store(OUT_OF_RANGE, std::memory_order_relaxed);
            return;
        }
        // Four numbers per vertex: x, y, z and padding; the pull on these three, and the mass.
        const Memory<double> room(8 * many);
        if (!room) {
            failed.store(NO_MEMORY, std::memory_order_relaxed);
            return;
        }
        double *x = room.get(), *sum = x + 4 * many;
        for (i64 i = 0; i < many; ++i) {
            const double* point = points + 3 * i64(vertices[base + i]);
            for (int q = 0; q < 3; ++q) x[4 * i + q] = point[q];
            x[4 * i + 3] = 0.0;
            for (int q = 0; q < 4; ++q) sum[4 * i + q] = 0.0;
        }
        double steepest = 0.0;
        bool flat = false, sound = true;
        const auto add = [&](const std::uint16_t* corner, const Lanes& lanes, int l) {
            const double cot[3] = {lanes.cot[0][l], lanes.cot[1][l], lanes.cot[2][l]}, area = lanes.area[l];
            for (int c = 0; c < 3; ++c) steepest = greater(steepest, std::fabs(cot[c]));
            flat |= !(area > 0.0);
            double* to[3] = {sum + 4 * corner[0], sum + 4 * corner[1], sum + 4 * corner[2]};
            for (int q = 0; q < 3; ++q) {
                const double a = lanes.at[0][q][l], z = lanes.at[1][q][l], e = lanes.at[2][q][l];
                const double of_i = tension(cot[0], z, e), of_j = tension(cot[1], e, a), of_k = tension(cot[2], a, z);
                to[0][q] += of_k - of_j, to[1][q] += of_i - of_k, to[2][q] += of_j - of_i;
            }
            to[0][3] += share<KIND>(cot[0], cot[1], cot[2], area);
            to[1][3] += share<KIND>(cot[1], cot[2], cot[0], area);
            to[2][3] += share<KIND>(cot[2], cot[0], cot[1], area);
        };
        for (i64 at = begin; at < end && sound; at += LANES) {
            Lanes lanes;
            const int some = end - at < LANES ? static_cast<int>(end - at) : LANES;
            for (int l = 0; l < LANES; ++l)
                for (int c = 0; c < 3; ++c) {
                    const i64 corner = triangles[3 * (at + (l < some ? l : 0)) + c];
                    if (corner >= many) {
                        sound = false;
                        continue;
                    }
                    for (int q = 0; q < 3; ++q) lanes.at[c][q][l] = x[4 * corner + q];
                }
            if (!sound) break;
            lanes.measure();
            for (int l = 0; l < some; ++l) add(triangles + 3 * (at + l), lanes, l);
        }
        if (!sound) {
            failed.store(OUT_OF_RANGE, std::memory_order_relaxed);
            return;
        }
        for (i64 i = 0; i < owned[block]; ++i) {
            const i64 vertex = vertices[base + i];
            const double mass = sum[4 * i + 3], by = mass > 0.0 && !held[vertex] ? dt / mass : 0.0;
            for (int q = 0; q < 3; ++q) out[3 * vertex + q] = keep * x[4 * i + q] - by * sum[4 * i + q];
            if (inverse) inverse[vertex] = by;
        }
        sharpest[block] = flat ? HUGE_VAL : steepest;
    });
    return failed.load(std::memory_order_relaxed);
}

inline i64 march_blocks(i64 v, i64 b, i64 t, i64 n, const i32* vertices, const i64* start, const i64* owned,
                        const std::uint16_t* triangles, const i64* first, const double* points, i64 kind, const u8* held,
                        double keep, double dt, double* out, double* inverse, double* sharpest, i32 threads) {
    i64 done = 0;
    for_mass(kind, [&]<Mass KIND>() {
        done = march<KIND>(n, b, v, t, vertices, start, owned, triangles, first, points, held, keep, dt, out, inverse, sharpest,
                           threads);
    });
    return done;
}

}  // namespace meshflow
