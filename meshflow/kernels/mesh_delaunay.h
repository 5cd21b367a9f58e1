// Triangles given by the lengths of their sides only; edges are flipped until they are Delaunay.
#pragma once
#include <cmath>

#include "memory.h"
#include "mesh_corners.h"
#include "mesh_triangle.h"

namespace meshflow {

// Inner products at the corners opposite to sides of lengths a, b, c, and four times the squared area by Kahan's formula.
template <class T> Dots<T> dots_of_sides(T a, T b, T c) {
    const T high = greater(greater(a, b), c), low = lesser(lesser(a, b), c), middle = a + b + c - high - low;
    const T det = (high + (middle + low)) * (low - (high - middle)) * (low + (high - middle)) * (high + (middle - low)) / T(4);
    return {{T(0.5) * (b * b + c * c - a * a), T(0.5) * (c * c + a * a - b * b), T(0.5) * (a * a + b * b - c * c)},
            greater(det, T(0))};
}

// Cotangents (m, 3) and areas (m,) of triangles with sides (m, 3), each opposite to a corner.
inline i64 length_angles(i64 m, const double* lengths, double* cot, double* area, i32 threads) {
    parallel_blocks(m, MESH_BLOCK, threads, [&](i64 begin, i64 end, i64, i32) {
        for (i64 f = begin; f < end; ++f) {
            const Angles<double> angles = angles_of(dots_of_sides(lengths[3 * f], lengths[3 * f + 1], lengths[3 * f + 2]));
            for (int c = 0; c < 3; ++c) cot[3 * f + c] = angles.cot[c];
            area[f] = angles.area;
        }
    });
    return 0;
}

// The cotangent of the angle opposite to a side; for a triangle without area it is very large, with the correct sign.
inline double cotangent_of(const double* lengths, i64 side) {
    const Corner at(static_cast<i32>(side));
    const Dots<double> form = dots_of_sides(lengths[at.c], lengths[at.b], lengths[at.d]);
    if (form.det > 0.0) return form.dot[0] / std::sqrt(form.det);
    return form.dot[0] > 0.0 ? 1e300 : form.dot[0] < 0.0 ? -1e300 : 0.0;
}

// Flips edges of faces (m, 3) with sides (m, 3) until no cotangent weight is negative, or the largest number of flips is reached.
//
// A side has the index 3 f + c of the opposite corner. glue (c,): the adjacent side of each, negative if it must not be flipped.
inline i64 flip_edges(i64 m, i64 c, i32* faces, double* lengths, i32* glue) {
    if (c != 3 * m) return OUT_OF_RANGE;
    for (i64 side = 0; side < c; ++side)
        if (glue[side] >= c) return OUT_OF_RANGE;
    const Memory<i32> stack(c);
    const Memory<u8> waits(c);
    if (!stack || !waits) return NO_MEMORY;
    i64 top = 0, flips = 0;
    for (; top < c; ++top) stack[top] = static_cast<i32>(top), waits[top] = 1;
    while (top > 0 && flips < 200 * m + 1000) {
        const i32 side = stack[--top], other = glue[side];
        waits[side] = 0;
        if (other < 0 || other / 3 == side / 3 || cotangent_of(lengths, side) + cotangent_of(lengths, other) >= -1e-12) continue;
        ++flips;
        // The edge i j has k above it and e below; k = corner `one`, e = corner `two`.
        const Corner one(side), two(other);
        const std::uint32_t f = 3 * one.triangle(), g = 3 * two.triangle();
        const i32 k = faces[one.c], i = faces[one.b], j = faces[one.d], e = faces[two.c];
        const double base = lengths[one.c], ki = lengths[one.d], kj = lengths[one.b], ei = lengths[two.b], ej = lengths[two.d];
        // Both triangles unfolded into a plane, with i at the origin.
        const double xk = (base * base + ki * ki - kj * kj) / (2 * base), xe = (base * base + ei * ei - ej * ej) / (2 * base);
        const double yk = std::sqrt(greater(ki * ki - xk * xk, 0.0)), ye = std::sqrt(greater(ei * ei - xe * xe, 0.0));
        const double along = (xk - xe) * (xk - xe) + (yk + ye) * (yk + ye), crossing = std::sqrt(along);
        // The four outer sides, their new positions, and their adjacent sides: each other, or sides of other triangles.
        const std::uint32_t outer[4] = {two.b, one.d, one.b, two.d}, image[4] = {f, f + 2, g, g + 2};
        i32 beyond[4];
        for (int t = 0; t < 4; ++t) {
            beyond[t] = glue[outer[t]];
            for (int s = 0; s < 4; ++s)
                if (beyond[t] >= 0 && static_cast<std::uint32_t>(beyond[t]) == outer[s]) {
                    beyond[t] = static_cast<i32>(image[s]);
                    break;
                }
        }
        faces[f] = k, faces[f + 1] = i, faces[f + 2] = e;
        faces[g] = e, faces[g + 1] = j, faces[g + 2] = k;
        lengths[f] = ei, lengths[f + 1] = crossing, lengths[f + 2] = ki;
        lengths[g] = kj, lengths[g + 1] = crossing, lengths[g + 2] = ej;
        glue[f + 1] = static_cast<i32>(g + 1), glue[g + 1] = static_cast<i32>(f + 1);
        for (int t = 0; t < 4; ++t) {
            glue[image[t]] = beyond[t];
            if (beyond[t] < 0) continue;
            glue[beyond[t]] = static_cast<i32>(image[t]);
            if (!waits[image[t]] && top < c) stack[top++] = static_cast<i32>(image[t]), waits[image[t]] = 1;
        }
    }
    return flips;
}

}  // namespace meshflow
