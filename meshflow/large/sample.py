"""Spread tiles of a large grid side by side, on which the noise is estimated and the method and time are chosen."""

from dataclasses import dataclass, replace

import numpy as np

from meshflow.errors import InputError
from meshflow.estimate.constraints import Constraints
from meshflow.geometry.validation import Array
from meshflow.large.source import Form, OnGrid, Source

__all__ = ["Places", "Sample", "part_of", "places_in", "sample_from", "sample_of"]

# The largest number of values of a sample, and the side of its tiles.
ENOUGH, SIDE = 1 << 22, 256


@dataclass(frozen=True, eq=False)
class Places:
    """Where the sample of a grid is taken.

    :ivar rows: (r,), the row of the grid of each row of the sample, -1 between tiles; ``columns``: likewise.
    :ivar is_whole: whether they are all rows and columns.
    """

    rows: Array
    columns: Array
    is_whole: bool = False


@dataclass(frozen=True, eq=False)
class Sample:
    """A part of a grid.

    :ivar data: tiles side by side, with a row or column of missing samples between them; the grid itself if it is small.
    :ivar places: of its samples.
    """

    data: OnGrid
    places: Places

    @property
    def is_whole(self) -> bool:
        """Whether it is the whole grid."""
        return self.places.is_whole

    def of(self, constraints: Constraints, shape: tuple[int, int]) -> Constraints:
        """The constraints of the sample.

        :param shape: (h, w), of the whole grid.
        """
        return part_of(constraints, shape, (self.places.rows, self.places.columns))


def places_in(form: Form, enough: int = ENOUGH, side: int = SIDE) -> Places:
    """The places of the sample of a grid: all of it up to ``enough`` values, else evenly spaced tiles of (side, side)."""
    (h, w), k = form.shape, form.channels or 1
    if h * w * k <= enough:
        return Places(np.arange(h), np.arange(w), True)
    count = max(1, enough // (side * side * k))
    high, wide = min(h, side), min(w, side)
    down = int(np.clip(np.rint(np.sqrt(count * h / w)), 1, h // high))
    across = int(np.clip(count // down, 1, w // wide))
    down = int(np.clip(count // across, 1, h // high))
    return Places(_side_by_side(h, high, down), _side_by_side(w, wide, across))


def sample_of(source: Source, enough: int = ENOUGH, side: int = SIDE) -> Sample:
    """The sample of a source, tile by tile.

    :raises InputError: where no sample of any tile is present.
    """
    form, places = source.form, places_in(source.form, enough, side)
    channels = () if form.channels is None else (form.channels,)
    values = np.zeros((len(places.rows), len(places.columns), *channels), form.dtype)
    missing = np.ones(values.shape[:2], bool)
    for rows in _runs(places.rows):
        for columns in _runs(places.columns):
            window = _span(places.rows[rows]), _span(places.columns[columns])
            values[rows, columns], missing[rows, columns] = source.read(window)
    return sample_from(form, places, values, missing)


def sample_from(form: Form, places: Places, values: Array, missing: Array) -> Sample:
    """The sample of a grid from its values at the places; what lies between tiles is missing.

    :param values: (r, c) or (r, c, k); ``missing``: (r, c).
    :raises InputError: where no sample is present.
    """
    missing = missing | (places.rows < 0)[:, None] | (places.columns < 0)
    if missing.all() and not places.is_whole:
        raise InputError("all samples of the tiles spread over the grid are missing; crop it to where data is")
    return Sample(form.data(values, missing, np.maximum(places.rows, 0)), places)


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


def part_of(constraints: Constraints, shape: tuple[int, int], part: tuple[Array | slice, Array | slice]) -> Constraints:
    """The constraints of a part of a grid: arrays of one number per sample are cut.

    :param shape: (h, w), of the whole grid.
    :param part: rows and columns, as slices or as indices; at -1 there is no sample.
    """
    changed = {}
    for name in constraints.arrays:
        array = np.asarray(getattr(constraints, name))
        if array.shape[:2] != shape:
            raise InputError(f"{name}: one number per sample, shape {shape}, expected, got {array.shape}")
        rows, columns = part
        changed[name] = array[rows][:, columns]
    return replace(constraints, **changed)
