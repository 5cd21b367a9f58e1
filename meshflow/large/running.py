"""Runs one window of a grid, whatever file it lies in: the smoothed values, and the expected error of each sample."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from meshflow.estimate.noise_fields import NoiseFields
from meshflow.estimate.preparation import AS_DATA
from meshflow.estimate.request import Request
from meshflow.flow.progress import Progress, reporting
from meshflow.geometry.validation import Array
from meshflow.large.between import Between, carried
from meshflow.large.census import Census
from meshflow.large.legs import Leg
from meshflow.large.memory import Budget, Room
from meshflow.large.sample import part_of
from meshflow.large.source import Source, Window, grown, rows_and_columns, tiled, within
from meshflow.large.windows import Begun, Bound, Windowed
from meshflow.results.expected_error import spread_around

__all__ = ["Block", "Done", "Run", "at_the_last_leg", "smoothed"]


@dataclass(frozen=True, eq=False)
class Run:
    """What is run on the windows of a file.

    :ivar census: of the file; ``bound``: knows that of the grid in which it lies.
    :ivar legs: by which it is run; ``between``: the state before the last one.
    """

    found: Windowed
    bound: Bound
    census: Census
    request: Request
    legs: tuple[Leg, ...]
    between: Between

    @classmethod
    def of(cls, bound: Bound, run: Windowed, census: Census, request: Request, room: Room) -> "Run":
        """The run with the legs by which windows have the least to compute."""
        form, cut, tile = bound.local.form, run.local.legs, room.tile

        def sides(leg: Leg) -> tuple[int, ...]:
            """Of the windows of a leg."""
            fit = room.budget.sides(form, leg.halo, leg.held)
            if not leg.ends or tile is None:
                return fit
            return tuple(max(side // own, 1) * min(own, side) for side, own in zip(fit, tile, strict=True))

        legs = (cut.one,) if room.alone else cut.cheapest(sides, form.shape)
        return cls(run, bound, census, request, legs, Between(room.folder, form.shape))

    @property
    def leg(self) -> Leg:
        """The last one."""
        return self.legs[-1]


@dataclass(frozen=True, eq=False)
class Done:
    """A window that was smoothed.

    :ivar before: (r, c) or (r, c, k), of a volume with one axis more; ``after``: likewise.
    :ivar missing: its samples that are missing.
    :ivar error: the expected error of each value; None: it was not asked for.
    """

    before: Array
    after: Array
    missing: Array
    error: Array | None = None

    def side(self, word: str) -> Array:
        """The values of a file beside the result."""
        return self.before.astype(np.float64) - self.after if word == "removed" or self.error is None else self.error

    def part(self, at: Window) -> "Done":
        """That of a window of it."""
        error = None if self.error is None else self.error[at]
        return Done(self.before[at], self.after[at], self.missing[at], error)


@dataclass(eq=False)
class Block:
    """Neighbouring files of a grid that are run as one window, as soon as the first of them asks: one halo is around them all.

    :ivar place: of the window in the grid.
    :ivar with_error: estimate the error of each sample, too.
    """

    grid: Source
    run: Run
    place: Window
    with_error: bool = False
    _done: Done | None = None

    def part(self, window: Window) -> Done:
        """What becomes of a window of the grid that lies in it."""
        if self._done is None:
            self._done = smoothed(self.grid, self.run, self.place, with_error=self.with_error)
        return self._done.part(within(window, self.place))


def smoothed(grid: Source, run: Run, inner: Window, *, with_error: bool = False) -> Done:
    """A window of a grid, smoothed.

    :param with_error: estimate the error of each sample, too; of grids of two axes.
    """
    shape, halo = grid.form.shape, run.leg.halo
    wide = grown(inner, halo, shape) if with_error else inner
    outer = grown(wide, halo, shape)
    values, missing = grid.read(outer)
    held = part_of(run.request.constraints, shape, outer)
    done = run.bound.moved((wide, outer), values, missing, held, Begun(run.leg, run.between.read(outer)))
    at, error = within(inner, outer), None
    if with_error:
        left_out = run.bound.local.cleaned(values, missing, outer[0], held)[1]
        error = _error_of(run, (inner, wide), done, left_out[within(wide, outer)])
    return Done(values[at], done[within(inner, wide)], missing[at], error)


@contextmanager
def at_the_last_leg(grid: Source, run: Run, budget: Budget, progress: Progress) -> Iterator[Run]:
    """The run when all windows of a grid have come to its last leg; the state before that vanishes with the context."""
    form, bound = grid.form, run.bound

    def windows(leg: Leg) -> list[Window]:
        """Those of a leg."""
        return list(tiled(form.shape, budget.sides(form, leg.halo, leg.held)))

    def moved(leg: Leg, inner: Window, between: Between) -> dict[str, Array]:
        """The state of a window after a leg."""
        outer = grown(inner, leg.halo, form.shape)
        held = part_of(run.request.constraints, form.shape, outer)
        return bound.held((inner, outer), *grid.read(outer), held, Begun(leg, between.read(outer)))

    between = run.between
    if len(run.legs) > 1:
        with reporting(progress, f"smoothing by {len(run.legs)} legs, before the last one") as report:
            between = carried(run.legs, windows, moved, between, report)
    try:
        yield replace(run, between=between)
    finally:
        between.close()


def _error_of(run: Run, windows: tuple[Window, Window], done: Array, missing: Array) -> Array:
    """The expected error (r, c) or (r, c, k) of a window; NaN where samples are missing, or were left out.

    :param windows: the one that is asked for, and it with its halo.
    :param done: the result in the latter; ``missing``: (r, c), with the samples that were left out.
    """
    inner, wide = windows
    at, found = within(inner, wide), run.found.found
    if found.idle is not None:
        error = np.full_like(done[at], found.noise.sigma)
    else:
        # What is left out is missing now; nothing else is an outlier.
        bound = replace(run.bound, local=replace(run.bound.local, cleaning=AS_DATA))
        again = _Again(replace(run, bound=bound), windows, missing)
        fields = NoiseFields(found.noise, bound.local.form.channels)
        error = spread_around(done, (rows_and_columns(at), rows_and_columns(wide)), again, fields)
    error[missing[at]] = np.nan
    return error


@dataclass(frozen=True, eq=False)
class _Again:
    """Runs the plan of windows on other values of one."""

    run: Run
    windows: tuple[Window, Window]
    missing: Array

    def __call__(self, values: Array) -> Array:
        """The smoothed values."""
        run = self.run
        constraints = part_of(run.request.constraints, run.bound.local.form.shape, self.windows[1])
        return run.bound.moved(self.windows, values, self.missing, constraints)
