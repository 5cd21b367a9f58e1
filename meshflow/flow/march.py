"""The time loop: yields states and ends with a reason, a sentence."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import ceil

import numpy as np

from meshflow.errors import NotConverged
from meshflow.flow.constraints import Hold
from meshflow.flow.contract import Flow
from meshflow.flow.controls import Control, Embedded, FixedStep, Until
from meshflow.flow.progress import Progress, reporting
from meshflow.flow.step_lengths import Steps
from meshflow.flow.steppers import (
    Explicit,
    SemiImplicit,
    Stepper,
    StepperName,
    counted_in,
    embeds,
    stepper_for,
)
from meshflow.flow.stops import Course, crossing, unmet
from meshflow.flow.workspace import Workspace
from meshflow.geometry.options import named_fields
from meshflow.geometry.validation import Array

__all__ = ["VANISHED", "State", "march"]


# The number of remaining rates at which a run with a stepper of the caller is given up: it would take hours.
HOPELESS = 1_000_000
# The share of its area below which a mesh counts as a point.
GONE = 1e-9
# The reason given then.
VANISHED = "the surface has vanished"


@named_fields
@dataclass(frozen=True, eq=False)
class State:
    """The state of a run.

    :ivar flow: the flow.
    :ivar u: free coordinates (n, k).
    :ivar time: since the start, squared length.
    :ivar dt: length of the step that led here; 0 at the start.
    :ivar step: number of steps taken.
    :ivar reason: why the run ended here, a sentence; None where it goes on.
    :ivar stepper: name of the stepper that led here; empty at the start.
    :ivar error: root mean square error of the step; None where the stepper does not estimate it.
    :ivar before: free coordinates (n, k) where the step began; None at the start.
    """

    flow: Flow = field(repr=False)
    u: Array
    time: float = 0.0
    dt: float = 0.0
    step: int = 0
    reason: str | None = None
    stepper: str = ""
    error: float | None = None
    before: Array | None = field(default=None, repr=False)

    @cached_property
    def area(self) -> float:
        """Area of the surface, squared length; computed on first use."""
        return self.flow.area(self.u)

    @cached_property
    def explicit(self) -> float:
        """The explicit step in which stages are counted at this state; computed on first use."""
        return counted_in(self.flow, self.u)

    @cached_property
    def largest(self) -> float:
        """Largest displacement of a vertex in this step, in the unit of u; computed on first use."""
        if self.before is None:
            return 0.0
        return self.flow.size((1.0, self.u), (-1.0, self.before))[1]


@dataclass(frozen=True, eq=False)
class _Taken:
    """A step, for its control."""

    old: State
    new: State

    @property
    def dt(self) -> float:
        """Length of the step, squared length."""
        return self.new.dt

    @property
    def error(self) -> float | None:
        """Error of the step, where its stepper knows it."""
        return self.new.error

    @property
    def change(self) -> float:
        """Root mean square change since the start of the run."""
        return self._change

    @cached_property
    def _change(self) -> float:
        flow = self.new.flow
        return flow.size((1.0, self.new.u), (-1.0, flow.start()), roughly=True)[0]

    def areas(self) -> tuple[float, float]:
        """Area before and after the step, squared length."""
        return self.old.area, self.new.area


def march(
    flow: Flow,
    until: Until,
    stepper: Stepper | StepperName | None = None,
    control: Control | None = None,
    progress: Progress = None,
    recycle: bool = False,
    limit: Hold | None = None,
) -> Iterator[State]:
    """Move from the start to the end, yielding the start and the state after each step; the last one has a reason.

    The last step is shortened to end at the requested time. Where a stop is met within a step, the run ends there, by linear
    interpolation between the ends of the step. A step that is no longer stable, because the surface has changed, is shortened;
    with ``auto``, the implicit stepper takes over where that would take too many steps.

    Example:

        >>> import numpy as np
        >>> from meshflow import GridFlow, HeightField, Lift, SuperTime, Until, Variant
        >>> field = HeightField(np.random.default_rng(0).normal(size=(32, 32)), spacing=1.0)
        >>> flow = GridFlow(field.gridded(Lift(contrast=1.0)), Variant(gamma=-1.0))
        >>> for state in march(flow, Until(time=2.0), SuperTime()):
        ...     pass
        >>> state.time
        2.0

    :param flow: the flow to run, such as :class:`GridFlow` or :class:`MeshFlow`.
    :param until: when to stop.
    :param stepper: a stepper or its name; :class:`Explicit` by default.
    :param control: by default :class:`Embedded` for a stepper that knows its error, else :class:`FixedStep`.
    :param progress: as in :func:`meshflow.smooth`.
    :param recycle: reuse the memory of a state once the next one is computed, for callers who do not keep states.
    :param limit: a constraint that is restored after every step.
    :raises InputError: for a dt that is not stable at the start.
    :raises NotConverged: when a solver fails, coordinates are no longer finite, or explicit steps have become hopelessly short.
    """
    changes, stepper = stepper == "auto", stepper_for(stepper or Explicit(), flow, until.time)
    state = State(flow, flow.start(), reason=until.reason(0.0, 0))
    control = control or (Embedded() if embeds(stepper) else FixedStep())
    steps, workspace = control.opened(flow, stepper, state.u, until), Workspace(flow)
    yield state
    with reporting(progress, f"{stepper.name} flow") as report:
        while state.reason is None:
            longest = _longest(stepper, state)
            left = until.left(state.time)
            most = flow.patience if changes or np.isinf(flow.patience) else HOPELESS
            if np.isfinite(most) and np.isfinite(left) and longest * most < left * stepper.rates:
                stepper = _implicit_instead(changes, state, longest)
                steps = FixedStep().opened(flow, stepper, state.u, Until(time=left))
                longest = _longest(stepper, state)
            new, steps = _stepped(state, stepper, steps, (min(longest, left), left), limit, workspace)
            new = _gone(_stopped(state, new, until), stepper)
            report(until.share(new.time, new.step))
            yield new
            if recycle and state.step > 0:
                workspace.give(state.u)
            state = new


def _longest(stepper: Stepper, state: State) -> float:
    """The largest stable step; the bound of explicit steps is computed once for each state."""
    if embeds(stepper):
        return state.explicit * stepper.stretch
    return stepper.largest(state.flow, state.u)


def _stepped(
    old: State,
    stepper: Stepper,
    steps: Steps,
    limits: tuple[float, float],
    hold: Hold | None,
    workspace: Workspace,
) -> tuple[State, Steps]:
    """The next state that is accepted, and the lengths of the steps after it.

    :param limits: the longest stable step, and the time left to the end or the next mark.
    """
    flow, (longest, left) = old.flow, limits
    while True:
        dt = min(steps.length(longest), left)
        if embeds(stepper) and dt < left < 2 * dt:
            dt = left / ceil(left / dt)  # two equal steps instead of a long and a short one
        if steps.asks_error and embeds(stepper):
            u, error = stepper.tried(flow, old.u, dt, old.explicit, old.step, workspace)
        else:
            u, error = stepper.step(flow, old.u, dt, old.step, workspace), None
        # A finite error implies finite coordinates; they need not be checked again.
        sound = error is not None and np.isfinite(error)
        if not sound and not np.isfinite(flow.size((1.0, u), (-1.0, old.u), roughly=True)[0]):
            raise NotConverged(
                f"step {old.step + 1} of dt {dt:.3g}: the coordinates are no longer finite; take a smaller dt"
            )
        u = u if hold is None else hold.hold(u)
        new = State(flow, u, old.time + dt, dt, old.step + 1, None, stepper.name, error, old.u)
        if error is not None and embeds(stepper) and not stepper.endured(dt, old.explicit, new.explicit):
            new = replace(new, error=np.inf)
        taken = _Taken(old, new)
        kept = steps.accepts(taken)
        steps = steps.after(taken)
        if kept:
            return new, steps
        workspace.give(u)


def _stopped(old: State, new: State, until: Until) -> State:
    """The new state, or the state at which a stop was met before it; at the end of the time the reason names unmet stops."""
    course, reason = Course(new.flow, until.scale), until.reason(new.time, new.step)
    found = crossing(until.stops, course, (old.u, old.time), (new.u, new.time)) if until.stops else None
    if found is None:
        if reason is not None and until.stops:
            reason += unmet(until.stops, course, new.u, new.time)
        return new if reason is None else replace(new, reason=reason)
    u, time, words, _ = found
    count = f"{new.step} step{'' if new.step == 1 else 's'}"
    reason = f"came to {words} at time {time:.6g} in {count}"
    return replace(new, u=u, time=time, dt=time - old.time, reason=reason)


def _gone(new: State, stepper: Stepper) -> State:
    """The new state; the run ends where implicit steps have shrunk a mesh to points, which no step can move."""
    flow = new.flow
    if new.reason is not None or np.isinf(flow.patience) or not isinstance(stepper, SemiImplicit):
        return new
    left = new.area / max(flow.area(flow.start()), np.finfo(float).tiny)
    if left > GONE:
        return new
    return replace(new, reason=f"{VANISHED}: {left:.1e} of its area is left at time {new.time:.6g}")


def _implicit_instead(changes: bool, state: State, longest: float) -> Stepper:
    """The implicit stepper, where triangles have become too thin for explicit steps to reach the end.

    :raises NotConverged: when the caller requested explicit steps by name.
    """
    if changes:
        return SemiImplicit()
    raise NotConverged(
        f"after {state.step} steps, at time {state.time:.3g}, triangles have become so thin that explicit steps are at "
        f"most {longest:.1e} long; take stepper='semi-implicit', or stop earlier"
    )
