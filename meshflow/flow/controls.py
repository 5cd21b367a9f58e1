"""How long a step is, and when to stop."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from meshflow.errors import InputError
from meshflow.flow.contract import Flow
from meshflow.flow.step_lengths import AreaSteps, ErrorSteps, EvenSteps, Steps
from meshflow.flow.steppers import Embedding, Explicit, Stepper
from meshflow.flow.stops import Stop
from meshflow.geometry.validation import Array, positive

__all__ = ["AreaChange", "Control", "Embedded", "Fixed", "Until"]

# Steps over which a semi-implicit run is spread where nobody says otherwise: the metric is lagged by a tenth of the way.
IMPLICIT_STEPS = 10


@dataclass(frozen=True)
class Until:
    """When to stop: at a time (squared length), after a number of steps, at one of the ``stops``, or at what comes first.

    :param marks: times on the way that a step shall end at.

    :raises InputError: when neither is given, or one is negative.
    """

    time: float | None = None
    steps: int | None = None
    stops: tuple[Stop, ...] = ()
    marks: tuple[float, ...] = ()

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


class Control(Protocol):
    """How long steps are."""

    def opened(self, flow: Flow, stepper: Stepper, u: Array, until: Until) -> Steps:
        """The steps of this run."""
        ...


@dataclass(frozen=True)
class Fixed:
    """Steps of one length.

    :param dt: squared length. By default the largest stable one; for a stepper without limit, a tenth of the time to go.
    """

    dt: float | None = None

    def __post_init__(self) -> None:
        if self.dt is not None:
            positive(self.dt, "dt", "squared length")

    def opened(self, flow: Flow, stepper: Stepper, u: Array, until: Until) -> EvenSteps:
        """The steps of this run.

        :raises InputError: for a dt beyond the largest stable one, which is named.
        """
        return EvenSteps(_longest(self.dt, flow, stepper, u, until))


@dataclass(frozen=True)
class AreaChange:
    """Section 5.6, after El-Fallah and Ford: the more area a step loses, the more noise there is, the longer the next may be.

    The first step is the longest, dt; the next are dt times (relative loss of area per dt) / target, between dt / 100 and dt.

    :param target: relative loss of area in a step of length dt from which on the full step is taken.
    :param dt: the longest step, squared length; by default as :class:`Fixed`.
    """

    target: float = 0.01
    dt: float | None = None

    def __post_init__(self) -> None:
        positive(self.target, "target")
        if self.dt is not None:
            positive(self.dt, "dt", "squared length")

    def opened(self, flow: Flow, stepper: Stepper, u: Array, until: Until) -> AreaSteps:
        """The steps of this run."""
        return AreaSteps(self.target, _longest(self.dt, flow, stepper, u, until))


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

    def __post_init__(self) -> None:
        positive(self.tolerance, "tolerance")
        if self.dt is not None:
            positive(self.dt, "dt", "squared length")

    def opened(self, flow: Flow, stepper: Stepper, u: Array, until: Until) -> ErrorSteps:
        """The steps of this run.

        :raises InputError: for a stepper that does not know its error.
        """
        if not isinstance(stepper, Embedding):
            raise InputError(f"control: the {stepper.name} stepper does not know its error; take Fixed or AreaChange")
        dt = _longest(self.dt, flow, stepper, u, until)
        return ErrorSteps(self.tolerance, dt, dt)


def _longest(dt: float | None, flow: Flow, stepper: Stepper, u: Array, until: Until) -> float:
    """The length of steps that is asked for, or the largest stable one; without limit, a tenth of the time to go.

    :raises InputError: for a dt beyond the largest stable one, which is named; for steps without limit and no time.
    """
    if dt is None and isinstance(stepper, Embedding):
        first = Explicit().largest(flow, u)
        return first if np.isfinite(first) else 1.0  # where nothing moves any step will do
    largest = stepper.largest(flow, u)
    if dt is not None:
        if dt > largest * (1.0 + 1e-9):
            raise InputError(
                f"dt: {dt:.6g} is not stable with the {stepper.name} stepper here; the largest stable "
                f"step is {largest:.6g}. Take that, or stepper='semi-implicit'"
            )
        return dt
    if np.isfinite(largest):
        return largest
    if until.time is None:
        if flow.bound(u) == 0:
            return 1.0  # nothing moves: any step will do
        raise InputError(f"dt: the {stepper.name} stepper takes steps of any length; give dt beside steps, or a time")
    return max(until.time / IMPLICIT_STEPS, np.finfo(float).tiny)
