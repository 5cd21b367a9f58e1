"""How long a step is, and when to stop."""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from meshflow.errors import InputError
from meshflow.flow.contract import Flow
from meshflow.flow.steppers import Embedding, Explicit, Stepper
from meshflow.flow.stops import Scale, Stop
from meshflow.geometry.validation import Array, positive

__all__ = ["AreaChange", "Control", "Embedded", "FixedStep", "Taken", "Until"]

# Steps over which a semi-implicit run is spread where nobody says otherwise: the metric is lagged by a tenth of the way.
IMPLICIT_STEPS = 10
# Share of the time gone by that the next super-time step is at least: with it, a run is off by 0.005 to 0.02 sigma (with a half,
# by 0.01 to 0.03, for a fifth fewer rates).
SURE = 0.25


@dataclass(frozen=True)
class Until:
    """When to stop: at a time (squared length), after a number of steps, at one of the ``stops``, or at what comes first.

    :param marks: times on the way that a step shall end at.
    :param scale: what makes the numbers of the stops those of the run.

    :raises InputError: when neither is given, or one is negative.
    """

    time: float | None = None
    steps: int | None = None
    stops: tuple[Stop, ...] = ()
    marks: tuple[float, ...] = ()
    scale: Scale = Scale()

    def __post_init__(self) -> None:
        if self.time is None and self.steps is None:
            raise InputError("until: a time or a number of steps expected, got neither")
        if self.time is not None and not (np.isfinite(self.time) and self.time >= 0):
            raise InputError(f"time: a finite number, zero or more, expected (squared length), got {self.time}")
        if self.steps is not None and (int(self.steps) != self.steps or self.steps < 0):
            raise InputError(f"steps: a whole number, zero or more, expected, got {self.steps}")

    def left(self, time: float) -> float:
        """How far the next step may go."""
        ends = [end for end in (*self.marks, *([] if self.time is None else [self.time])) if end > time * (1.0 + 1e-12)]
        return min(ends, default=np.inf) - time

    def share(self, time: float, steps: int) -> float:
        """How much of the way is done, in [0, 1]."""
        shares = [1.0 if self.time == 0 else time / self.time] if self.time is not None else []
        if self.steps is not None:
            shares.append(1.0 if self.steps == 0 else steps / self.steps)
        return min(1.0, max(shares))

    def reason(self, time: float, steps: int) -> str | None:
        """Why the run is over, as a sentence; None while it is not."""
        count = f"{steps} step{'' if steps == 1 else 's'}"
        if self.time is not None and time >= self.time * (1.0 - 1e-12):
            return f"reached time {time:.6g} in {count}"
        if self.steps is not None and steps >= self.steps:
            return f"took all {count} asked for, to time {time:.6g}"
        return None


class Taken(Protocol):
    """A step that was taken, as a control sees it; ways and areas are measured when they are asked for."""

    @property
    def dt(self) -> float:
        """Its length."""
        ...

    @property
    def error(self) -> float | None:
        """Root mean square of what it leaves out; None where the stepper does not say."""
        ...

    @property
    def way(self) -> float:
        """Root mean square of the way from the start of the run to its end."""
        ...

    def areas(self) -> tuple[float, float]:
        """The area before and after it."""
        ...


class Control(Protocol):
    """How long the next step is."""

    def opened(self, flow: Flow, stepper: Stepper, u: Array, until: Until) -> "Control":
        """A copy that is settled for this run."""
        ...

    def length(self, limit: float) -> float:
        """The next step, no longer than what is stable now."""
        ...

    def accepts(self, taken: Taken) -> bool:
        """Whether a step is good enough to be kept; if not, :meth:`after` says how long the next trial is."""
        ...

    def after(self, taken: Taken) -> "Control":
        """The control after a step, kept or not."""
        ...


@dataclass(frozen=True)
class FixedStep:
    """Steps of one length.

    :param dt: squared length. By default the largest stable one; for a stepper without limit, a tenth of the time to go.
    """

    dt: float | None = None

    def __post_init__(self) -> None:
        if self.dt is not None:
            positive(self.dt, "dt", "squared length")

    def opened(self, flow: Flow, stepper: Stepper, u: Array, until: Until) -> "FixedStep":
        """A copy whose dt is settled for this run.

        :raises InputError: for a dt beyond the largest stable one, which is named.
        """
        if self.dt is None and isinstance(stepper, Embedding):
            first = Explicit().largest(flow, u)
            return replace(self, dt=first if np.isfinite(first) else 1.0)  # where nothing moves any step will do
        largest = stepper.largest(flow, u)
        if self.dt is not None:
            if self.dt > largest * (1.0 + 1e-9):
                raise InputError(
                    f"dt: {self.dt:.6g} is not stable with the {stepper.name} stepper here; the largest stable "
                    f"step is {largest:.6g}. Take that, or stepper='semi-implicit'"
                )
            return self
        if np.isfinite(largest):
            return replace(self, dt=largest)
        if until.time is None:
            if flow.bound(u) == 0:
                return replace(self, dt=1.0)  # nothing moves: any step will do
            raise InputError(
                f"dt: the {stepper.name} stepper takes steps of any length; give dt beside steps, or a time"
            )
        return replace(self, dt=max(until.time / IMPLICIT_STEPS, np.finfo(float).tiny))

    def length(self, limit: float) -> float:
        """The next step, no longer than what is stable now."""
        assert self.dt is not None
        return min(self.dt, limit)

    def accepts(self, taken: Taken) -> bool:
        """Every step."""
        return True

    def after(self, taken: Taken) -> "FixedStep":
        """The same."""
        return self


@dataclass(frozen=True)
class AreaChange:
    """Section 5.6, after El-Fallah and Ford: the more area a step loses, the more noise there is, the longer the next may be.

    The first step is the longest, dt; the next are dt times (relative loss of area per dt) / target, between dt / 100 and dt.

    :param target: relative loss of area in a step of length dt from which on the full step is taken.
    :param dt: the longest step, squared length; by default as :class:`FixedStep`.
    """

    target: float = 0.01
    dt: float | None = None
    share: float = 1.0

    def __post_init__(self) -> None:
        positive(self.target, "target")
        if self.dt is not None:
            positive(self.dt, "dt", "squared length")

    def opened(self, flow: Flow, stepper: Stepper, u: Array, until: Until) -> "AreaChange":
        """A copy whose longest step is settled for this run."""
        return replace(self, dt=FixedStep(self.dt).opened(flow, stepper, u, until).dt)

    def length(self, limit: float) -> float:
        """The next step, no longer than what is stable now."""
        assert self.dt is not None
        return min(self.dt * self.share, limit)

    def accepts(self, taken: Taken) -> bool:
        """Every step."""
        return True

    def after(self, taken: Taken) -> "AreaChange":
        """The control after a step."""
        assert self.dt is not None
        before, area = taken.areas()
        loss = max(before - area, 0.0) / before * self.dt / taken.dt if before > 0 else 0.0
        return replace(self, share=float(np.clip(loss / self.target, 0.01, 1.0)))


@dataclass(frozen=True)
class Embedded:
    """Steps as long as their embedded error allows, for :class:`SuperTime`.

    The error of a step is measured against the way that the surface has come since the start. What is still there after a time
    t decays no faster than about 1 / t: the first step is as long as an explicit one, and a step of a quarter of the time gone
    by is taken whatever its error; longer ones as their error allows.

    :param tolerance: error of a step, root mean square, as a share of the way from the start.
    :param dt: the first step, squared length; by default the longest explicit one. None is shorter.
    """

    tolerance: float = 0.01
    dt: float | None = None
    least: float = 0.0  # settled when a run is opened, as what follows
    gone: float = 0.0

    def __post_init__(self) -> None:
        positive(self.tolerance, "tolerance")
        if self.dt is not None:
            positive(self.dt, "dt", "squared length")

    def opened(self, flow: Flow, stepper: Stepper, u: Array, until: Until) -> "Embedded":
        """A copy whose first step is settled for this run.

        :raises InputError: for a stepper that does not know its error.
        """
        if not isinstance(stepper, Embedding):
            raise InputError(
                f"control: the {stepper.name} stepper does not know its error; take FixedStep or AreaChange"
            )
        dt = FixedStep(self.dt).opened(flow, stepper, u, until).dt
        assert dt is not None
        return replace(self, dt=dt, least=dt)

    def length(self, limit: float) -> float:
        """The next step, no longer than what is stable now."""
        assert self.dt is not None
        return min(self.dt, limit)

    def accepts(self, taken: Taken) -> bool:
        """A step of at most twice the error allowed, or one that may not be shorter."""
        excess = self._excess(taken)
        return excess <= 2.0 or (np.isfinite(excess) and taken.dt <= self._sure * (1.0 + 1e-9))

    def after(self, taken: Taken) -> "Embedded":
        """Longer or shorter by the root of the error over what is allowed, no more than twice as long."""
        excess = self._excess(taken)
        factor = 2.0 if excess == 0 else float(np.clip(0.9 / np.sqrt(excess), 0.3, 2.0))
        if np.isinf(excess):
            return replace(self, dt=taken.dt * factor, least=min(self.least, taken.dt * factor), gone=0.0)
        later = replace(self, gone=self.gone + taken.dt) if self.accepts(taken) else self
        return replace(later, dt=max(later._sure, taken.dt * factor))

    @property
    def _sure(self) -> float:
        """The length that is taken whatever its error."""
        return max(self.least, SURE * self.gone)

    def _excess(self, taken: Taken) -> float:
        """The error over what is allowed; where nothing has moved it is rounding, unless the step was not stable at all."""
        if not taken.error or (np.isfinite(taken.error) and taken.way == 0):
            return 0.0
        return taken.error / (self.tolerance * max(taken.way, np.finfo(float).tiny))
