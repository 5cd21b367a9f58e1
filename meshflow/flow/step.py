"""One step in time: explicit Euler and semi-implicit Euler."""

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
import scipy.sparse as sparse

from meshflow.errors import InputError
from meshflow.flow.rate import Flow
from meshflow.flow.solve import Method, solve
from meshflow.geometry.gates import Array, positive

__all__ = ["MANY", "Explicit", "SemiImplicit", "Stepper", "StepperName", "stepper_for"]

StepperName = Literal["auto", "explicit", "semi-implicit"]

# An explicit run of more steps than this costs more than ten linear solves.
MANY = 400


class Stepper(Protocol):
    """u after a step of dt."""

    name: str

    def step(self, flow: Flow, u: Array, dt: float, turn: int) -> Array:
        """The free coordinates (n, k) after time dt."""
        ...

    def largest(self, flow: Flow, u: Array) -> float:
        """The largest step that is stable at u; infinite where every step is."""
        ...


@dataclass(frozen=True)
class Explicit:
    """u + dt rate(u): first order, stable for dt <= 2 / bound (h^2 / 6 on a grid of spacing h, whatever its data)."""

    name = "explicit"

    def step(self, flow: Flow, u: Array, dt: float, turn: int) -> Array:
        """The free coordinates (n, k) after time dt."""
        return u + dt * flow.rate(u, turn)

    def largest(self, flow: Flow, u: Array) -> float:
        """2 / bound of the triangles as they are at u."""
        bound = flow.bound(u)
        return 2.0 / bound if bound > 0 else np.inf


@dataclass(frozen=True)
class SemiImplicit:
    """(M / s + dt L) (u+ - u) = dt (M / s) rate(u): metric of now, positions of the end [DMSB99]; stable for every dt.

    Solved for the change, so that what rests, rests to the last bit; corrections of the boundary are lagged in the rate.

    :param solver: ``auto | direct | cg | multigrid``.
    :param tolerance: relative residual of the change.
    """

    solver: Method = "auto"
    tolerance: float = 1e-9
    name = "semi-implicit"

    def __post_init__(self) -> None:
        if self.solver not in ("auto", "direct", "cg", "multigrid"):
            raise InputError(f"solver: auto, direct, cg or multigrid expected, got {self.solver!r}")
        positive(self.tolerance, "tolerance")

    def step(self, flow: Flow, u: Array, dt: float, turn: int) -> Array:
        """The free coordinates (n, k) after time dt."""
        rate = flow.rate(u, turn)
        if not rate.any():
            return u.copy()
        system = flow.system(u, turn)
        matrix = (sparse.diags(system.mass) + dt * system.stiffness).tocsr()
        right = dt * system.mass[:, None] * rate
        guess = right / matrix.diagonal()[:, None]
        return u + solve(matrix, right, guess, self.solver, self.tolerance)

    def largest(self, flow: Flow, u: Array) -> float:
        """Infinite: every step lowers the Dirichlet energy of the present metric."""
        return np.inf


def stepper_for(word: Stepper | StepperName, flow: Flow, time: float | None) -> Stepper:
    """The stepper of a name; ``auto`` takes the explicit one unless slivers or cliffs would make its steps too many.

    :raises InputError: for an unknown word.
    """
    if not isinstance(word, str):
        return word
    if word == "auto":
        steps = np.inf if time is None else time * flow.bound(flow.start()) / 2.0
        return SemiImplicit() if time is not None and steps > MANY else Explicit()
    if word not in ("explicit", "semi-implicit"):
        raise InputError(f"stepper: auto, explicit or semi-implicit expected, got {word!r}")
    return Explicit() if word == "explicit" else SemiImplicit()
