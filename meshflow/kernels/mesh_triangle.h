// One triangle: its formulas, each once.
//
// A triangle is given by its quadratic form: dot[i] is the inner product of the two edges that start at corner i. Then the
// edge opposite corner 0 has squared length dot[1] + dot[2], and four times the squared area is det = dot0 dot1 + dot1 dot2 +
// dot2 dot0. Only lengths are used, so this holds in every dimension (Desbrun et al. 2000, section 5.4).
#pragma once
#include <cmath>

#include "grid_triangle.h"

namespace meshflow {

enum Mass : i64 { BARYCENTRIC, VORONOI, RING };  // as meshflow.geometry.operator.MASSES names them

template <class T> struct Dots { T dot[3], det; };
template <class T> struct Angles { T cot[3], area; };  // cotangents at the corners; all zero without area

template <class T> T greater(T a, T b) { return a < b ? b : a; }
template <class T> T lesser(T a, T b) { return b < a ? b : a; }

// The form of a triangle in R^D, or in d coordinates if D is 0. at(corner, q) returns coordinate q of a corner.
//
// Four times the squared area, |u|^2 |v|^2 - (u . v)^2, is computed as the sum of squared 2 x 2 minors (Lagrange). The difference
// of products would lose all digits for slivers and steep cliffs; the sum of squares loses none.
template <class T, int D, class At> Dots<T> form_of(const At& at, i64 d) {
    const i64 many = D ? D : d;
    Dots<T> form{};
    for (i64 q = 0; q < many; ++q) {
        const T u = at(1, q) - at(0, q), v = at(2, q) - at(0, q), w = at(2, q) - at(1, q);
        form.dot[0] += u * v, form.dot[1] -= u * w, form.dot[2] += v * w;
    }
    if constexpr (D == 3) {
        const T ux = at(1, 0) - at(0, 0), uy = at(1, 1) - at(0, 1), uz = at(1, 2) - at(0, 2);
        const T vx = at(2, 0) - at(0, 0), vy = at(2, 1) - at(0, 1), vz = at(2, 2) - at(0, 2);
        const T yz = uy * vz - uz * vy, zx = uz * vx - ux * vz, xy = ux * vy - uy * vx;
        form.det = yz * yz + zx * zx + xy * xy;
    } else {
        for (i64 p = 1; p < many; ++p) {
            const T up = at(1, p) - at(0, p), vp = at(2, p) - at(0, p);
            for (i64 q = 0; q < p; ++q) {
                const T minor = up * (at(2, q) - at(0, q)) - vp * (at(1, q) - at(0, q));
                form.det += minor * minor;
            }
        }
    }
    return form;
}

// The mixed term of det(A + B) = det A + det B + mixed; over det B it is |gradient|^2 = trace(A B^-1) of a free form A, base B.
template <class T> T mixed(const Dots<T>& a, const Dots<T>& b) {
    return greater(a.dot[0] * (b.dot[1] + b.dot[2]) + a.dot[1] * (b.dot[0] + b.dot[2]) + a.dot[2] * (b.dot[0] + b.dot[1]), T(0));
}

// A triangle measured in two spaces at once: |D|^2 = |D in the one|^2 + |D in the other|^2 for every edge.
template <class T> Dots<T> joint(const Dots<T>& a, const Dots<T>& b) {
    return {{a.dot[0] + b.dot[0], a.dot[1] + b.dot[1], a.dot[2] + b.dot[2]}, a.det + b.det + mixed(a, b)};
}

// The factor of the free part of a form for sharpness q (grid_weights.h), slope2 = W^2 - 1.
template <class T> T stretch(T slope2, T q) {
    return grid::with_weight(q, [&](auto weight) { return decltype(weight)::stretch(slope2, q); });
}

// `joint` of a free form, stretched for sharpness q, and a base form.
template <class T> Dots<T> sharpened(const Dots<T>& a, const Dots<T>& b, T q) {
    const T by = b.det > T(0) ? stretch(mixed(a, b) / b.det, q) : T(1);
    return joint(Dots<T>{{by * a.dot[0], by * a.dot[1], by * a.dot[2]}, by * by * a.det}, b);
}

// Cotangents of the three angles and the area: cot_i = dot_i / 2T, T = sqrt(det) / 2. All four are zero for a triangle without
// area.
template <class T> Angles<T> angles_of(const Dots<T>& form) {
    const T longest = greater(greater(form.dot[0] + form.dot[1], form.dot[1] + form.dot[2]), form.dot[2] + form.dot[0]);
    const T doubled = std::sqrt(form.det > T(0) ? form.det : T(0)), by = T(1) / doubled;
    const bool there = doubled > T(grid::FLAT) * longest;
    return {{there ? by * form.dot[0] : T(0), there ? by * form.dot[1] : T(0), there ? by * form.dot[2] : T(0)},
            there ? T(0.5) * doubled : T(0)};
}

// The term of an edge in the area gradient of a coordinate at its end x, for the triangle with cotangent `cot` opposite to it.
template <class T> T tension(T cot, T x, T other) { return T(0.5) * cot * (x - other); }

// The term of triangle i, j, k in the area gradient of a coordinate at i (13): (cot_k (x_i - x_j) + cot_j (x_i - x_k)) / 2.
template <class T> T pull(T at_j, T at_k, T x, T x_j, T x_k) { return tension(at_k, x, x_j) + tension(at_j, x, x_k); }

// The part of the area of a triangle that is the mass of its corner 0.
//
// Barycentric: T / 3. Voronoi (mixed, Meyer et al. 2002): T (1 + cot1 cot2) / 4 where no angle is obtuse (that is
// (b cot B + c cot C) / 8), else T / 2 at the obtuse corner and T / 4 at the others. Ring: T.
template <Mass KIND, class T> T share([[maybe_unused]] T cot0, [[maybe_unused]] T cot1, [[maybe_unused]] T cot2, T area) {
    if constexpr (KIND == BARYCENTRIC) return area / T(3);
    else if constexpr (KIND == RING) return area;
    else return grid::voronoi_share(cot0, cot1, cot2, area);
}

// Calls work.template operator()<KIND>() for a kind of mass.
template <class F> void for_mass(i64 kind, const F& work) {
    if (kind == BARYCENTRIC) work.template operator()<BARYCENTRIC>();
    else if (kind == VORONOI) work.template operator()<VORONOI>();
    else work.template operator()<RING>();
}

// The largest eigenvalue of the stiffness of the triangle over its smallest mass: an upper bound of lambda_max(M^-1 L).
//
// (t / 2 + sqrt(t^2 / 4 - 3 / 4)) / smallest share, t = cot A + cot B + cot C = (a + b + c) / 4T >= sqrt 3; with the barycentric
// third of T it is exact for a single triangle. On a grid of spacing h and any heights it is at most 12 / h^2.
template <Mass KIND, class T> T bound(const T* cot, T area) {
    if (!(area > T(0))) return T(0);
    const T smallest = lesser(lesser(share<KIND>(cot[0], cot[1], cot[2], area), share<KIND>(cot[1], cot[2], cot[0], area)),
                              share<KIND>(cot[2], cot[0], cot[1], area));
    const T half = T(0.5) * (cot[0] + cot[1] + cot[2]);
    return (half + std::sqrt(greater(half * half - T(0.75), T(0)))) / smallest;
}

}  // namespace meshflow
