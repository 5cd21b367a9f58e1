// One triangle: its formulas, each once.
//
// A triangle of a grid has its right angle at P, a leg along the row to Q and a leg along the column to R. With a, b the
// differences of the free coordinates along the legs, x, y the legs on the ground (0 for points in space), s = alpha^2 times the
// stretch of the sharpness, and the minors m_ij = a_i b_j - a_j b_i,
//
//     (2T)^2 = x^2 y^2 + s (x^2 |b|^2 + y^2 |a|^2) + s^2 sum m_ij^2
//     gradient of the area at Q: (y^2 a_i + s sum_j m_ij b_j) / 4T,   at R: (x^2 b_i - s sum_j m_ij a_j) / 4T,
//
// and minus their sum at P. There is no cancellation. For one channel they are (y / 2x) a / W^q and (x / 2y) b / W^q, with area
// x y W^q / 2.
#pragma once
#include "grid_weights.h"

namespace meshflow::grid {

// The area of a triangle is zero if twice the area is below this share of its longest squared edge.
constexpr double FLAT = 1e-12;

// The ground below triangles with a leg in one row of samples: columns of `geometry`, and numbers derived from them.
template <class T> struct Ground {
    T ax, ay, kx, ky, sixth, x, y;  // (alpha / x)^2, (alpha / y)^2, y / 2x, x / 2y, x y / 6
    T xx, yy, over_xx, over_yy;
    static Ground of(const T* g) {
        const T xx = g[5] * g[5], yy = g[6] * g[6];
        return {g[0], g[1], g[2], g[3], g[4], g[5], g[6], xx, yy, T(1) / xx, T(1) / yy};
    }
};

// The pulls on the far ends of the legs, and a third of the area.
template <class T> struct Pull {
    T on_q, on_r, third;
};

// One coordinate over the ground. The two triangles that share the column leg b: (a, b) and (c, -b); one that does not exist has
// no effect.
template <class W, class T>
INLINE void pair_over_ground(T a, T b, T c, const Ground<T>& above, const Ground<T>& below, T q, Lane<T> code,
                             Pull<T>& m, Pull<T>& n) {
    const T square = b * b;
    const T w = W::expansion(T(1) + (above.ax * (a * a) + above.ay * square), q);
    const T v = W::expansion(T(1) + (below.ax * (c * c) + below.ay * square), q);
    // A common division would make the bits of one triangle depend on the other, which may be missing in a part of a grid.
    const T over_w = where<UPPER_BIT>(code, T(1) / w), over_v = where<LOWER_BIT>(code, T(1) / v);
    m = {above.kx * a * over_w, above.ky * b * over_w, where<UPPER_BIT>(code, above.sixth * w)};
    n = {below.kx * c * over_v, -(below.ky * b * over_v), where<LOWER_BIT>(code, below.sixth * v)};
}

// D coordinates over the ground; scale is alpha^2. A triangle is given by 1 / 4T and s / 4T, which are 0 if it does not exist.
template <class T> struct Share {
    T half, scaled;
};

// Minors by their larger index. Sums start with their first term, to save the addition to zero.
template <int D, class T> INLINE void minors_of(const T (&a)[D], const T (&b)[D], T (&minors)[D][D]) {
    UNROLL for (int i = 1; i < D; ++i)
        UNROLL for (int j = 0; j < i; ++j) minors[i][j] = a[i] * b[j] - a[j] * b[i];
}
template <int D, class T> INLINE T squared(const T (&a)[D]) {
    T sum = a[0] * a[0];
    UNROLL for (int i = 1; i < D; ++i) sum += a[i] * a[i];
    return sum;
}

template <int BIT, class W, int D, class T>
INLINE Share<T> share_over_ground(const T (&a)[D], T aa, const T (&b)[D], T bb, const Ground<T>& g, T q, T scale, Lane<T> code,
                                  T& third) {
    T minors[D][D];
    minors_of(a, b, minors);
    T squares = minors[1][0] * minors[1][0];
    UNROLL for (int i = 2; i < D; ++i)
        UNROLL for (int j = 0; j < i; ++j) squares += minors[i][j] * minors[i][j];
    const T s = scale * W::stretch(scale * (aa * g.over_xx + bb * g.over_yy), q);
    const T doubled = std::sqrt(g.xx * g.yy + s * ((g.xx * bb + g.yy * aa) + s * squares));
    const T half = where<BIT>(code, T(0.5) / doubled);
    third = where<BIT>(code, doubled * T(1.0 / 6));
    return {half, half * s};
}

// The pulls of a triangle with legs a, b on Q and on R.
template <int D, class T>
INLINE void pulls_over_ground(const T (&a)[D], const T (&b)[D], const Share<T>& share, const Ground<T>& g, T (&on_q)[D], T (&on_r)[D]) {
    T minors[D][D];
    minors_of(a, b, minors);
    UNROLL for (int i = 1; i < D; ++i)
        UNROLL for (int j = 0; j < i; ++j) minors[i][j] *= share.scaled;
    const T on_a = share.half * g.yy, on_b = share.half * g.xx;
    UNROLL for (int i = 0; i < D; ++i) {
        on_q[i] = on_a * a[i], on_r[i] = on_b * b[i];
        UNROLL for (int j = 0; j < D; ++j) {
            if (j < i) on_q[i] += minors[i][j] * b[j], on_r[i] -= minors[i][j] * a[j];
            if (j > i) on_q[i] -= minors[j][i] * b[j], on_r[i] += minors[j][i] * a[j];
        }
    }
}

// A vector in space.
template <class T> struct Vector {
    T x, y, z;
    INLINE Vector operator+(const Vector& o) const { return {x + o.x, y + o.y, z + o.z}; }
    INLINE Vector operator-(const Vector& o) const { return {x - o.x, y - o.y, z - o.z}; }
    INLINE Vector operator*(T by) const { return {x * by, y * by, z * by}; }
    INLINE T dot(const Vector& o) const { return x * o.x + y * o.y + z * o.z; }
    INLINE Vector cross(const Vector& o) const { return {y * o.z - z * o.y, z * o.x - x * o.z, x * o.y - y * o.x}; }
    INLINE T square() const { return dot(*this); }
};

// Points in space, legs a and b: the normal a x b, its squared length, 0 where the triangle has no area, and |a|^2 + |b|^2 - a . b.
// Plain numbers, because compilers do not vectorize loops with nested structs.
template <class T> struct Spanned {
    T x, y, z, square, spread;
    static INLINE Spanned of(const Vector<T>& a, const Vector<T>& b) {
        const T x = a.y * b.z - a.z * b.y, y = a.z * b.x - a.x * b.z, z = a.x * b.y - a.y * b.x;
        const T uu = a.square(), vv = b.square(), uv = a.dot(b), far = uu + vv - (uv + uv), more = uu > vv ? uu : vv;
        const T longest = T(FLAT) * (far > more ? far : more), square = x * x + y * y + z * z;
        return {x, y, z, square > longest * longest ? square : T(0), uu + vv - uv};
    }
    // The gradient of the area at Q and at R, given |a x b|; zero without area.
    INLINE void pulls(const Vector<T>& a, const Vector<T>& b, T doubled, Vector<T>& on_q, Vector<T>& on_r) const {
        const T by = T(0.5) / doubled, half = doubled > T(0) ? by : T(0), u = x * half, v = y * half, w = z * half;
        on_q.x = b.y * w - b.z * v, on_q.y = b.z * u - b.x * w, on_q.z = b.x * v - b.y * u;
        on_r.x = v * a.z - w * a.y, on_r.y = w * a.x - u * a.z, on_r.z = u * a.y - v * a.x;
    }
    // An upper bound of the rate of decay in the triangle, with barycentric masses: 3 (N + sqrt(N^2 - 3 D)) / D, D = |a x b|^2,
    // N half the sum of the squared lengths. Zero without area.
    INLINE T decay() const {
        const T rest = spread * spread - T(3) * square;
        return square > T(0) ? T(3) * (spread + std::sqrt(rest > T(0) ? rest : T(0))) / square : T(0);
    }
};

// A triangle with depths p, q, r for a pinhole with an even grid: its points are u (x, y, 1). With a = (q - p) / X and
// b = (r - p) / Y, X, Y the signed differences of x along the row and of y along the column, the normal is
// X Y (-a r, -b q, q r + x a r + y b q): it needs no differences of points, so less precision is lost. Pulls are along the rays.
template <class T> struct Facing {
    T on_p, on_q, on_r, length;
    // across: 1 / X, down: 1 / Y, half: |X Y| / 2; x, y: of the ray of P.
    static INLINE Facing of(T p, T q, T r, T x, T y, T across, T down, T half) {
        const T a = (q - p) * across, b = (r - p) * down, m = a * r, n = b * q, k = q * r + x * m + y * n;
        const T length = std::sqrt(m * m + n * n + k * k), over = half / length;
        const T kk = k * over, mm = (m + x * k) * over, nn = (n + y * k) * over, one = mm * r * across, two = nn * q * down;
        return {-(one + two), one + nn * b + kk * r, mm * a + two + kk * q, length};
    }
};

// The form of a triangle: |u|^2, |v|^2 and u . v of its legs over 4T, in any metric, and a third of its area. Its cotangents are
// 2 u . v at P, 2 (|u|^2 - u . v) at Q, 2 (|v|^2 - u . v) at R.
template <class T> struct Form {
    T uu, vv, uv, third;
    INLINE T on_q(T a, T b) const { return vv * a - uv * b; }
    INLINE T on_r(T a, T b) const { return uu * b - uv * a; }
    template <int BIT> INLINE Form if_there(Lane<T> code) const {
        return {where<BIT>(code, uu), where<BIT>(code, vv), where<BIT>(code, uv), where<BIT>(code, third)};
    }
    // From the products of the legs in the free coordinates, and the sum of their squared minors.
    template <class W> static INLINE Form over_ground(T uu, T vv, T uv, T minors, const Ground<T>& g, T q, T scale) {
        const T s = scale * W::stretch(scale * (uu * g.over_xx + vv * g.over_yy), q);
        const T doubled = std::sqrt(g.xx * g.yy + s * ((g.xx * vv + g.yy * uu) + s * minors)), half = T(0.5) / doubled;
        return {half * (g.xx + s * uu), half * (g.yy + s * vv), half * (s * uv), doubled * T(1.0 / 6)};
    }
    static INLINE Form in_space(T uu, T vv, T uv, T minors) {
        const T doubled = std::sqrt(minors), far = uu + vv - (uv + uv), more = uu > vv ? uu : vv;
        const bool there = doubled > T(FLAT) * (far > more ? far : more);
        const T half = there ? T(0.5) / doubled : T(0);
        return {half * uu, half * vv, half * uv, there ? doubled * T(1.0 / 6) : T(0)};
    }
};

// The part of the area of a triangle that belongs to its corner 0, for Voronoi masses (mixed, Meyer et al. 2002).
template <class T> INLINE T voronoi_share(T cot0, T cot1, T cot2, T area) {
    const T sharp = T(0.25) * area * (T(1) + cot1 * cot2), blunt = T(0.25) * area;
    return cot0 < T(0) ? T(0.5) * area : cot1 < T(0) || cot2 < T(0) ? blunt : sharp;
}

}  // namespace meshflow::grid
