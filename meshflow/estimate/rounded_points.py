"""Coordinates of points that were rounded to multiples of a quantum, as those of files with few decimals or of integers are."""

import numpy as np

from meshflow.geometry.validation import Array

__all__ = ["quanta_of"]

# The least number of levels of a coordinate: those of a designed model are few, and are no rounding.
LEVELS = 16
# The share of the smallest differences of levels, in whose median the quantum is: levels that are next to each other.
NEXT = 0.05
# How far levels may be from multiples, in quanta, beside the precision of the numbers; and the share of the levels that are not.
OFF, SHARE = 0.02, 0.995
# The largest error of the numbers, in quanta.
PRECISE = 0.1


def quanta_of(points: Array) -> Array | None:
    """The quantum (3,) of each coordinate of points (n, 3); None if one of them was not rounded.

    A coordinate of few levels is taken to have the least quantum of the others.
    """
    found = [_quantum(column) for column in points.T]
    known = [quantum for quantum in found if quantum is not None]
    if not known or min(known) == 0:
        return None
    return np.array([min(known) if quantum is None else quantum for quantum in found])


def _quantum(values: Array) -> float | None:
    """The quantum of which values (n,) are multiples, up to a common shift; 0 without one, None for few levels."""
    levels = np.unique(values.astype(np.float64))
    if len(levels) < LEVELS:
        return None
    with np.errstate(over="ignore"):  # what is too large for single precision is not stored in it
        single = values.dtype == np.float32 or bool((levels == levels.astype(np.float32)).all())
    error = float(np.abs(levels).max()) * float(np.finfo(np.float32 if single else np.float64).eps)
    levels = levels[np.concatenate([[True], np.diff(levels) > 4.0 * error])]
    gaps = np.diff(levels)
    if len(gaps) < LEVELS:
        return None
    least = np.sort(gaps)[: max(3, int(NEXT * len(gaps)))]
    # the multiples of small gaps are sure, whatever the error of the quantum
    quantum = float((levels[-1] - levels[0]) / np.rint(gaps / np.median(least)).sum())
    if error > PRECISE * quantum:
        return 0.0
    multiples = (levels - levels[0]) / quantum
    off = np.abs(multiples - np.rint(multiples))
    off = np.minimum(off, np.abs(off - np.median(off)))
    return quantum if np.mean(off <= OFF + 2.0 * error / quantum) >= SHARE else 0.0
