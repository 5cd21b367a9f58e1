"""Finds outliers: values far from all others, and impulses that differ from all their neighbours."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import label, uniform_filter

from meshflow.estimate.impulse_values import impulse_values
from meshflow.estimate.noise_growth import MAD
from meshflow.estimate.quantization import steps_of
from meshflow.estimate.ring_fill import neighbours_of
from meshflow.geometry.validation import Array

__all__ = ["Outliers", "large_pieces", "outliers_of"]

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
# An impulse differs from the median around it by this many deviations of its neighbourhood; by fewer where impulses are dense,
# and where it has the same value as many of them.
IMPULSE, IMPULSE_AMONG_MANY, IMPULSE_OF_A_VALUE = 6.0, 4.0, 2.0
# A value is one of impulses if this share of them has it.
OFTEN = 0.1
# Impulses are dense if they are this share of the samples, and this share of them is unlike all neighbours, which hardly any
# sample of thin lines is. Then samples that are like a few of their neighbours are also impulses.
DENSE, ISOLATED, LIKE = 2e-3, 0.3, 3
# Impulses that have one of two values differ by this many deviations of the others around them in the median; not more of the
# samples around one have its value than are likely by so many standard deviations.
CLEAR, LIKELY = 3.0, 3.0
# More than this share of all samples, as where each channel has impulses of its own, cannot be replaced from the few others.
FILLED = 0.55
# The number of repetitions without the impulses found so far, where they are dense.
ROUNDS = 3
# Samples that are processed at a time.
CHUNK = 200_000
# The neighbourhood of a sample reaches so far along rows and columns; the eight nearest in the order of its samples.
REACH = 2
NEAR = np.array(
    [max(abs(r), abs(c)) == 1 for r in range(-REACH, REACH + 1) for c in range(-REACH, REACH + 1) if r or c]
)


@dataclass(frozen=True, eq=False)
class Outliers:
    """Outliers of a grid.

    :ivar far: (h, w), values far from all others: undeclared missing samples, overflows.
    :ivar impulses: (h, w), samples that differ from all their neighbours: hot pixels, salt and pepper.
    :ivar value: of the far samples, if they are all equal; else None.
    :ivar span: least and largest value of the others.
    :ivar dense: whether the impulses are so many that they come from the sensor, and not from the scene.
    """

    far: Array
    impulses: Array
    value: float | None
    span: tuple[float, float]
    dense: bool = False

    @property
    def mask(self) -> Array:
        """All outliers (h, w)."""
        return self.far | self.impulses


def outliers_of(values: Array, missing: Array, level: Array | None = None) -> Outliers | None:
    """The outliers of a grid; None where there are none.

    A sample is an outlier if one of its channels is. Far values are farther from the median than ten times the range of the
    middle 98 %, have one value or form pieces of few samples, and are separated from their neighbours by a cliff. Impulses
    differ from the median of the 5 x 5 samples around them by six robust deviations, and from each neighbour (as in Garnett and
    others 2005).

    :param values: (h, w) or (h, w, k).
    :param missing: (h, w).
    :param level: (h, w), exactly level regions, beside which noise is no impulse; None: there are none.
    """
    stack = values.reshape(*missing.shape, -1)
    far, dense, impulses = np.zeros(missing.shape, bool), False, np.zeros(missing.shape, bool)
    for channel in np.moveaxis(stack, 2, 0):
        far |= _far(channel, ~missing)
    there = ~(missing | far) if level is None else ~(missing | far | level)
    if not there.any():
        return None
    for by_value in (True, False):
        impulses, dense = np.zeros(missing.shape, bool), False
        for channel in np.moveaxis(stack, 2, 0):
            found, many = _impulses(channel, there, by_value)
            impulses, dense = impulses | found, dense or many
        if impulses.sum() <= FILLED * there.sum():
            break
    if not (far.any() or impulses.any()):
        return None
    alone = np.unique(stack[far]) if far.any() else np.zeros(0)
    kept = stack[there & ~impulses] if (there & ~impulses).any() else stack[there]
    value = float(alone[0]) if len(alone) == 1 else None
    return Outliers(far, impulses, value, (float(kept.min()), float(kept.max())), dense)


def _far(z: Array, there: Array) -> Array:
    """The samples (h, w) far from all others."""
    far = np.zeros(z.shape, bool)
    for _ in range(4):
        found = _marked(z, there & ~far)
        if found is None:
            break
        far |= found
    return far | _strays(z, there & ~far)


def _marked(z: Array, there: Array) -> Array | None:
    """The samples with the least or the largest value, if that marks missing samples; else None."""
    known = z[there]
    if known.size < 2:
        return None
    for nearest in (np.min, np.max):
        extreme = nearest(known)
        if _marks(extreme, known[known != extreme], known.size, nearest):
            return there & (z == extreme)
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
    enough = (1.0 if named else FAR) * (high - low)
    drawn = high == low or len(np.unique(rest[:ENOUGH])) < LEVELS
    return gap > enough and (not drawn or huge) and (named or count - len(rest) > 1)


def _strays(z: Array, there: Array) -> Array:
    """Far samples that differ from each other, in small pieces with a cliff around."""
    out = np.zeros(z.shape, bool)
    known = z[there]
    if known.size < LEVELS:
        return out
    low, high = _middle(known)
    middle, width = 0.5 * (low + high), FAR * (high - low)
    if width == 0 or (known.max() <= middle + width and known.min() >= middle - width):
        return out
    away = np.where(there, np.abs(z.astype(np.float64) - middle), 0.0)
    out = away > width
    out = out & ~large_pieces(out)
    if out.sum() > max(1.0, SHARE * known.size):
        return np.zeros(z.shape, bool)
    rim = np.pad(np.where(out | ~there, 0.0, away), 1)
    h, w = z.shape
    around = np.max([rim[r : r + h, c : c + w] for r in range(3) for c in range(3)], axis=0)
    return out & (around < 0.5 * away)


def large_pieces(mask: Array) -> Array:
    """The samples (h, w) of a mask in components of more than nine samples."""
    pieces = np.asarray(label(mask, np.ones((3, 3), int))[0], np.int64)  # type: ignore[index]
    large = np.bincount(pieces.ravel()) > PIECE
    large[0] = False
    return np.asarray(large[pieces], bool)


def _middle(values: Array) -> tuple[float, float]:
    """The range of the middle 98 % of values, or of at least all but two."""
    some = np.sort(values[:: max(1, values.size // ENOUGH)].astype(np.float64))
    off = max(1, some.size // 100)
    return float(some[min(off, some.size - 1)]), float(some[max(some.size - 1 - off, 0)])


def _impulses(z: Array, there: Array, by_value: bool) -> tuple[Array, bool]:
    """The impulses (h, w) of one channel, and whether they are dense.

    :param by_value: whether to look for impulses of the least and the greatest value first.
    """
    none = np.zeros(z.shape, bool)
    if min(z.shape) < 5:
        return none, False
    steps = steps_of(z[there])
    least = 0.0 if steps is None else float(np.median(steps.sizes))
    # The largest of n Gaussian samples is near sqrt(2 log n) deviations; it is no impulse.
    most = max(IMPULSE, float(np.sqrt(2.0 * np.log(max(1, there.sum())))) + 1.0)
    found, often = _of_two_values(z, there, least) if by_value else (none, z[:0, 0])
    others = most  # where impulses have two values, others are none more easily than usual
    if not often.size:
        found, alone = _unlike(z, there, least, most)
        total, single = int(found.sum()), int(alone.sum())
        dense = total >= max(8.0, DENSE * there.sum()) and single >= ISOLATED * total
        if not dense:
            return alone, False
        values, counts = np.unique(z[found], return_counts=True)
        often, others = values[counts >= OFTEN * total], IMPULSE_AMONG_MANY
    for _ in range(ROUNDS):
        most = np.where(np.isin(z, often), IMPULSE_OF_A_VALUE, others) if often.size else others
        more, _ = _unlike(z, there & ~found, least, most)
        if not more.any():
            break
        found |= more
    return found, True


def _of_two_values(z: Array, there: Array, least: float) -> tuple[Array, Array]:
    """The impulses (h, w) that have the least or the greatest value, and these values (n,); none where they are not impulses.

    They may be as many as the other samples, which alone say what is usual.

    :param least: the least deviation, the step of quantized data.
    """
    found, values = np.zeros(z.shape, bool), np.zeros(0, z.dtype)
    salted = impulse_values(z, there)
    known = there & ~np.isin(z, [value for value, _ in salted])
    usual = max(_usual(z, known), least) if salted else 0.0
    for value, share in salted:
        at = there & (z == value)
        around = (2 * REACH + 1) ** 2 * uniform_filter(at.astype(np.float64), 2 * REACH + 1, mode="constant") - 1.0
        count = (2 * REACH + 1) ** 2 - 1
        places = np.argwhere(at & (around <= count * share + LIKELY * np.sqrt(count * share * (1.0 - share)) + 0.5))
        off = np.concatenate([np.zeros(0), *(_off(z, known, usual, part) for part in _portions(places))])
        if off.size and np.nanmedian(off) > CLEAR:
            out = places[off > IMPULSE_OF_A_VALUE]
            found[out[:, 0], out[:, 1]] = True
            values = np.append(values, z.dtype.type(value))
    return found, values


def _portions(places: Array) -> list[Array]:
    """Places (m, 2) in portions that are processed at a time."""
    return [places[start : start + CHUNK] for start in range(0, len(places), CHUNK)]


def _off(z: Array, known: Array, usual: float, places: Array) -> Array:
    """How many deviations samples (m, 2) differ from the median of the known ones around them; NaN for fewer than three.

    :param usual: the least deviation.
    """
    rows, columns, inside = neighbours_of(places, z.shape, REACH)
    around = np.where(inside & known[rows, columns], z[rows, columns].astype(np.float64), np.nan)
    off = np.full(len(places), np.nan)
    enough = np.isfinite(around).sum(axis=1) >= 3
    around, own = around[enough], z[places[enough, 0], places[enough, 1]].astype(np.float64)
    if own.size:
        median = np.nanmedian(around, axis=1)
        scale = np.maximum(MAD * np.nanmedian(np.abs(around - median[:, None]), axis=1), usual)
        # Among equal samples each difference is infinitely many deviations.
        off[enough] = np.divide(np.abs(own - median), scale, out=np.where(own == median, 0.0, np.inf), where=scale > 0)
    return off


def _unlike(z: Array, there: Array, least: float, most: float | Array) -> tuple[Array, Array]:
    """Samples that differ from the median around them and are like at most three neighbours; and those that are like none.

    :param least: the least deviation, the step of quantized data.
    :param most: the largest allowed difference in deviations, a number or (h, w).
    """
    usual, places = _suspects(z, there, float(np.min(most)) / 2.0)
    usual = max(usual, least)
    found, alone, limit = np.zeros(z.shape, bool), np.zeros(z.shape, bool), np.broadcast_to(most, z.shape)
    for start in range(0, len(places), CHUNK):
        part = places[start : start + CHUNK]
        rows, columns, inside = neighbours_of(part, z.shape, REACH)
        around = np.where(inside & there[rows, columns], z[rows, columns].astype(np.float64), np.nan)
        enough = np.isfinite(around[:, NEAR]).sum(axis=1) >= 3
        (row, column), around = part[enough].T, around[enough]
        if row.size == 0:
            continue
        own, median = z[row, column].astype(np.float64), np.nanmedian(around, axis=1)
        scale = np.maximum(MAD * np.nanmedian(np.abs(around - median[:, None]), axis=1), usual)
        off = np.abs(own - median)
        like = (np.abs(around[:, NEAR] - own[:, None]) < 0.5 * off[:, None]).sum(axis=1)
        out = (off > limit[row, column] * scale) & (like <= LIKE)
        found[row[out], column[out]] = True
        alone[row, column] = out & (like == 0)
    return found, alone


def _suspects(z: Array, there: Array, least: float) -> tuple[float, Array]:
    """The usual deviation of a sample from its neighbours, and the places (m, 2) that differ along rows and columns.

    :param least: the least difference in deviations.
    """
    usual, places = _usual(z, there), [np.zeros((0, 2), np.int64)]
    for top, bottom in _bands(z.shape):
        across, down = _departures(z, there, top, bottom)
        off = ~(across <= least * usual) & ~(down <= least * usual) & there[top:bottom]
        places.append(np.argwhere(off) + (top, 0))
    return usual, np.concatenate(places)


def _usual(z: Array, there: Array) -> float:
    """The usual deviation of a sample from its neighbours; 0 where no sample is known with both of them."""
    count = int((there[:, :-2] & there[:, 1:-1] & there[:, 2:]).sum())
    stride, seen, some = max(1, count // ENOUGH), 0, [np.zeros(0)]
    for band in _bands(z.shape):
        known = _departures(z, there, *band)[0]
        known = known[np.isfinite(known)]
        some.append(known[-seen % stride :: stride].copy())  # a view would keep the whole band
        seen += known.size
    return MAD / np.sqrt(1.5) * float(np.median(np.concatenate(some))) if count else 0.0


def _bands(shape: tuple[int, ...]) -> list[tuple[int, int]]:
    """Bands of rows, first and after the last: a large grid needs no more memory than a band."""
    height = max(1, CHUNK // shape[1])
    return [(top, min(top + height, shape[0])) for top in range(0, shape[0], height)]


def _departures(z: Array, there: Array, top: int, bottom: int) -> tuple[Array, Array]:
    """How far samples are from the mean of their two neighbours in the row, and in the column; NaN where one is unknown.

    :param top: the first row; ``bottom``: the row after the last.
    """
    low, high = max(top - 1, 0), min(bottom + 1, len(z))
    field = np.full((bottom - top + 2, z.shape[1] + 2), np.nan)
    field[low - top + 1 : high - top + 1, 1:-1] = np.where(there[low:high], z[low:high], np.nan)
    inner = field[1:-1, 1:-1]
    across = np.abs(inner - 0.5 * (field[1:-1, :-2] + field[1:-1, 2:]))
    down = np.abs(inner - 0.5 * (field[:-2, 1:-1] + field[2:, 1:-1]))
    return across, down
