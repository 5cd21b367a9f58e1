"""The contract of every engine: what a stepper asks, and nothing of where the numbers came from."""

from typing import Any, Protocol, runtime_checkable

from meshflow.flow.blend import RATE, Blend
from meshflow.geometry.validation import Array

__all__ = ["FEW_RATES", "MANY_RATES", "Flow", "MatrixFree", "Ordered", "System"]

# The rates after which a run loses patience with explicit steps: more cost far more than ten linear solves; and where implicit
# steps are poor, by far.
FEW_RATES, MANY_RATES = 1000.0, 50_000.0


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


@runtime_checkable
class Ordered(Protocol):
    """A system that knows an order in which it is sooner solved."""

    @property
    def order(self) -> Array | None:
        """The vertices (n,), neighbours near each other; None for the order that they have."""
        ...


class Flow(Protocol):
    """A flow is its rate, its area, the bound of its rate, and the system of an implicit step, at any state u (n, k).

    Beside these it says where it starts, and how large a difference of states is: only the engine knows how its states lie in
    memory (planes of a grid, rows of a mesh), which of their samples stand for all, and by how many threads they are read.

    :ivar patience: the number of rates above which implicit steps are better: where triangles may be so thin that their bound
        says nothing of the others. Infinite: explicit steps do not shorten.
    :ivar pace: the share of a stable explicit step for which stages of a super-time step are stable. Beside missing triangles a
        mode may be fast in one triangulation and at rest in another; stages that alternate between them make it grow, unless
        none of them overshoots: half a step does not. 0: no stage is stable, as of flows that switch with the sign of a
        difference.
    """

    patience: float
    pace: float

    def start(self) -> Array:
        """Free coordinates (n, k) at time zero; not to be written to."""
        ...

    def rate(self, u: Array, diagonal: int = 0, blend: Blend = RATE, out: Array | None = None) -> Array:
        """du/dt (n, k), or what a stage of a stepper makes of it, in one pass.

        :param u: (n, k).
        :param diagonal: how many rates came before: an engine whose triangulations alternate takes the one whose turn it is.
        :param blend: what is written: keep u + dt rate(u) + ...; by default the rate.
        :param out: (n, k), where it is written, laid out as :meth:`start`; it may be one of the arrays of the blend other than
            u. A new array by default.
        """
        ...

    def area(self, u: Array) -> float:
        """The energy, for step control; squared length."""
        ...

    def bound(self, u: Array) -> float:
        """Upper bound of the fastest decay, per time: an explicit step of at most 2 / bound is stable."""
        ...

    def system(self, u: Array, diagonal: int = 0) -> System:
        """Mass and stiffness of the present metric; ``diagonal`` as of :meth:`rate`."""
        ...

    def size(self, *terms: tuple[float, Array], roughly: bool = False) -> tuple[float, float]:
        """The sum of c a over ``terms``, (n, k), at most four: root mean square of the vertices, and the greatest.

        :param roughly: a part of the vertices is enough.
        """
        ...
