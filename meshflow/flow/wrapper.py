"""A flow around another one: what it does not change is that of the inner one."""

from collections.abc import Sequence

from meshflow.flow.contract import Flow, System
from meshflow.geometry.validation import Array

__all__ = ["Around"]


class Around:
    """The contract of a flow, handed on.

    :param flow: an engine, or another flow around one.
    """

    def __init__(self, flow: Flow) -> None:
        self.flow, self.slivers = flow, flow.slivers

    def start(self) -> Array:
        """Free coordinates (n, k) at time zero."""
        return self.flow.start()

    def rate(self, u: Array, turn: int = 0) -> Array:
        """du/dt (n, k)."""
        return self.flow.rate(u, turn)

    def advance(
        self,
        u: Array,
        dt: float,
        turn: int = 0,
        toward: Sequence[tuple[float, Array]] = (),
        drift: tuple[float, Array] | None = None,
        out: Array | None = None,
    ) -> Array:
        """u + dt rate(u) and what else is asked for, into ``out``."""
        return self.flow.advance(u, dt, turn, toward, drift, out)

    def area(self, u: Array) -> float:
        """Of the surface, squared length."""
        return self.flow.area(u)

    def bound(self, u: Array) -> float:
        """Upper bound of the fastest decay, per time."""
        return self.flow.bound(u)

    def system(self, u: Array, turn: int = 0) -> System:
        """Mass and stiffness."""
        return self.flow.system(u, turn)

    def size(self, *terms: tuple[float, Array], roughly: bool = False) -> tuple[float, float]:
        """Root mean square and greatest of a sum."""
        return self.flow.size(*terms, roughly=roughly)

    def spare(self) -> Array:
        """An array (n, k) to write to."""
        return self.flow.spare()

    def done(self, array: Array) -> None:
        """An array that nobody needs any more."""
        self.flow.done(array)
