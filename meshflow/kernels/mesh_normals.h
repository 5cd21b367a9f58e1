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

// Lengths (m, 3) of the sides opposite to each corner, of triangles of points (n, d).
inline i64 side_lengths(i64, i64 d, i64 m, const double* points, const i32* faces, double* lengths, i32 threads) {
    parallel_blocks(m, MESH_BLOCK, threads, [&](i64 begin, i64 end, i64, i32) {
        for (i64 f = begin; f < end; ++f)
            for (int c = 0; c < 3; ++c) {
                const double *a = points + d * i64(faces[3 * f + (c + 1) % 3]), *b = points + d * i64(faces[3 * f + (c + 2) % 3]);
                double square = 0.0;
                for (i64 k = 0; k < d; ++k) square += (a[k] - b[k]) * (a[k] - b[k]);
                lengths[3 * f + c] = std::sqrt(square);
            }
    });
    return 0;
}

// Triangles are gathered by so many, so that the loop over them is compiled to SIMD.
constexpr int GATHERED = 64;

// The corners of some triangles, and the far corners of the triangles beyond each side.
struct Pairs { double at[3][3][GATHERED], beyond[3][3][GATHERED], there[3][GATHERED], conductance[3][GATHERED]; };

LOOP inline void conductances_of_some(Pairs& of, int count) {
    for (int c = 0; c < 3; ++c) {
        const int d = (c + 1) % 3, e = (c + 2) % 3;
        SIMD for (int i = 0; i < count; ++i) {
            double side = 0.0, here = 0.0, there = 0.0;
            UNROLL for (int k = 0; k < 3; ++k) {
                const double a = of.at[d][k][i], b = of.at[e][k][i], middle = 0.5 * (a + b);
                const double own = of.at[c][k][i] - middle, its = of.beyond[c][k][i] - middle;
                side += (a - b) * (a - b), here += own * own, there += its * its;
            }
            // A centroid is a third of the way from the middle of a side to the corner opposite.
            const double way = std::sqrt(here) + std::sqrt(there), wide = 3.0 * std::sqrt(side) / way;
            of.conductance[c][i] = way > 0.0 ? of.there[c][i] * wide : 0.0;
        }
    }
}

// |e| / |d| (m, 3) of the edge e opposite to each corner, where |d| is the length of the path between the centroids over the
// middle of e; zero if across (m, 3), the triangle on the other side, is negative.
inline i64 edge_conductances(i64 n, i64 m, const double* points, const i32* faces, const i32* across, double* conductances,
                             i32 threads) {
    return checked_blocks(m, threads, [&](i64 begin, i64 end) {
        Pairs of;
        for (; begin < end; begin += GATHERED) {
            const int count = static_cast<int>(end - begin < GATHERED ? end - begin : GATHERED);
            bool sound = true;
            for (int i = 0; i < count; ++i) {
                const i32* face = faces + 3 * (begin + i);
                for (int c = 0; c < 3; ++c) {
                    const i64 g = across[3 * (begin + i) + c];
                    i64 far = face[c];
                    of.there[c][i] = 0.0;
                    if (g >= 0 && g < m) {
                        const i32* other = faces + 3 * g;
                        far = i64(other[0]) + other[1] + other[2] - face[(c + 1) % 3] - face[(c + 2) % 3];
                        of.there[c][i] = 1.0;
                    }
                    sound &= g < m && far >= 0 && far < n;
                    far = sound ? far : 0;
                    for (int k = 0; k < 3; ++k) {
                        of.at[c][k][i] = points[3 * i64(face[c]) + k];
                        of.beyond[c][k][i] = points[3 * far + k];
                    }
                }
            }
            if (!sound) return false;
            conductances_of_some(of, count);
            for (int i = 0; i < count; ++i)
                for (int c = 0; c < 3; ++c) conductances[3 * (begin + i) + c] = of.conductance[c][i];
        }
        return true;
    });
}

// stretch^power. SQUARINGS: the power is -2^SQUARINGS, for sharpness 2, 4 and 8, by products, because pow would dominate the
// time.
template <int SQUARINGS> INLINE double conducting(double stretch, double power) {
    if constexpr (SQUARINGS < 0) return grid::raised(stretch, power);
    const double by = 1.0 / stretch;
    if constexpr (SQUARINGS == 1) return by * by;
    if constexpr (SQUARINGS == 2) return by * by * by * by;
    return by;
}

// How normals are spread: see spread_normals.
struct Spreading { double dt, contrast2, power, keep, pull; };

// Some triangles and those beyond their sides; the weight of a side without one is zero.
struct Sides {
    double own[3][GATHERED], its[3][3][GATHERED], weight[3][GATHERED], area[GATHERED], back[3][GATHERED];
};

template <int SQUARINGS> LOOP void spread_some(Sides& at, int count, Spreading by) {
    SIMD for (int i = 0; i < count; ++i) {
        const double x = at.own[0][i], y = at.own[1][i], z = at.own[2][i], area = at.area[i];
        double sx = area * x, sy = area * y, sz = area * z;
        UNROLL for (int c = 0; c < 3; ++c) {
            const double u = at.its[c][0][i], v = at.its[c][1][i], w = at.its[c][2][i];
            const double turn = (u - x) * (u - x) + (v - y) * (v - y) + (w - z) * (w - z);
            const double much = by.dt * at.weight[c][i] * conducting<SQUARINGS>(1.0 + by.contrast2 * turn, by.power);
            sx += much * u, sy += much * v, sz += much * w;
        }
        const double length = std::sqrt(sx * sx + sy * sy + sz * sz), one = length > 0.0 ? by.pull / length : 0.0;
        const double stays = 1.0 - by.keep - (length > 0.0 ? by.pull : 0.0);
        const double tx = stays * x + by.keep * at.back[0][i] + one * sx;
        const double ty = stays * y + by.keep * at.back[1][i] + one * sy;
        const double tz = stays * z + by.keep * at.back[2][i] + one * sz;
        const double size = std::sqrt(tx * tx + ty * ty + tz * tz), unit = 1.0 / size;
        at.back[0][i] = size > 0.0 ? tx * unit : x;
        at.back[1][i] = size > 0.0 ? ty * unit : y;
        at.back[2][i] = size > 0.0 ? tz * unit : z;
    }
}

template <int SQUARINGS> i64 spread(i64 m, const double* normals, const double* areas, const double* weights, const i32* across,
                                    Spreading by, double* out, i32 threads) {
    const double* from = by.keep != 0.0 ? out : normals;
    return checked_blocks(m, threads, [&](i64 begin, i64 end) {
        Sides at;
        for (; begin < end; begin += GATHERED) {
            const int count = static_cast<int>(end - begin < GATHERED ? end - begin : GATHERED);
            bool sound = true;
            for (int i = 0; i < count; ++i) {
                const i64 f = begin + i;
                for (int k = 0; k < 3; ++k) at.own[k][i] = normals[3 * f + k], at.back[k][i] = from[3 * f + k];
                at.area[i] = areas[f];
                for (int c = 0; c < 3; ++c) {
                    const i64 g = across[3 * f + c], there = g >= 0 && g < m ? g : f;
                    sound &= g < m;
                    at.weight[c][i] = g < 0 ? 0.0 : weights[3 * f + c];
                    for (int k = 0; k < 3; ++k) at.its[c][k][i] = normals[3 * there + k];
                }
            }
            if (!sound) return false;
            spread_some<SQUARINGS>(at, count, by);
            for (int i = 0; i < count; ++i)
                for (int k = 0; k < 3; ++k) out[3 * (begin + i) + k] = at.back[k][i];
        }
        return true;
    });
}

// One stage of the diffusion of unit normals (m, 3). Its sweep is a step dt that is implicit in the triangle itself:
// A s = A n + dt sum of w (1 + contrast2 |n_beyond - n|^2)^power n_beyond, normalized. out holds the normals of the stage before n,
// which are not read if keep is zero, and becomes n + keep (out - n) + pull (s - n), normalized.
inline i64 spread_normals(i64 m, const double* normals, const double* areas, const double* weights, const i32* across, double dt,
                          double contrast2, double power, double keep, double pull, double* out, i32 threads) {
    const Spreading by{dt, contrast2, power, keep, pull};
    const auto with = [&](auto one) { return one(m, normals, areas, weights, across, by, out, threads); };
    if (power == -1.0) return with(spread<0>);
    if (power == -2.0) return with(spread<1>);
    if (power == -4.0) return with(spread<2>);
    return with(spread<-1>);
}

// weights (m, 3) times (1 + contrast2 |n_beyond - n|^2)^power, to out; zero where across (m, 3) is negative.
template <int SQUARINGS> i64 weigh(i64 m, const double* normals, const double* weights, const i32* across, double contrast2,
                                   double power, double* out, i32 threads) {
    return checked_blocks(m, threads, [&](i64 begin, i64 end) {
        for (i64 at = 3 * begin; at < 3 * end; ++at) {
            const i64 g = across[at];
            if (g >= m) return false;
            const Point turn = minus(vector_at(normals, g < 0 ? at / 3 : g), vector_at(normals, at / 3));
            out[at] = g < 0 ? 0.0 : weights[at] * conducting<SQUARINGS>(1.0 + contrast2 * dot(turn, turn), power);
        }
        return true;
    });
}

inline i64 crease_weights(i64 m, const double* normals, const double* weights, const i32* across, double contrast2, double power,
                          double* out, i32 threads) {
    const auto with = [&](auto one) { return one(m, normals, weights, across, contrast2, power, out, threads); };
    if (power == -2.0) return with(weigh<1>);
    return with(weigh<-1>);
}

// One stage of means of pairs of values (m, 2) on triangles. With D v = sum of w (v - v_beyond) over the sides of each, weights w
// (m, 3), before, of the stage before v, becomes scale D v - twice v - before.
inline i64 average_pairs(i64 m, const double* weights, const i32* across, double scale, double twice, const double* values,
                         double* before, i32 threads) {
    return checked_blocks(m, threads, [&](i64 begin, i64 end) {
        bool sound = true;
        for (i64 f = begin; f < end; ++f) {
            const double *w = weights + 3 * f, a = values[2 * f], b = values[2 * f + 1];
            double of_a = 0.0, of_b = 0.0;
            for (int c = 0; c < 3; ++c) {
                const i64 g = across[3 * f + c], there = g >= 0 && g < m ? g : f;
                sound &= g < m;
                of_a += w[c] * (a - values[2 * there]), of_b += w[c] * (b - values[2 * there + 1]);
            }
            before[2 * f] = scale * of_a - twice * a - before[2 * f];
            before[2 * f + 1] = scale * of_b - twice * b - before[2 * f + 1];
        }
        return sound;
    });
}

// Unit vectors (n, 3), to out: the directions of the sums of normals (m, 3) times weights (m,) over the triangles around each vertex;
// zero where that sum is.
inline i64 vertex_normals(i64 n, i64 c, i64 m, const i64* first, const i32* corners, const double* normals, const double* weights,
                          double* out, i32 threads) {
    if (c != 3 * m) return OUT_OF_RANGE;
    return checked_blocks(n, threads, [&](i64 begin, i64 end) {
        if (!are_around(first, corners, begin, end, c)) return false;
        for (i64 i = begin; i < end; ++i) {
            Point sum{0.0, 0.0, 0.0};
            for (i64 t = first[i]; t < first[i + 1]; ++t) {
                const i64 f = static_cast<std::uint32_t>(corners[t]) / 3;
                const Point k = vector_at(normals, f);
                sum.x += weights[f] * k.x, sum.y += weights[f] * k.y, sum.z += weights[f] * k.z;
            }
            const double length = std::sqrt(dot(sum, sum)), by = length > 0.0 ? 1.0 / length : 0.0;
            put(out, i, {by * sum.x, by * sum.y, by * sum.z});
        }
        return true;
    });
}

// The solution of a x = b, a (3, 3) symmetric and positive definite, packed as xx, xy, xz, yy, yz, zz.
inline Point solved(const double* a, Point b) {
    const double yz = a[3] * a[5] - a[4] * a[4], xz = a[2] * a[4] - a[1] * a[5], xy = a[1] * a[4] - a[2] * a[3];
    const double by = 1.0 / (a[0] * yz + a[1] * xz + a[2] * xy);
    const double zx = a[0] * a[5] - a[2] * a[2], zy = a[1] * a[2] - a[0] * a[4], zz = a[0] * a[3] - a[1] * a[1];
    return {by * (yz * b.x + xz * b.y + xy * b.z), by * (xz * b.x + zx * b.y + zy * b.z), by * (xy * b.x + zy * b.y + zz * b.z)};
}

// Motions (n, 3) of the vertices, to out: the solution of least squares of n_f . x = offset_f over the triangles f around each,
// with weights (m,); what lies in directions that hold less than the share ridge of the squares of the normals is small. The ridge is
// refined away in the others.
inline i64 shift_along_normals(i64 n, i64 c, i64 m, const i64* first, const i32* corners, const double* normals,
                               const double* weights, const double* offsets, double ridge, double* out, i32 threads) {
    constexpr int REFINED = 3;
    if (c != 3 * m) return OUT_OF_RANGE;
    return checked_blocks(n, threads, [&](i64 begin, i64 end) {
        if (!are_around(first, corners, begin, end, c)) return false;
        for (i64 i = begin; i < end; ++i) {
            double a[6] = {};
            Point pull{0.0, 0.0, 0.0}, x{0.0, 0.0, 0.0};
            for (i64 t = first[i]; t < first[i + 1]; ++t) {
                const i64 f = static_cast<std::uint32_t>(corners[t]) / 3;
                const Point k = vector_at(normals, f);
                const double w = weights[f], p = w * offsets[f];
                a[0] += w * k.x * k.x, a[1] += w * k.x * k.y, a[2] += w * k.x * k.z;
                a[3] += w * k.y * k.y, a[4] += w * k.y * k.z, a[5] += w * k.z * k.z;
                pull.x += p * k.x, pull.y += p * k.y, pull.z += p * k.z;
            }
            const double total = a[0] + a[3] + a[5], by = total > 0.0 ? 1.0 / total : 0.0;
            for (double& entry : a) entry *= by;
            double held[6] = {a[0] + ridge, a[1], a[2], a[3] + ridge, a[4], a[5] + ridge};
            for (int round = 0; round < REFINED; ++round) {
                const Point left{by * pull.x - (a[0] * x.x + a[1] * x.y + a[2] * x.z),
                                 by * pull.y - (a[1] * x.x + a[3] * x.y + a[4] * x.z),
                                 by * pull.z - (a[2] * x.x + a[4] * x.y + a[5] * x.z)};
                const Point more = solved(held, left);
                x = {x.x + more.x, x.y + more.y, x.z + more.z};
            }
            put(out, i, x);
        }
        return true;
    });
}

// The corners of some triangles with their normals, and n . (c - x) at each corner x, c the centroid.
struct Corners { double at[3][3][GATHERED], normal[3][GATHERED], height[3][GATHERED]; };

LOOP inline void heights_of_some(Corners& of, int count) {
    for (int c = 0; c < 3; ++c) {
        const int d = (c + 1) % 3, e = (c + 2) % 3;
        SIMD for (int i = 0; i < count; ++i) {
            // By differences, so that planes far from the origin do not move, up to the rounding of their edges.
            const double x = (of.at[d][0][i] - of.at[c][0][i]) + (of.at[e][0][i] - of.at[c][0][i]);
            const double y = (of.at[d][1][i] - of.at[c][1][i]) + (of.at[e][1][i] - of.at[c][1][i]);
            const double z = (of.at[d][2][i] - of.at[c][2][i]) + (of.at[e][2][i] - of.at[c][2][i]);
            of.height[c][i] = (of.normal[0][i] * x + of.normal[1][i] * y + of.normal[2][i] * z) / 3.0;
        }
    }
}

inline void heights_at_corners(i64 m, const double* points, const i32* faces, const double* normals, double* heights, i32 threads) {
    parallel_blocks(m, MESH_BLOCK, threads, [&](i64 begin, i64 end, i64, i32) {
        Corners of;
        for (; begin < end; begin += GATHERED) {
            const int count = static_cast<int>(end - begin < GATHERED ? end - begin : GATHERED);
            for (int i = 0; i < count; ++i) {
                const i64 f = begin + i;
                for (int k = 0; k < 3; ++k) of.normal[k][i] = normals[3 * f + k];
                for (int c = 0; c < 3; ++c)
                    for (int k = 0; k < 3; ++k) of.at[c][k][i] = points[3 * i64(faces[3 * f + c]) + k];
            }
            heights_of_some(of, count);
            for (int i = 0; i < count; ++i)
                for (int c = 0; c < 3; ++c) heights[3 * (begin + i) + c] = of.height[c][i];
        }
    });
}

// One stage of a motion of points (n, 3). Its sweep adds the mean of n_f n_f . (c_f - x_i) over the triangles f around each, with
// centroids c_f and normals n_f (m, 3). out holds the points of the stage before x (not read if keep is zero), and becomes
// x + keep (out - x) + pull times that mean. held (n,): points that do not move. heights (m, 3): work space.
inline i64 follow_normals(i64 n, i64 c, i64 m, const double* points, const i64* first, const i32* corners, const i32* faces,
                          const double* normals, const u8* held, double keep, double pull, double* heights, double* out,
                          i32 threads) {
    if (c != 3 * m) return OUT_OF_RANGE;
    heights_at_corners(m, points, faces, normals, heights, threads);
    return checked_blocks(n, threads, [&](i64 begin, i64 end) {
        if (!are_around(first, corners, begin, end, c)) return false;
        for (i64 i = begin; i < end; ++i) {
            const Point own = vector_at(points, i);
            Point sum{0.0, 0.0, 0.0};
            const i64 count = first[i + 1] - first[i];
            for (i64 t = first[i]; t < first[i + 1]; ++t) {
                const std::uint32_t corner = static_cast<std::uint32_t>(corners[t]);
                const Point normal = vector_at(normals, corner / 3);
                const double high = heights[corner];
                sum.x += high * normal.x, sum.y += high * normal.y, sum.z += high * normal.z;
            }
            const bool moves = count > 0 && !held[i];
            const double by = moves ? pull / static_cast<double>(count) : 0.0, kept = moves ? keep : 0.0;
            const Point back = minus(vector_at(keep != 0.0 ? out : points, i), own);
            put(out, i, {own.x + (kept * back.x + by * sum.x), own.y + (kept * back.y + by * sum.y),
                         own.z + (kept * back.z + by * sum.z)});
        }
        return true;
    });
}

}  // namespace meshflow
