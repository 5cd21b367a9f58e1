"""What each chunk of an array of dask is told, and what it computes: its count, and its smoothed values."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from operator import add
from typing import Any, Literal

import numpy as np

from meshflow.estimate.constraints import Constraints
from meshflow.flow.compute import Compute
from meshflow.flow.stops import Met
from meshflow.geometry.validation import Array
from meshflow.large.census import Census, Counted, counted_in
from meshflow.large.legs import Leg
from meshflow.large.outcome import Measured
from meshflow.large.source import Window, grown, within
from meshflow.large.stopping import Sought, Sums, Watching
from meshflow.large.windows import Begun, Bound, Local

__all__ = ["Step", "Task", "bound_by", "counted_chunk", "gone_in", "smoothed_chunk", "stop_in", "summed_chunk"]


def gone_in(values: Array, declared: tuple[Any, ...], missing: Array | None, axes: int) -> Array:
    """Missing samples of a chunk.

    :param values: also masked ones (numpy.ma).
    :param axes: of the samples, 2 or 3; one more of the values is that of their channels.
    """
    numbers = np.ma.getdata(values)
    gone = ~np.isfinite(numbers)
    if isinstance(values, np.ma.MaskedArray):
        gone |= np.ma.getmaskarray(values)
    for value in declared:
        gone |= numbers == numbers.dtype.type(value)
    gone = gone if gone.ndim == axes else np.logical_or.reduce(gone, axis=axes)
    return gone if missing is None else gone | missing


@dataclass(frozen=True, eq=False)
class Task:
    """What every chunk is told.

    :ivar shape: of the grid.
    :ivar chunks: of each axis.
    :ivar depth: of each axis, how many lines of its neighbours it has on each side.
    :ivar names: of what is given for each sample, the values first.
    :ivar measured: where it notes what is removed; None: nowhere.
    """

    shape: tuple[int, ...]
    chunks: tuple[tuple[int, ...], ...]
    declared: tuple[Any, ...]
    free: Constraints
    depth: tuple[int, ...]
    names: tuple[str, ...]
    measured: Measured | None = None

    def window(self, numbers: Sequence[int]) -> tuple[Window, Window]:
        """The window of a chunk, and it with its halo.

        :param numbers: of the chunk along each axis.
        """
        inner = tuple(slice(sum(sizes[:i]), sum(sizes[: i + 1])) for sizes, i in zip(self.chunks, numbers, strict=True))
        return inner, tuple(grown(inner, depth, self.shape)[axis] for axis, depth in enumerate(self.depth))

    def taken(self, parts: Sequence[Array]) -> tuple[Array, Array, Constraints]:
        """The values of a chunk, its missing samples, and its constraints.

        :param parts: what is given for each sample, in the order of the names.
        """
        own = dict(zip(self.names, parts, strict=True))
        values = own.pop("values")
        missing = gone_in(values, self.declared, own.pop("missing", None), len(self.chunks))
        return np.ma.getdata(values), missing, replace(self.free, **own)


@dataclass(frozen=True)
class Step:
    """What chunks do between two exchanges.

    :ivar leg: of the work.
    :ivar before: the names of the arrays of the state before it, one after the other along the last axis; ``after``: those of the
        state after it, none after the last leg.
    """

    leg: Leg
    before: tuple[str, ...]
    after: tuple[str, ...]


def summed_chunk(numbers: tuple[int, ...], *parts: Array, task: Task, bound: Bound, sought: Sought) -> Sums:
    """What stops ask of the samples of a chunk, to the end of the steps that are known; parameters of :func:`counted_chunk`."""
    watching = Watching(sought.with_area)
    compute: Compute = bound.plan.request.compute
    leg = bound.local.legs.one
    with compute.running():
        bound.held(task.window(numbers), *task.taken(parts), Begun(leg), watching)
    return watching.sums or sought.nothing(leg)


def stop_in(sums: Sequence[Sums], sought: Sought, lengths: Sequence[float]) -> tuple[int, Met] | None:
    """The step within which all chunks together meet a stop, counted from 0, and where; None where they meet none.

    :param sums: of each chunk, of steps of these ``lengths``.
    """
    return sought.met(reduce(add, sums), lengths)


def smoothed_chunk(
    *parts: Array, task: Task, bound: Bound, step: Step, met: tuple[int, Met] | Literal["known"] | None = "known"
) -> Array:
    """The smoothed values of a chunk; before the last leg its state.

    :param parts: of each axis (1,), the number of the chunk along it; what is given for each sample; and the state before.
    :param bound: what it runs.
    :param met: of :func:`stop_in`; ``known``: the end of the run was found before.
    """
    if met != "known":
        bound = replace(bound, local=bound.local.ended(bound.local.legs.tracks[0], met))
    axes, given = len(task.chunks), len(task.names)
    numbers = tuple(int(number[0]) for number in parts[:axes])
    windows = task.window(numbers)
    state = np.split(parts[-1], len(step.before), axis=-1) if step.before else ()
    begun = Begun(step.leg, dict(zip(step.before, state, strict=True)))
    compute: Compute = bound.plan.request.compute
    with compute.running():
        taken = task.taken(parts[axes : axes + given])
        if not step.after:
            after, at = bound.moved(windows, *taken, begun), within(*windows)
            if task.measured is not None:
                task.measured.add(numbers, taken[0][at], after, taken[1][at])
            return _as_masked(parts[axes], at, after)
        held = bound.held(windows, *taken, begun)
    if not held:
        sides = tuple(part.stop - part.start for part in windows[0])
        return np.zeros((*sides, len(step.after) * (bound.local.form.channels or 1)), bound.local.form.dtype)
    return np.concatenate([held[name] for name in step.after], axis=-1)


def _as_masked(given: Array, at: Window, values: Array) -> Array:
    """Smoothed values with the mask of those that were given with a halo, if they had one.

    :param at: where they are among these.
    """
    if not isinstance(given, np.ma.MaskedArray):
        return values
    return np.ma.MaskedArray(values, mask=np.ma.getmaskarray(given)[at])


def counted_chunk(numbers: tuple[int, ...], *parts: Array, task: Task, local: Local) -> Counted:
    """The count of one chunk.

    :param numbers: of the chunk along each axis; ``parts``: what is given for each sample.
    """
    inner, outer = task.window(numbers)
    at = within(inner, outer)
    values, missing, constraints = task.taken(parts)
    values, missing = local.cleaned(values, missing, outer[0], constraints)
    return counted_in(inner, values[at], missing[at], local.form)


def bound_by(census: Census, local: Local) -> Bound:
    """What every chunk runs: found once, and smaller than the count."""
    return local.over(census)
