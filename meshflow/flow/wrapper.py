"""A flow that wraps another flow and changes parts of it."""

from meshflow.flow.blend import RATE, Blend
from meshflow.flow.contract import Flow, System
from meshflow.geometry.validation import Array

__all__ = ["Around"]


class Around:
    """The contract of a flow, passed on to the inner flow.

    :param flow: an engine, or another flow around one.
    """

    def __init__(self, flow: Flow) -> None:
        self.flow, self.patience, self.pace = flow, flow.patience, flow.pace

    def start(self) -> Array:
        """Free coordinates (n, k) at time zero."""
        return self.flow.start()

    def rate(self, u: Array, diagonal: int = 0, blend: Blend = RATE, out: Array | None = None) -> Array:
        """du/dt (n, k), or what the blend makes of it."""
        return self.flow.rate(u, diagonal, blend, out)

    def area(self, u: Array) -> float:
        """Area of the surface, squared length."""
        return self.flow.area(u)

    def bound(self, u: Array) -> float:
        """Upper bound of the fastest decay, per time."""
        return self.flow.bound(u)

    def system(self, u: Array, diagonal: int = 0) -> System:
        """Mass and stiffness."""
        return self.flow.system(u, diagonal)

    def size(self, *terms: tuple[float, Array], roughly: bool = False) -> tuple[float, float]:
        """Root mean square and largest of a sum."""
        return self.flow.size(*terms, roughly=roughly)
