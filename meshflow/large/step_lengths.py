"""Finds the lengths of explicit steps that follow from all samples: windows are run ahead, and the bounds of steps are found."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from meshflow.errors import NotConverged
from meshflow.estimate.plan import Plan
from meshflow.estimate.request import Request
from meshflow.flow.constraints import Faithful
from meshflow.flow.contract import Flow
from meshflow.flow.controls import FixedStep, Until, must_be_stable
from meshflow.flow.engines.grid import GridFlow
from meshflow.flow.progress import Progress, reporting
from meshflow.flow.wrapper import Around
from meshflow.geometry.validation import Array
from meshflow.large.between import Between
from meshflow.large.legs import Leg, Legs
from meshflow.large.memory import Room
from meshflow.large.source import Form, Source, Window, rows_and_columns
from meshflow.large.sweeping import Swept
from meshflow.large.windows import Bound, Windowed
from meshflow.results.given_steps import kept_after
from meshflow.results.run import until_of
from meshflow.results.stretches import Seen, Stretch

__all__ = ["lengths_by_all"]

# How many steps are run ahead at most; the number of steps beyond which the run is given up: it would take days.
AHEAD, HOPELESS = 16, 100_000


@dataclass(eq=False)
class _Bounds:
    """The bounds of a window before each of some steps, and after the last one."""

    found: list[float] = field(default_factory=list)

    def __call__(self, plan: Plan, at: Window) -> Seen:
        """What is told of each step of the plan of a window.

        :param at: the window in the plan.
        """
        inner = rows_and_columns(at)

        def seen(flow: Flow, old: Array, new: Array) -> None:
            """Measure what a step begins with, and what it ends with, which the next one begins with."""
            if not self.found:
                self.found.append(_bound_in(flow, old, inner))
            self.found.append(_bound_in(flow, new, inner))

        return seen


def _bound_in(flow: Flow, u: Array, window: tuple[slice, slice]) -> float:
    """The bound of a flow in a window of its grid."""
    more = flow.most if isinstance(flow, Faithful) else 0.0
    while isinstance(flow, Around):
        flow = flow.flow
    return flow.bound_within(u, window) + more if isinstance(flow, GridFlow) else np.inf


def lengths_by_all(
    run: Windowed, bound: Bound, grid: Source, request: Request, room: Room, progress: Progress = None
) -> tuple[Windowed, Bound]:
    """The plan for the windows of a grid with steps as long as all its samples allow, and what they run.

    :raises InputError: for a dt that is not stable.
    :raises NotConverged: for hopelessly many steps.
    """
    if not run.unsteady:
        return run, bound
    local = run.local
    (track,) = local.legs.tracks
    plan = local.plan
    control = plan.request.compute.control
    dt = control.dt if isinstance(control, FixedStep) else plan.request.compute.dt
    ahead = _Ahead(Swept(bound, grid, request, room.budget), until_of(plan), dt, room.folder)
    with reporting(progress, "looking for the lengths of its steps") as report:
        lengths = ahead.lengths(track.lengths[0] if track.lengths else 0.0, report)
    done = replace(track, lengths=lengths, rates=(1,) * len(lengths), kept=kept_after(plan, lengths))
    local = replace(local, legs=replace(local.legs, tracks=(done,)))
    return replace(run, local=local, unsteady=False), replace(bound, local=local)


@dataclass(frozen=True, eq=False)
class _Ahead:
    """Runs all windows some steps ahead.

    :ivar until: when the run ends.
    :ivar dt: the length of its steps, where it is given.
    :ivar folder: where its state lies.
    """

    swept: Swept
    until: Until
    dt: float | None
    folder: Path

    def lengths(self, guess: float, report: Callable[[float], object]) -> tuple[float, ...]:
        """The lengths of all steps.

        Some steps are run ahead with lengths of which those after the first are a guess; where the bounds that are met show that
        one of them is wrong, they are run again with those before it, which are right.

        :param guess: of the first one.
        """
        lengths, time, most, ahead, sure = list[float](), 0.0, None, 1, [guess]
        old = Between(self.folder, self._form.shape)
        try:
            while self.until.reason(time, len(lengths)) is None:
                trial = self._continued(sure, time, len(lengths), ahead)
                new = Between(self.folder, self._form.shape)
                try:
                    bounds = self._bounds(lengths, trial, (old, new))
                except BaseException:
                    new.close()
                    raise
                most = self._most(bounds[0]) if most is None else most
                right, after = self._right(trial, bounds, most, time)
                if len(right) == len(trial):
                    old.close()
                    old, lengths, sure, ahead = new, lengths + trial, [after], min(2 * ahead, AHEAD)
                    for dt in trial:
                        time += dt
                else:
                    new.close()
                    sure, ahead = [*right, after], 1
                self._must_end(time, len(lengths), after)
                report(self.until.share(time, len(lengths)))
        finally:
            old.close()
        return tuple(lengths)

    @property
    def _form(self) -> Form:
        return self.swept.grid.form

    def _most(self, bound: float) -> float:
        """The length of steps that is not exceeded, by the bound at the start of the run."""
        largest = _longest(bound)
        if self.dt is not None:
            must_be_stable(self.dt, largest, "explicit")
            return self.dt
        return 1.0 if np.isinf(largest) and self.until.time is None else largest  # nothing moves: any step will do

    def _right(
        self, trial: Sequence[float], bounds: Sequence[float], most: float, time: float
    ) -> tuple[list[float], float]:
        """The first ones of some steps that are as long as they must be, and the length of the one after them.

        :param bounds: before each step, and after the last one.
        :param time: at which they begin.
        """
        right = list[float]()
        for dt, bound in zip(trial, bounds, strict=False):
            must = min(most, _longest(bound), self.until.left(time))
            if must != dt:
                return right, must
            right.append(must)
            time += must
        return right, min(most, _longest(bounds[-1]), self.until.left(time))

    def _continued(self, sure: Sequence[float], time: float, count: int, ahead: int) -> list[float]:
        """Steps that are sure, and more like the last one of them, as far as the run goes."""
        steps, guess = list[float](), sure[-1]
        for number in range(max(len(sure), ahead)):
            if self.until.reason(time, count + number) is not None:
                break
            steps.append(sure[number] if number < len(sure) else min(guess, self.until.left(time)))
            time += steps[-1]
        return steps

    def _bounds(self, lengths: Sequence[float], trial: Sequence[float], states: tuple[Between, Between]) -> list[float]:
        """The bounds of all windows before each of some steps, and after the last one.

        :param lengths: of the steps before them.
        """
        local = self.swept.bound.local
        steps = (*lengths, *trial, 0.0)  # one more, which is not taken: then the state is kept as it is
        track = replace(local.legs.tracks[0], lengths=steps, rates=(1,) * len(steps), kept=0, share=1.0)
        legs = replace(local.legs, tracks=(track,), passes=())
        swept = replace(self.swept, bound=replace(self.swept.bound, local=replace(local, legs=legs)))
        leg = _leg(legs, len(lengths), len(trial))
        found = [watch.found for watch, _ in swept.by(leg, states, _Bounds) if watch.found]
        return np.max(found, axis=0).tolist() if found else [0.0] * (len(trial) + 1)

    def _must_end(self, time: float, count: int, dt: float) -> None:
        """Give up where the end of the run is out of reach.

        :param dt: the length of the next step.
        """
        left = self.until.left(time)
        if np.isfinite(left) and left > HOPELESS * dt:
            raise NotConverged(
                f"after {count} steps, at time {time:.3g}, explicit steps are at most {dt:.1e} long; stop earlier"
            )


def _longest(bound: float) -> float:
    """The longest explicit step."""
    return 2.0 / bound if bound > 0 else np.inf


def _leg(legs: Legs, begin: int, count: int) -> Leg:
    """Some steps of the run; the halo is wide enough to measure the bound after the last one."""
    reach = legs.reaches[0]
    return Leg((Stretch(0, begin, begin + count),), legs.beside + reach * (count + 1) + 2, float(count), 1)
