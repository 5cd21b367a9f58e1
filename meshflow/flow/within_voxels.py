"""The smoothest surface that the same voxels have: a low-pass filter whose surface passes between the same grid points.

Where a binary volume is extracted, each vertex is at the middle of an edge of the grid, one end of which is inside and one
outside. The surface crosses that edge somewhere, so that its distance from the vertex along the normal n is at most half of
|n . e|, e the edge. Of all surfaces that do so the one is taken that is least bent and nearest to the middles: a quadratic
program, as in Lempitsky, "Surface extraction from binary volumes with higher-order smoothness" (2010), on the mesh instead of
the volume, so that its triangles stay.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sparse

from meshflow.flow.contract import Flow
from meshflow.flow.low_pass import filtered, generator_of
from meshflow.flow.offsets import without_offsets
from meshflow.flow.workspace import Workspace
from meshflow.geometry.connectivity import connect
from meshflow.geometry.normals import mean_edge, normals_at
from meshflow.geometry.orientation import parts
from meshflow.geometry.validation import Array
from meshflow.geometry.volume import volume_gradient, volume_shares

__all__ = ["Between", "Held", "VoxelEdges"]

# The least distance that is allowed for, as a share of half an edge: the normals are not known better.
LEAST = 0.15
# Rounds of the dual iteration, after how many of them the normals are revised, and the share of vertices that may be farther
# out than a share of what they may; rounds for the volume of each part.
ROUNDS, REVISED, FEW, OUT, VOLUMES = 40, 5, 1e-3, 0.05, 3
# The largest rate of the filter's operator over the squared mean edge (of equilateral triangles it is 8). Vertices of thin
# triangles, whose rates are a hundred times that, would need polynomials four times as long, and nothing is gained.
FASTEST = 24.0
# The order of the filter of which the normals of the start are, with the time of which the cotangents are.
FIRST = 2


@dataclass(frozen=True, eq=False)
class VoxelEdges:
    """The edges of a grid at the middles of which the vertices of a level set of a binary volume are.

    :ivar axes: (3, 3), the edges of a voxel as rows, unit of the points; they need not be orthogonal.
    :ivar odd: (n, 3), the axes along which a vertex is between two grid points: one in marching cubes; none where unknown.
    """

    axes: Array
    odd: Array

    @property
    def shortest(self) -> float:
        """The shortest edge of a voxel."""
        return float(np.linalg.norm(self.axes, axis=1).min())

    @property
    def across(self) -> float:
        """The root mean square of the edges on which the vertices are."""
        between = self.odd[self.odd.any(axis=1)]
        return float(np.sqrt(np.mean((between @ np.linalg.norm(self.axes, axis=1)) ** 2)))

    def farthest(self, normals: Array) -> Array:
        """How far (n,) the surface may be from each vertex along unit normals (n, 3)."""
        between = np.where(self.odd.any(axis=1, keepdims=True), self.odd, True)
        lengths = np.linalg.norm(self.axes, axis=1)
        return 0.5 * (between * np.maximum(np.abs(normals @ self.axes.T), LEAST * lengths)).sum(axis=1)

    def nearer(self, start: Array, points: Array, normals: Array) -> Array:
        """Points (n, 3) within half a voxel of their start: an ellipsoid of which the edges of a voxel are the axes.

        Those outside are moved along the surface at first, so that its place is kept as far as it can be.
        """
        to_voxels = np.linalg.inv(self.axes)
        change = (points - start) @ to_voxels
        out = np.flatnonzero(np.einsum("ij,ij->i", change, change) > 0.25)
        if not len(out):
            return points
        change, across = change[out], normals[out] @ self.axes.T
        across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), np.finfo(float).tiny)
        off = np.einsum("ij,ij->i", change, across)[:, None]
        along, off = change - off * across, np.clip(off, -0.5, 0.5)
        length = np.maximum(np.linalg.norm(along, axis=1, keepdims=True), np.finfo(float).tiny)
        kept = off * across + along * np.minimum(1.0, np.sqrt(0.25 - off**2) / length)
        found = points.copy()
        found[out] = start[out] + kept @ self.axes
        return found


@dataclass(frozen=True, eq=False)
class Held:
    """The constraint that no point leaves half a voxel around its start (n, 3).

    :param faces: (m, 3).
    """

    edges: VoxelEdges
    start: Array
    faces: Array

    def hold(self, u: Array) -> Array:
        """u, moved in place; points inside keep their bits."""
        u[:] = self.edges.nearer(self.start, u, normals_at(u, self.faces))
        return u


@dataclass(frozen=True, eq=False)
class Between:
    """A stepper: the least bent surface between the same grid points, without mean offsets, with the volume of each part.

    :param order: of the filter (:class:`.LowPass`); ``presmooth``: of its cotangents.
    :param faces: (m, 3).
    """

    order: int
    presmooth: float
    edges: VoxelEdges
    faces: Array
    name = "low-pass"
    rates = 1

    def step(self, flow: Flow, u: Array, dt: float, diagonal: int = 0, workspace: Workspace | None = None) -> Array:
        """The points (n, 3) after time dt.

        :raises InputError: for a flow without a matrix of its operator.
        """
        start = u.astype(np.float64)
        generator = generator_of(flow, u, "cotangent", self.presmooth)
        rates = np.asarray(np.abs(generator).sum(axis=1)).ravel()
        stays = rates == 0
        most = FASTEST / mean_edge(start, self.faces) ** 2
        generator = sparse.csr_matrix(sparse.diags(most / np.maximum(rates, most)) @ generator)
        points = without_offsets(self._bent(generator, start, dt), start, self.faces, stays)
        return np.where(stays[:, None], u, self._with_volumes(points, start, ~stays)).astype(u.dtype)

    def largest(self, flow: Flow, u: Array) -> float:
        """Infinite: a filter of any length is stable."""
        return np.inf

    def _bent(self, generator: Any, start: Array, time: float) -> Array:
        """The least of |x - start|^2 + |(time A)^(order/2) x|^2 (n, 3), so that the surface is between the same grid points.

        With multipliers p along the normals it is the filter of start - p; they are found by the projected gradient of the
        dual, accelerated as Nesterov does. The filter takes nothing away from what is constant, so that steps of 1 are stable.
        """
        normals = normals_at(filtered(generator, start, self.presmooth, FIRST), self.faces)
        x, before = filtered(generator, start, time, self.order), np.zeros(len(start))
        ahead, momentum = before, 1.0
        for turn in range(ROUNDS):
            if turn > 0 and turn % REVISED == 0:
                normals = normals_at(x, self.faces)
            farthest = self.edges.farthest(normals)
            off = np.einsum("ij,ij->i", x - start, normals)
            if turn > 0 and np.mean(np.abs(off) > (1.0 + OUT) * farthest) <= FEW:
                break
            wanted = ahead + off
            pull = np.sign(wanted) * np.maximum(np.abs(wanted) - farthest, 0.0)
            following = 0.5 + np.sqrt(0.25 + momentum**2)
            ahead = pull + (momentum - 1.0) / following * (pull - before)
            before, momentum = pull, following
            x = filtered(generator, start - ahead[:, None] * normals, time, self.order)
        return x

    def _with_volumes(self, points: Array, start: Array, free: Array) -> Array:
        """Points (n, 3) within half a voxel, each closed part moved along its normals so that it has the volume of the start."""
        count, label = parts(self.faces, len(points))
        closed = np.ones(count, bool)
        closed[label[connect((self.faces,), len(points)).rim]] = False
        own = label[self.faces[:, 0]]
        goal = _volumes(start, self.faces, own, count)
        for _ in range(VOLUMES):
            normals = normals_at(points, self.faces) * free[:, None]
            slope = np.bincount(label, np.einsum("ij,ij->i", volume_gradient(points, self.faces), normals), count)
            short = goal - _volumes(points, self.faces, own, count)
            shift = np.divide(short, slope, out=np.zeros(count), where=closed & (slope != 0))
            most = 0.25 * self.edges.shortest
            points = points + np.clip(shift, -most, most)[label][:, None] * normals
            points = self.edges.nearer(start, points, normals)
        return points


def _volumes(points: Array, faces: Array, own: Array, count: int) -> Array:
    """The volume (count,) that the triangles of each part enclose, by the part (m,) of each."""
    return np.bincount(own, volume_shares(points, faces) / 6.0, count)
