"""Controls of the step length, and the end of a run."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from meshflow.errors import InputError
from meshflow.flow.contract import Flow
from meshflow.flow.step_lengths import AreaSteps, ErrorSteps, EvenSteps, ListedSteps, Steps
from meshflow.flow.steppers import Explicit, Stepper, embeds
from meshflow.flow.stops import Scale, Stop
from meshflow.geometry.options import named_fields
from meshflow.geometry.validation import Array, positive

__all__ = ["AreaChange", "Control", "Embedded", "FixedStep", "GrowingStep", "LongerLater", "Until"]

# The default number of steps of a semi-implicit run: the metric is then lagged by a tenth of the time.
IMPLICIT_STEPS = 10
# The number of steps beyond which no run is begun: a million take minutes on a hundred samples. Where stops end the run,
# its time is only the latest end, and this times as many are possible.
MOST, SOONER = 1_000_000, 1000


@named_fields
@dataclass(frozen=True)
class Until:
    """When to stop: at a time (squared length), after a number of steps, or at one of the ``stops``, whichever comes first.

    :param marks: times at which a step must end.
    :param scale: converts the numbers of the stops to those of the run.
    :raises InputError: when neither time nor steps are given, or one is negative.
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
        """The longest next step."""
        ends = [end for end in (*self.marks, *([] if self.time is None else [self.time])) if end > time * (1.0 + 1e-12)]
        return min(ends, default=np.inf) - time

    def share(self, time: float, steps: int) -> float:
        """The share of the run that is done, in [0, 1]."""
        shares = [1.0 if self.time == 0 else time / self.time] if self.time is not None else []
        if self.steps is not None:
            shares.append(1.0 if self.steps == 0 else steps / self.steps)
        return min(1.0, max(shares))

    def reason(self, time: float, steps: int) -> str | None:
        """Why the run has ended, as a sentence; None while it goes on."""
        count = f"{steps} step{'' if steps == 1 else 's'}"
        if self.time is not None and time >= self.time * (1.0 - 1e-12):
            return f"reached time {time:.6g} in {count}"
        if self.steps is not None and steps >= self.steps:
            return f"took all {count} asked for, to time {time:.6g}"
        return None


class Control(Protocol):
    """Controls the lengths of the steps."""

    def opened(self, flow: Flow, stepper: Stepper, u: Array, until: Until) -> Steps:
        """The steps of this run."""
        ...


@named_fields
@dataclass(frozen=True)
class FixedStep:
    """Steps of one length.

    :param dt: squared length. By default the largest stable one; for a stepper without limit, a tenth of the time to go.
    """

    dt: float | None = None

    def __post_init__(self) -> None:
        if self.dt is not None:
            positive(self.dt, "dt", "squared length")

    def opened(self, flow: Flow, stepper: Stepper, u: Array, until: Until) -> EvenSteps:
        """The steps of this run.

        :raises InputError: for a dt beyond the largest stable one, which is named, and for one that needs millions of steps.
        """
        return EvenSteps(_ending(_longest(self.dt, flow, stepper, u, until), until))


@named_fields
@dataclass(frozen=True)
class GrowingStep:
    """Steps of a share of the elapsed time, at first of an explicit step: whatever the data, as linear flows need it.

    With super-time steps of second order and a quarter of the time white noise is within 0.4 % of the exact solution, and
    within 1.4 % at times below one squared distance, where the longest explicit steps are off by 40 %.

    :param share: of the elapsed time.
    """

    share: float = 0.25

    def __post_init__(self) -> None:
        positive(self.share, "share")

    def opened(self, flow: Flow, stepper: Stepper, u: Array, until: Until) -> ListedSteps | EvenSteps:
        """The steps of this run; of one length for a stepper without stages.

        :raises InputError: without a time.
        """
        if until.time is None:
            raise InputError("control: growing steps end at a time, and none is given")
        first = Explicit().largest(flow, u)
        if not embeds(stepper) or not np.isfinite(first):
            return FixedStep().opened(flow, stepper, u, until)
        lengths, gone, longest = [], 0.0, stepper.largest(flow, u)
        while gone < until.time and (not lengths or lengths[-1] < longest):
            lengths.append(min(self.share * max(first, gone), longest))
            gone += lengths[-1]
        return ListedSteps(tuple(lengths))


@named_fields
@dataclass(frozen=True)
class LongerLater:
    """Steps of a share of the longest stable one up to a time, then the longest.

    :param share: of the longest step.
    :param early: that time, in longest steps.
    """

    share: float
    early: float

    def __post_init__(self) -> None:
        positive(self.share, "share")
        positive(self.early, "early")

    def opened(self, flow: Flow, stepper: Stepper, u: Array, until: Until) -> ListedSteps:
        """The steps of this run."""
        longest = _ending(_longest(None, flow, stepper, u, until), until)
        return ListedSteps((self.share * longest,) * round(self.early / self.share) + (longest,))


@named_fields
@dataclass(frozen=True)
class AreaChange:
    """Step control by change of area (section 5.6, after El-Fallah and Ford): a large loss means much noise and long steps.

    The first step is the longest, dt; the next are dt times (relative loss of area per dt) / target, between dt / 100 and dt.

    :param target: relative loss of area per step of length dt at or above which the full step is taken.
    :param dt: the longest step, squared length; by default as in :class:`FixedStep`.
    """

    target: float = 0.01
    dt: float | None = None

    def __post_init__(self) -> None:
        positive(self.target, "target")
        if self.dt is not None:
            positive(self.dt, "dt", "squared length")

    def opened(self, flow: Flow, stepper: Stepper, u: Array, until: Until) -> AreaSteps:
        """The steps of this run."""
        return AreaSteps(self.target, _ending(_longest(self.dt, flow, stepper, u, until), until))


@named_fields
@dataclass(frozen=True)
class Embedded:
    """Steps as long as their embedded error allows, for :class:`SuperTime`.

    The error of a step is compared with the change of the surface since the start. What remains after a time t decays no faster
    than about 1 / t. Therefore the first step is as long as an explicit one, a step of a quarter of the elapsed time is always
    accepted, and longer steps are taken as their error allows.

    :param tolerance: root mean square error of a step, as a share of the change since the start.
    :param dt: the first and shortest step, squared length; by default the longest explicit one.
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
        if not embeds(stepper):
            raise InputError(
                f"control: the {stepper.name} stepper does not know its error; take FixedStep or AreaChange"
            )
        dt = _longest(self.dt, flow, stepper, u, until)
        return ErrorSteps(self.tolerance, dt, dt)


def _ending(dt: float, until: Until) -> float:
    """The length of steps itself, where a run of such steps comes to an end.

    :raises InputError: for more than :data:`MOST` steps, with their number and a length that suits.
    """
    most = MOST * (SOONER if until.stops else 1)
    if until.time is not None and until.time > most * dt and (until.steps is None or until.steps > most):
        raise InputError(
            f"dt: {until.time / dt:.3g} steps of {dt:.3g} would be needed to reach time {until.time:.6g}, at most {most:.0e} are "
            f"taken; take a longer dt, or none with stepper='auto', or a shorter time"
        )
    return dt


def _longest(dt: float | None, flow: Flow, stepper: Stepper, u: Array, until: Until) -> float:
    """The requested length of steps, or the largest stable one; without a stability limit, a tenth of the remaining time.

    :raises InputError: for a dt above the largest stable one, which the message names; for a stepper without limit and no time.
    """
    if dt is None and embeds(stepper):
        first = Explicit().largest(flow, u)
        return first if np.isfinite(first) else 1.0  # nothing moves: any step will do
    largest = stepper.largest(flow, u)
    if dt is not None:
        must_be_stable(dt, largest, stepper.name)
        return dt
    if np.isfinite(largest):
        return largest
    if until.time is None:
        if flow.bound(u) == 0:
            return 1.0  # nothing moves: any step will do
        raise InputError(f"dt: the {stepper.name} stepper takes steps of any length; give dt beside steps, or a time")
    return max(until.time / IMPLICIT_STEPS, np.finfo(float).tiny)


def must_be_stable(dt: float, largest: float, name: str) -> None:
    """Refuse a length of steps above the largest stable one.

    :param name: of the stepper.
    :raises InputError: it names that one.
    """
    if dt > largest * (1.0 + 1e-9):
        raise InputError(
            f"dt: {dt:.6g} is not stable with the {name} stepper here; the largest stable "
            f"step is {largest:.6g}. Take that, or stepper='semi-implicit'"
        )
