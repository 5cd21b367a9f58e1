"""Spread tiles of a large grid side by side, on which the noise is estimated and the method and time are chosen."""

from dataclasses import dataclass, replace

import numpy as np

from meshflow.errors import InputError
from meshflow.estimate.constraints import Constraints
from meshflow.geometry.validation import Array
from meshflow.large.source import OnGrid, Source

__all__ = ["Sample", "part_of", "sample_of"]

# The largest number of values of a sample, and the side of its tiles.
ENOUGH, SIDE = 1 << 22, 256


@dataclass(frozen=True, eq=False)
class Sample:
    """A part of a grid.

    :ivar data: the tiles side by side, with a row or column of missing samples between them; the grid itself if it is small.
    :ivar rows: (r,), the row of the grid of each row of the sample, -1 between tiles; ``columns``: likewise.
    """

    data: OnGrid
    rows: Array
    columns: Array
    is_whole: bool

    def of(self, constraints: Constraints, shape: tuple[int, int]) -> Constraints:
        """The constraints of the sample.

        :param shape: (h, w), of the whole grid.
        """
        return part_of(constraints, shape, (self.rows, self.columns))


def sample_of(source: Source, enough: int = ENOUGH, side: int = SIDE) -> Sample:
    """The sample of a source: all of it up to ``enough`` values, else evenly spaced tiles of (side, side).

    :raises InputError: where no sample of any tile is present.
    """
    form = source.form
    (h, w), k = form.shape, form.channels or 1
    if h * w * k <= enough:
        window = slice(0, h), slice(0, w)
        data = form.data(*source.read(window))
        return Sample(data, np.arange(h), np.arange(w), True)
    count = max(1, enough // (side * side * k))
    high, wide = min(h, side), min(w, side)
    down = int(np.clip(np.rint(np.sqrt(count * h / w)), 1, h // high))
    across = int(np.clip(count // down, 1, w // wide))
    down = int(np.clip(count // across, 1, h // high))
    tops, lefts = (np.linspace(0, size - one, n).astype(int) for size, one, n in ((h, high, down), (w, wide, across)))
    rows, columns = _side_by_side(tops, high), _side_by_side(lefts, wide)
    values = np.zeros((len(rows), len(columns), *(() if form.channels is None else (k,))), form.dtype)
    missing = np.ones((len(rows), len(columns)), bool)
    for i, top in enumerate(tops.tolist()):
        for j, left in enumerate(lefts.tolist()):
            at = np.s_[i * (high + 1) : i * (high + 1) + high, j * (wide + 1) : j * (wide + 1) + wide]
            values[at], missing[at] = source.read((slice(top, top + high), slice(left, left + wide)))
    if missing.all():
        raise InputError(
            f"all samples of {len(tops) * len(lefts)} tiles spread over the grid are missing; crop it to where data is"
        )
    data = form.data(values, missing, np.maximum(rows, 0))
    return Sample(data, rows, columns, False)


def _side_by_side(begins: Array, size: int) -> Array:
    """The indices of parts one after the other, -1 between them."""
    parts = [np.concatenate([np.arange(begin, begin + size), [-1]]) for begin in begins]
    return np.concatenate(parts)[:-1]


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
