"""Who touches whom: computed once for each set of triangles, used at every step."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sparse

from meshflow.geometry.gates import Array

__all__ = ["Connectivity", "Pattern", "boundary_edges", "connect", "shared_sides"]


@dataclass(frozen=True, eq=False)
class Pattern:
    """The sparse matrix that triangles span, without its numbers.

    :ivar indptr: of the CSR pattern of vertices joined by an edge, (n + 1,).
    :ivar indices: its columns, sorted within each row.
    :ivar slots: (3 m, 2), for each corner of ``Connectivity.corners`` where the entries of its two neighbours stand.
    :ivar diagonal: (n,), where the diagonal entries stand.
    """

    indptr: Array
    indices: Array
    slots: Array
    diagonal: Array


@dataclass(frozen=True, eq=False)
class Connectivity:
    """The triangles around each vertex.

    A *corner* c of the mesh is corner ``c % 3`` of triangle ``c // 3``. Loops gather over the corners of a vertex, so that
    no two threads write to one place and the sum does not depend on their number.

    :ivar faces: (m, 3).
    :ivar first: (n + 1,), where the corners of each vertex begin in ``corners`` (3 m,).
    :ivar border: corners opposite to a boundary edge.
    """

    faces: Array
    first: Array
    corners: Array
    border: Array

    @property
    def size(self) -> int:
        """Number of vertices."""
        return len(self.first) - 1

    @cached_property
    def rim(self) -> Array:
        """Vertices (n,) at the boundary."""
        found = np.zeros(self.size, bool)
        for turn in (1, 2):
            found[self.faces[self.border // 3, (self.border + turn) % 3]] = True
        return found

    @cached_property
    def pattern(self) -> Pattern:
        """The sparse pattern; made when the first matrix is asked for, since explicit steps need none."""
        faces, n = self.faces.astype(np.int64), self.size
        rows = np.concatenate([faces[:, i] for i in (0, 1, 2, 1, 2, 0)] + [np.arange(n)])
        columns = np.concatenate([faces[:, i] for i in (1, 2, 0, 0, 1, 2)] + [np.arange(n)])
        matrix: Any = sparse.csr_matrix((np.ones(len(rows), np.int8), (rows, columns)), shape=(n, n))
        matrix.sum_duplicates()
        keys = np.repeat(np.arange(n), np.diff(matrix.indptr)) * n + matrix.indices  # sorted: rows, then columns
        triangle, corner = np.divmod(self.corners, 3)
        own = faces[triangle, corner] * n
        slots = [np.searchsorted(keys, own + faces[triangle, (corner + turn) % 3]) for turn in (1, 2)]
        diagonal = np.searchsorted(keys, np.arange(n) * (n + 1))
        return Pattern(matrix.indptr, matrix.indices, np.stack(slots, axis=-1).astype(np.int32), diagonal)


def connect(sheets: tuple[Array, ...], n: int) -> Connectivity:
    """Connect all triangles of one or more triangulations of the same n vertices.

    The boundary is that of each triangulation by itself: an edge of one may be covered by a diagonal of the other.
    """
    faces = np.concatenate(sheets).astype(np.int32)  # half the memory; no mesh has 2^31 / 3 triangles
    offsets = [sum(map(len, sheets[:i])) for i in range(len(sheets))]
    border = np.concatenate([boundary_edges(sheet) + 3 * at for sheet, at in zip(sheets, offsets, strict=True)])
    flat = faces.ravel()
    corners = np.argsort(flat, kind="stable").astype(np.int32)
    first = np.zeros(n + 1, np.int64)
    np.cumsum(np.bincount(flat, minlength=n), out=first[1:])
    return Connectivity(faces, first, corners, border)


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


def shared_sides(faces: Array) -> tuple[Array, Array]:
    """Corners (e,) and (e,) opposite to the edges of exactly two triangles, one of each; corner c is ``c % 3`` of ``c // 3``."""
    ends = np.sort(faces[:, [[1, 2], [2, 0], [0, 1]]].reshape(-1, 2).astype(np.int64), axis=1)
    keys = ends[:, 0] * (int(faces.max(initial=0)) + 1) + ends[:, 1]
    order = np.argsort(keys, kind="stable")
    same = keys[order][1:] == keys[order][:-1]
    pair = same.copy()
    pair[1:] &= ~same[:-1]
    pair[:-1] &= ~same[1:]
    first = np.flatnonzero(pair)
    return order[first], order[first + 1]
