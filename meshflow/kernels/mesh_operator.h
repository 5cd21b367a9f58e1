// The cotangent operator of a mesh: quantities of triangles, and their sums at vertices.
#pragma once
#include "mesh_corners.h"
#include "mesh_triangle.h"

namespace meshflow {

// Cotangents (m, 3) and areas (m,) of the triangles of points (n, d). forms (m, 4), or null: squared lengths in further
// coordinates, which are added to those of the points and stretched by the sharpness relative to them.
template <int D> i64 measure(i64 d, i64 m, const double* points, const i32* faces, const double* forms, double sharpness,
                             double* cot, double* area, i32 threads) {
    parallel_blocks(m, MESH_BLOCK, threads, [&](i64 begin, i64 end, i64, i32) {
        for (i64 f = begin; f < end; ++f) {
            const i32* corners = faces + 3 * f;
            Dots<double> form = form_of<double, D>([&](int c, i64 q) { return points[(D ? D : d) * corners[c] + q]; }, d);
            if (forms) {
                const double* base = forms + 4 * f;
                form = sharpened(form, Dots<double>{{base[0], base[1], base[2]}, base[3]}, sharpness);
            }
            const Angles<double> angles = angles_of(form);
            for (int c = 0; c < 3; ++c) cot[3 * f + c] = angles.cot[c];
            area[f] = angles.area;
        }
    });
    return 0;
}

inline i64 triangle_angles(i64, i64 d, i64 m, const double* points, const i32* faces, const double* forms, double sharpness,
                           double* cot, double* area, i32 threads) {
    if (d == 2) return measure<2>(d, m, points, faces, forms, sharpness, cot, area, threads);
    if (d == 3) return measure<3>(d, m, points, faces, forms, sharpness, cot, area, threads);
    if (d == 4) return measure<4>(d, m, points, faces, forms, sharpness, cot, area, threads);
    if (d == 6) return measure<6>(d, m, points, faces, forms, sharpness, cot, area, threads);
    return measure<0>(d, m, points, faces, forms, sharpness, cot, area, threads);
}

// Cotangents (m, 3) and areas (m,) of triangles given by their forms (m, 4).
inline i64 form_angles(i64 m, const double* forms, double* cot, double* area, i32 threads) {
    parallel_blocks(m, MESH_BLOCK, threads, [&](i64 begin, i64 end, i64, i32) {
        for (i64 f = begin; f < end; ++f) {
            const double* form = forms + 4 * f;
            const Angles<double> angles = angles_of(Dots<double>{{form[0], form[1], form[2]}, form[3]});
            for (int c = 0; c < 3; ++c) cot[3 * f + c] = angles.cot[c];
            area[f] = angles.area;
        }
    });
    return 0;
}

// The forms (m, 4) of triangles given by the coordinates of their corners (m, 3, d).
inline i64 chart_forms(i64 m, i64 d, const double* charts, double* forms, i32 threads) {
    parallel_blocks(m, MESH_BLOCK, threads, [&](i64 begin, i64 end, i64, i32) {
        for (i64 f = begin; f < end; ++f) {
            const Dots<double> form = form_of<double, 0>([&](int c, i64 q) { return charts[(3 * f + c) * d + q]; }, d);
            for (int c = 0; c < 3; ++c) forms[4 * f + c] = form.dot[c];
            forms[4 * f + 3] = form.det;
        }
    });
    return 0;
}

// The bound (m,) of the eigenvalues of M^-1 L of each triangle.
inline i64 triangle_bounds(i64 m, const double* cot, const double* area, i64 kind, double* bounds, i32 threads) {
    for_mass(kind, [&]<Mass KIND>() {
        parallel_blocks(m, MESH_BLOCK, threads, [&](i64 begin, i64 end, i64, i32) {
            for (i64 f = begin; f < end; ++f) bounds[f] = bound<KIND>(cot + 3 * f, area[f]);
        });
    });
    return 0;
}

// The mass (n,) of each vertex. c is the number of corners of the mesh, three per triangle, here and below.
inline i64 vertex_mass(i64 n, i64 c, i64 m, const i64* first, const i32* corners, const double* cot, const double* area, i64 kind,
                       double* mass, i32 threads) {
    if (c != 3 * m) return OUT_OF_RANGE;
    i64 done = 0;
    for_mass(kind, [&]<Mass KIND>() {
        done = checked_blocks(n, threads, [&](i64 begin, i64 end) {
            if (!are_around(first, corners, begin, end, c)) return false;
            for (i64 i = begin; i < end; ++i) {
                double total = 0.0;
                for (i64 t = first[i]; t < first[i + 1]; ++t) {
                    const Corner at(corners[t]);
                    total += share<KIND>(cot[at.c], cot[at.b], cot[at.d], area[at.triangle()]);
                }
                mass[i] = total;
            }
            return true;
        });
    });
    return done;
}

// The sum of each vertex for d coordinates; at(c) returns those of corner c of the mesh.
template <int D, class At> i64 gather_gradient(i64 n, i64 c, i64 d, const i64* first, const i32* corners, const double* cot,
                                               const At& at, double* gradient, i32 threads) {
    const i64 many = D ? D : d;
    return checked_blocks(n, threads, [&](i64 begin, i64 end) {
        if (!are_around(first, corners, begin, end, c)) return false;
        for (i64 i = begin; i < end; ++i) {
            double* sum = gradient + many * i;
            for (i64 q = 0; q < many; ++q) sum[q] = 0.0;
            for (i64 t = first[i]; t < first[i + 1]; ++t) {
                const Corner corner(corners[t]);
                const double at_j = cot[corner.b], at_k = cot[corner.d];
                const double *x = at(corner.c), *x_j = at(corner.b), *x_k = at(corner.d);
                for (i64 q = 0; q < many; ++q) sum[q] += pull(at_j, at_k, x[q], x_j[q], x_k[q]);
            }
        }
        return true;
    });
}

// The gradient (n, d) of the area with respect to points (n, d), in the metric of the cotangents.
inline i64 area_gradient(i64 n, i64 c, i64 m, i64 d, const i64* first, const i32* corners, const i32* faces, const double* cot,
                         const double* points, double* gradient, i32 threads) {
    if (c != 3 * m) return OUT_OF_RANGE;
    const auto of = [&]<int D>() {
        const i64 many = D ? D : d;
        const auto at = [&](std::uint32_t corner) { return points + many * faces[corner]; };
        return gather_gradient<D>(n, c, d, first, corners, cot, at, gradient, threads);
    };
    if (d == 1) return of.template operator()<1>();
    if (d == 2) return of.template operator()<2>();
    if (d == 3) return of.template operator()<3>();
    return of.template operator()<0>();
}

// The same for coordinates of corners (m, 3, d) in a separate chart for each triangle.
inline i64 chart_gradient(i64 n, i64 c, i64 m, i64 d, const i64* first, const i32* corners, const double* cot,
                          const double* charts, double* gradient, i32 threads) {
    if (c != 3 * m) return OUT_OF_RANGE;
    const auto at = [&](std::uint32_t corner) { return charts + d * corner; };
    return gather_gradient<0>(n, c, d, first, corners, cot, at, gradient, threads);
}

// Subtracts from the area gradient (n, d) the term at both ends of each boundary edge that is due to the missing triangle: half
// the outward conormal times the length of the edge, -(cot_i (X_k - X_j) + cot_j (X_k - X_i)). border (b,): the corners opposite
// to these edges; charts (b, 3, d): the coordinates of the corners of their triangles.
inline i64 border_conormals(i64 b, i64 m, i64 d, i64, const i64* border, const i32* faces, const double* cot,
                            const double* charts, double* gradient) {
    for (i64 t = 0; t < b; ++t) {
        if (border[t] < 0 || border[t] >= 3 * m) return OUT_OF_RANGE;
        const Corner at(static_cast<i32>(border[t]));
        const std::uint32_t base = 3 * at.triangle();
        const double* chart = charts + 3 * d * t;
        const double *x_k = chart + d * (at.c - base), *x_i = chart + d * (at.b - base), *x_j = chart + d * (at.d - base);
        double *at_i = gradient + d * faces[at.b], *at_j = gradient + d * faces[at.d];
        for (i64 q = 0; q < d; ++q) {
            const double half = 0.5 * (cot[at.b] * (x_k[q] - x_j[q]) + cot[at.d] * (x_k[q] - x_i[q]));
            at_i[q] += half, at_j[q] += half;
        }
    }
    return 0;
}

// The area (n,) of the triangles around each vertex, projected along its direction (n, 3), in R^3.
inline i64 area_seen(i64 n, i64 c, i64 m, const i64* first, const i32* corners, const i32* faces, const double* points,
                     const double* directions, double* seen, i32 threads) {
    if (c != 3 * m) return OUT_OF_RANGE;
    return checked_blocks(n, threads, [&](i64 begin, i64 end) {
        if (!are_around(first, corners, begin, end, c)) return false;
        for (i64 i = begin; i < end; ++i) {
            const double rx = directions[3 * i], ry = directions[3 * i + 1], rz = directions[3 * i + 2];
            const double length = std::sqrt(rx * rx + ry * ry + rz * rz);
            double total = 0.0;
            for (i64 t = first[i]; t < first[i + 1]; ++t) {
                const i32* face = faces + 3 * i64(Corner(corners[t]).triangle());
                const double *x = points + 3 * i64(face[0]), *y = points + 3 * i64(face[1]), *z = points + 3 * i64(face[2]);
                const double ux = y[0] - x[0], uy = y[1] - x[1], uz = y[2] - x[2];
                const double vx = z[0] - x[0], vy = z[1] - x[1], vz = z[2] - x[2];
                total += std::fabs(rx * (uy * vz - uz * vy) + ry * (uz * vx - ux * vz) + rz * (ux * vy - uy * vx));
            }
            seen[i] = length > 0.0 ? 0.5 * total / length : 0.0;
        }
        return true;
    });
}

// The values (e,) of the stiffness matrix in the pattern of the mesh: L, or L_ij (d_i . d_j) with directions (n, 3).
struct Places {
    const i32 *indptr, *indices, *diagonal;
    const u8* slots;
};
template <bool MOVES> i64 fill(i64 n, i64 c, i64 e, const i64* first, const i32* corners, const i32* faces, const Places& places,
                               const double* cot, const double* rays, double* data, i32 threads) {
    const auto dot = [&](i64 i, i64 j) {
        const double *a = rays + 3 * i, *b = rays + 3 * j;
        return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    };
    return checked_blocks(n, threads, [&](i64 begin, i64 end) {
        if (!are_around(first, corners, begin, end, c) || !are_rising(places.indptr, begin, end, e) ||
            !are_below(places.diagonal + begin, end - begin, e))
            return false;
        for (i64 i = begin; i < end; ++i) {
            const i64 base = places.indptr[i], count = places.indptr[i + 1] - base;
            double *row = data + base, own = 0.0;
            for (i64 at = 0; at < count; ++at) row[at] = 0.0;
            for (i64 t = first[i]; t < first[i + 1]; ++t) {
                const Corner at(corners[t]);
                i64 j = places.slots[2 * t], k = places.slots[2 * t + 1];
                if (j == FARTHER) j = place_in_row(places.indices + base, count, faces[at.b]);
                if (k == FARTHER) k = place_in_row(places.indices + base, count, faces[at.d]);
                if (j >= count || k >= count) return false;
                double to_j = 0.5 * cot[at.d], to_k = 0.5 * cot[at.b], both = 0.5 * (cot[at.b] + cot[at.d]);
                if constexpr (MOVES) to_j *= dot(i, faces[at.b]), to_k *= dot(i, faces[at.d]), both *= dot(i, i);
                row[j] -= to_j, row[k] -= to_k, own += both;
            }
            data[places.diagonal[i]] += own;
        }
        return true;
    });
}

inline i64 fill_stiffness(i64 n, i64 c, i64 m, i64 e, const i64* first, const i32* corners, const i32* faces, const i32* indptr,
                          const i32* indices, const u8* slots, const i32* diagonal, const double* cot, const double* rays,
                          double* data, i32 threads) {
    if (c != 3 * m) return OUT_OF_RANGE;
    const Places places{indptr, indices, diagonal, slots};
    if (rays) return fill<true>(n, c, e, first, corners, faces, places, cot, rays, data, threads);
    return fill<false>(n, c, e, first, corners, faces, places, cot, rays, data, threads);
}

}  // namespace meshflow
