"""The step lengths of a run, each computed from the step before."""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

__all__ = ["AreaSteps", "ErrorSteps", "EvenSteps", "ListedSteps", "Steps", "Taken"]

# The next super-time step is at least this share of the elapsed time. A run then has an error of 0.005 to 0.02 sigma (with a
# half, 0.01 to 0.03 for a fifth fewer rates).
SURE = 0.25


class Taken(Protocol):
    """A step that was taken, for its control; change and areas are computed on use."""

    @property
    def dt(self) -> float:
        """Its length."""
        ...

    @property
    def error(self) -> float | None:
        """Root mean square error; None where the stepper does not estimate it."""
        ...

    @property
    def change(self) -> float:
        """Root mean square change from the start of the run to the end of the step."""
        ...

    def areas(self) -> tuple[float, float]:
        """The area before and after it."""
        ...


class Steps(Protocol):
    """The steps of a run: determines the length of the next one."""

    @property
    def asks_error(self) -> bool:
        """Whether the error of each step is needed."""
        ...

    def length(self, limit: float) -> float:
        """The length of the next step, at most the stable limit."""
        ...

    def accepts(self, taken: Taken) -> bool:
        """Whether a step is accepted; if not, :meth:`after` gives the length of the next attempt."""
        ...

    def after(self, taken: Taken) -> "Steps":
        """The steps after this one, accepted or not."""
        ...


@dataclass(frozen=True)
class EvenSteps:
    """Steps of one length.

    :ivar dt: squared length.
    """

    dt: float
    asks_error = False

    def length(self, limit: float) -> float:
        """The length of the next step, at most the stable limit."""
        return min(self.dt, limit)

    def accepts(self, taken: Taken) -> bool:
        """Every step."""
        return True

    def after(self, taken: Taken) -> "EvenSteps":
        """The same."""
        return self


@dataclass(frozen=True)
class ListedSteps:
    """Steps of given lengths, one after the other; once they are used up, of the length of the last one.

    :ivar lengths: squared lengths.
    :ivar taken: the number of steps so far.
    """

    lengths: tuple[float, ...]
    taken: int = 0
    asks_error = False

    def length(self, limit: float) -> float:
        """The length of the next step, at most the stable limit."""
        return min(self.lengths[min(self.taken, len(self.lengths) - 1)], limit)

    def accepts(self, taken: Taken) -> bool:
        """Every step."""
        return True

    def after(self, taken: Taken) -> "ListedSteps":
        """The steps after this one."""
        return replace(self, taken=self.taken + 1)


@dataclass(frozen=True)
class AreaSteps:
    """Steps dt times (relative loss of area per dt) / target, between dt / 100 and dt (section 5.6).

    :ivar target: relative loss of area in a step of length dt from which on the full step is taken.
    :ivar dt: the longest step, squared length.
    :ivar share: of the longest step, of the next one.
    """

    target: float
    dt: float
    share: float = 1.0
    asks_error = False

    def length(self, limit: float) -> float:
        """The length of the next step, at most the stable limit."""
        return min(self.dt * self.share, limit)

    def accepts(self, taken: Taken) -> bool:
        """Every step."""
        return True

    def after(self, taken: Taken) -> "AreaSteps":
        """The steps with the share that follows from the loss of area."""
        before, area = taken.areas()
        loss = max(before - area, 0.0) / before * self.dt / taken.dt if before > 0 else 0.0
        return replace(self, share=float(np.clip(loss / self.target, 0.01, 1.0)))


@dataclass(frozen=True)
class ErrorSteps:
    """Steps as long as their embedded error allows.

    :ivar tolerance: error of a step, root mean square, as a share of the change since the start.
    :ivar dt: the next step, squared length.
    :ivar least: the shortest step.
    :ivar gone: the elapsed time.
    """

    tolerance: float
    dt: float
    least: float
    gone: float = 0.0
    asks_error = True

    def length(self, limit: float) -> float:
        """The length of the next step, at most the stable limit."""
        return min(self.dt, limit)

    def accepts(self, taken: Taken) -> bool:
        """Whether its error is at most twice the allowed one, or it may not be shorter."""
        excess = self._excess(taken)
        return excess <= 2.0 or (np.isfinite(excess) and taken.dt <= self._sure * (1.0 + 1e-9))

    def after(self, taken: Taken) -> "ErrorSteps":
        """The steps, scaled by the square root of allowed over actual error; at most twice as long."""
        excess = self._excess(taken)
        factor = 2.0 if excess == 0 else float(np.clip(0.9 / np.sqrt(excess), 0.3, 2.0))
        if np.isinf(excess):
            return replace(self, dt=taken.dt * factor, least=min(self.least, taken.dt * factor), gone=0.0)
        later = replace(self, gone=self.gone + taken.dt) if self.accepts(taken) else self
        return replace(later, dt=max(later._sure, taken.dt * factor))

    @property
    def _sure(self) -> float:
        """The length that is accepted whatever its error."""
        return max(self.least, SURE * self.gone)

    def _excess(self, taken: Taken) -> float:
        """The error over the allowed one; where nothing has moved it is rounding, unless the step was unstable."""
        if not taken.error or (np.isfinite(taken.error) and taken.change == 0):
            return 0.0
        return taken.error / (self.tolerance * max(taken.change, np.finfo(float).tiny))
