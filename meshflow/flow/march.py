"""The loop: yields states, ends with a reason that reads as a sentence."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from meshflow.errors import NotConverged
from meshflow.flow.control import AreaChange, Fixed, Until
from meshflow.flow.progress import Progress, reporting
from meshflow.flow.rate import Flow
from meshflow.flow.step import Explicit, Stepper
from meshflow.geometry.gates import Array

__all__ = ["State", "march"]


@dataclass(frozen=True, eq=False)
class State:
    """Where a run is.

    :ivar u: free coordinates (n, k).
    :ivar time: since the start, squared length.
    :ivar dt: length of the step that led here; 0 at the start.
    :ivar step: number of steps taken.
    :ivar area: of the surface, squared length.
    :ivar largest: largest displacement of a vertex in this step, length.
    :ivar reason: why the run ended here, a sentence; None where it goes on.
    """

    u: Array
    time: float
    dt: float
    step: int
    area: float
    largest: float
    reason: str | None = None


def march(
    flow: Flow,
    until: Until,
    stepper: Stepper | None = None,
    control: Fixed | AreaChange | None = None,
    progress: Progress = None,
) -> Iterator[State]:
    """Move from the start to the end, yielding the start and the state after each step; the last one has a reason.

    The last step is cut to end at the time asked for. A step that is no longer stable, because the surface has changed, is
    shortened.

    :raises InputError: for a dt that is not stable at the start.
    :raises NotConverged: when a solver fails or the coordinates are no longer finite.
    """
    stepper = stepper or Explicit()
    u = flow.start()
    time, step, area = 0.0, 0, flow.area(u)
    steps = (control or Fixed()).opened(flow, stepper, u, until)
    yield State(u, time, 0.0, step, area, 0.0, until.reason(time, step))
    with reporting(progress, f"{stepper.name} flow") as report:
        while until.reason(time, step) is None:
            dt = steps.length(stepper.largest(flow, u))
            if until.time is not None:
                dt = min(dt, until.time - time)
            moved = stepper.step(flow, u, dt, step)
            largest = float(np.sqrt(np.square(moved - u).sum(axis=1).max(initial=0.0)))
            if not np.isfinite(largest):
                raise NotConverged(
                    f"step {step + 1} of dt {dt:.3g}: the coordinates are no longer finite; take a smaller dt"
                )
            before, area = area, flow.area(moved)
            u, time, step = moved, time + dt, step + 1
            steps = steps.after(dt, area, before)
            report(until.share(time, step))
            yield State(u, time, dt, step, area, largest, until.reason(time, step))
