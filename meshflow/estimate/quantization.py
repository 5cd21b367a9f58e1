"""The steps of quantized data, which may grow with the value; for depths from disparities, with its square."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import minimum_filter

from meshflow.geometry.validation import Array

__all__ = ["Steps", "quantum_of", "steps_of", "terraced"]

# The number of adjacent levels whose least step is used, because not every level occurs where samples are few.
AROUND = 15
# Values are quantized if they have fewer levels than samples by this factor.
FEWER = 20
# The largest numbers of samples, for variable steps and for a constant one.
ENOUGH, MANY = 60_000, 200_000
# Values that are tested first: if most of them differ, the data is not quantized, and no more need to be sorted.
GLANCE = 20_000
# Data is not rounded where this share of its steps repeats the one before.
ALIKE = 0.97


@dataclass(frozen=True, eq=False)
class Steps:
    """The distance of neighbouring levels, unit of the values.

    :ivar levels: increasing.
    :ivar sizes: the step at each level.
    """

    levels: Array
    sizes: Array

    def at(self, values: Array) -> Array:
        """The step at values, in double precision; outside the levels that at their ends; 1 for NaN."""
        known = np.where(np.isnan(values), self.levels[0], values)
        return np.interp(known, self.levels, self.sizes)


def steps_of(values: Array) -> Steps | None:
    """The steps of values (n,); None if they are not quantized."""
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
    """A constant step, if all levels are multiples of it."""
    gaps = np.diff(levels)
    step = float(gaps.min())
    counts = gaps / step
    if step <= rounding or np.abs(counts - np.rint(counts)).max() > 0.05:
        return None
    return Steps(levels[[0, -1]], np.array([step, step]))


def quantum_of(values: Array) -> tuple[float, float]:
    """The step of which the values are multiples, up to rounding, and the share of those that are; 0 without one."""
    glance = values[:: max(1, values.size // GLANCE)]
    if glance.size >= GLANCE and len(np.unique(glance)) > glance.size / 4:
        return 0.0, 0.0
    some = values[:: max(1, values.size // MANY)].astype(np.float64)
    levels, counts = np.unique(some, return_counts=True)
    if len(levels) < 2 or len(levels) > some.size / 4:
        return 0.0, 0.0
    for step in _steps(levels):
        multiples = (levels - levels[np.argmax(counts)]) / step
        slack = 1e-3 + np.finfo(values.dtype).eps * np.abs(levels) / step
        on = float(counts[np.abs(multiples - np.rint(multiples)) < slack].sum() / some.size)
        if on > 0.99:
            return step, on
    return 0.0, 0.0


def _steps(levels: Array) -> Iterator[float]:
    """Candidates for the quantum: the least difference of levels, and the most frequent one if a few samples lie between."""
    differences = np.diff(levels)
    yield float(differences.min())
    yield float(np.median(differences))


def terraced(parts: list[tuple[Array, Array]], quantum: float) -> bool:
    """Whether differences of neighbours are mostly one quantum: smooth data was rounded, and is not made of blocks.

    Data whose steps are all alike, as those of a plane of whole numbers, was not rounded.
    """
    steps, single, before, alike, levels = 0, 0, 0, 0, set()
    for z, there in parts:
        for axis in (0, 1):
            whole, heights = np.moveaxis(there, axis, 0), np.moveaxis(np.where(there, z, 0.0), axis, 0)
            both, change = whole[1:] & whole[:-1], np.diff(heights, axis=0) / quantum
            size = np.abs(change[both])
            steps += int((size > 0.5).sum())
            single += int(((size > 0.5) & (size < 1.5)).sum())
            pairs = both[1:] & both[:-1] & (np.abs(change[1:]) > 0.5)
            before += int(pairs.sum())
            alike += int((pairs & (np.abs(change[1:] - change[:-1]) < 0.5)).sum())
        levels.update(np.unique(z[there])[:3].tolist())
    return len(levels) > 2 and 2 * single > steps and alike < ALIKE * before
