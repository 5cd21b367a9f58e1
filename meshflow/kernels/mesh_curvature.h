// Weights of a diffusion that follows the principal directions of a mesh.
#pragma once
#include "mesh_normals.h"

namespace meshflow {

// 1 / (1 + k^8).
inline double drawing(double k) {
    const double k2 = k * k, k4 = k2 * k2;
    return 1.0 / (1.0 + k4 * k4);
}

// u . D v of a symmetric form (xx, xy, yy) with D = sum of g(k / threshold) e e^T over its eigenvalues k and vectors e.
struct Bending {
    double xx, xy, yy;
    double draw(double ux, double uy, double vx, double vy, double threshold) const {
        const double mean = 0.5 * (xx + yy), half = 0.5 * (xx - yy), apart = std::sqrt(half * half + xy * xy);
        const double high = drawing((mean + apart) / threshold), low = drawing((mean - apart) / threshold);
        const double along = ux * vx + uy * vy;
        if (apart == 0.0) return high * along;
        // The mean of both, and their difference times the traceless form, normalized to eigenvalues 1 and -1.
        const double turned = half * (ux * vx - uy * vy) + xy * (ux * vy + uy * vx);
        return 0.5 * ((high + low) * along + (high - low) * turned / apart);
    }
};

// For each corner -2 A grad_i . D grad_j (m, 3) of the other two corners i and j, with D from the normals (n, 3) at the corners;
// zero for triangles without area. points (n, 3).
inline i64 directed_weights(i64, i64 m, const double* points, const i32* faces, const double* normals, double threshold,
                            double* weights, i32 threads) {
    parallel_blocks(m, MESH_BLOCK, threads, [&](i64 begin, i64 end, i64, i32) {
        for (i64 f = begin; f < end; ++f) {
            // The triangle in its plane, from corner 0 along the side to corner 1: (0, 0), (a, 0), (p, q).
            const Point origin = vector_at(points, faces[3 * f]);
            const Point side = minus(vector_at(points, faces[3 * f + 1]), origin);
            const Point other = minus(vector_at(points, faces[3 * f + 2]), origin);
            const double a = std::sqrt(dot(side, side));
            const Point x = a > 0.0 ? Point{side.x / a, side.y / a, side.z / a} : side;
            const double p = dot(other, x);
            const Point up{other.x - p * x.x, other.y - p * x.y, other.z - p * x.z};
            const double q = std::sqrt(dot(up, up)), doubled = a * q;
            if (!(doubled > 0.0)) {
                for (int c = 0; c < 3; ++c) weights[3 * f + c] = 0.0;
                continue;
            }
            const Point y{up.x / q, up.y / q, up.z / q};
            // Gradients of the three hat functions, and of the normals.
            const double gx[3] = {-q / doubled, q / doubled, 0.0}, gy[3] = {(p - a) / doubled, -p / doubled, a / doubled};
            Bending form{0.0, 0.0, 0.0};
            for (int c = 0; c < 3; ++c) {
                const Point normal = vector_at(normals, faces[3 * f + c]);
                const double nx = dot(normal, x), ny = dot(normal, y);
                form.xx += nx * gx[c], form.yy += ny * gy[c], form.xy += 0.5 * (nx * gy[c] + ny * gx[c]);
            }
            for (int c = 0; c < 3; ++c) {
                const int i = (c + 1) % 3, j = (c + 2) % 3;
                weights[3 * f + c] = -doubled * form.draw(gx[i], gy[i], gx[j], gy[j], threshold);
            }
        }
    });
    return 0;
}

}  // namespace meshflow
