"""The cotangent operator in every dimension.

Sign convention: the stiffness L is symmetric and positive semidefinite, ``L @ X`` is the gradient of the total area
with respect to every vertex (Desbrun et al. 2000, (13)), and libigl's ``cotmatrix`` is ``-L``. The curvature normal is
B = M^-1 L X = grad A / A (11), (12), of length twice the mean curvature; -B is the Laplace-Beltrami of the position.
"""

from typing import Literal

import numpy as np
import scipy.sparse as sparse

from meshflow.errors import InputError
from meshflow.geometry.connectivity import Connectivity, connect
from meshflow.geometry.validation import Array, indices_of
from meshflow.kernels import mesh_operator as kernels

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


def mass_kind(kind: str) -> int:
    """The number of a kind of mass in the kernels.

    :raises InputError: for an unknown word.
    """
    if kind not in MASSES:
        raise InputError(f"mass: one of {', '.join(MASSES)} expected, got {kind!r}")
    return MASSES.index(kind)


def cotangents(points: Array, faces: Array, forms: Array | None = None, sharpness: float = 1.0) -> tuple[Array, Array]:
    """Cotangents (m, 3) of the angles at the corners, and areas (m,), of triangles in R^d (section 5.4).

    :param points: (n, d).
    :param faces: (m, 3).
    :param forms: (m, 4) of :func:`forms`, for lengths in further coordinates that are added to those of ``points``.
    :param sharpness: q of :class:`Variant`, which stretches the lengths of ``points`` relative to those of ``forms``.
    """
    cot, area = np.empty((len(faces), 3)), np.empty(len(faces))
    kernels.triangle_angles(_doubles(points), indices_of(faces), forms, sharpness, cot, area)
    return cot, area


def forms(charts: Array) -> Array:
    """Quadratic forms (m, 4) of triangles with corners (m, 3, c): the dot products at three corners and the determinant."""
    out = np.empty((len(charts), 4))
    kernels.chart_forms(_doubles(charts), out)
    return out


def form_cotangents(forms: Array) -> tuple[Array, Array]:
    """Cotangents (m, 3) and areas (m,) of triangles given by quadratic forms (m, 4)."""
    cot, area = np.empty((len(forms), 3)), np.empty(len(forms))
    kernels.form_angles(forms, cot, area)
    return cot, area


def total_area(points: Array, faces: Array) -> float:
    """Sum of the areas of all triangles, squared length."""
    return float(cotangents(points, faces)[1].sum())


def stiffness(points: Array, faces: Array) -> sparse.csr_matrix:
    """L (n, n), positive semidefinite: L_ij = -(cot alpha_ij + cot beta_ij) / 2, rows sum to zero (13)."""
    connectivity = connect((faces,), len(points))
    return fill_stiffness(connectivity, cotangents(points, faces)[0])


def mass(points: Array, faces: Array, kind: MassKind = "barycentric") -> Array:
    """Lumped mass (n,), the area of each vertex; zero where there is no triangle.

    ``barycentric``: a third of the triangles around it; ``voronoi``: mixed (Meyer et al. 2002); ``ring``: all of them, as in
    (14).
    """
    connectivity = connect((faces,), len(points))
    return gather_mass(connectivity, *cotangents(points, faces), kind)


def area_gradient(points: Array, faces: Array, boundary: Literal["neumann", "plane-preserving"] = "neumann") -> Array:
    """Gradient (n, d) of the total area with respect to each vertex, L @ X (13).

    :param boundary: ``plane-preserving`` removes the pull of the conormal of each boundary edge; the result is zero on every
        plane.
    """
    connectivity = connect((faces,), len(points))
    return gather_gradient(connectivity, cotangents(points, faces)[0], points, boundary == "plane-preserving")


def curvature_normal(
    points: Array,
    faces: Array,
    kind: MassKind = "barycentric",
    boundary: Literal["neumann", "plane-preserving"] = "neumann",
) -> Array:
    """B = grad A / A (n, d), per length (11), (12): twice the mean curvature along the normal; zero at isolated vertices."""
    gradient, share = area_gradient(points, faces, boundary), mass(points, faces, kind)
    return np.divide(gradient, share[:, None], out=np.zeros_like(gradient), where=share[:, None] > 0)


def mean_curvature(points: Array, faces: Array, kind: MassKind = "voronoi") -> Array:
    """|B| / 2 (n,), per length, in every dimension: 1 on the unit sphere, 1/2 on the unit cylinder, 0 on minimal surfaces.

    kappa of section 5.1 lacks the factor 1/2. With Voronoi mass it converges pointwise on irregular samplings, with others it
    does not.
    """
    return 0.5 * np.linalg.norm(curvature_normal(points, faces, kind, "plane-preserving"), axis=1)


def rate_bound(cot: Array, area: Array, kind: MassKind = "barycentric") -> Array:
    """Upper bounds (m,) of the eigenvalues of M^-1 L, one per triangle, per squared length.

    The largest is a bound for the whole mesh: explicit steps below 2 / max are stable.
    """
    out = np.empty(len(area))
    kernels.triangle_bounds(cot, area, mass_kind(kind), out)
    return out


def fill_stiffness(connectivity: Connectivity, cot: Array, directions: Array | None = None) -> sparse.csr_matrix:
    """L, or L_ij (d_i . d_j) for vertices that move along directions (n, 3); both are symmetric positive semidefinite."""
    c, pattern = connectivity, connectivity.pattern
    data = np.empty(len(pattern.indices))
    rays = None if directions is None else _doubles(directions)
    kernels.fill_stiffness(
        c.first,
        c.corners,
        c.faces,
        pattern.indptr,
        pattern.indices,
        pattern.slots,
        pattern.diagonal,
        cot,
        rays,
        data,
    )
    return sparse.csr_matrix((data, pattern.indices, pattern.indptr), shape=(c.size, c.size))


def gather_mass(connectivity: Connectivity, cot: Array, area: Array, kind: MassKind) -> Array:
    """Mass (n,) from cotangents (m, 3) and areas (m,)."""
    out = np.empty(connectivity.size)
    kernels.vertex_mass(connectivity.first, connectivity.corners, cot, area, mass_kind(kind), out)
    return out


def gather_gradient(connectivity: Connectivity, cot: Array, points: Array, linear: bool) -> Array:
    """Area gradient (n, k) of the coordinates in points (n, k), in the metric of the cotangents."""
    c, points = connectivity, _doubles(points)
    out = np.empty_like(points)
    kernels.area_gradient(c.first, c.corners, c.faces, cot, points, out)
    if linear:
        kernels.border_conormals(c.border, c.faces, cot, points[c.faces[c.border // 3]], out)
    return out


def border_pull(connectivity: Connectivity, points: Array) -> Array:
    """The conormals of the boundary edges at points (n, k), which are removed from the area gradient (n, k)."""
    c, out = connectivity, np.zeros(points.shape)
    faces = c.faces[c.border // 3]
    cot, _ = cotangents(points, faces)
    kernels.border_conormals(3 * np.arange(len(faces)) + c.border % 3, faces, cot, _doubles(points)[faces], out)
    return out


def gather_chart_gradient(connectivity: Connectivity, cot: Array, charts: Array, linear: bool) -> Array:
    """As :func:`gather_gradient`, for coordinates (m, 3, c) of corners in separate charts of the triangles."""
    c, charts = connectivity, _doubles(charts)
    out = np.empty((c.size, charts.shape[2]))
    kernels.chart_gradient(c.first, c.corners, cot, charts, out)
    if linear:
        kernels.border_conormals(c.border, c.faces, cot, charts[c.border // 3], out)
    return out


def gather_seen(connectivity: Connectivity, points: Array, directions: Array) -> Array:
    """Area (n,) of the triangles around each vertex, projected along its direction (n, 3), in R^3."""
    out = np.empty(connectivity.size)
    c = connectivity
    kernels.area_seen(c.first, c.corners, c.faces, _doubles(points), _doubles(directions), out)
    return out


def _doubles(values: Array) -> Array:
    return np.ascontiguousarray(values, dtype=np.float64)
