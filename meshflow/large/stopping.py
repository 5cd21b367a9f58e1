"""Finds where a run by windows meets a stop: windows are run to sum what the stop asks of all samples, step by step."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from meshflow.estimate.plan import Decided, Plan
from meshflow.estimate.request import Request
from meshflow.estimate.second_stage import cut_out
from meshflow.flow.contract import Flow
from meshflow.flow.engines.grid import GridFlow
from meshflow.flow.engines.volume import VolumeFlow
from meshflow.flow.progress import Progress, reporting
from meshflow.flow.stops import AreaLoss, Met, Residual, Stop, place_of
from meshflow.geometry.validation import Array
from meshflow.large.between import Between
from meshflow.large.legs import Leg
from meshflow.large.memory import Room
from meshflow.large.source import Source, Window
from meshflow.large.sweeping import Swept
from meshflow.large.windows import Bound, Local, Windowed
from meshflow.results.given_steps import Track
from meshflow.results.stretches import Seen
from meshflow.surfaces.grid import Grid, Whole
from meshflow.surfaces.volume import WholeVolume

__all__ = ["Sought", "Sums", "Watching", "stopped_by_all"]

# The shares of a step at which areas are summed: between them they follow a polynomial to a millionth of their change.
SHARES = np.linspace(0.0, 1.0, 5)


@dataclass(frozen=True, eq=False)
class Sums:
    """What stops ask of some samples, for steps one after the other.

    :ivar moving: the number of samples that may move.
    :ivar changes: (n, 3), sums over them: at the beginning of each step of the squared change since the start; of its product
        with the change in the step; and of the square of that.
    :ivar areas: (n, 5), areas at :data:`SHARES` of each step; (n, 0) where no stop asks for them.
    """

    moving: int
    changes: Array
    areas: Array

    def __add__(self, other: "Sums") -> "Sums":
        return Sums(self.moving + other.moving, self.changes + other.changes, self.areas + other.areas)


@dataclass(eq=False)
class _Watch:
    """Sums over the samples of a window, step by step.

    :ivar plan: of the window with its halo; ``at``: the window in it, in the orientation of the plan.
    :ivar with_area: whether areas are asked for.
    """

    plan: Plan
    at: Window
    with_area: bool
    changes: list[list[float]] = field(default_factory=list)
    areas: list[list[float]] = field(default_factory=list)

    def __post_init__(self) -> None:
        data = self.plan.grid
        self.moves = ~(data.missing | data.fixed)[self.at]
        # Cells belong to the window that has their first corner.
        shape = data.missing.shape
        self.cells = tuple(slice(p.start, min(p.stop + 1, size)) for p, size in zip(self.at, shape, strict=True))
        self.measure = self._engine() if self.with_area else None

    def __call__(self, flow: Flow, old: Array, new: Array) -> None:
        """Count a step."""
        gone, step = self._inner(old) - self._inner(flow.start()), self._inner(new) - self._inner(old)
        self.changes.append([float((gone * gone).sum()), float((gone * step).sum()), float((step * step).sum())])
        areas, measure = [], self.measure
        if measure is not None:
            for share in SHARES:
                u = old if share == 0 else new if share == 1 else old + np.asarray(share, old.dtype) * (new - old)
                part = np.ascontiguousarray(self._planes(u)[(slice(None), *self.cells)])
                areas.append(measure.area(part.reshape(len(part), -1).T))
        self.areas.append(areas if measure is not None or not self.with_area else [0.0] * len(SHARES))

    @property
    def sums(self) -> Sums:
        """What was counted."""
        count = len(self.changes)
        areas = np.array(self.areas, float).reshape(count, -1) if count else np.zeros((0, 0))
        return Sums(int(self.moves.sum()), np.array(self.changes, float).reshape(count, 3), areas)

    def _planes(self, u: Array) -> Array:
        return u.T.reshape(-1, *self.plan.grid.missing.shape)

    def _inner(self, u: Array) -> Array:
        """The samples of the window that may move, (k, m)."""
        return self._planes(u)[(slice(None), *self.at)][:, self.moves].astype(np.float64)

    def _engine(self) -> Flow | None:
        """The engine of the cells of the window; None where it has none, at the last row or column."""
        grid, whole = self.plan.grid, self.plan.whole
        if min(part.stop - part.start for part in self.cells) < 2:
            return None
        part, threads = cut_out(grid, self.cells), self.plan.request.compute.threads
        if isinstance(part, Grid):
            return GridFlow(
                replace(part, whole=whole if isinstance(whole, Whole) else None), self.plan.variant, threads
            )
        known = whole if isinstance(whole, WholeVolume) else None
        return VolumeFlow(replace(part, whole=known), self.plan.variant, threads)


@dataclass(eq=False)
class Watching:
    """Makes the watch of a window.

    :ivar with_area: whether areas are asked for.
    """

    with_area: bool
    _made: _Watch | None = None

    def __call__(self, plan: Plan, at: Window) -> Seen:
        """What is told of each step."""
        self._made = _Watch(plan, at, self.with_area)
        return self._made

    @property
    def sums(self) -> Sums | None:
        """What was counted; None where no sample was moved."""
        return None if self._made is None else self._made.sums


@dataclass(frozen=True)
class Sought:
    """What is asked of all samples.

    :ivar stops: of which one is to be met.
    :ivar sigma: the noise of a sample with all its channels.
    """

    stops: tuple[Stop, ...]
    sigma: float

    @classmethod
    def of(cls, request: Request, sigma: float, channels: int | None) -> "Sought":
        """What a request asks of samples of so many channels.

        :param sigma: of the noise of one channel.
        """
        return cls(request.stops, sigma * request.strength * float(np.sqrt(channels or 1)))

    @property
    def with_area(self) -> bool:
        """Whether areas are asked for."""
        return any(isinstance(stop, AreaLoss) for stop in self.stops)

    def to_the_end(self, local: Local, track: Track) -> Local:
        """What windows run to the end of the steps that are known; the second stage comes later.

        Their halo is wider by the samples that cells of a window have beside it.
        """
        old = local.legs
        legs = replace(old, tracks=(track,), reaches=old.reaches[:1], passes=(), beside=old.beside + self.with_area)
        return replace(local, legs=legs)

    def nothing(self, leg: Leg) -> Sums:
        """The sums over no samples in a leg."""
        count = sum(stretch.end - stretch.begin for stretch in leg.stretches)
        return Sums(0, np.zeros((count, 3)), np.zeros((count, len(SHARES) * self.with_area)))

    def met(
        self, sums: Sums, lengths: Sequence[float], since: float = 0.0, area: float | None = None
    ) -> tuple[int, Met] | None:
        """The step within which the first stop is met, counted from 0, and where; None where none is met.

        :param sums: over all samples, of steps of these ``lengths``.
        :param since: the time at which the first of the steps begins.
        :param area: that of the start of the run; None: the steps begin there.
        """
        time = since
        if area is None:
            area = float(sums.areas[0, 0]) if sums.areas.size else 0.0
        for number, dt in enumerate(lengths):
            found: tuple[float, Stop, float] | None = None
            for stop in self.stops:
                value = partial(_value, stop, sums, number, self.sigma, area)
                if _over(stop, value(1.0)) < 0:
                    continue
                late = _over(stop, value(0.0)) < 0
                share = place_of(stop, partial(_excess, stop, value)) if late else 0.0
                if found is None or share < found[0]:
                    found = share, stop, value(share)
            if found is not None:
                share, stop, reached = found
                said = stop.said(reached) if isinstance(stop, (Residual, AreaLoss)) else ""
                return number, Met(share, time + share * dt, said)
            time += dt
        return None


def _excess(stop: Stop, value: Callable[[float], float], share: float) -> float:
    """The excess of a stop at a share of a step."""
    return _over(stop, value(share))


def _over(stop: Stop, value: float) -> float:
    """The excess of a stop."""
    return stop.over(value) if isinstance(stop, (Residual, AreaLoss)) else -1.0


def _value(stop: Stop, sums: Sums, number: int, sigma: float, area: float, share: float) -> float:
    """What a stop is asked of at a share of a step: the removed share of sigma, or the lost share of the area."""
    if isinstance(stop, Residual):
        before, cross, step = sums.changes[number]
        square = max(before + 2.0 * share * cross + share * share * step, 0.0)
        return float(np.sqrt(square / max(sums.moving, 1)) / sigma) if sigma > 0 else np.inf
    if area <= 0:
        return 0.0
    each = [np.prod([(share - b) / (a - b) for b in SHARES if b != a]) for a in SHARES]
    return 1.0 - float(np.dot(each, sums.areas[number])) / area


def stopped_by_all(
    run: Windowed, bound: Bound, grid: Source, request: Request, room: Room, progress: Progress = None
) -> tuple[Windowed, Bound]:
    """The plan for the windows of a grid to where all its samples meet a stop, not those of the tiles; and what they run."""
    track = run.longer
    if track is None:
        return run, bound
    sought = Sought.of(request, run.found.noise.sigma, grid.form.channels)
    swept = Swept(replace(bound, local=sought.to_the_end(run.local, track)), grid, request, room.budget)
    sweep = _Sweep(swept, sought)
    with reporting(progress, "looking for where it stops") as report:
        found = sweep.met(room.folder, track.lengths, report)
    local = run.local.ended(track, found)
    met, warnings = local.met, run.warnings
    if met is None:
        warnings += ("the stop is not met in the time of the run",)
    time = sum(track.lengths) if met is None else met.time
    why = Decided("default", "at most, where no stop is met") if met is None else Decided("estimated", met.said)
    made = replace(run, found=run.found.with_({"time": why}, time=time), local=local, longer=None, warnings=warnings)
    return made, replace(bound, local=local)


@dataclass(frozen=True, eq=False)
class _Sweep:
    """Windows that are run to sum what stops ask for.

    :ivar swept: with the legs to the end of the steps that are known.
    :ivar sought: what the stops of the request ask.
    """

    swept: Swept
    sought: Sought

    def met(self, folder: Path, lengths: Sequence[float], report: Callable[[float], object]) -> tuple[int, Met] | None:
        """The step within which the first stop is met, counted from 0, and where; None where none is met.

        :param folder: where the state lies; ``lengths``: of the steps.
        :param report: takes the share done.
        """
        form, budget = self.swept.grid.form, self.swept.budget
        legs = self.swept.bound.local.legs.cheapest(lambda leg: budget.sides(form, leg.halo, leg.held), form.shape)
        old, done, since, area = Between(folder, form.shape), 0, 0.0, None
        try:
            for number, leg in enumerate(legs):
                new = Between(folder, form.shape)
                try:
                    sums = self._summed(
                        leg, old, new, lambda share, number=number: report((number + share) / len(legs))
                    )
                except BaseException:
                    new.close()
                    raise
                old.close()
                old = new
                area = float(sums.areas[0, 0]) if number == 0 and sums.areas.size else area
                part = lengths[done : done + len(sums.changes)]
                found = self.sought.met(sums, part, since, area)
                if found is not None:
                    return done + found[0], found[1]
                done, since = done + len(part), since + sum(part)
        finally:
            old.close()
        return None

    def _summed(self, leg: Leg, old: Between, new: Between, report: Callable[[float], object]) -> Sums:
        """What stops ask of all windows in a leg.

        :param old: the state before it; ``new``: takes that after it.
        """
        total = None
        for watching, share in self.swept.by(leg, (old, new), partial(Watching, self.sought.with_area)):
            total = watching.sums if total is None else total if watching.sums is None else total + watching.sums
            report(share)
        return self.sought.nothing(leg) if total is None else total
