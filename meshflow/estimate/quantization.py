"""The steps of quantised data, which may grow with the value: of depths from a disparity, with its square."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import minimum_filter

from meshflow.geometry.validation import Array

__all__ = ["Steps", "steps_of"]

# Levels of which the least step is taken: where samples are few not every level occurs, and what is left has gaps of several.
AROUND = 15
# A set of values is quantised if it has so many times fewer levels.
FEWER = 20
# Samples looked at.
ENOUGH = 60_000


@dataclass(frozen=True, eq=False)
class Steps:
    """The distance of neighbouring levels, unit of the values.

    :ivar levels: growing.
    :ivar sizes: the step at each.
    """

    levels: Array
    sizes: Array

    def at(self, values: Array) -> Array:
        """The step at values, in double precision; beyond the levels, as at their ends; 1 where a value is NaN."""
        known = np.where(np.isnan(values), self.levels[0], values)
        return np.interp(known, self.levels, self.sizes)


def steps_of(values: Array) -> Steps | None:
    """The steps of values (n,); None where they are not quantised."""
    some = values[:: max(1, values.size // ENOUGH)].astype(np.float64)
    levels = np.unique(some)
    if len(levels) < 2:
        return None
    if len(levels) < AROUND or len(levels) * FEWER > some.size:
        return _even(levels, 32.0 * float(np.finfo(values.dtype).eps) * float(np.abs(levels).max()))
    gaps = np.diff(levels)
    least = np.minimum(np.concatenate([gaps[:1], gaps]), np.concatenate([gaps, gaps[-1:]]))
    return Steps(levels, minimum_filter(least, AROUND, mode="nearest"))


def _even(levels: Array, rounding: float) -> Steps | None:
    """One step everywhere, where all levels are multiples of it."""
    gaps = np.diff(levels)
    step = float(gaps.min())
    counts = gaps / step
    if step <= rounding or np.abs(counts - np.rint(counts)).max() > 0.05:
        return None
    return Steps(levels[[0, -1]], np.array([step, step]))
