"""The noise of a mesh at its edges, from four vertices each: the shape counts least there, and designed models are flat across
most of their edges.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import ndtri

from meshflow.estimate.noise_growth import MAD
from meshflow.geometry.connectivity import shared_sides
from meshflow.geometry.validation import Array

__all__ = ["bent_like_noise", "noise_at_edges"]

# The share of the edges with the least residuals, from which sigma is estimated.
LEAST = 0.25
# Residuals are clipped at this many of their deviations.
CLIPPED = 2.5


def noise_at_edges(points: Array, faces: Array, counted: Array) -> float:
    """The standard deviation of white noise that edges show, unit of the points; infinite if there are no edges.

    The residual of an edge is the volume of the tetrahedron of the two triangles beside it, divided by its response to noise. It
    does not depend on which diagonal of a quadrilateral is the edge. Where a quarter of the edges is flat without noise, sigma
    is right to a tenth; for curved shapes it is too large, for noise as large as triangles up to 40 % too small.

    :param points: (n, 3), float64.
    :param counted: (n,), mask of the vertices that are used.
    """
    edges = _Edges.of(points, faces, counted)
    if not len(edges.corners):
        return np.inf
    return float(np.quantile(np.abs(edges.residuals), LEAST) / ndtri(0.5 + 0.5 * LEAST))


def bent_like_noise(points: Array, faces: Array, normals: Array, made: Array) -> float:
    """How far the edges of a triangle are bent against each other as those of white noise are: 1 for noise alone, about 0 for
    surfaces that were simplified, whose triangles follow the shape, and below for curved ones.

    A vertex that is raised makes ridges of the edges that meet in it, and valleys of those around it, so that two edges of a
    triangle have opposite signs more often than not.

    :param points: (n, 3), float64; ``normals``: (n, 3), along which there may be noise.
    :param made: (n, d), samples of white noise, with which the correlation of residuals is compared.
    """
    edges = _Edges.of(points, faces, np.ones(len(points), bool))
    if not len(edges.pairs):
        return 0.0
    noise = np.mean([edges.correlation(edges.answers(one[:, None] * normals)) for one in made.T])
    return float(edges.correlation(edges.residuals) / noise) if noise < 0 else 0.0


@dataclass(frozen=True, eq=False)
class _Edges:
    """Edges between two triangles each, and the tetrahedra of these.

    :ivar corners: (e, 4), the ends of each edge, and the vertices beside it; ``pulls``: (4, e, 3), what moves its volume.
    :ivar residuals: (e,), of the points; positive at ridges of a surface whose normals point outwards.
    :ivar response: (e,), to noise.
    :ivar triangles: (e, 2), beside each edge.
    """

    corners: Array
    pulls: Array
    residuals: Array
    response: Array
    triangles: Array

    @classmethod
    def of(cls, points: Array, faces: Array, counted: Array) -> "_Edges":
        """Those whose four vertices have the mask (n,)."""
        one, other = shared_sides(faces)
        triangle = one // 3
        start, end = (faces[triangle, (one + turn) % 3] for turn in (1, 2))
        corners = np.stack([start, end, faces.ravel()[one], faces.ravel()[other]], axis=1)
        used = counted[corners].all(axis=1)
        corners = corners[used]
        side, left, right = (points[corners[:, i]] - points[corners[:, 0]] for i in (1, 2, 3))
        across = np.cross(side, left)
        moved = (np.cross(left, right), -np.cross(side, right), across)
        pulls = np.stack([-(moved[0] + moved[1] + moved[2]), *moved])
        response = np.sqrt(np.einsum("kij,kij->i", pulls, pulls))
        residuals = _over(-np.einsum("ij,ij->i", across, right), response)
        return cls(corners, pulls, residuals, response, np.stack([triangle, other // 3], axis=1)[used])

    def answers(self, noise: Array) -> Array:
        """The residuals (e,) of small displacements (n, 3)."""
        return _over(-np.einsum("kij,ikj->i", self.pulls, noise[self.corners]), self.response)

    @cached_property
    def pairs(self) -> Array:
        """(p, 2), the edges of a triangle by two."""
        triangles, edges = self.triangles.T.ravel(), np.tile(np.arange(len(self.corners)), 2)
        order = np.argsort(triangles, kind="stable")
        triangles, edges = triangles[order], edges[order]
        return np.concatenate(
            [
                np.stack([edges[:-after], edges[after:]], axis=1)[triangles[:-after] == triangles[after:]]
                for after in (1, 2)
            ]
        )

    def correlation(self, residuals: Array) -> float:
        """That of the residuals (e,) of two edges of a triangle, which are clipped."""
        size = MAD * float(np.median(np.abs(residuals)))
        held = np.clip(residuals / max(size, np.finfo(float).tiny), -CLIPPED, CLIPPED)
        square = float(np.mean(np.square(held)))
        return float(np.mean(held[self.pairs[:, 0]] * held[self.pairs[:, 1]])) / max(square, np.finfo(float).tiny)


def _over(values: Array, by: Array) -> Array:
    """A quotient, zero where nothing is divided by."""
    return np.divide(values, by, out=np.zeros_like(values), where=by > 0)
