// Values on a mesh of tetrahedra: the weights of their edges, and the sums at vertices.
//
// Each tetrahedron has a frame of its own, which follows from its six squared lengths: leg 1 along the first axis, leg 2 in the plane
// of the first two. So the formula holds for points in a space of any dimension. Its edges are (0, 1), (0, 2), (0, 3), (1, 2),
// (1, 3), (2, 3).
#pragma once
#include "mesh_corners.h"
#include "tetrahedron.h"

namespace meshflow {

constexpr int EDGE_OF[4][4] = {{-1, 0, 1, 2}, {0, -1, 3, 4}, {1, 3, -1, 5}, {2, 4, 5, -1}};

// The gradient of values from their differences along the three legs, lower triangular; and the volume.
struct Frame {
    double xx, yx, yy, zx, zy, zz, volume;
};

// Weights (m, 6), minus the stiffness between the ends of each edge, and volumes (m,) of the tetrahedra lifted by values u (n, k).
// frames (m, 7). scale: alpha^2; 0: the ground itself. One channel runs along its gradient alone, where V0 / W^q takes the place of
// the metric: across it that one grows as W^q, which slivers make so large that rounding is left of implicit steps.
inline i64 tetrahedra_measured(i64, i64 k, i64 m, const double* u, const i32* cells, const double* frames, double scale,
                               double sharpness, double* weights, double* volumes, i32 threads) {
    grid::with_weight(sharpness, [&](auto weight) {
        using W = decltype(weight);
        parallel_blocks(m, MESH_BLOCK, threads, [&](i64 begin, i64 end, i64, i32) {
            for (i64 t = begin; t < end; ++t) {
                const i32* cell = cells + 4 * t;
                const double* f = frames + 7 * t;
                const Frame g{f[0], f[1], f[2], f[3], f[4], f[5], f[6]};
                const double *first = u + k * cell[0], *one = u + k * cell[1], *two = u + k * cell[2], *three = u + k * cell[3];
                double xx = 0, yy = 0, zz = 0, yz = 0, xz = 0, xy = 0;
                for (i64 c = 0; c < k; ++c) {
                    const double a = one[c] - first[c], b = two[c] - first[c], d = three[c] - first[c];
                    const double x = g.xx * a, y = g.yx * a + g.yy * b, z = (g.zx * a + g.zy * b) + g.zz * d;
                    xx += scale * (x * x), yy += scale * (y * y), zz += scale * (z * z);
                    yz += scale * (y * z), xz += scale * (x * z), xy += scale * (x * y);
                }
                if (k > 1) volumes[t] = g.volume * lifted<W>(sharpness, g.volume, xx, yy, zz, yz, xz, xy);
                else {
                    const double root = W::expansion(1.0 + (xx + (yy + zz)), sharpness);
                    volumes[t] = g.volume * root, xx = yy = zz = g.volume / root, yz = xz = xy = 0;
                }
                // G^T F G: the stiffness between the ends of the legs.
                const double x1 = xx * g.xx + xy * g.yx + xz * g.zx, y1 = xy * g.xx + yy * g.yx + yz * g.zx;
                const double z1 = xz * g.xx + yz * g.yx + zz * g.zx, y2 = yy * g.yy + yz * g.zy, z2 = yz * g.yy + zz * g.zy;
                const double k33 = g.zz * zz * g.zz, k13 = g.zz * z1, k23 = g.zz * z2, k12 = g.yy * y1 + g.zy * z1;
                const double k11 = g.xx * x1 + g.yx * y1 + g.zx * z1, k22 = g.yy * y2 + g.zy * z2;
                double* to = weights + 6 * t;
                to[0] = (k11 + k12) + k13, to[1] = (k12 + k22) + k23, to[2] = (k13 + k23) + k33;
                to[3] = -k12, to[4] = -k13, to[5] = -k23;
            }
        });
    });
    return 0;
}

// Sums over the tetrahedra around each vertex: of w_ij (u_i - u_j), (n, k); of a quarter of their volumes, (n,); and, unless it is
// null, of the weights above zero, (n,). Corner c of the mesh is corner c % 4 of tetrahedron c / 4.
inline i64 tetrahedra_gathered(i64 n, i64 c, i64 m, i64 k, const i64* first, const i32* corners, const i32* cells, const double* weights,
                               const double* volumes, const double* u, double* pull, double* quarters, double* attraction, i32 threads) {
    if (c != 4 * m) return OUT_OF_RANGE;
    return checked_blocks(n, threads, [&](i64 begin, i64 end) {
        if (!are_around(first, corners, begin, end, c)) return false;
        for (i64 i = begin; i < end; ++i) {
            double *sum = pull + k * i, quarter = 0.0, above = 0.0;
            for (i64 q = 0; q < k; ++q) sum[q] = 0.0;
            for (i64 at = first[i]; at < first[i + 1]; ++at) {
                const i64 t = corners[at] / 4, own = corners[at] % 4;
                quarter += 0.25 * volumes[t];
                for (i64 other = 0; other < 4; ++other) {
                    if (other == own) continue;
                    const double w = weights[6 * t + EDGE_OF[own][other]];
                    const double *here = u + k * i, *there = u + k * i64(cells[4 * t + other]);
                    for (i64 q = 0; q < k; ++q) sum[q] += w * (here[q] - there[q]);
                    above += w > 0.0 ? w : 0.0;
                }
            }
            quarters[i] = quarter;
            if (attraction) attraction[i] = above;
        }
        return true;
    });
}

}  // namespace meshflow
