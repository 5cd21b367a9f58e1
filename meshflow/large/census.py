"""What the run of a window must know of the whole grid: the ends of its values, and which way it lies."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from meshflow.errors import NothingThere
from meshflow.estimate.preparation import datum_between
from meshflow.flow.compute import Compute
from meshflow.geometry.validation import Array
from meshflow.large.source import Form, Source, Window, tiled
from meshflow.surfaces.grid import Whole
from meshflow.surfaces.orientation import AS_IT_IS, Orientation, lattice, orientation_by

__all__ = ["Census", "Counted", "census_of", "counted_in", "joined"]

# The largest number of samples that are counted at a time.
AT_ONCE = 1 << 22


@dataclass(frozen=True, eq=False)
class Counted:
    """The count of one window.

    :ivar present: the number of samples that are not missing.
    :ivar ends: (k, 2), the least and the greatest present value of each channel; infinite where there is none.
    :ivar rows: places of the window's samples of the lattice in the lattice, rows; ``columns``: likewise.
    :ivar some: (r, c, k), those samples; ``there``: (r, c), whether they are present.
    """

    present: int
    ends: Array
    rows: Array
    columns: Array
    some: Array
    there: Array


@dataclass(frozen=True, eq=False)
class Census:
    """The count of a whole grid.

    :ivar form: of the grid.
    :ivar present: the number of samples that are not missing.
    :ivar ends: (k, 2), the least and the greatest present value of each channel.
    :ivar some: (r, c, k), the samples of the lattice; ``there``: (r, c), whether they are present.
    """

    form: Form
    present: int
    ends: Array
    some: Array
    there: Array

    @property
    def datum(self) -> Array:
        """What is subtracted from single-precision values that are far from zero, () or (k,)."""
        ends = self.ends if self.form.channels is not None else self.ends[0]
        if self.form.dtype != np.float32:
            return np.zeros(ends.shape[:-1])
        return datum_between(ends[..., 0], ends[..., 1])

    @property
    def whole(self) -> Whole:
        """What a window takes from the whole, in the orientation of the source."""
        ends = self._above(self.ends.T).T
        return Whole(self.form.spacing, (float(ends.min()), float(ends.max())))

    def orientation(self, compute: Compute) -> Orientation:
        """The orientation of the whole for the flow."""
        if compute.diagonals in ("forward", "backward"):
            return AS_IT_IS
        return orientation_by(self._above(self.some), self.there, self.form.shape, self.form.spacing)

    def _above(self, values: Array) -> Array:
        """Values (..., k) above the datum."""
        datum = np.atleast_1d(self.datum)
        return values - datum.astype(self.form.dtype) if datum.any() else values


def counted_in(window: Window, values: Array, missing: Array, shape: tuple[int, int]) -> Counted:
    """The count of a window of a grid.

    :param values: (r, c) or (r, c, k); ``missing``: (r, c).
    :param shape: (h, w), of the whole.
    """
    stack, ends = values.reshape(*missing.shape, -1), []
    whole = not missing.any()
    for channel in np.moveaxis(stack, 2, 0):
        known = channel if whole else channel[~missing]
        ends.append((known.min(initial=np.inf), known.max(initial=-np.inf)))
    (rows, high), (columns, wide) = (_inside(size, part) for size, part in zip(shape, window, strict=True))
    where = np.ix_(high, wide)
    present = int(missing.size - np.count_nonzero(missing))
    return Counted(present, np.array(ends, stack.dtype), rows, columns, stack[where], ~missing[where])


def _inside(size: int, part: slice) -> tuple[Array, Array]:
    """The lines of the lattice along a side that lie in a part of it: their number in the lattice, and in the part."""
    at = lattice(size)
    chosen = np.flatnonzero((at >= part.start) & (at < part.stop))
    return chosen, at[chosen] - part.start


def joined(counts: Iterable[Counted], form: Form) -> Census:
    """The count of a whole grid from those of windows that cover it.

    :raises NothingThere: where no sample is present.
    """
    h, w = form.shape
    present, ends = 0, np.zeros(0)
    shape = len(lattice(h)), len(lattice(w))
    some, there = np.zeros((*shape, form.channels or 1), form.dtype), np.zeros(shape, bool)
    for count in counts:
        present += count.present
        low, high = count.ends.T
        ends = count.ends if not ends.size else np.stack([np.minimum(ends[:, 0], low), np.maximum(ends[:, 1], high)], 1)
        at = np.ix_(count.rows, count.columns)
        some[at], there[at] = count.some, count.there
    if not present:
        raise NothingThere(f"all {h * w} samples are missing (nodata, NaN, infinite or masked); nothing to smooth")
    return Census(form, present, ends, some, there)


def census_of(source: Source, report: Callable[[float], object] | None = None, at_once: int = AT_ONCE) -> Census:
    """The count of a source, by bands of its rows.

    :param report: takes the share done.
    :param at_once: the number of samples that are read at a time.
    """
    form = source.form
    h, w = form.shape
    high = max(1, at_once // (w * (form.channels or 1)))

    def counts() -> Iterable[Counted]:
        """The count of each band."""
        for window in tiled(form.shape, (high, w)):
            yield counted_in(window, *source.read(window), form.shape)
            if report is not None:
                report(window[0].stop / h)

    return joined(counts(), form)
