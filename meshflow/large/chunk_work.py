"""What each chunk of an array of dask is told, and what it computes: its count, and its smoothed values."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from meshflow.estimate.constraints import Constraints
from meshflow.flow.compute import Compute
from meshflow.geometry.validation import Array
from meshflow.large.census import Census, Counted, counted_in
from meshflow.large.source import Window, grown, within
from meshflow.large.windows import Local

__all__ = ["Task", "counted_chunk", "gone_in", "smoothed_chunk"]


def gone_in(values: Array, declared: tuple[Any, ...], missing: Array | None, axes: int) -> Array:
    """Missing samples of a chunk.

    :param axes: of the samples, 2 or 3; one more of the values is that of their channels.
    """
    gone = ~np.isfinite(values)
    for value in declared:
        gone |= values == values.dtype.type(value)
    gone = gone if gone.ndim == axes else np.logical_or.reduce(gone, axis=axes)
    return gone if missing is None else gone | missing


@dataclass(frozen=True, eq=False)
class Task:
    """What every chunk is told.

    :ivar chunks: of each axis.
    :ivar depth: of each axis, how many lines of its neighbours it has on each side.
    :ivar names: of what is given for each sample, the values first.
    """

    local: Local
    chunks: tuple[tuple[int, ...], ...]
    declared: tuple[Any, ...]
    free: Constraints
    depth: tuple[int, ...]
    names: tuple[str, ...]

    def window(self, numbers: Sequence[int]) -> tuple[Window, Window]:
        """The window of a chunk, and it with its halo.

        :param numbers: of the chunk along each axis.
        """
        inner = tuple(slice(sum(sizes[:i]), sum(sizes[: i + 1])) for sizes, i in zip(self.chunks, numbers, strict=True))
        shape = self.local.form.shape
        return inner, tuple(grown(inner, depth, shape)[axis] for axis, depth in enumerate(self.depth))

    def taken(self, parts: Sequence[Array]) -> tuple[Array, Array, Constraints]:
        """The values of a chunk, its missing samples, and its constraints.

        :param parts: what is given for each sample, in the order of the names.
        """
        own = dict(zip(self.names, parts, strict=True))
        values = own.pop("values")
        missing = gone_in(values, self.declared, own.pop("missing", None), len(self.chunks))
        return values, missing, replace(self.free, **own)


def smoothed_chunk(*parts: Array, task: Task, census: Census) -> Array:
    """The smoothed values of a chunk.

    :param parts: of each axis (1,), the number of the chunk along it; and what is given for each sample.
    """
    axes = len(task.chunks)
    windows = task.window([int(number[0]) for number in parts[:axes]])
    bound = task.local.over(census)
    compute: Compute = bound.plan.request.compute
    with compute.running():
        return bound.moved(windows, *task.taken(parts[axes:]))


def counted_chunk(numbers: tuple[int, ...], *parts: Array, task: Task) -> Counted:
    """The count of one chunk.

    :param numbers: of the chunk along each axis; ``parts``: what is given for each sample.
    """
    inner, outer = task.window(numbers)
    at = within(inner, outer)
    values, missing, constraints = task.taken(parts)
    values, missing = task.local.cleaned(values, missing, outer[0], constraints)
    return counted_in(inner, values[at], missing[at], task.local.form)
