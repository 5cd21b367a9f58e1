"""Who touches whom: computed once for each set of triangles, used at every step."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sparse

from meshflow.geometry.gates import Array

__all__ = ["Connectivity", "boundary_edges", "connect"]


@dataclass(frozen=True, eq=False)
class Connectivity:
    """The triangles around each vertex, and the sparse pattern that they span.

    A *corner* c of the mesh is corner ``c % 3`` of triangle ``c // 3``. Loops gather over the corners of a vertex, so that
    no two threads write to one place and the sum does not depend on their number.

    :ivar faces: (m, 3).
    :ivar first: (n + 1,), where the corners of each vertex begin in ``corners`` (3 m,).
    :ivar indptr: of the CSR pattern of vertices joined by an edge, (n + 1,), and its column ``indices``.
    :ivar slots: (3 m, 2), for each corner of ``corners`` where the entries of its two neighbours stand in the pattern.
    :ivar diagonal: (n,), where the diagonal entries stand.
    :ivar border: corners opposite to a boundary edge.
    """

    faces: Array
    first: Array
    corners: Array
    indptr: Array
    indices: Array
    slots: Array
    diagonal: Array
    border: Array

    @property
    def size(self) -> int:
        """Number of vertices."""
        return len(self.first) - 1


def connect(sheets: tuple[Array, ...], n: int) -> Connectivity:
    """Connect all triangles of one or more triangulations of the same n vertices.

    The boundary is that of each triangulation by itself: an edge of one may be covered by a diagonal of the other.
    """
    faces = np.concatenate(sheets)
    offsets = [sum(map(len, sheets[:i])) for i in range(len(sheets))]
    border = np.concatenate([boundary_edges(sheet) + 3 * at for sheet, at in zip(sheets, offsets, strict=True)])
    flat = faces.ravel()
    corners = np.argsort(flat, kind="stable")
    first = np.zeros(n + 1, np.int64)
    np.cumsum(np.bincount(flat, minlength=n), out=first[1:])
    rows = np.concatenate([faces[:, i] for i in (0, 1, 2, 1, 2, 0)] + [np.arange(n)])
    columns = np.concatenate([faces[:, i] for i in (1, 2, 0, 0, 1, 2)] + [np.arange(n)])
    pattern: Any = sparse.csr_matrix((np.ones(len(rows), np.int8), (rows, columns)), shape=(n, n))
    pattern.sum_duplicates()
    keys = np.repeat(np.arange(n), np.diff(pattern.indptr)) * n + pattern.indices  # sorted: rows, then columns
    own = flat[corners]
    slots = np.stack([np.searchsorted(keys, own * n + _turned(faces, corners, turn)) for turn in (1, 2)], axis=-1)
    diagonal = np.searchsorted(keys, np.arange(n) * (n + 1))
    return Connectivity(faces, first, corners, pattern.indptr, pattern.indices, slots, diagonal, border)


def _turned(faces: Array, corners: Array, turn: int) -> Array:
    """The vertex that follows each corner, ``turn`` corners on around its triangle."""
    return faces[corners // 3, (corners + turn - corners // 3 * 3) % 3]


def boundary_edges(faces: Array) -> Array:
    """Corners (b,) opposite to the edges that belong to one triangle only; corner c is ``c % 3`` of triangle ``c // 3``.

    Triangles that name a vertex twice have no edges; an edge of three triangles (non-manifold) is no boundary.
    """
    if len(faces) == 0:
        return np.zeros(0, np.int64)
    tails, heads = faces[:, [1, 2, 0]].ravel(), faces[:, [2, 0, 1]].ravel()
    real = np.repeat((faces != np.roll(faces, 1, axis=1)).all(axis=1), 3)
    edges = np.sort(np.stack([tails, heads], axis=1), axis=1)
    keys = edges[:, 0] * (faces.max() + 1) + edges[:, 1]
    keys[~real] = -1
    _, inverse, counts = np.unique(keys, return_inverse=True, return_counts=True)
    return np.flatnonzero((counts[inverse] == 1) & real)
