"""The base of data for a fixed method: the data at a larger scale. Only departures from its slope then count as edges."""

from dataclasses import replace

import numpy as np

from meshflow.flow.engines.grid import GridFlow
from meshflow.flow.family import Variant
from meshflow.flow.steppers import SuperTime, counted_in
from meshflow.geometry.validation import Array
from meshflow.surfaces.discontinuities import Cuts
from meshflow.surfaces.grid import Grid, Whole

__all__ = ["base_of", "base_reach"]

# The time of the heat flow for the base, in squared sample distances.
TIME = 64.0
# The ends of its steps as parts of that time. A single step would leave fine noise.
PARTS = (1.0 / 64.0, 1.0 / 16.0, 0.25, 1.0)
# A difference of neighbours that departs by so many sigma from the differences around it is a jump, which the base keeps.
JUMP = 6.0
# How many samples away a sample decides whether a difference is a jump.
ACROSS = 3
# The slope of a step over the whole range. It is so small that the flow is the heat equation.
FLAT = 1e-3


def base_of(grid: Grid, sigma: float, threads: int | None = None) -> Array:
    """The base of the planes (k, h, w) of a grid: the result of a heat flow that crosses no jump.

    A tilted plane of any slope is its own base.

    :param sigma: the noise, unit of the planes.
    """
    planes = np.where(grid.missing, 0, grid.planes)
    ends = _ends(planes, grid)
    spread = ends[1] - ends[0]
    if spread == 0.0:
        return planes
    power = int(np.frexp(spread)[1])
    right, down = (_jumps(planes, grid.missing, axis, JUMP * sigma, power) for axis in (2, 1))
    if grid.cuts is not None:
        right, down = right | grid.cuts.right, down | grid.cuts.down
    step = float(np.sqrt(np.mean(grid.spacing[0]) * grid.spacing[1])) if grid.whole is None else grid.whole.step
    # Steps as short as where triangles are missing: a window may have cuts, or none.
    whole = Whole(grid.spacing, ends, ragged=True) if grid.whole is None else replace(grid.whole, ragged=True)
    cut = replace(grid, contrast=FLAT * step / spread, cuts=Cuts(right, down), whole=whole)
    flow = GridFlow(cut, Variant(), threads)
    u, since = flow.start(), 0.0
    for count, part in enumerate(PARTS):
        u = SuperTime().step(flow, u, (part - since) * TIME * step**2, count)
        since = part
    # A tilted plane is its own base up to its border, beyond which no base goes.
    return np.clip(u.T.reshape(planes.shape), *ends)


def base_reach(whole: Whole) -> int:
    """How many samples away a sample decides the base of another one.

    :param whole: of the grid.
    """
    none = np.zeros((2, 2), bool)
    spacing = float(np.min(whole.spacing[0])), whole.spacing[1]
    grid = Grid(np.zeros((1, 2, 2)), none, none, spacing, whole=replace(whole, ragged=True))
    flow = GridFlow(grid, Variant())
    unit, ends = counted_in(flow, flow.start()), np.diff([0.0, *PARTS]) * TIME * whole.step**2
    return ACROSS + sum(SuperTime().count(float(dt), unit) for dt in ends)


def _ends(planes: Array, grid: Grid) -> tuple[float, float]:
    """The least and the greatest present number, of a window those of the whole grid, in the number type of the planes."""
    if grid.whole is not None:
        low, high = (planes.dtype.type(end) for end in grid.whole.ends)
        return float(low), float(high)
    there = np.broadcast_to(~grid.missing, planes.shape)
    return float(np.min(planes, where=there, initial=np.inf)), float(np.max(planes, where=there, initial=-np.inf))


def _jumps(planes: Array, missing: Array, axis: int, most: float, power: int) -> Array:
    """Mask of the differences along an axis that depart by ``most`` from the differences around them, over all channels.

    :param power: differences are squared in a unit of 2^power, near the range of the planes, so that no square overflows.
    """
    differences = np.diff(planes, axis=axis)
    whole = ~missing.take(range(1, missing.shape[axis - 1]), axis - 1)
    whole &= ~missing.take(range(missing.shape[axis - 1] - 1), axis - 1)
    beside = [_shifted(differences, whole, axis, by) for by in (-2, -1, 1, 2)]
    departure, limit = np.ldexp(differences - _median(differences, *beside), -power), float(np.ldexp(most, -power))
    return whole & (np.square(departure).sum(axis=0) > limit * limit * len(planes))


def _shifted(differences: Array, whole: Array, axis: int, by: int) -> Array:
    """The differences ``by`` places further along an axis; at the ends the last one is repeated."""
    size = differences.shape[axis]
    at = np.clip(np.arange(size) + by, 0, size - 1)
    return np.where(whole.take(at, axis - 1), differences.take(at, axis), differences)


def _median(a: Array, b: Array, c: Array, d: Array, e: Array) -> Array:
    """The median of five arrays, elementwise."""
    low, high = np.minimum(a, b), np.maximum(a, b)
    low, high = np.maximum(low, np.minimum(c, d)), np.minimum(high, np.maximum(c, d))
    return np.maximum(np.minimum(low, high), np.minimum(np.maximum(low, high), e))
