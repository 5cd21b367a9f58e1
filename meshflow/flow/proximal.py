"""Fully implicit steps: the minimum of an energy and a fidelity, by solving systems with the weights of the last iterate."""

from dataclasses import dataclass

import numpy as np

from meshflow.errors import NotConverged
from meshflow.flow.contract import Flow
from meshflow.flow.linear_solve import solve
from meshflow.flow.workspace import Workspace
from meshflow.geometry.validation import Array

__all__ = ["Proximal"]

# The relative residual of the systems; their solutions are only iterates.
SOLVED = 1e-8


@dataclass(frozen=True)
class Proximal:
    """The fully implicit step of Euler, M (v - u) = dt M rate(v): at the v with the least E(v) + |v - u|^2_M / (2 dt).

    Half-quadratic minimization (Charbonnier, Blanc-Feraud, Aubert, Barlaud 1997, [ABBFC97]): the weights of the system are
    those of the last iterate, and (M + dt L(v)) v' = M u is solved for the next one, in form of its change. Every iteration
    lowers the sum, if the potential of the energy is concave in |grad u|^2. One step of the flow's energy is a variational
    restoration, with 1 / dt the weight of the fidelity.

    :param tolerance: the last change, as a share of the change since u (root mean squares).
    :param most: the largest number of iterations.
    """

    tolerance: float = 1e-4
    most: int = 400
    name = "half-quadratic"
    rates = 1

    def step(self, flow: Flow, u: Array, dt: float, diagonal: int = 0, workspace: Workspace | None = None) -> Array:
        """The free coordinates (n, k) after time dt.

        :raises NotConverged: with the last relative change.
        """
        return self.solved(flow, u, dt, u)

    def solved(self, flow: Flow, u: Array, dt: float, guess: Array) -> Array:
        """:meth:`step`, with the iterate (n, k) to begin with."""
        v, share = np.array(guess), np.inf
        for _ in range(self.most):
            rate, system = flow.rate(v), flow.system(v)
            right = system.mass[:, None] * (u - v + dt * rate)
            change = solve(system.matrix(dt), right, None, "auto", SOLVED)
            v = v + change
            whole = float(np.sqrt(np.mean(np.square(v - u))))
            share = float(np.sqrt(np.mean(np.square(change)))) / whole if whole > 0 else 0.0
            if share <= self.tolerance:
                return v
        raise NotConverged(
            f"half-quadratic: the last of {self.most} iterations still changed {share:.1e} of the whole change; take a smaller "
            "time, or a lower contrast"
        )

    def largest(self, flow: Flow, u: Array) -> float:
        """Infinite."""
        return np.inf
