"""How long a step is, and when to stop."""

from dataclasses import dataclass, replace

import numpy as np

from meshflow.errors import InputError
from meshflow.flow.rate import Flow
from meshflow.flow.step import Stepper
from meshflow.geometry.gates import Array, positive

__all__ = ["AreaChange", "Fixed", "Until"]

# Steps over which a semi-implicit run is spread where nobody says otherwise: the metric is lagged by a tenth of the way.
IMPLICIT_STEPS = 10


@dataclass(frozen=True)
class Until:
    """When to stop: at a time (squared length), after a number of steps, or at what comes first.

    :raises InputError: when neither is given, or one is negative.
    """

    time: float | None = None
    steps: int | None = None

    def __post_init__(self) -> None:
        if self.time is None and self.steps is None:
            raise InputError("until: a time or a number of steps expected, got neither")
        if self.time is not None and not (np.isfinite(self.time) and self.time >= 0):
            raise InputError(f"time: a finite number, zero or more, expected (squared length), got {self.time}")
        if self.steps is not None and (int(self.steps) != self.steps or self.steps < 0):
            raise InputError(f"steps: a whole number, zero or more, expected, got {self.steps}")

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


@dataclass(frozen=True)
class Fixed:
    """Steps of one length.

    :param dt: squared length. By default the largest stable one; for a stepper without limit, a tenth of the time to go.
    """

    dt: float | None = None

    def __post_init__(self) -> None:
        if self.dt is not None:
            positive(self.dt, "dt", "squared length")

    def opened(self, flow: Flow, stepper: Stepper, u: Array, until: Until) -> "Fixed":
        """A copy whose dt is settled for this run.

        :raises InputError: for a dt beyond the largest stable one, which is named.
        """
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

    def after(self, dt: float, area: float, before: float) -> "Fixed":
        """The control after a step of dt that took the area from ``before`` to ``area``."""
        return self


@dataclass(frozen=True)
class AreaChange:
    """Section 5.6, after El-Fallah and Ford: the more area a step loses, the more noise there is, the longer the next may be.

    The first step is the longest, dt; the next are dt times (relative loss of area per dt) / target, between dt / 100 and dt.

    :param target: relative loss of area in a step of length dt from which on the full step is taken.
    :param dt: the longest step, squared length; by default as :class:`Fixed`.
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
        return replace(self, dt=Fixed(self.dt).opened(flow, stepper, u, until).dt)

    def length(self, limit: float) -> float:
        """The next step, no longer than what is stable now."""
        assert self.dt is not None
        return min(self.dt * self.share, limit)

    def after(self, dt: float, area: float, before: float) -> "AreaChange":
        """The control after a step of dt that took the area from ``before`` to ``area``."""
        assert self.dt is not None
        loss = max(before - area, 0.0) / before * self.dt / dt if before > 0 else 0.0
        return replace(self, share=float(np.clip(loss / self.target, 0.01, 1.0)))
