"""Spread tiles of a large grid side by side, on which the noise is estimated and the method and time are chosen."""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from meshflow.errors import InputError
from meshflow.estimate.constraints import Constraints
from meshflow.geometry.validation import Array
from meshflow.large.source import Form, OnGrid, Source

__all__ = ["Places", "Sample", "part_of", "places_in", "sample_from", "sample_of"]

# The largest number of values of a sample, and the side of its tiles, of a volume that of its cubes.
ENOUGH, SIDE, CUBE = 1 << 22, 256, 64


@dataclass(frozen=True, eq=False)
class Places:
    """Where the sample of a grid is taken.

    :ivar axes: of each axis the lines of the grid that are the lines of the sample, -1 between tiles.
    :ivar is_whole: whether they are all lines.
    """

    axes: tuple[Array, ...]
    is_whole: bool = False


@dataclass(frozen=True, eq=False)
class Sample:
    """A part of a grid.

    :ivar data: tiles side by side, with a line of missing samples between them; the grid itself if it is small.
    :ivar places: of its samples.
    """

    data: OnGrid
    places: Places

    @property
    def is_whole(self) -> bool:
        """Whether it is the whole grid."""
        return self.places.is_whole

    def of(self, constraints: Constraints, shape: tuple[int, ...]) -> Constraints:
        """The constraints of the sample.

        :param shape: of the whole grid.
        """
        return part_of(constraints, shape, self.places.axes)


def places_in(form: Form, enough: int = ENOUGH, side: int | None = None) -> Places:
    """The places of the sample of a grid: all of it up to ``enough`` values, else evenly spaced tiles of equal sides."""
    shape, k = form.shape, form.channels or 1
    if form.values <= enough:
        return Places(tuple(map(np.arange, shape)), True)
    side = side or (CUBE if len(shape) == 3 else SIDE)
    left = count = max(1, enough // (side ** len(shape) * k))
    sides, numbers = [min(size, side) for size in shape], []
    for axis, size in enumerate(shape):  # as many tiles along each axis as go with its length
        rest = shape[axis:]
        each = np.rint((left * size ** len(rest) / np.prod(rest, dtype=float)) ** (1 / len(rest)))
        numbers.append(int(np.clip(each, 1, size // sides[axis])))
        left = max(1, left // numbers[-1])
    numbers[0] = int(np.clip(count // int(np.prod(numbers[1:])), 1, shape[0] // sides[0]))
    return Places(tuple(map(_side_by_side, shape, sides, numbers)))


def sample_of(source: Source, enough: int = ENOUGH, side: int | None = None) -> Sample:
    """The sample of a source, tile by tile.

    :raises InputError: where no sample of any tile is present.
    """
    form, places = source.form, places_in(source.form, enough, side)
    shape = tuple(map(len, places.axes))
    values, missing = np.zeros((*shape, *form.tail), form.dtype), np.ones(shape, bool)
    for part in product(*map(_runs, places.axes)):
        window = tuple(_span(lines[run]) for lines, run in zip(places.axes, part, strict=True))
        values[part], missing[part] = source.read(window)
    return sample_from(form, places, values, missing)


def sample_from(form: Form, places: Places, values: Array, missing: Array) -> Sample:
    """The sample of a grid from its values at the places; what lies between tiles is missing.

    :param values: (r, c) or (r, c, k); ``missing``: (r, c); of a volume with one axis more.
    :raises InputError: where no sample is present.
    """
    for axis, lines in enumerate(places.axes):
        missing = missing | (lines < 0).reshape(-1, *(1,) * (missing.ndim - axis - 1))
    if missing.all() and not places.is_whole:
        raise InputError("all samples of the tiles spread over the grid are missing; crop it to where data is")
    return Sample(form.data(values, missing, np.maximum(places.axes[0], 0)), places)


def _side_by_side(size: int, each: int, count: int) -> Array:
    """The indices of parts of a side one after the other, -1 between them."""
    begins = np.linspace(0, size - each, count).astype(int)
    return np.concatenate([np.concatenate([np.arange(begin, begin + each), [-1]]) for begin in begins])[:-1]


def _runs(lines: Array) -> list[slice]:
    """The places of tiles in the sample, along a side."""
    ends = [*np.flatnonzero(lines < 0).tolist(), len(lines)]
    begins = [0, *(end + 1 for end in ends[:-1])]
    return [slice(begin, end) for begin, end in zip(begins, ends, strict=True)]


def _span(lines: Array) -> slice:
    """Consecutive lines of a grid."""
    return slice(int(lines[0]), int(lines[-1]) + 1)


def part_of(constraints: Constraints, shape: tuple[int, ...], part: tuple[Array | slice, ...]) -> Constraints:
    """The constraints of a part of a grid: arrays of one number per sample are cut.

    :param shape: of the whole grid.
    :param part: of each axis, as slices or as indices; at -1 there is no sample.
    """
    changed = {}
    for name in constraints.arrays:
        array = np.asarray(getattr(constraints, name))
        if array.shape[: len(shape)] != shape:
            raise InputError(f"{name}: one number per sample, shape {shape}, expected, got {array.shape}")
        for axis, lines in enumerate(part):
            array = array[(slice(None),) * axis + (lines,)]
        changed[name] = array
    return replace(constraints, **changed)
