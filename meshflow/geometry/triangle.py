"""One triangle: its formulas, each once, as plain functions of scalars that loops, threads and tiles compile.

A triangle is known by its quadratic form: at corner i, ``dot_i`` is the inner product of the two edges that leave it. Then
the edge opposite corner 0 has squared length ``dot1 + dot2``, and four times the squared area is ``det = dot0 dot1 +
dot1 dot2 + dot2 dot0``: lengths alone, so all of this holds in every dimension (Desbrun et al. 2000, section 5.4).
"""

import math
from typing import SupportsIndex

from numba.extending import register_jitable

from meshflow.geometry.validation import Array

__all__ = ["bound", "cotangents", "dots", "gram", "joint", "pull", "share", "sharpened", "stretch", "tension"]

# A triangle whose doubled area is below this share of its longest squared edge has no area: double precision has lost it.
FLAT = 1e-12


@register_jitable
def dots(points: Array, i: SupportsIndex, j: SupportsIndex, k: SupportsIndex) -> tuple[float, float, float]:
    """Inner products at the three corners: (X_j - X_i) . (X_k - X_i), and so on."""
    dot0 = dot1 = dot2 = 0.0
    for q in range(points.shape[1]):
        a, b, c = points[i, q], points[j, q], points[k, q]
        u, v, w = b - a, c - a, c - b
        dot0 += u * v
        dot1 -= u * w
        dot2 += v * w
    return dot0, dot1, dot2


@register_jitable
def gram(points: Array, i: SupportsIndex, j: SupportsIndex, k: SupportsIndex) -> float:
    """Four times the squared area, |u|^2 |v|^2 - (u . v)^2, as the sum of squared 2 x 2 minors (Lagrange).

    The difference of products loses all digits on slivers and steep cliffs; the sum of squares loses none.
    """
    if points.shape[1] == 3:  # the same sum, laid out: compilers do not unroll the loops below
        ux, uy, uz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
        vx, vy, vz = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1], points[k, 2] - points[i, 2]
        yz, zx, xy = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        return yz * yz + zx * zx + xy * xy
    det = 0.0
    for p in range(points.shape[1]):
        up, vp = points[j, p] - points[i, p], points[k, p] - points[i, p]
        for q in range(p):
            minor = up * (points[k, q] - points[i, q]) - vp * (points[j, q] - points[i, q])
            det += minor * minor
    return det


@register_jitable
def joint(
    a0: float, a1: float, a2: float, det_a: float, b0: float, b1: float, b2: float, det_b: float
) -> tuple[float, float, float, float]:
    """Dots and determinant of the sum of two forms: a triangle measured in two spaces at once.

    |D|^2 = |D in the one|^2 + |D in the other|^2 for every edge; det(A + B) = det A + det B + the mixed term.
    """
    mixed = a0 * (b1 + b2) + a1 * (b0 + b2) + a2 * (b0 + b1)
    return a0 + b0, a1 + b1, a2 + b2, det_a + det_b + max(mixed, 0.0)


@register_jitable
def stretch(slope2: float, q: float) -> float:
    """(W^(2q) - 1) / (W^2 - 1) with W^2 = 1 + slope2: what the free part of a form is multiplied by for sharpness q.

    For one channel the area of a triangle is then W^q times that of its base; q where the surface is flat (DESIGN.md, section 2).
    """
    one = type(slope2)(1)
    if q == one:
        return one
    if q == one + one:
        return one + one + slope2
    if q == type(slope2)(1.5):
        w = math.sqrt(one + slope2)
        return w + one / (w + one)
    if not slope2 > type(slope2)(0):
        return q
    return type(slope2)(math.expm1(q * math.log1p(slope2)) / slope2)


@register_jitable
def sharpened(
    a0: float, a1: float, a2: float, det_a: float, b0: float, b1: float, b2: float, det_b: float, q: float
) -> tuple[float, float, float, float]:
    """:func:`joint` of a free form A, stretched for sharpness q, and its base B: |gradient|^2 = trace(A B^-1) = mixed / det B."""
    mixed = max(a0 * (b1 + b2) + a1 * (b0 + b2) + a2 * (b0 + b1), 0.0)
    by = stretch(mixed / det_b, q) if det_b > 0.0 else 1.0
    return joint(by * a0, by * a1, by * a2, by * by * det_a, b0, b1, b2, det_b)


@register_jitable
def cotangents(dot0: float, dot1: float, dot2: float, det: float) -> tuple[float, float, float, float]:
    """Cotangents of the three angles and the area: cot_i = dot_i / 2T, T = sqrt(det) / 2.

    A triangle without area contributes nothing: all four are zero.
    """
    longest = max(dot0 + dot1, dot1 + dot2, dot2 + dot0)
    doubled = math.sqrt(max(det, 0.0))
    if not doubled > FLAT * longest:
        return 0.0, 0.0, 0.0, 0.0
    by = 1.0 / doubled
    return by * dot0, by * dot1, by * dot2, 0.5 * doubled


@register_jitable
def tension(cot: float, x: float, other: float) -> float:
    """What an edge adds to the area gradient of a coordinate at its end x, for the triangle whose angle across it has ``cot``."""
    return 0.5 * cot * (x - other)


@register_jitable
def pull(at_j: float, at_k: float, x: float, x_j: float, x_k: float) -> float:
    """What triangle i, j, k adds to the area gradient of a coordinate at i (13): (cot_k (x_i - x_j) + cot_j (x_i - x_k)) / 2."""
    return tension(at_k, x, x_j) + tension(at_j, x, x_k)


@register_jitable
def share(kind: int, cot0: float, cot1: float, cot2: float, area: float) -> float:
    """The part of a triangle's area that is the mass of its corner 0.

    kind 0, barycentric: T / 3. Kind 1, Voronoi, mixed as Meyer et al. 2002: T (1 + cot1 cot2) / 4 where no angle is obtuse
    (that is (b cot B + c cot C) / 8), else T / 2 at the obtuse corner and T / 4 at the others. Kind 2, ring: T.
    """
    if kind == 0:
        return area / 3.0
    if kind == 2:
        return area
    if cot0 < 0.0:
        return 0.5 * area
    if cot1 < 0.0 or cot2 < 0.0:
        return 0.25 * area
    return 0.25 * area * (1.0 + cot1 * cot2)


@register_jitable
def bound(cot0: float, cot1: float, cot2: float, area: float, smallest: float) -> float:
    """Largest eigenvalue of the triangle's own stiffness over its smallest mass: an upper bound of lambda_max(M^-1 L).

    (t / 2 + sqrt(t^2 / 4 - 3 / 4)) / smallest share, t = cot A + cot B + cot C = (a + b + c) / 4T >= sqrt 3; with the
    barycentric third of T it is exact for the triangle alone. On a grid of spacing h and any heights it is at most 12 / h^2.
    """
    if not area > 0.0:
        return 0.0
    half = 0.5 * (cot0 + cot1 + cot2)
    return (half + math.sqrt(max(half * half - 0.75, 0.0))) / smallest
