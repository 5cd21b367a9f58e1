"""The loop: yields states, ends with a reason that reads as a sentence."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from meshflow.errors import NotConverged
from meshflow.flow.control import AreaChange, Fixed, Until
from meshflow.flow.progress import Progress, reporting
from meshflow.flow.rate import Flow
from meshflow.flow.step import MANY, Explicit, SemiImplicit, Stepper, StepperName, stepper_for
from meshflow.geometry.gates import Array

__all__ = ["State", "march"]


# Explicit steps still to take at which a run asked for by name is given up: hours for any mesh worth the name.
HOPELESS = 100_000


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
    :ivar stepper: name of the stepper that led here; empty at the start.
    """

    u: Array
    time: float
    dt: float
    step: int
    area: float
    largest: float
    reason: str | None = None
    stepper: str = ""


def march(
    flow: Flow,
    until: Until,
    stepper: Stepper | StepperName | None = None,
    control: Fixed | AreaChange | None = None,
    progress: Progress = None,
) -> Iterator[State]:
    """Move from the start to the end, yielding the start and the state after each step; the last one has a reason.

    The last step is cut to end at the time asked for. A step that is no longer stable, because the surface has changed, is
    shortened; with ``auto``, the implicit stepper takes over where that would take too many steps.

    :param stepper: a stepper or its name; :class:`Explicit` by default.
    :raises InputError: for a dt that is not stable at the start.
    :raises NotConverged: when a solver fails, coordinates are no longer finite, or explicit steps have become hopelessly short.
    """
    control = control or Fixed()
    u = flow.start()
    time, step, area = 0.0, 0, flow.area(u)
    changes, stepper = stepper == "auto", stepper_for(stepper or Explicit(), flow, until.time)
    steps = control.opened(flow, stepper, u, until)
    yield State(u, time, 0.0, step, area, 0.0, until.reason(time, step))
    with reporting(progress, f"{stepper.name} flow") as report:
        while until.reason(time, step) is None:
            limit = stepper.largest(flow, u)
            if until.time is not None and _too_short(limit, until.time - time, MANY if changes else HOPELESS):
                stepper = _implicit_instead(changes, step, time, limit)
                steps = control.opened(flow, stepper, u, Until(time=until.time - time))
                limit = stepper.largest(flow, u)
            dt = steps.length(limit)
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
            yield State(u, time, dt, step, area, largest, until.reason(time, step), stepper.name)


def _too_short(limit: float, left: float, most: int) -> bool:
    return limit * most < left


def _implicit_instead(changes: bool, step: int, time: float, limit: float) -> Stepper:
    """The implicit stepper, where triangles have become so thin that explicit steps would not arrive.

    :raises NotConverged: when the caller asked for explicit steps by name.
    """
    if changes:
        return SemiImplicit()
    raise NotConverged(
        f"after {step} steps, at time {time:.3g}, triangles have become so thin that explicit steps are at most {limit:.1e} "
        "long; take stepper='semi-implicit', or stop earlier"
    )
