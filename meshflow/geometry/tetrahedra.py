"""Meshes of tetrahedra: the cotangent operator from the six lengths of each, connectivity, and the skin of the body.

The stiffness L is symmetric and positive semidefinite, and ``L @ X`` is the gradient of the total volume with respect to every
vertex, in a space of any dimension: L_ij is minus a sixth of the length of the opposite edge times the cotangent of the angle at
it. libigl's ``cotmatrix`` of tetrahedra is ``-L``.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sparse

from meshflow.geometry.validation import Array
from meshflow.kernels import mesh_tetrahedra as kernels

__all__ = ["Tetrahedra", "skin_of", "triangles_of_cells"]

# Heights of a tetrahedron over its longest leg below which it is flat: it then contributes nothing.
FLAT = 1e-6
# The triangles of a tetrahedron, their normals pointing outward where its volume is positive.
SIDES = np.array(((1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1)))


@dataclass(frozen=True, eq=False)
class Tetrahedra:
    """Tetrahedra, and what does not change while values move on them.

    :ivar size: n, the number of vertices.
    :ivar cells: (m, 4), int32.
    :ivar frames: (m, 7), of each one: the gradient from the differences along its three legs, lower triangular, and its volume;
        zero where it is flat.
    """

    size: int
    cells: Array
    frames: Array

    @classmethod
    def of(cls, points: Array, cells: Array) -> "Tetrahedra":
        """From points (n, d), d >= 3, and cells (m, 4). Only lengths count, so that any isometric points give the same."""
        corners = np.asarray(points, np.float64)[cells]
        legs = corners[:, 1:] - corners[:, :1]
        return cls(len(points), np.ascontiguousarray(cells, np.int32), _frames(legs))

    @property
    def volumes(self) -> Array:
        """(m,), cubed length."""
        return self.frames[:, 6]

    def measured(self, u: Array, scale: float, sharpness: float, threads: int | None = None) -> tuple[Array, Array]:
        """Weights (m, 6) of the edges and volumes (m,) of the tetrahedra lifted by values.

        :param u: (n, k).
        :param scale: alpha squared; 0: the ground itself.
        :param sharpness: q of :class:`Variant`.
        """
        weights, volumes = np.empty((len(self.cells), 6)), np.empty(len(self.cells))
        kernels.tetrahedra_measured(u, self.cells, self.frames, scale, sharpness, weights, volumes, threads)
        return weights, volumes

    def gathered(self, weights: Array, volumes: Array, u: Array, threads: int | None = None) -> tuple[Array, Array]:
        """L @ u (n, k), L of weights (m, 6), and the mass (n,) of each vertex: a quarter of the volumes (m,) around it."""
        first, corners = self._around
        found, mass = np.empty_like(u), np.empty(self.size)
        kernels.tetrahedra_gathered(first, corners, self.cells, weights, volumes, u, found, mass, None, threads)
        return found, mass

    def rows(self, weights: Array, volumes: Array, threads: int | None = None) -> tuple[Array, Array]:
        """Bounds (n,) of the rows of L of weights (m, 6), the sums of their absolute values (Gershgorin), and the mass (n,)."""
        first, corners = self._around
        above, mass, none = np.empty(self.size), np.empty(self.size), np.zeros((self.size, 1))
        pull = np.empty_like(none)
        kernels.tetrahedra_gathered(first, corners, self.cells, weights, volumes, none, pull, mass, above, threads)
        return 2.0 * above, mass

    @cached_property
    def ground(self) -> tuple[Array, Array]:
        """:meth:`rows` of the ground: bounds (n,) of the rows of L, and the mass (n,)."""
        return self.rows(*self.measured(np.zeros((self.size, 1)), 0.0, 1.0))

    def stiffness(self, weights: Array | None = None) -> Any:
        """L (n, n) of weights (m, 6), by default those of the ground."""
        if weights is None:
            weights, _ = self.measured(np.zeros((self.size, 1)), 0.0, 1.0)
        edges, slots = self._edges
        found = np.bincount(slots.ravel(), weights.ravel(), len(edges))
        low, high = edges.T
        one = sparse.coo_matrix((-found, (low, high)), shape=(self.size, self.size))
        off = sparse.csr_matrix(one + one.T)
        return sparse.csr_matrix(off - sparse.diags(np.asarray(off.sum(axis=1)).ravel()))

    @cached_property
    def rim(self) -> Array:
        """The vertices (n,) on the skin of the body."""
        found = np.zeros(self.size, bool)
        found[skin_of(self.cells)] = True
        return found

    @cached_property
    def _edges(self) -> tuple[Array, Array]:
        """The edges (e, 2), and which of them each tetrahedron has (m, 6)."""
        ends = np.sort(self.cells[:, np.array(kernels.EDGES)].astype(np.int64), axis=2)
        keys, slots = np.unique(ends[..., 0] * self.size + ends[..., 1], return_inverse=True)
        return np.stack(np.divmod(keys, self.size), axis=1), slots.reshape(-1, 6)

    @cached_property
    def _around(self) -> tuple[Array, Array]:
        """The start of the corners of each vertex (n + 1,), and the corners (4 m,)."""
        flat = self.cells.ravel()
        first = np.concatenate([[0], np.cumsum(np.bincount(flat, minlength=self.size))])
        return first, np.argsort(flat, kind="stable").astype(np.int32)


def triangles_of_cells(cells: Array) -> Array:
    """The triangles (4 m, 3) of tetrahedra (m, 4), four of each; those inside occur twice."""
    return cells[:, SIDES].reshape(-1, 3)


def skin_of(cells: Array) -> Array:
    """The triangles (b, 3) that belong to one tetrahedron only: the skin of the body."""
    sides = triangles_of_cells(cells)
    _, which, count = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True, return_counts=True)
    return sides[count[which.reshape(-1)] == 1]


def _frames(legs: Array) -> Array:
    """Gradients and volumes (m, 7) of legs (m, 3, d), by orthogonalization; zero for flat tetrahedra."""
    a, b, c = np.moveaxis(legs, 1, 0)
    longest = np.linalg.norm(legs, axis=2).max(axis=1, initial=0.0)

    def direction(leg: Array) -> tuple[Array, Array, Array]:
        """Length, its inverse, and unit vector of a leg; zero where it is too short."""
        length = np.linalg.norm(leg, axis=1)
        over = np.divide(1.0, length, out=np.zeros_like(length), where=length > FLAT * longest)
        return length, over, leg * over[:, None]

    x, xx, e = direction(a)
    yx = np.einsum("md,md->m", b, e)
    y, yy, f = direction(b - yx[:, None] * e)
    zx = np.einsum("md,md->m", c, e)
    rest = c - zx[:, None] * e
    zy = np.einsum("md,md->m", rest, f)
    z, zz, _ = direction(rest - zy[:, None] * f)
    # The inverse of ((x, 0, 0), (yx, y, 0), (zx, zy, z)).
    frames = np.stack(
        [xx, -yx * xx * yy, yy, -(zx * xx - zy * yx * xx * yy) * zz, -zy * yy * zz, zz, x * y * z / 6.0], axis=1
    )
    frames[(xx * yy * zz) == 0] = 0.0
    return frames
