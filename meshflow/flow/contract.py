"""The contract of every engine: what a stepper asks, and nothing of where the numbers came from."""

from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

from meshflow.geometry.validation import Array

__all__ = ["Flow", "MatrixFree", "System"]


class System(Protocol):
    """What an implicit step solves: (mass + dt stiffness) change = dt mass rate, symmetric positive definite."""

    @property
    def mass(self) -> Array:
        """M |d|^2 / s (n,), one where a vertex does not move."""
        ...

    def matrix(self, dt: float) -> Any:
        """mass + dt stiffness, a sparse matrix (n, n)."""
        ...


@runtime_checkable
class MatrixFree(Protocol):
    """A system that is solved without a matrix."""

    def conjugate_gradients(self, dt: float, right: Array, tolerance: float) -> Array:
        """x (n, k) with (mass + dt stiffness) x = right, by conjugate gradients.

        :raises NotConverged: with the residual reached.
        """
        ...


class Flow(Protocol):
    """What a stepper asks of an engine. ``turn`` counts the evaluations, for engines whose triangles alternate.

    :ivar slivers: triangles may be so thin that their bound says nothing of the others.
    """

    slivers: bool

    def start(self) -> Array:
        """Free coordinates (n, k) at time zero; not to be written to."""
        ...

    def rate(self, u: Array, turn: int = 0) -> Array:
        """du/dt, (n, k)."""
        ...

    def advance(
        self,
        u: Array,
        dt: float,
        turn: int = 0,
        toward: Sequence[tuple[float, Array]] = (),
        drift: tuple[float, Array] | None = None,
        out: Array | None = None,
    ) -> Array:
        """u + dt rate(u) + the sum of c (a - u) over ``toward``, at most two, + c a of ``drift``; into ``out``."""
        ...

    def area(self, u: Array) -> float:
        """The energy, for step control; squared length."""
        ...

    def bound(self, u: Array) -> float:
        """Upper bound of the fastest decay, per time: an explicit step of at most 2 / bound is stable."""
        ...

    def system(self, u: Array, turn: int = 0) -> System:
        """Mass and stiffness of the present metric."""
        ...

    def size(self, *terms: tuple[float, Array], roughly: bool = False) -> tuple[float, float]:
        """The sum of c a over ``terms``, (n, k), at most four: root mean square of the vertices, and the greatest.

        :param roughly: a part of the vertices is enough.
        """
        ...

    def spare(self) -> Array:
        """An array (n, k) to write to; what it holds means nothing."""
        ...

    def done(self, array: Array) -> None:
        """An array of :meth:`spare` that nobody needs any more."""
        ...
