"""The motion of a graph of several channels under mean curvature flow."""

import numpy as np

from meshflow.errors import InputError
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.geometry import operator
from meshflow.geometry.validation import Array
from meshflow.surfaces.surface import Surface

__all__ = ["GraphMotion"]


class GraphMotion(MeshFlow):
    """dI^a/dt = g^ij d_i d_j I^a, the part of mean curvature flow that moves the shape, brought back to the vertical.

    With B = M^-1 L X of the points X = (x, I) over the plane, and G the slopes of the channels,

        dI/dt = -(B_I - G B_x),

    since a point that moves by -B lies on the graph that has moved by this at the place where the point was. For one channel it
    is (6), 2 W kappa. For more, (8) as the paper writes it is another motion: in codimension above 1 the projection of B on the
    channels is not its share of the motion. G is the mean over the triangles around a vertex, weighted by their areas on the
    plane.

    :param surface: channels over a plane.
    :raises InputError: for another surface.
    """

    def __init__(self, surface: Surface) -> None:
        super().__init__(surface)
        if surface.is_free or surface.free.per_vertex:
            raise InputError("graph: channels over a plane expected, got points that move or rays")
        self._slopes = tuple(
            0.5 * np.sqrt(t.forms[:, 3]) if t.forms is not None else np.zeros(0) for t in self._triangulations
        )

    def _rated(self, u: Array, diagonal: int) -> Array:
        """The rate (n, k)."""
        snapshot = self._at(u, diagonal)
        t, m = snapshot.triangulation, snapshot.measured
        free = operator.gather_gradient(m.connectivity, m.weights, snapshot.x, False)
        chart = operator.gather_chart_gradient(m.connectivity, m.weights, t.charts, False)
        if self.surface.boundary != "plane-preserving":
            chart[t.connectivity.rim] = 0.0  # there B_x is the pull of the border, not the curvature
        pull = free - np.einsum("nc,nck->nk", chart, self._mean_slopes(diagonal % len(self._metrics), snapshot.x))
        moves = self._moves(snapshot.mass)
        rate = -np.divide(pull, snapshot.mass[:, None], out=np.zeros_like(pull), where=moves[:, None])
        rate = self.surface.free.along(rate)
        if self._border is not None:
            rate[self._rim] = -(self._border @ u)[self._rim]
        return rate

    def _mean_slopes(self, which: int, x: Array) -> Array:
        """G (n, c, k) of the triangulation."""
        t = self._triangulations[which]
        faces, area = t.connectivity.faces, self._slopes[which]
        legs = t.charts[:, 1:] - t.charts[:, :1]  # (m, 2, c)
        rises = x[faces[:, 1:]] - x[faces[:, :1]]
        slopes = np.linalg.pinv(legs) @ rises  # (m, c, k)
        total = np.zeros((len(x), *slopes.shape[1:]))
        for corner in range(3):
            np.add.at(total, faces[:, corner], area[:, None, None] * slopes)
        whole = np.bincount(faces.ravel(), np.repeat(area, 3), len(x))
        return total / np.where(whole > 0, whole, 1.0)[:, None, None]
