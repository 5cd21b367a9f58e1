"""Two filters of normals from their papers, which no package has: bilateral (Zheng et al. 2011) and guided (Zhang et al. 2015).

Points follow the normals as in Sun et al. 2007, written out here: peers share no code with what they are compared with.
"""

from typing import Any

import numpy as np
import scipy.sparse as sparse
from scipy.spatial import cKDTree

from meshflow.geometry.validation import Array

__all__ = ["bilateral_normals", "guided_normals"]

TINY = 1e-30


def bilateral_normals(points: Array, faces: Array, width: float, rounds: float, fits: float) -> Array:
    """Bilateral normal filtering, local and iterative (Zheng, Fu, Au, Tai, *Bilateral Normal Filtering for Mesh Denoising*).

    :param width: sigma of the differences of normals; that of distances is the mean distance of centroids, as in the paper.
    :param rounds: of the normals.
    :param fits: rounds of the vertices.
    """
    ring, (normals, areas, centers) = _ring(faces), _triangles(points, faces)
    row, column = ring.row, ring.col
    apart = np.linalg.norm(centers[row] - centers[column], axis=1)
    near = areas[column] * np.exp(-0.5 * (apart / apart.mean()) ** 2)
    for _ in range(int(rounds)):
        normals = _averaged(normals, normals, (row, column), near, width)
    return _followed(points, faces, normals, int(fits))


def guided_normals(points: Array, faces: Array, width: float, rounds: float, normal_rounds: float) -> Array:
    """Guided normal filtering (Zhang, Deng, Zhang, Bouaziz, Liu, *Guided Mesh Normal Filtering*, 2015).

    The guidance of a triangle is the mean normal of the most consistent patch that contains it; a patch is a triangle with all
    that share a vertex with it. Distances within 2 mean distances of the centroids of neighbours count.

    :param width: sigma of the differences of guidance normals.
    :param rounds: of all: normals, then 10 rounds of the vertices.
    :param normal_rounds: rounds of the normals in each.
    """
    x, m, ring = points.astype(np.float64), len(faces), _ring(faces)
    patches = [
        np.append(part, k)
        for k, part in enumerate(np.split(ring.col, np.cumsum(np.bincount(ring.row, minlength=m))[:-1]))
    ]
    widest = max(map(len, patches))
    slots = np.array([np.pad(part, (0, widest - len(part)), mode="edge") for part in patches])
    inner = _inner_edges(faces, slots)
    for _ in range(int(rounds)):
        normals, areas, centers = _triangles(x, faces)
        sides = _sides(faces)
        reach = float(np.linalg.norm(centers[sides[:, 0]] - centers[sides[:, 1]], axis=1).mean())
        pairs = cKDTree(centers).query_pairs(2.0 * reach, output_type="ndarray")
        row, column = np.concatenate([pairs, pairs[:, ::-1], np.repeat(np.arange(m)[:, None], 2, axis=1)]).T
        apart = np.linalg.norm(centers[row] - centers[column], axis=1)
        near = areas[column] * np.exp(-0.5 * (apart / reach) ** 2)
        for _ in range(int(normal_rounds)):
            guide = _guidance(normals, areas, slots, inner)
            normals = _averaged(normals, guide, (row, column), near, width)
        x = _followed(x, faces, normals, 10)
    return x


def _guidance(normals: Array, areas: Array, slots: Array, inner: tuple[Array, Array, Array]) -> Array:
    """The mean normal (m, 3) of the most consistent patch that contains each triangle."""
    m = len(normals)
    inside = normals[slots]
    cosine = np.einsum("kic,kjc->kij", inside, inside).min(axis=(1, 2))
    spread = np.sqrt(np.maximum(2.0 - 2.0 * cosine, 0.0))
    patch, one, other = inner
    steps = np.linalg.norm(normals[one] - normals[other], axis=1)
    largest, total = np.zeros(m), np.bincount(patch, steps, m)
    np.maximum.at(largest, patch, steps)
    harm = spread * largest / (1e-9 + total)
    weight = np.ones(slots.shape)
    weight[:, 1:] = slots[:, 1:] != slots[:, :-1]  # padding repeats the last one
    mean = np.einsum("ki,kic->kc", weight * areas[slots], inside)
    best = slots[np.arange(m), harm[slots].argmin(axis=1)]
    return _unit(mean[best])


def _averaged(normals: Array, guide: Array, pairs: tuple[Array, Array], near: Array, width: float) -> Array:
    """The means of normals (m, 3) with weights near exp(-|difference of the guides|^2 / 2 width^2)."""
    row, column = pairs
    turn = guide[row] - guide[column]
    weight = near * np.exp(-0.5 * np.einsum("ij,ij->i", turn, turn) / width**2)
    matrix = sparse.csr_matrix((weight, (row, column)), shape=(len(normals), len(normals)))
    return _unit(np.asarray(matrix @ normals))


def _followed(points: Array, faces: Array, normals: Array, rounds: int) -> Array:
    """Points moved to fit the normals: x += mean of n n . (c - x) over the triangles around."""
    x, many = points.astype(np.float64), np.maximum(np.bincount(faces.ravel(), minlength=len(points)), 1)
    for _ in range(rounds):
        centers, total = x[faces].mean(axis=1), np.zeros_like(x)
        for corner in range(3):
            high = np.einsum("ij,ij->i", normals, centers - x[faces[:, corner]])
            np.add.at(total, faces[:, corner], high[:, None] * normals)
        x = x + total / many[:, None]
    return x


def _triangles(points: Array, faces: Array) -> tuple[Array, Array, Array]:
    """Unit normals, areas and centroids."""
    a, b, c = np.moveaxis(points[faces], 1, 0)
    across = np.cross(b - a, c - a)
    return _unit(across), 0.5 * np.linalg.norm(across, axis=1), (a + b + c) / 3.0


def _ring(faces: Array) -> Any:
    """The pairs of different triangles that share a vertex, sorted by rows."""
    m = len(faces)
    at = sparse.csr_matrix(
        (np.ones(3 * m), (np.repeat(np.arange(m), 3), faces.ravel())), shape=(m, int(faces.max()) + 1)
    )
    shared = sparse.csr_matrix(at @ at.T)
    shared.setdiag(0)
    shared.eliminate_zeros()
    shared.sort_indices()
    return shared.tocoo()


def _sides(faces: Array) -> Array:
    """The pairs (e, 2) of triangles that share an edge."""
    ends = np.sort(faces[:, [[1, 2], [2, 0], [0, 1]]].reshape(-1, 2).astype(np.int64), axis=1)
    keys = ends[:, 0] * (int(faces.max()) + 1) + ends[:, 1]
    order = np.argsort(keys, kind="stable")
    same = np.flatnonzero(keys[order][1:] == keys[order][:-1])
    return np.stack([order[same] // 3, order[same + 1] // 3], axis=1)


def _inner_edges(faces: Array, slots: Array) -> tuple[Array, Array, Array]:
    """Patch, triangle and triangle of each edge inside of each patch."""
    m, sides = len(faces), _sides(faces)
    member = sparse.csr_matrix(
        (np.ones(slots.size), (np.repeat(np.arange(m), slots.shape[1]), slots.ravel())), shape=(m, m)
    )
    both = sparse.coo_matrix(member[:, sides[:, 0]].multiply(member[:, sides[:, 1]]))
    return both.row, sides[both.col, 0], sides[both.col, 1]


def _unit(vectors: Array) -> Array:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), TINY)
