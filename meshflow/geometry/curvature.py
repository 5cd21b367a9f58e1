"""Principal curvatures and their directions on triangles (Meyer, Desbrun, Schröder, Barr 2002)."""

from dataclasses import dataclass

import numpy as np

from meshflow.geometry.connectivity import connect
from meshflow.geometry.normals import measured, normals_at
from meshflow.geometry.operator import cotangents, curvature_normal, fill_stiffness, gather_mass
from meshflow.geometry.validation import Array, indices_of
from meshflow.kernels import mesh_normals as kernels

__all__ = ["Curvatures", "curvatures", "directed", "directions", "signed_mean"]

# How often normals are averaged before curvatures are computed: over about one and a half edges.
ROUNDS = 2


@dataclass(frozen=True, eq=False)
class Curvatures:
    """Curvatures at each vertex, per length; positive where the surface bends away from its normal, as a sphere does.

    :ivar mean: kappa_H (n,), and ``gauss``: K (n,), per squared length.
    :ivar greatest: kappa_1 (n,); ``least``: kappa_2; kappa_H +- sqrt(kappa_H^2 - K).
    """

    mean: Array
    gauss: Array
    greatest: Array
    least: Array


def curvatures(points: Array, faces: Array) -> Curvatures:
    """Mean curvature by the cotangent formula, Gaussian curvature by the angle defect, over Voronoi areas (sections 3 and 4).

    Both are zero at the border, where the angle defect is no curvature, and at isolated vertices.

    :param points: (n, 3).
    :param faces: (m, 3), oriented alike; the sign is that of the normals.
    """
    points = np.ascontiguousarray(points, dtype=np.float64)
    connectivity = connect((faces,), len(points))
    cot, area = cotangents(points, faces)
    mass = gather_mass(connectivity, cot, area, "voronoi")
    known = (mass > 0) & ~connectivity.rim
    angles = np.where(area[:, None] > 0, np.arctan2(1.0, cot), 0.0)
    around: Array = np.bincount(connectivity.faces.ravel(), angles.ravel(), len(points))
    defect = np.subtract(2.0 * np.pi, around)
    gauss = np.divide(defect, mass, out=np.zeros_like(mass), where=known)
    mean = np.where(known, signed_mean(points, faces), 0.0)
    root: Array = np.sqrt(np.maximum(mean**2 - gauss, 0.0))
    return Curvatures(mean, gauss, mean + root, mean - root)


def signed_mean(points: Array, faces: Array) -> Array:
    """Mean curvature kappa_H (n,) by the cotangent formula (11) over mixed Voronoi areas, positive as in :class:`Curvatures`.

    At the border, where the ring of triangles is open, the pull of the conormals is removed.

    :param points: (n, 3).
    :param faces: (m, 3), oriented alike.
    """
    normals = curvature_normal(points, faces, "voronoi", "plane-preserving")
    return 0.5 * np.einsum("nd,nd->n", normals, normals_at(points, faces))


def directions(points: Array, faces: Array) -> Array:
    """Unit directions (n, 2, 3) of the greatest and of the least curvature, tangent to the surface.

    Each edge measures the curvature along it, 2 (x_i - x_j) . n / |x_i - x_j|^2 (section 5.2 of the paper). The mean, the ellipse
    and its angle are fitted by least squares, weighted by the edges' parts of the Voronoi area where these are positive. Unlike
    the paper, the fit includes the tilt of the normal: on an uneven cylinder of 5 edges radius the normal of a vertex has an
    error of 1.7 degrees, and directions have an error of 7.6 degrees without the tilt and of 0.8 with it. Also unlike the
    paper, trace and determinant of :func:`curvatures` are not used for the ellipse, since they are means over the ring (with
    them: 5.3 degrees). Directions are zero where there is no normal, and arbitrary at umbilics.
    """
    points = np.ascontiguousarray(points, dtype=np.float64)
    n = len(points)
    edges = fill_stiffness(connect((faces,), n), cotangents(points, faces)[0]).tocoo()
    off = edges.row != edges.col
    stiff: Array = edges.data[off]
    i, j, weights = edges.row[off], edges.col[off], np.maximum(-stiff, 0.0)
    normals = normals_at(points, faces)
    first = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
    lengths = np.linalg.norm(first, axis=1, keepdims=True)
    first = np.divide(first, lengths, out=np.zeros_like(first), where=lengths > 0)
    second = np.cross(normals, first)
    edge = points[j] - points[i]
    square = np.maximum(np.einsum("ij,ij->i", edge, edge), np.finfo(float).tiny)
    along, across = (np.einsum("ij,ij->i", edge, basis[i]) for basis in (first, second))
    flat = np.maximum(along**2 + across**2, np.finfo(float).tiny)
    typical = np.sqrt(float(square.mean()) if len(square) else 1.0)
    columns = np.stack(
        [
            (along**2 - across**2) / flat,  # cosine and sine of twice the angle
            2.0 * along * across / flat,
            np.ones(len(i)),
            along * typical / square,  # twice the tilt
            across * typical / square,
        ]
    )
    measured_along = -2.0 * np.einsum("ij,ij->i", edge, normals[i]) / square
    fitted = _fitted(columns, measured_along, weights * square, i, n)
    theta = 0.5 * np.arctan2(fitted[:, 1], fitted[:, 0])[:, None]
    return np.stack(
        [np.cos(theta) * first + np.sin(theta) * second, np.cos(theta) * second - np.sin(theta) * first], axis=1
    )


def _fitted(columns: Array, values: Array, weights: Array, at: Array, n: int) -> Array:
    """Least squares (n, c) of columns (c, e) to values (e,), for each vertex ``at`` (e,) separately.

    It is the minimum-norm solution where there are fewer edges than unknowns.
    """
    c = len(columns)
    matrix, right = np.empty((n, c, c)), np.empty((n, c))
    for p in range(c):
        right[:, p] = np.bincount(at, weights * columns[p] * values, n)
        for q in range(c):
            matrix[:, p, q] = np.bincount(at, weights * columns[p] * columns[q], n)
    ridge = 1e-9 * np.trace(matrix, axis1=1, axis2=2)
    matrix += np.where(ridge > 0, ridge, 1.0)[:, None, None] * np.eye(c)
    return np.linalg.solve(matrix, right[..., None])[..., 0]


def directed(points: Array, faces: Array, threshold: float) -> Array:
    """Weights (m, 3) of div(D grad), which replace the cotangents of div(grad).

    D = sum of g(k) e e^T over the principal directions e of the triangle and their curvatures k, g(k) = 1 / (1 + (k/T)^8).
    Where all curvatures are below T, D = 1. Across an edge D is 0, so that a cylinder does not move, and along it D is 1; at a
    corner D is 0. The operator is positive semidefinite and at most that of the cotangents, for any noise.

    Curvatures are those of normals that were averaged over the neighbours ROUNDS times, because curvatures of a vertex and its
    ring are dominated by noise of more than a few hundredths of an edge.

    :param threshold: T, per length.
    """
    points = np.ascontiguousarray(points, dtype=np.float64)
    normals, areas = measured(points, faces)
    weights = np.empty((len(faces), 3))
    at = _averaged(normals, areas, faces, len(points))
    kernels.directed_weights(points, indices_of(faces), at, threshold, weights)
    return weights


def _averaged(normals: Array, areas: Array, faces: Array, n: int) -> Array:
    """Unit normals (n, 3) of the vertices, averaged ROUNDS times over triangles, by area, and back."""
    flat, each = faces.ravel(), np.repeat(areas, 3)
    around: Array = np.bincount(flat, each, n)[:, None]

    def gathered(normals: Array) -> Array:
        """The mean over the triangles of each vertex, by their areas."""
        sums = np.stack([np.bincount(flat, each * np.repeat(part, 3), n) for part in normals.T], axis=1)
        return np.divide(sums, around, out=np.zeros_like(sums), where=around > 0)

    at = gathered(normals)
    for _ in range(ROUNDS):
        at = gathered(at[faces].mean(axis=1))
    sizes = np.linalg.norm(at, axis=1, keepdims=True)
    return np.divide(at, sizes, out=np.zeros_like(at), where=sizes > 0)
