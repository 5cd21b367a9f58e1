// Diffusion of the normals of triangles, and the update of points to fit them.
#pragma once
#include <cmath>

#include "grid_weights.h"
#include "mesh_corners.h"

namespace meshflow {

struct Point { double x, y, z; };

inline Point vector_at(const double* numbers, i64 i) { return {numbers[3 * i], numbers[3 * i + 1], numbers[3 * i + 2]}; }
inline Point minus(Point a, Point b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline double dot(Point a, Point b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Point cross(Point u, Point v) { return {u.y * v.z - u.z * v.y, u.z * v.x - u.x * v.z, u.x * v.y - u.y * v.x}; }
inline void put(double* numbers, i64 i, Point a) { numbers[3 * i] = a.x, numbers[3 * i + 1] = a.y, numbers[3 * i + 2] = a.z; }

// Unit normals (m, 3) and areas (m,) of the triangles of points (n, 3); a triangle without area has the normal zero.
inline i64 triangle_normals(i64, i64 m, const double* points, const i32* faces, double* normals, double* areas, i32 threads) {
    parallel_blocks(m, MESH_BLOCK, threads, [&](i64 begin, i64 end, i64, i32) {
        for (i64 f = begin; f < end; ++f) {
            const Point at = vector_at(points, faces[3 * f]);
            const Point u = minus(vector_at(points, faces[3 * f + 1]), at), v = minus(vector_at(points, faces[3 * f + 2]), at);
            const Point n = cross(u, v);
            const double length = std::sqrt(dot(n, n)), by = length > 0.0 ? 1.0 / length : 0.0;
            areas[f] = 0.5 * length;
            put(normals, f, {n.x * by, n.y * by, n.z * by});
        }
    });
    return 0;
}

// |e| / |d| (m, 3) of the edge e opposite to each corner, where |d| is the length of the path between the centroids over the
// middle of e; zero if across (m, 3), the triangle on the other side, is negative.
inline i64 edge_conductances(i64, i64 m, const double* points, const i32* faces, const i32* across, double* conductances,
                             i32 threads) {
    const auto center = [&](i64 f) {
        const Point a = vector_at(points, faces[3 * f]), b = vector_at(points, faces[3 * f + 1]);
        const Point c = vector_at(points, faces[3 * f + 2]);
        return Point{(a.x + b.x + c.x) / 3.0, (a.y + b.y + c.y) / 3.0, (a.z + b.z + c.z) / 3.0};
    };
    return checked_blocks(m, threads, [&](i64 begin, i64 end) {
        for (i64 f = begin; f < end; ++f) {
            const Point own = center(f);
            for (int c = 0; c < 3; ++c) {
                const i64 g = across[3 * f + c];
                if (g >= m) return false;
                conductances[3 * f + c] = 0.0;
                if (g < 0) continue;
                const Point a = vector_at(points, faces[3 * f + (c + 1) % 3]), b = vector_at(points, faces[3 * f + (c + 2) % 3]);
                const Point middle{0.5 * (a.x + b.x), 0.5 * (a.y + b.y), 0.5 * (a.z + b.z)};
                const Point edge = minus(a, b), here = minus(own, middle), there = minus(center(g), middle);
                const double way = std::sqrt(dot(here, here)) + std::sqrt(dot(there, there));
                if (way > 0.0) conductances[3 * f + c] = std::sqrt(dot(edge, edge)) / way;
            }
        }
        return true;
    });
}

// stretch^power. SQUARINGS: the power is -2^SQUARINGS, for sharpness 2, 4 and 8, by products, because pow would dominate the
// time.
template <int SQUARINGS> double conducting(double stretch, double power) {
    if constexpr (SQUARINGS < 0) return grid::raised(stretch, power);
    const double by = 1.0 / stretch;
    if constexpr (SQUARINGS == 1) return by * by;
    if constexpr (SQUARINGS == 2) return by * by * by * by;
    return by;
}

template <int SQUARINGS> i64 spread(i64 m, const double* normals, const double* areas, const double* weights, const i32* across,
                                    double dt, double contrast2, double power, double* out, i32 threads) {
    return checked_blocks(m, threads, [&](i64 begin, i64 end) {
        for (i64 f = begin; f < end; ++f) {
            const Point own = vector_at(normals, f);
            Point sum{areas[f] * own.x, areas[f] * own.y, areas[f] * own.z};
            for (int c = 0; c < 3; ++c) {
                const i64 g = across[3 * f + c];
                if (g >= m) return false;
                if (g < 0) continue;
                const Point its = vector_at(normals, g), turn = minus(its, own);
                const double w = dt * weights[3 * f + c] * conducting<SQUARINGS>(1.0 + contrast2 * dot(turn, turn), power);
                sum.x += w * its.x, sum.y += w * its.y, sum.z += w * its.z;
            }
            const double length = std::sqrt(dot(sum, sum));
            put(out, f, length > 0.0 ? Point{sum.x / length, sum.y / length, sum.z / length} : own);
        }
        return true;
    });
}

// One step dt of the diffusion of unit normals (m, 3), implicit in the triangle itself, to out:
// A n+ = A n + dt sum of w (1 + contrast2 |n_beyond - n|^2)^power n_beyond, normalized.
inline i64 spread_normals(i64 m, const double* normals, const double* areas, const double* weights, const i32* across, double dt,
                          double contrast2, double power, double* out, i32 threads) {
    const auto with = [&](auto one) { return one(m, normals, areas, weights, across, dt, contrast2, power, out, threads); };
    if (power == -1.0) return with(spread<0>);
    if (power == -2.0) return with(spread<1>);
    if (power == -4.0) return with(spread<2>);
    return with(spread<-1>);
}

// Moves points (n, 3) by the mean of n_f n_f . (c_f - x_i) over the triangles f around each, with centroids c_f and normals n_f
// (m, 3), to out. held (n,): points that do not move.
inline i64 follow_normals(i64 n, i64 c, i64 m, const double* points, const i64* first, const i32* corners, const i32* faces,
                          const double* normals, const u8* held, double* out, i32 threads) {
    if (c != 3 * m) return OUT_OF_RANGE;
    return checked_blocks(n, threads, [&](i64 begin, i64 end) {
        if (!are_around(first, corners, begin, end, c)) return false;
        for (i64 i = begin; i < end; ++i) {
            const Point own = vector_at(points, i);
            Point sum{0.0, 0.0, 0.0};
            const i64 count = first[i + 1] - first[i];
            for (i64 t = first[i]; t < first[i + 1]; ++t) {
                const Corner at(corners[t]);
                const Point normal = vector_at(normals, at.triangle());
                const Point j = minus(vector_at(points, faces[at.b]), own), k = minus(vector_at(points, faces[at.d]), own);
                // n . (c_f - x_i) by differences, so that planes far from the origin do not move, up to the rounding of their
                // edges.
                const double high = dot(normal, Point{j.x + k.x, j.y + k.y, j.z + k.z}) / 3.0;
                sum.x += high * normal.x, sum.y += high * normal.y, sum.z += high * normal.z;
            }
            const double by = count > 0 && !held[i] ? 1.0 / static_cast<double>(count) : 0.0;
            put(out, i, {own.x + by * sum.x, own.y + by * sum.y, own.z + by * sum.z});
        }
        return true;
    });
}

}  // namespace meshflow
