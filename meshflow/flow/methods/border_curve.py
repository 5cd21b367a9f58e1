"""The border of a mesh as a curve in space, which moves by its own curvature, independently of the interior."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sparse

from meshflow.flow.blend import RATE, Blend
from meshflow.flow.contract import Flow, System
from meshflow.flow.low_pass import Operator, generator_of
from meshflow.flow.wrapper import Around
from meshflow.geometry.connectivity import boundary_edges
from meshflow.geometry.validation import Array
from meshflow.surfaces.surface import Surface

__all__ = ["Bordered"]

# The shortest border edge, as a share of the mean; shorter ones count as this long.
SHORT = 1e-5


@dataclass(frozen=True, eq=False)
class _BorderedSystem:
    """The systems of the interior and of the border; the coupling between them is lagged."""

    system: System
    at: Array
    own: Array
    stiffness: Any

    @property
    def mass(self) -> Array:
        """M (n,) of vertices in the interior; half the length of the adjacent edges on the border."""
        mass = self.system.mass.copy()
        mass[self.at] = self.own
        return mass

    def matrix(self, dt: float) -> Any:
        """mass + dt stiffness."""
        return self.system.matrix(dt) + sparse.diags(self.mass - self.system.mass) + dt * self.stiffness


class Bordered(Around):
    """A flow in the interior; the border vertices move by the curvature vector of the border curve.

    It is the curve shortening flow dx/dt = d2x/ds2 with s by edge lengths. Straight borders do not move, however irregularly they
    are sampled; a circle shrinks as sqrt(r^2 - 2 t); corners become round. A vertex where not exactly two border edges meet (a
    bow tie, the end of an edge of three triangles) stays, because no curve is defined there.

    :param flow: an engine that keeps the border fixed.
    :param surface: of that engine, all coordinates free.
    """

    def __init__(self, flow: Flow, surface: Surface) -> None:
        super().__init__(flow)
        faces, n = surface.triangulations[0], len(surface.points)
        border = boundary_edges(faces)
        ends = np.stack([faces[border // 3, (border + shift) % 3] for shift in (1, 2)], axis=1)
        moves = (np.bincount(ends.ravel(), minlength=n) == 2) & ~surface.fixed
        self._edges, self._moves, self._at = ends, moves, np.flatnonzero(moves)

    def rate(self, u: Array, diagonal: int = 0, blend: Blend = RATE, out: Array | None = None) -> Array:
        """du/dt (n, k), or what the blend makes of it."""
        drawn = self._drawn(u)
        to = self.flow.rate(u, diagonal, blend, out)
        to[self._at] += blend.dt * drawn
        return to

    def bound(self, u: Array) -> float:
        """The bound of the flow, and that of the curve by Gershgorin's theorem."""
        stiffness, mass = self._curve(u)
        diagonal = stiffness.diagonal()[self._at]
        return max(self.flow.bound(u), 2.0 * float(np.max(diagonal / mass[self._at], initial=0.0)))

    def system(self, u: Array, diagonal: int = 0) -> System:
        """Mass and stiffness of both."""
        stiffness, mass = self._curve(u)
        keep = sparse.diags(self._moves.astype(np.float64))
        return _BorderedSystem(self.flow.system(u, diagonal), self._at, mass[self._at], keep @ stiffness @ keep)

    def generator(self, u: Array, weights: Operator, presmooth: float = 0.0) -> Any:
        """A (n, n) of both; the border is always weighted by lengths."""
        stiffness, mass = self._curve(u)
        scale = np.divide(1.0, mass, out=np.zeros_like(mass), where=self._moves)
        return sparse.csr_matrix(generator_of(self.flow, u, weights, presmooth) + sparse.diags(scale) @ stiffness)

    def _curve(self, u: Array) -> tuple[Any, Array]:
        """Stiffness (n, n) of the border edges, 1 / length, and mass (n,), half the length of the edges at a vertex."""
        n, (i, j) = len(u), self._edges.T
        lengths = np.linalg.norm(u[i] - u[j], axis=1)
        lengths = np.maximum(lengths, max(SHORT * float(lengths.mean()) if len(lengths) else 0.0, np.finfo(float).tiny))
        weights = sparse.coo_matrix((1.0 / lengths, (i, j)), shape=(n, n))
        weights = weights + weights.T
        stiffness = sparse.csr_matrix(sparse.diags(np.asarray(weights.sum(axis=1)).ravel()) - weights)
        return stiffness, 0.5 * (np.bincount(i, lengths, n) + np.bincount(j, lengths, n))

    def _drawn(self, u: Array) -> Array:
        """The curvature vectors of the border vertices that move."""
        stiffness, mass = self._curve(u)
        return -(stiffness @ u)[self._at] / mass[self._at, None]
