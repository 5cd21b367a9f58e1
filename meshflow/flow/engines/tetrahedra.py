"""The flow of values on a mesh of tetrahedra. The loops are in C++ (kernels)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sparse

from meshflow.flow.blend import RATE, Blend
from meshflow.flow.contract import FEW_RATES
from meshflow.flow.family import Variant
from meshflow.flow.linear_solve import solve
from meshflow.geometry.tetrahedra import Tetrahedra
from meshflow.geometry.validation import Array, whole
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.tet_mesh import TetMesh

__all__ = ["TetFlow", "TetSystem"]

# A factorization of so many unknowns costs less than iterations.
FEW = 100


@dataclass(frozen=True, eq=False)
class TetSystem:
    """What an implicit step on tetrahedra solves: (mass + dt stiffness) change = dt mass rate.

    :ivar mass: (n,), one where a vertex does not move.
    :ivar moves: (n,), vertices that move; rows and columns of others are zero in the stiffness.
    :ivar tetrahedra: with weights (m, 6) of the present metric.
    """

    mass: Array
    moves: Array
    tetrahedra: Tetrahedra
    weights: Array

    def matrix(self, dt: float) -> Any:
        """mass + dt stiffness, (n, n)."""
        stiffness = self.tetrahedra.stiffness(self.weights)
        if not self.moves.all():
            only = sparse.diags(self.moves.astype(np.float64))
            stiffness = only @ stiffness @ only
        return sparse.csr_matrix(sparse.diags(self.mass) + dt * stiffness)

    def conjugate_gradients(self, dt: float, right: Array, tolerance: float) -> Array:
        """x (n, k) with (mass + dt stiffness) x = right. A factorization fills up in space: few unknowns alone are factorized.

        To a tenth of the tolerance, since what is left of the residual is a change of the mean.

        :raises NotConverged: with the residual reached and the iterations.
        """
        return solve(self.matrix(dt), right, None, "direct" if len(right) <= FEW else "cg", 0.1 * tolerance)


class TetFlow:
    """dX/dt = -s P B on tetrahedra in R^(d + k), s = (edge indicator)^gamma.

    It is the flow of :class:`.volume.VolumeFlow` on tetrahedra of any shape: B is the gradient of the volume over the mass, by
    the cotangent operator, which needs their six squared lengths only. Free coordinates are the values, not multiplied by the
    contrast. The boundary of the body is the variational one; the mean of the values, weighted by the volume around each vertex,
    is conserved with gamma -1 and by the heat equation.

    :param data: the values.
    :param lift: contrast and boundary.
    :param variant: which flow of the family.
    :param threads: how many; by default as many as the process may use (``MESHFLOW_NUM_THREADS``).
    :raises InputError: for a variant without meaning here.
    """

    patience = FEW_RATES
    pace = 1.0

    def __init__(self, data: TetMesh, lift: Lift, variant: Variant | None = None, threads: int | None = None) -> None:
        self.variant, self.threads = variant or Variant(), None if threads is None else whole(threads, "threads", 1)
        self.variant.check_on_tetrahedra()
        self._tetrahedra, self._begin = data.spanned, data.columns(lift)
        self._begin.flags.writeable = False
        self._scale = 0.0 if self.variant.linear else float(lift.contrast) ** 2
        self._rows, self._ground = self._tetrahedra.ground
        self._moves = ~(data.fixed | data.missing) & (self._ground > 0)
        if (lift.boundary or data.boundary) == "fixed":
            self._moves &= ~self._tetrahedra.rim

    def start(self) -> Array:
        """The values (n, k), zero where missing; read-only."""
        return self._begin

    def rate(self, u: Array, diagonal: int = 0, blend: Blend = RATE, out: Array | None = None) -> Array:
        """du/dt (n, k), unit of the values per time, or a blend; zero where a vertex is missing, fixed, or without tetrahedra."""
        u = np.ascontiguousarray(u, np.float64)
        weights, volumes = self._measured(u)
        found, mass = self._tetrahedra.gathered(weights, volumes, u, self.threads)
        inverse = np.divide(-1.0, self._inertia(mass), out=np.zeros(len(u)), where=self._moves)
        found *= inverse[:, None]
        return blend.of_rate(u, found, out)

    def area(self, u: Array) -> float:
        """The volume of the lifted tetrahedra at u, cubed length."""
        return float(self._measured(np.ascontiguousarray(u, np.float64))[1].sum())

    def bound(self, u: Array) -> float:
        """Upper bound of the fastest decay, per time: the largest row of the present operator (Gershgorin).

        One value per vertex moves along the gradient of its volume, whose second derivatives are at most those of the flat
        Dirichlet energy, whatever the sharpness: its operator is that of the ground, and no M / s is below the mass of the ground
        down to gamma -1.
        """
        alone = u.shape[1] == 1 or self._scale == 0.0
        if alone and self.variant.gamma >= -1.0:
            return self._largest(self._rows, 4.0 * self._ground if self.variant.mass == "ring" else self._ground)
        rows, mass = self._tetrahedra.rows(*self._measured(np.ascontiguousarray(u, np.float64)), self.threads)
        return self._largest(self._rows if alone else rows, self._inertia(mass))

    def system(self, u: Array, diagonal: int = 0) -> TetSystem:
        """Mass and stiffness of the present metric."""
        weights, volumes = self._measured(np.ascontiguousarray(u, np.float64))
        _, mass = self._tetrahedra.rows(weights, volumes, self.threads)
        mass = np.where(self._moves, self._inertia(mass), 1.0)
        return TetSystem(mass, self._moves, self._tetrahedra, weights)

    def size(self, *terms: tuple[float, Array], roughly: bool = False) -> tuple[float, float]:
        """The sum of c a over ``terms``, (n, k): root mean square of the vertices, and the greatest length."""
        squares = np.square(sum(c * a for c, a in terms)).sum(axis=1)
        return float(np.sqrt(squares.mean())), float(np.sqrt(squares.max(initial=0.0)))

    def _measured(self, u: Array) -> tuple[Array, Array]:
        """Weights (m, 6) and volumes (m,) at u."""
        return self._tetrahedra.measured(u, self._scale, self.variant.sharpness, self.threads)

    def _inertia(self, mass: Array) -> Array:
        """M / s (n,), of the mass (n,) of each vertex, barycentric."""
        m = self.variant
        whole = 4.0 * mass if m.mass == "ring" else mass
        if m.gamma == 0.0:
            return whole
        if m.gamma == -1.0 and m.mass == "barycentric":
            return self._ground
        indicator = np.divide(self._ground, mass, out=np.ones_like(mass), where=mass > 0)
        return whole * np.minimum(indicator, 1.0) ** -m.gamma

    def _largest(self, rows: Array, inertia: Array) -> float:
        """The largest of the bounds (n,) of rows over M / s, of vertices that move."""
        return float((rows[self._moves] / inertia[self._moves]).max(initial=0.0))
