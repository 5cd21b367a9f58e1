"""The cotangent operator in every dimension. Arrays in, arrays out.

Sign, once and for all: the stiffness L is symmetric and positive semidefinite, ``L @ X`` is the gradient of the total area
with respect to every vertex (Desbrun et al. 2000, (13)), and libigl's ``cotmatrix`` is ``-L``. The curvature normal is
B = M^-1 L X = grad A / A (11), (12), of length twice the mean curvature; -B is the Laplace-Beltrami of the position.
"""

from typing import Literal

import numpy as np
import scipy.sparse as sparse
from numba import njit, prange
from numba.extending import register_jitable

from meshflow.errors import InputError
from meshflow.geometry import triangle
from meshflow.geometry.connectivity import Connectivity, connect
from meshflow.geometry.validation import Array

__all__ = [
    "MASSES",
    "MassKind",
    "area_gradient",
    "cotangents",
    "curvature_normal",
    "form_cotangents",
    "forms",
    "mass",
    "mass_kind",
    "mean_curvature",
    "rate_bound",
    "stiffness",
    "total_area",
]

MassKind = Literal["barycentric", "voronoi", "ring"]
MASSES = ("barycentric", "voronoi", "ring")
_NOWHERE = np.zeros((0, 4))


def mass_kind(kind: str) -> int:
    """The number under which the kernels know a kind of mass.

    :raises InputError: for an unknown word.
    """
    if kind not in MASSES:
        raise InputError(f"mass: one of {', '.join(MASSES)} expected, got {kind!r}")
    return MASSES.index(kind)


def cotangents(points: Array, faces: Array, forms: Array = _NOWHERE, sharpness: float = 1.0) -> tuple[Array, Array]:
    """Cotangents (m, 3) of the angles at the corners, and areas (m,), of triangles in R^d (section 5.4).

    :param points: (n, d).
    :param faces: (m, 3).
    :param forms: (m, 4) of :func:`forms`, lengths measured in further coordinates and added to those of ``points``.
    :param sharpness: q of :class:`Member`, which stretches the lengths of ``points`` against those of ``forms``.
    """
    cot, area = np.empty((len(faces), 3)), np.empty(len(faces))
    _measure(np.ascontiguousarray(points, dtype=np.float64), faces, forms, float(sharpness), cot, area)
    return cot, area


def forms(charts: Array) -> Array:
    """Quadratic forms (m, 4), the dots of three corners and the determinant, of triangles given by corners (m, 3, c)."""
    out = np.empty((len(charts), 4))
    _forms(np.ascontiguousarray(charts, dtype=np.float64), out)
    return out


def form_cotangents(forms: Array) -> tuple[Array, Array]:
    """Cotangents (m, 3) and areas (m,) of triangles known by their quadratic forms (m, 4)."""
    cot, area = np.empty((len(forms), 3)), np.empty(len(forms))
    _measure_forms(forms, cot, area)
    return cot, area


def total_area(points: Array, faces: Array) -> float:
    """Sum of the areas of all triangles, squared length."""
    return float(cotangents(points, faces)[1].sum())


def stiffness(points: Array, faces: Array) -> sparse.csr_matrix:
    """L (n, n), positive semidefinite: L_ij = -(cot alpha_ij + cot beta_ij) / 2, rows sum to zero (13)."""
    connectivity = connect((faces,), len(points))
    return fill_stiffness(connectivity, cotangents(points, faces)[0])


def mass(points: Array, faces: Array, kind: MassKind = "barycentric") -> Array:
    """Lumped mass (n,), the area that belongs to each vertex; zero where there is no triangle.

    ``barycentric``: a third of the triangles around it; ``voronoi``: mixed, Meyer et al. 2002; ``ring``: all of them, as (14).
    """
    connectivity = connect((faces,), len(points))
    return gather_mass(connectivity, *cotangents(points, faces), kind)


def area_gradient(points: Array, faces: Array, boundary: Literal["natural", "linear"] = "natural") -> Array:
    """Gradient (n, d) of the total area with respect to each vertex, L @ X (13).

    :param boundary: ``linear`` takes out the pull of the conormal of each boundary edge: zero on every plane.
    """
    connectivity = connect((faces,), len(points))
    points = np.ascontiguousarray(points, dtype=np.float64)
    return gather_gradient(connectivity, cotangents(points, faces)[0], points, boundary == "linear")


def curvature_normal(
    points: Array, faces: Array, kind: MassKind = "barycentric", boundary: Literal["natural", "linear"] = "natural"
) -> Array:
    """B = grad A / A (n, d), per length (11), (12): twice the mean curvature along the normal; zero at isolated vertices."""
    gradient, share = area_gradient(points, faces, boundary), mass(points, faces, kind)
    return np.divide(gradient, share[:, None], out=np.zeros_like(gradient), where=share[:, None] > 0)


def mean_curvature(points: Array, faces: Array, kind: MassKind = "voronoi") -> Array:
    """|B| / 2 (n,), per length, in every dimension: 1 on the unit sphere, 1/2 on the unit cylinder, 0 on minimal surfaces.

    kappa of section 5.1 lacks the half. Voronoi mass: it alone converges pointwise on irregular samplings.
    """
    return 0.5 * np.linalg.norm(curvature_normal(points, faces, kind, "linear"), axis=1)


def rate_bound(cot: Array, area: Array, kind: MassKind = "barycentric") -> Array:
    """Upper bound (m,) of the eigenvalues of M^-1 L that each triangle allows, per squared length.

    The largest is a bound for the whole mesh: an explicit step below 2 / max is stable.
    """
    out = np.empty(len(area))
    _bounds(cot, area, mass_kind(kind), out)
    return out


def fill_stiffness(connectivity: Connectivity, cot: Array, directions: Array | None = None) -> sparse.csr_matrix:
    """L, or L_ij (d_i . d_j) for vertices that move along directions (n, 3): still symmetric positive semidefinite."""
    c, pattern = connectivity, connectivity.pattern
    data = np.zeros(len(pattern.indices))
    rays = np.zeros((0, 0)) if directions is None else np.ascontiguousarray(directions, dtype=np.float64)
    _fill(c.faces, c.first, c.corners, pattern.slots, pattern.diagonal, pattern.indptr, cot, rays, data)
    return sparse.csr_matrix((data, pattern.indices, pattern.indptr), shape=(c.size, c.size))


def gather_mass(connectivity: Connectivity, cot: Array, area: Array, kind: MassKind) -> Array:
    """Mass (n,) from cotangents (m, 3) and areas (m,)."""
    out = np.empty(connectivity.size)
    _gather_mass(connectivity.first, connectivity.corners, cot, area, mass_kind(kind), out)
    return out


def gather_gradient(connectivity: Connectivity, cot: Array, points: Array, linear: bool) -> Array:
    """Area gradient (n, k) of the coordinates in points (n, k), in the metric of the cotangents."""
    out = np.empty_like(points)
    c = connectivity
    _gather_gradient(c.faces, c.first, c.corners, cot, points, out)
    if linear:
        _conormals(c.faces, c.border, cot, points[c.faces[c.border // 3]], out)
    return out


def border_pull(connectivity: Connectivity, points: Array) -> Array:
    """What ``linear`` takes out of the area gradient (n, k): the conormals of the boundary edges, measured at points (n, k)."""
    c, out = connectivity, np.zeros(points.shape)
    faces = c.faces[c.border // 3]
    cot, _ = cotangents(points, faces)
    _conormals(faces, 3 * np.arange(len(faces)) + c.border % 3, cot, points[faces], out)
    return out


def gather_chart_gradient(connectivity: Connectivity, cot: Array, charts: Array, linear: bool) -> Array:
    """As :func:`gather_gradient`, for coordinates that each triangle's corners (m, 3, c) have in a chart of its own."""
    out = np.empty((connectivity.size, charts.shape[2]))
    c = connectivity
    _gather_charts(c.first, c.corners, cot, charts, out)
    if linear:
        _conormals(c.faces, c.border, cot, charts[c.border // 3], out)
    return out


def gather_seen(connectivity: Connectivity, points: Array, directions: Array) -> Array:
    """Area (n,) of the triangles around each vertex after projecting them along its direction (n, 3), in R^3."""
    out = np.empty(connectivity.size)
    c = connectivity
    _gather_seen(c.faces, c.first, c.corners, points, directions, out)
    return out


@register_jitable
def _corner(t):
    """Triangle and corner; numbers that cannot be negative divide faster, and index without a comparison."""
    t = np.uint64(t)
    return t // np.uint64(3), t % np.uint64(3)


@njit(cache=True, parallel=True)
def _measure(points, faces, forms, sharpness, cot, area):
    for f in prange(len(faces)):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        dot0, dot1, dot2 = triangle.dots(points, i, j, k)
        det = triangle.gram(points, i, j, k)
        if len(forms) > 0:
            dot0, dot1, dot2, det = triangle.sharpened(
                dot0, dot1, dot2, det, forms[f, 0], forms[f, 1], forms[f, 2], forms[f, 3], sharpness
            )
        cot[f, 0], cot[f, 1], cot[f, 2], area[f] = triangle.cotangents(dot0, dot1, dot2, det)


@njit(cache=True, parallel=True)
def _measure_forms(forms, cot, area):
    for f in prange(len(forms)):
        cot[f, 0], cot[f, 1], cot[f, 2], area[f] = triangle.cotangents(
            forms[f, 0], forms[f, 1], forms[f, 2], forms[f, 3]
        )


@njit(cache=True, parallel=True)
def _forms(charts, out):
    for f in prange(len(charts)):
        out[f, 0], out[f, 1], out[f, 2] = triangle.dots(charts[f], 0, 1, 2)
        out[f, 3] = triangle.gram(charts[f], 0, 1, 2)


@njit(cache=True, parallel=True)
def _bounds(cot, area, kind, out):
    for f in prange(len(area)):
        a, b, c = cot[f, 0], cot[f, 1], cot[f, 2]
        smallest = min(
            triangle.share(kind, a, b, c, area[f]),
            triangle.share(kind, b, c, a, area[f]),
            triangle.share(kind, c, a, b, area[f]),
        )
        out[f] = triangle.bound(a, b, c, area[f], smallest)


@njit(cache=True, parallel=True)
def _gather_mass(first, corners, cot, area, kind, out):
    for i in prange(len(out)):
        total = 0.0
        for t in range(first[i], first[i + 1]):
            f, c = _corner(corners[t])
            total += triangle.share(kind, cot[f, c], cot[f, (c + 1) % 3], cot[f, (c + 2) % 3], area[f])
        out[i] = total


@njit(cache=True, parallel=True)
def _gather_gradient(faces, first, corners, cot, points, out):
    for i in prange(len(points)):
        for q in range(points.shape[1]):
            out[i, q] = 0.0
        for t in range(first[i], first[i + 1]):
            f, c = _corner(corners[t])
            b, d = (c + 1) % 3, (c + 2) % 3
            j, k = faces[f, b], faces[f, d]
            for q in range(points.shape[1]):
                out[i, q] += triangle.pull(cot[f, b], cot[f, d], points[i, q], points[j, q], points[k, q])


@njit(cache=True, parallel=True)
def _gather_charts(first, corners, cot, charts, out):
    for i in prange(len(out)):
        for q in range(charts.shape[2]):
            out[i, q] = 0.0
        for t in range(first[i], first[i + 1]):
            f, c = corners[t] // 3, corners[t] % 3
            b, d = (c + 1) % 3, (c + 2) % 3
            for q in range(charts.shape[2]):
                out[i, q] += triangle.pull(cot[f, b], cot[f, d], charts[f, c, q], charts[f, b, q], charts[f, d, q])


@njit(cache=True)
def _conormals(faces, border, cot, corners, out):
    # Half the outward conormal times the length of each boundary edge, -(cot_i (X_k - X_j) + cot_j (X_k - X_i)), is what
    # the area gradient holds at both its ends for want of a triangle beyond; it is taken out. corners (b, 3, k).
    for t in range(len(border)):
        f, c = border[t] // 3, border[t] % 3
        b, d = (c + 1) % 3, (c + 2) % 3
        i, j = faces[f, b], faces[f, d]
        for q in range(out.shape[1]):
            xk, xi, xj = corners[t, c, q], corners[t, b, q], corners[t, d, q]
            pull = 0.5 * (cot[f, b] * (xk - xj) + cot[f, d] * (xk - xi))
            out[i, q] += pull
            out[j, q] += pull


@njit(cache=True, parallel=True)
def _gather_seen(faces, first, corners, points, directions, out):
    for i in prange(len(out)):
        rx, ry, rz = directions[i, 0], directions[i, 1], directions[i, 2]
        length = np.sqrt(rx * rx + ry * ry + rz * rz)
        total = 0.0
        for t in range(first[i], first[i + 1]):
            f = corners[t] // 3
            a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
            ux, uy, uz = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
            vx, vy, vz = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1], points[c, 2] - points[a, 2]
            total += abs(rx * (uy * vz - uz * vy) + ry * (uz * vx - ux * vz) + rz * (ux * vy - uy * vx))
        out[i] = 0.5 * total / length if length > 0.0 else 0.0


@njit(cache=True, parallel=True)
def _fill(faces, first, corners, slots, diagonal, indptr, cot, rays, data):
    moves = len(rays) > 0
    for i in prange(len(diagonal)):
        for t in range(indptr[i], indptr[i + 1]):
            data[t] = 0.0
        for t in range(first[i], first[i + 1]):
            f, c = _corner(corners[t])
            b, d = (c + 1) % 3, (c + 2) % 3
            with_j = with_k = own = 1.0
            if moves:
                j, k = faces[f, b], faces[f, d]
                with_j = rays[i, 0] * rays[j, 0] + rays[i, 1] * rays[j, 1] + rays[i, 2] * rays[j, 2]
                with_k = rays[i, 0] * rays[k, 0] + rays[i, 1] * rays[k, 1] + rays[i, 2] * rays[k, 2]
                own = rays[i, 0] * rays[i, 0] + rays[i, 1] * rays[i, 1] + rays[i, 2] * rays[i, 2]
            data[slots[t, 0]] -= 0.5 * cot[f, d] * with_j
            data[slots[t, 1]] -= 0.5 * cot[f, b] * with_k
            data[diagonal[i]] += 0.5 * (cot[f, b] + cot[f, d]) * own
