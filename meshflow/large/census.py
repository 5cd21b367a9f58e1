"""What the run of a window must know of the whole grid: the ends of its values, and which way it lies."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from meshflow.errors import NothingThere
from meshflow.estimate.preparation import datum_between
from meshflow.estimate.stabilizer import Stabilizer
from meshflow.flow.compute import Compute
from meshflow.geometry.validation import Array
from meshflow.large.source import Form, Source, Window, tiled
from meshflow.surfaces.grid import Whole
from meshflow.surfaces.orientation import AS_IT_IS, Orientation, lattice, orientation_by
from meshflow.surfaces.volume import Volume, WholeVolume, coarse_lattice, order_by

__all__ = ["Census", "Counted", "bands", "census_of", "counted_in", "joined"]

# The largest number of samples that are counted at a time.
AT_ONCE = 1 << 22


@dataclass(frozen=True, eq=False)
class Counted:
    """The count of one window.

    :ivar present: the number of samples that are not missing.
    :ivar ends: (k, 2), the least and the greatest present value of each channel; infinite where there is none.
    :ivar places: of the window's samples of the lattice in the lattice, along each axis.
    :ivar some: (r, c, k), of a volume (s, r, c, k), those samples; ``there``: whether they are present.
    """

    present: int
    ends: Array
    places: tuple[Array, ...]
    some: Array
    there: Array


@dataclass(frozen=True, eq=False)
class Census:
    """The count of a whole grid.

    :ivar form: of the grid.
    :ivar present: the number of samples that are not missing.
    :ivar ends: (k, 2), the least and the greatest present value of each channel.
    :ivar some: (r, c, k), of a volume (s, r, c, k), the samples of the lattice; ``there``: whether they are present.
    :ivar stabilizer: which the values run through, instead of a datum; None: through none.
    """

    form: Form
    present: int
    ends: Array
    some: Array
    there: Array
    stabilizer: Stabilizer | None = None

    @property
    def datum(self) -> Array:
        """What is subtracted from single-precision values that are far from zero, () or (k,)."""
        ends = self.ends if self.form.channels is not None else self.ends[0]
        if self.form.dtype != np.float32 or self.form.kind is Volume or self.stabilizer is not None:
            return np.zeros(ends.shape[:-1])
        return datum_between(ends[..., 0], ends[..., 1])

    @property
    def whole(self) -> Whole:
        """What a window of a height field or an image takes from the whole, in the orientation of the source."""
        return Whole(self.form.plane, self._ends)

    @property
    def whole_volume(self) -> WholeVolume:
        """What a window of a volume takes from the whole."""
        planes = np.moveaxis(self._above(self.some), -1, 0)
        ragged = self.present < self.form.samples
        return WholeVolume(self._ends, order_by(planes, self.there, self.form.shape), ragged)

    def orientation(self, compute: Compute) -> Orientation:
        """The orientation of the whole for the flow; a volume stays as it is."""
        if compute.diagonals in ("forward", "backward") or self.form.kind is Volume:
            return AS_IT_IS
        h, w = self.form.shape
        return orientation_by(self._above(self.some), self.there, (h, w), self.form.plane)

    @property
    def _ends(self) -> tuple[float, float]:
        ends = self._above(self.ends.T)
        return float(ends.min()), float(ends.max())

    def _above(self, values: Array) -> Array:
        """Values (..., k) above the datum, or stabilized."""
        if self.stabilizer is not None:
            return self.stabilizer.stabilized(values)
        datum = np.atleast_1d(self.datum)
        return values - datum.astype(self.form.dtype) if datum.any() else values


def counted_in(window: Window, values: Array, missing: Array, form: Form) -> Counted:
    """The count of a window of a grid.

    :param values: (r, c) or (r, c, k); ``missing``: (r, c); of a volume with one axis more.
    :param form: of the whole.
    """
    stack, ends = values.reshape(*missing.shape, -1), []
    whole = not missing.any()
    for channel in np.moveaxis(stack, -1, 0):
        known = channel if whole else channel[~missing]
        ends.append((known.min(initial=np.inf), known.max(initial=-np.inf)))
    inside = [_inside(at, part) for at, part in zip(_lattice(form), window, strict=True)]
    where = np.ix_(*(at for _, at in inside))
    present = int(missing.size - np.count_nonzero(missing))
    return Counted(present, np.array(ends, stack.dtype), tuple(one for one, _ in inside), stack[where], ~missing[where])


def _lattice(form: Form) -> list[Array]:
    """The places along each axis of the samples that tell which way the whole lies."""
    return [(coarse_lattice if form.kind is Volume else lattice)(size) for size in form.shape]


def _inside(at: Array, part: slice) -> tuple[Array, Array]:
    """The lines of the lattice along a side that lie in a part of it: their number in the lattice, and in the part."""
    chosen = np.flatnonzero((at >= part.start) & (at < part.stop))
    return chosen, at[chosen] - part.start


def joined(counts: Iterable[Counted], form: Form) -> Census:
    """The count of a whole grid from those of windows that cover it.

    :raises NothingThere: where no sample is present.
    """
    present, ends = 0, np.zeros(0)
    shape = tuple(map(len, _lattice(form)))
    some, there = np.zeros((*shape, form.channels or 1), form.dtype), np.zeros(shape, bool)
    for count in counts:
        present += count.present
        low, high = count.ends.T
        ends = count.ends if not ends.size else np.stack([np.minimum(ends[:, 0], low), np.maximum(ends[:, 1], high)], 1)
        at = np.ix_(*count.places)
        some[at], there[at] = count.some, count.there
    if not present:
        raise NothingThere(
            f"all {form.samples} samples are missing (nodata, NaN, infinite or masked); nothing to smooth"
        )
    return Census(form, present, ends, some, there)


def bands(form: Form, at_once: int) -> list[Window]:
    """Windows of about ``at_once`` values that cover a grid: bands of its rows, of a volume blocks."""
    sides, each = list(form.shape), form.channels or 1
    if form.kind is Volume:
        side = max(1, int((at_once / each) ** (1 / 3)))
        sides = [min(size, side) for size in sides]
    else:
        sides[0] = max(1, at_once // (sides[1] * each))
    return list(tiled(form.shape, tuple(sides)))


def census_of(
    source: Source,
    report: Callable[[float], object] | None = None,
    at_once: int = AT_ONCE,
    seen: Callable[[Window, Array, Array], object] | None = None,
) -> Census:
    """The count of a source, by windows.

    :param report: takes the share done.
    :param at_once: the number of samples that are read at a time.
    :param seen: takes each window with its values and those that are missing.
    """
    form = source.form
    windows = bands(form, at_once)

    def counts() -> Iterable[Counted]:
        """The count of each window."""
        for i, window in enumerate(windows):
            values, missing = source.read(window)
            yield counted_in(window, values, missing, form)
            if seen is not None:
                seen(window, values, missing)
            if report is not None:
                report((i + 1) / len(windows))

    return joined(counts(), form)
