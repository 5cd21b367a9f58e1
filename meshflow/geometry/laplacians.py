"""The operator of a linear flow as a matrix: du/dt = -A u, by cotangents or by the umbrella."""

from typing import Any, Literal

import numpy as np
import scipy.sparse as sparse

from meshflow.errors import InputError
from meshflow.geometry.connectivity import Connectivity, Pattern, connect, shared_sides
from meshflow.geometry.operator import fill_stiffness, stiffness
from meshflow.geometry.validation import Array

__all__ = [
    "Border",
    "border_pull",
    "cotangent_generator",
    "cotangent_means",
    "means_of",
    "means_over_diagonals",
    "neighbour_means",
    "scale_dependent_generator",
    "umbrella_generator",
]

# Diagonals whose lengths differ by less than this factor: a mesher could have taken either.
EITHER = 1.4

Border = Literal["curve", "free", "fixed"]


def border_pull(connectivity: Connectivity, cot: Array) -> Any:
    """C (n, n): C @ X is the boundary part of the area gradient, with its sign changed; it is added to L @ X.

    It is half the outward conormal of each boundary edge times its length, at both its ends (``plane-preserving``).
    """
    n, corner = connectivity.size, connectivity.border % 3
    triangle = connectivity.border // 3
    k, i, j = (connectivity.faces[triangle, (corner + shift) % 3] for shift in range(3))
    at_i, at_j = (0.5 * cot[triangle, (corner + shift) % 3] for shift in (1, 2))
    entries = np.concatenate([at_i + at_j, -at_i, -at_j])
    columns = np.concatenate([k, j, i])
    pulls = [sparse.coo_matrix((entries, (np.tile(end, 3), columns)), shape=(n, n)) for end in (i, j)]
    return sparse.csr_matrix(pulls[0] + pulls[1])


def cotangent_generator(connectivity: Connectivity, cot: Array, inertia: Array, moves: Array, linear: bool) -> Any:
    """M^-1 L, corrected at the border if ``linear`` (plane-preserving); rows of fixed vertices are zero.

    :param inertia: M / s (n,).
    :param moves: (n,).
    """
    matrix = fill_stiffness(connectivity, cot)
    if linear and len(connectivity.border):
        matrix = matrix + border_pull(connectivity, cot)
    scale = np.divide(1.0, inertia, out=np.zeros_like(inertia), where=moves & (inertia > 0))
    return sparse.csr_matrix(sparse.diags(scale) @ matrix)


def umbrella_generator(connectivity: Connectivity, step: float, moves: Array, curve: bool) -> Any:
    """4 / h^2 (x_i - mean of the neighbours), equal to M^-1 L on an equilateral mesh of edge h; zero for fixed vertices.

    :param step: h; of a mesh without size no vertex moves.
    :param curve: move the border as a curve, 2 / h^2 (x_i - mean of its two border neighbours); else with all neighbours.
    """
    c = connectivity
    factor = np.where(moves, np.where(c.rim & curve, 2.0, 4.0), 0.0) / step**2 if step**2 > 0 else np.zeros(c.size)
    if curve and len(c.border):
        mean = neighbour_means(c.faces.astype(np.int64), c.size, "curve")
        return sparse.csr_matrix(sparse.diags(factor) @ (sparse.identity(c.size) - mean))
    pattern, others = c.pattern, np.diff(c.pattern.indptr) - 1
    entries = np.repeat(-factor * (1.0 / np.maximum(others, 1)), others + 1)
    entries[pattern.diagonal] = np.where(others > 0, factor, 0.0)
    return sparse.csr_matrix((entries, pattern.indices, pattern.indptr), shape=(c.size, c.size))


def scale_dependent_generator(mean: Any, x: Array, moves: Array) -> Any:
    """4 / E sum (x_i - x_j) / |e_ij|, E = sum |e_ij| [DMSB99], equal to M^-1 L on an equilateral mesh; zero for fixed vertices.

    It is twice the operator of the paper, which is half the Laplacian there.

    :param mean: (n, n), whose pattern says which vertices are neighbours (:func:`neighbour_means`).
    :param x: (n, d), the lengths of the edges.
    :param moves: (n,).
    :raises InputError: for an edge of length zero.
    """
    rows, columns = mean.nonzero()
    away = rows != columns
    rows, columns = rows[away], columns[away]
    length = np.linalg.norm(x[rows] - x[columns], axis=1)
    if not length.all():
        raise InputError(f"scale-dependent: edges with length expected, got {int((length == 0).sum())} without")
    total = np.bincount(rows, weights=length, minlength=len(x))
    pull = np.where(moves, 4.0, 0.0)[rows] / (length * total[rows])
    entries = np.concatenate([np.bincount(rows, weights=pull, minlength=len(x)), -pull])
    own = np.arange(len(x))
    where = (np.concatenate([own, rows]), np.concatenate([own, columns]))
    return sparse.csr_matrix((entries, where), shape=(len(x), len(x)))


def neighbour_means(faces: Array, n: int, border: Border) -> Any:
    """The matrix (n, n) of the mean of the neighbours, each counted once; a vertex without neighbours is its own.

    :param faces: (m, 3).
    :param border: the neighbours of a border vertex: those along the border (``curve``), all (``free``), or none (``fixed``).
    """
    connectivity = connect((faces,), n)
    if border == "free" or not len(connectivity.border):
        return _means_around(connectivity.pattern)
    ends = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).astype(np.int64)
    low, high = ends.min(axis=1), ends.max(axis=1)
    edges, count = np.unique((low * n + high)[low != high], return_counts=True)
    low, high, single = edges // max(n, 1), edges % max(n, 1), count == 1
    on_border = np.zeros(n, bool)
    on_border[low[single]] = on_border[high[single]] = True
    pairs = np.concatenate([low * n + high, high * n + low])
    along = np.concatenate([single, single]) & (border == "curve")
    pairs = pairs[~on_border[pairs // max(n, 1)] | along]
    alone = np.flatnonzero(np.bincount(pairs // max(n, 1), minlength=n) == 0)
    pairs = np.sort(np.concatenate([pairs, alone * (n + 1)]))
    rows, columns = pairs // max(n, 1), pairs % max(n, 1)
    many = np.bincount(rows, minlength=n)
    first = np.concatenate([[0], np.cumsum(many)])
    return sparse.csr_matrix((1.0 / many[rows], columns, first), shape=(n, n))


def _means_around(pattern: Pattern) -> Any:
    """The matrix (n, n) of the mean of all neighbours, without the vertex itself if it has others."""
    many = np.diff(pattern.indptr)
    kept = np.ones(len(pattern.indices), bool)
    kept[pattern.diagonal[many > 1]] = False
    counts = np.maximum(many - 1, 1)
    first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    n = len(many)
    return sparse.csr_matrix((np.repeat(1.0 / counts, counts), pattern.indices[kept], first), shape=(n, n))


def means_over_diagonals(points: Array, faces: Array, normals: Array) -> Any:
    """The matrix (n, n) of the mean of the neighbours, over both diagonals of quadrilaterals that could be cut along either; a
    vertex without neighbours is its own.

    Where a mesher takes the shorter diagonal, the noise decides which vertices are neighbours, and those are more alike than
    others. Over both diagonals, each with half a weight, the mean is the same for either cut.

    :param points: (n, 3).
    :param faces: (m, 3).
    :param normals: unit normals (n, 3), along which lengths do not count.
    """
    n = len(points)
    ends = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).astype(np.int64), axis=1)
    edges = np.unique((ends[:, 0] * n + ends[:, 1])[ends[:, 0] != ends[:, 1]])
    one, other = shared_sides(faces)
    here, there = (faces[one // 3, (one + turn) % 3].astype(np.int64) for turn in (1, 2))
    left, right = (faces.ravel()[corner].astype(np.int64) for corner in (one, other))
    across = normals[here] + normals[there] + normals[left] + normals[right]
    across /= np.maximum(np.linalg.norm(across, axis=1), np.finfo(float).tiny)[:, None]
    kept, flipped = (_length_beside(points[b] - points[a], across) for a, b in ((here, there), (left, right)))
    either = (kept < EITHER * flipped) & (flipped < EITHER * kept) & (left != right) & (here != there)
    weights = np.ones(len(edges))
    cut = np.minimum(here, there)[either] * n + np.maximum(here, there)[either]
    weights[np.searchsorted(edges, cut)] = 0.5
    low, high = np.concatenate([edges // max(n, 1), left[either]]), np.concatenate([edges % max(n, 1), right[either]])
    weights = np.concatenate([weights, np.full(int(either.sum()), 0.5)])
    graph: Any = sparse.coo_matrix((weights, (low, high)), shape=(n, n)).tocsr()
    graph = graph + graph.T
    total = np.asarray(graph.sum(axis=1)).ravel()
    alone = sparse.diags((total == 0).astype(np.float64))
    return sparse.csr_matrix(sparse.diags(1.0 / np.where(total > 0, total, 1.0)) @ graph + alone)


def _length_beside(sides: Array, across: Array) -> Array:
    """The lengths (e,) of sides (e, 3) without their part along unit vectors (e, 3)."""
    along = np.einsum("ij,ij->i", sides, across)
    return np.linalg.norm(sides - along[:, None] * across, axis=1)


def cotangent_means(points: Array, faces: Array) -> Any:
    """The matrix (n, n) of the means of the neighbours with the weights of the cotangents; a vertex without neighbours is its
    own.

    On a plane linear functions of the place satisfy them, however irregular the triangles are.

    Weights below zero, which a Delaunay triangulation does not have inside, are taken for zero.

    :param points: (n, d).
    :param faces: (m, 3).
    """
    return means_of(stiffness(points, faces))


def means_of(stiffness: Any) -> Any:
    """The means of the neighbours (n, n) with the weights of a stiffness; a vertex without neighbours is its own.

    Weights below zero are taken for zero.
    """
    weights = sparse.csr_matrix(-stiffness)
    weights.setdiag(0.0)
    weights.data = np.maximum(weights.data, 0.0)
    weights.eliminate_zeros()
    total = np.asarray(weights.sum(axis=1)).ravel()
    alone = sparse.diags((total == 0).astype(np.float64))
    return sparse.csr_matrix(sparse.diags(1.0 / np.where(total > 0, total, 1.0)) @ weights + alone)
