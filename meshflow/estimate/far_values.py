"""Values far from all others: undeclared marks of missing samples, overflows, strays."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import label

from meshflow.geometry.validation import Array

__all__ = ["PIECE", "FarRule", "far_by", "far_of", "large_pieces"]

# Samples used for quantiles.
ENOUGH = 200_000
# A value is far outside at this multiple of the range of the middle 98 % of the others.
FAR = 10.0
# Far values that differ from each other form pieces of at most this many samples, and are at most this share.
PIECE, SHARE = 9, 0.01
# Values that files use for missing samples; for them a gap as wide as the range of the others suffices.
MARKERS = (
    -9999.0,
    -32768.0,
    -32767.0,
    -99999.0,
    -999.0,
    9999.0,
    99999.0,
    32767.0,
    65535.0,
    -2147483648.0,
    2147483647.0,
)
# So do values above the first number, and this many times as large as the others.
HUGE, BEYOND = 1e20, 1e6
# Data with fewer levels is a drawing, in which no value is far outside.
LEVELS = 16


@dataclass(frozen=True)
class FarRule:
    """What is far outside in a channel. Found on the whole, it tells of any part which samples are.

    :ivar marks: values that mark missing samples.
    :ivar middle: of the others; strays lie farther than ``width`` from it. A width of 0: there are none.
    """

    marks: tuple[float, ...] = ()
    middle: float = 0.0
    width: float = 0.0

    @property
    def reach(self) -> int:
        """How far away a sample decides whether another one is far outside: as far as small pieces and their rims."""
        return PIECE + 1 if self.width > 0 else 0


def far_of(z: Array, there: Array) -> tuple[FarRule, Array]:
    """The rule of a channel (h, w), and its far samples (h, w)."""
    far, marks = np.zeros(z.shape, bool), []
    for _ in range(4):
        extreme = _mark(z[there & ~far])
        if extreme is None:
            break
        marks.append(extreme)
        far |= there & (z == extreme)
    rule, known = FarRule(tuple(marks)), z[there & ~far]
    if known.size < LEVELS:
        return rule, far
    low, high = _middle(known)
    strayed = replace(rule, middle=0.5 * (low + high), width=FAR * (high - low))
    out = _small_pieces(strayed, z, there & ~far)
    if out.sum() > max(1.0, SHARE * known.size):
        return rule, far
    return strayed, far | _cliffs(strayed, z, there & ~far, out)


def far_by(rule: FarRule, z: Array, there: Array) -> Array:
    """The far samples (h, w) of a part of a channel by the rule of the whole."""
    far = there & np.isin(z, np.array(rule.marks, z.dtype))
    return far | _cliffs(rule, z, there & ~far, _small_pieces(rule, z, there & ~far))


def _mark(known: Array) -> float | None:
    """The least or the largest of values (n,), if it marks missing samples; else None."""
    if known.size < 2:
        return None
    for nearest in (np.min, np.max):
        extreme = nearest(known)
        if _marks(extreme, known[known != extreme], known.size, nearest):
            return float(extreme)
    return None


def _marks(extreme: np.floating, rest: Array, count: int, nearest: Callable[[Array], np.floating]) -> bool:
    """Whether an extreme value marks missing samples.

    :param rest: the other values (n,).
    :param count: the number of all values.
    :param nearest: takes the nearest one of the others, the least or the largest.
    """
    if len(rest) < 4:
        return False
    low, high = _middle(rest)
    gap = abs(float(nearest(rest)) - float(extreme))
    huge = abs(float(extreme)) > max(HUGE, BEYOND * max(abs(low), abs(high)))
    named = float(extreme) in MARKERS or huge
    if gap <= (1.0 if named else FAR) * (high - low):
        return False
    drawn = high == low or len(np.unique(rest[:ENOUGH])) < LEVELS
    return (not drawn or huge) and (named or count - len(rest) > 1)


def _small_pieces(rule: FarRule, z: Array, there: Array) -> Array:
    """The samples (h, w) of small pieces that lie far from the middle."""
    if rule.width == 0:
        return np.zeros(z.shape, bool)
    near = rule.width * (1.0 - 1e-9)  # most parts have none, which is seen in less memory
    some = there & ((z > np.float64(rule.middle + near)) | (z < np.float64(rule.middle - near)))
    if not some.any():
        return some
    out = _away(rule, z, there) > rule.width
    return out & ~large_pieces(out)


def _cliffs(rule: FarRule, z: Array, there: Array, out: Array) -> Array:
    """Those samples (h, w) of small pieces around which others are much nearer to the middle."""
    if not out.any():
        return out
    away = _away(rule, z, there)
    rim = np.pad(np.where(out | ~there, 0.0, away), 1)
    h, w = z.shape
    around = np.max([rim[r : r + h, c : c + w] for r in range(3) for c in range(3)], axis=0)
    return out & (around < 0.5 * away)


def _away(rule: FarRule, z: Array, there: Array) -> Array:
    """The distances (h, w) from the middle; 0 where a sample is not there."""
    return np.where(there, np.abs(z.astype(np.float64) - rule.middle), 0.0)


def large_pieces(mask: Array) -> Array:
    """The samples (h, w) of a mask in components of more than nine samples."""
    pieces = np.asarray(label(mask, np.ones((3, 3), int))[0], np.int64)  # type: ignore[index]
    large = np.bincount(pieces.ravel()) > PIECE
    large[0] = False
    return np.asarray(large[pieces], bool)


def _middle(values: Array) -> tuple[float, float]:
    """The range of the middle 98 % of values, or of at least all but two."""
    some = values[:: max(1, values.size // ENOUGH)]
    off = max(1, some.size // 100)
    low, high = min(off, some.size - 1), max(some.size - 1 - off, 0)
    some = np.partition(some, (low, high))
    return float(some[low]), float(some[high])
