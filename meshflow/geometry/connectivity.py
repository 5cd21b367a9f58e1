"""Connectivity of triangles, computed once for each set and used in every step."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from meshflow.geometry.once import once
from meshflow.geometry.validation import Array, indices_of
from meshflow.kernels import mesh_connectivity as kernels

__all__ = ["Connectivity", "Pattern", "boundary_edges", "connect", "shared_sides"]


@dataclass(frozen=True, eq=False)
class Pattern:
    """The sparsity pattern of the matrices of a mesh.

    :ivar indptr: of the CSR pattern of vertices joined by an edge, (n + 1,).
    :ivar indices: its columns, sorted within each row.
    :ivar slots: (3 m, 2), uint8, for each corner of ``Connectivity.corners`` the positions in its row of the entries of its two
        neighbours; 255: they must be searched for.
    :ivar diagonal: (n,), the positions of the diagonal entries.
    """

    indptr: Array
    indices: Array
    slots: Array
    diagonal: Array


@dataclass(frozen=True, eq=False)
class Connectivity:
    """The triangles around each vertex.

    A *corner* c of the mesh is corner ``c % 3`` of triangle ``c // 3``. Loops gather over the corners of a vertex, so that
    no two threads write to the same place and sums do not depend on the number of threads.

    :ivar faces: (m, 3).
    :ivar first: (n + 1,), the start of the corners of each vertex in ``corners`` (3 m,).
    :ivar border: corners opposite to a boundary edge.
    """

    faces: Array
    first: Array
    corners: Array
    border: Array

    @classmethod
    def of(cls, triangulations: tuple[Array, ...], n: int) -> "Connectivity":
        """Connect all triangles of one or more triangulations of the same n vertices.

        The boundary is that of each triangulation separately: an edge of one may be covered by a diagonal of the other.
        """
        if len(triangulations) == 1:
            faces = indices_of(triangulations[0])
            around = _around(faces, n)
            return cls(faces, *around, _opposite_to_border(*around, faces))
        faces = np.concatenate([indices_of(part) for part in triangulations])
        offsets = [sum(map(len, triangulations[:i])) for i in range(len(triangulations))]
        border = [boundary_edges(part) + 3 * at for part, at in zip(triangulations, offsets, strict=True)]
        return cls(faces, *_around(faces, n), np.concatenate(border))

    @property
    def size(self) -> int:
        """Number of vertices."""
        return len(self.first) - 1

    @cached_property
    def rim(self) -> Array:
        """Vertices (n,) at the boundary."""
        found = np.zeros(self.size, bool)
        for shift in (1, 2):
            found[self.faces[self.border // 3, (self.border + shift) % 3]] = True
        return found

    @cached_property
    def pattern(self) -> Pattern:
        """The sparsity pattern; made for the first matrix, since explicit steps need none."""
        indptr = np.empty(self.size + 1, np.int32)
        indices = np.empty(kernels.pattern_rows(self.first, self.corners, self.faces, indptr), np.int32)
        slots, diagonal = np.empty((len(self.corners), 2), np.uint8), np.empty(self.size, np.int32)
        kernels.pattern_entries(self.first, self.corners, self.faces, indptr, indices, slots, diagonal)
        return Pattern(indptr, indices, slots, diagonal)


@once
def connect(triangulations: tuple[Array, ...], n: int) -> Connectivity:
    """As :meth:`Connectivity.of`, for triangles that are asked for more than once."""
    return Connectivity.of(triangulations, n)


def boundary_edges(faces: Array) -> Array:
    """Corners (b,) opposite to the edges that belong to one triangle only; corner c is ``c % 3`` of triangle ``c // 3``.

    Triangles with a repeated vertex have no edges; an edge of three triangles (non-manifold) is no boundary.
    """
    faces = indices_of(faces)
    return _opposite_to_border(*_around(faces, int(faces.max(initial=-1)) + 1), faces)


def _opposite_to_border(first: Array, corners: Array, faces: Array) -> Array:
    """:func:`boundary_edges` of triangles whose corners around each vertex are known."""
    lonely = np.empty(3 * len(faces), np.bool_)
    kernels.mark_border(first, corners, faces, lonely)
    return np.flatnonzero(lonely)


def _around(faces: Array, n: int) -> tuple[Array, Array]:
    """The start of the corners of each vertex (n + 1,), and the corners (3 m,)."""
    first, corners = np.empty(n + 1, np.int64), np.empty(3 * len(faces), np.int32)
    kernels.corners_around(n, faces, first, corners)
    return first, corners


@once
def shared_sides(faces: Array) -> tuple[Array, Array]:
    """Corners (e,) and (e,) opposite to the edges of exactly two triangles, one of each; corner c is ``c % 3`` of ``c // 3``.

    They are in the order of the ends of the edges. Triangles with a repeated vertex have no edges.
    """
    faces = indices_of(faces)
    n = int(faces.max(initial=-1)) + 1
    around, start = _around(faces, n), np.empty(n + 1, np.int64)
    one = np.empty(kernels.count_shared(*around, faces, start), np.int64)
    other = np.empty_like(one)
    kernels.list_shared(*around, faces, start, one, other)
    return one, other
