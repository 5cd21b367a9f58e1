"""Samples that are not of the data: values far outside of all others, and impulses that differ from all their neighbours."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import label

from meshflow.estimate.quantization import steps_of
from meshflow.geometry.validation import Array

__all__ = ["Outliers", "large_pieces", "outliers_of"]

# Median absolute deviation of a Gaussian to its standard deviation.
MAD = 1.4826
# Samples of which quantiles are taken.
ENOUGH = 200_000
# A value lies far outside at so many times the range of the middle 98 % of the others.
FAR = 10.0
# Far values that differ from one another come in pieces of so few samples, and are no more than this share.
PIECE, SHARE = 9, 0.01
# Values by which files mark what is missing: a gap as wide as the others' range is enough for them.
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
HUGE = 1e20
# Fewer levels than these are a drawing, in which nothing lies far outside.
LEVELS = 16
# An impulse differs from the median around it by so many deviations of what is around it; by fewer where impulses are dense, and
# where it has the very value that many of them have.
IMPULSE, IMPULSE_AMONG_MANY, IMPULSE_OF_A_VALUE = 6.0, 4.0, 2.0
# Values are those of impulses where this share of them has each.
OFTEN = 0.1
# Impulses are dense where they are this share of the samples, and this share of them is like none of their neighbours. Of thin
# lines, which are as many, hardly any sample is. Then those count, too, that are like a few of their neighbours.
DENSE, ISOLATED, LIKE = 2e-3, 0.3, 3
# How often impulses are looked for without those that were found, where they are dense.
ROUNDS = 3
# Samples whose neighbourhoods are looked at at a time.
CHUNK = 200_000


@dataclass(frozen=True, eq=False)
class Outliers:
    """Samples that are not of the data.

    :ivar far: (h, w), values far outside of all others: missing samples that are not declared, overflows.
    :ivar impulses: (h, w), samples that differ from all their neighbours: hot pixels, salt and pepper.
    :ivar value: of the samples far outside, where they are all alike; None where they differ.
    :ivar span: least and greatest value of the others.
    :ivar dense: the impulses are so many that they are a fault of the sensor, and nothing that is drawn.
    """

    far: Array
    impulses: Array
    value: float | None
    span: tuple[float, float]
    dense: bool = False

    @property
    def mask(self) -> Array:
        """All of them, (h, w)."""
        return self.far | self.impulses


def outliers_of(values: Array, missing: Array) -> Outliers | None:
    """The samples of a grid that are not of the data; None where there are none.

    A sample is out where one of its channels is. Far outside: further from the median than ten times the range of the middle
    98 %, of one value or in pieces of few samples, and a cliff away from what is beside them. Impulses: six robust deviations
    of the 5 x 5 samples around off their median, and unlike each neighbour (Garnett and others 2005 count likeness so).

    :param values: (h, w) or (h, w, k).
    :param missing: (h, w).
    """
    stack = values.reshape(*missing.shape, -1)
    far, dense, impulses = np.zeros(missing.shape, bool), False, np.zeros(missing.shape, bool)
    for channel in np.moveaxis(stack, 2, 0):
        far |= _far(channel, ~missing)
    there = ~(missing | far)
    if not there.any():
        return None
    for channel in np.moveaxis(stack, 2, 0):
        found, many = _impulses(channel, there)
        impulses, dense = impulses | found, dense or many
    if not (far.any() or impulses.any()):
        return None
    alone = np.unique(stack[far]) if far.any() else np.zeros(0)
    kept = stack[there & ~impulses] if (there & ~impulses).any() else stack[there]
    value = float(alone[0]) if len(alone) == 1 else None
    return Outliers(far, impulses, value, (float(kept.min()), float(kept.max())), dense)


def _far(z: Array, there: Array) -> Array:
    """The samples (h, w) far outside of all others."""
    far = np.zeros(z.shape, bool)
    for _ in range(4):
        found = _marked(z, there & ~far)
        if found is None:
            break
        far |= found
    return far | _strays(z, there & ~far)


def _marked(z: Array, there: Array) -> Array | None:
    """The samples that have the least or the greatest value, where that marks what is missing; None where it does not."""
    known = z[there]
    if known.size < 2:
        return None
    for extreme in (known.min(), known.max()):
        rest = known[known != extreme]
        if len(rest) < 4:
            continue
        low, high = _middle(rest)
        gap = float(np.abs(rest.astype(np.float64) - float(extreme)).min())
        named = float(extreme) in MARKERS or abs(float(extreme)) > HUGE
        enough = (1.0 if named else FAR) * (high - low)
        drawn = high == low or len(np.unique(rest[:ENOUGH])) < LEVELS
        if gap > enough and (not drawn or abs(float(extreme)) > HUGE) and (named or known.size - rest.size > 1):
            return there & (z == extreme)
    return None


def _strays(z: Array, there: Array) -> Array:
    """Samples far outside that differ from one another, in small pieces with a cliff around."""
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
    """The samples (h, w) of a mask that hang together in pieces of more than nine samples."""
    pieces = np.asarray(label(mask, np.ones((3, 3), int))[0], np.int64)  # type: ignore[index]
    large = np.bincount(pieces.ravel()) > PIECE
    large[0] = False
    return np.asarray(large[pieces], bool)


def _middle(values: Array) -> tuple[float, float]:
    """Between which the middle 98 % of values lie, or of at least their number less two."""
    some = np.sort(values[:: max(1, values.size // ENOUGH)].astype(np.float64))
    off = max(1, some.size // 100)
    return float(some[min(off, some.size - 1)]), float(some[max(some.size - 1 - off, 0)])


def _impulses(z: Array, there: Array) -> tuple[Array, bool]:
    """The impulses (h, w) of one channel, and whether they are dense."""
    none = np.zeros(z.shape, bool)
    if min(z.shape) < 5:
        return none, False
    steps = steps_of(z[there])
    least = 0.0 if steps is None else float(np.median(steps.sizes))
    found, alone = _unlike(z, there, least, IMPULSE)
    total, single = int(found.sum()), int(alone.sum())
    dense = total >= max(8.0, DENSE * there.sum()) and single >= ISOLATED * total
    if not dense:
        return alone, False
    values, counts = np.unique(z[found], return_counts=True)
    often = values[counts >= OFTEN * total]
    for _ in range(ROUNDS):
        most = np.where(np.isin(z, often), IMPULSE_OF_A_VALUE, IMPULSE_AMONG_MANY) if often.size else IMPULSE_AMONG_MANY
        more, _ = _unlike(z, there & ~found, least, most)
        if not more.any():
            break
        found |= more
    return found, True


def _unlike(z: Array, there: Array, least: float, most: float | Array) -> tuple[Array, Array]:
    """Samples that are off the median around them and like no more than three neighbours; those that are like none.

    :param least: deviation, the step of quantised data.
    :param most: so many deviations off is what a sample may be, a number or one for each (h, w).
    """
    field = np.pad(np.where(there, z, np.nan).astype(np.float64), 2, constant_values=np.nan)
    usual, places = _suspects(field, there, np.min(most) / 2.0)
    usual = max(usual, least)
    found, alone = np.zeros(z.size, bool), np.zeros(z.size, bool)
    width = field.shape[1]
    ring = np.array([r * width + c for r in range(-2, 3) for c in range(-2, 3) if r or c])
    near = np.array([max(abs(r), abs(c)) == 1 for r in range(-2, 3) for c in range(-2, 3) if r or c])
    flat, limit = field.ravel(), np.broadcast_to(most, z.shape).ravel()
    for part in _parts(places):
        at = (part // z.shape[1] + 2) * width + part % z.shape[1] + 2
        around, own = flat[at[:, None] + ring], flat[at]
        enough = np.isfinite(around[:, near]).sum(axis=1) >= 3
        part, around, own = part[enough], around[enough], own[enough]
        if part.size == 0:
            continue
        median = np.nanmedian(around, axis=1)
        scale = np.maximum(MAD * np.nanmedian(np.abs(around - median[:, None]), axis=1), usual)
        off = np.abs(own - median)
        like = (np.abs(around[:, near] - own[:, None]) < 0.5 * off[:, None]).sum(axis=1)
        out = (off > limit[part] * scale) & (like <= LIKE)
        found[part[out]] = True
        alone[part[out & (like == 0)]] = True
    return found.reshape(z.shape), alone.reshape(z.shape)


def _suspects(field: Array, there: Array, least: float) -> tuple[float, Array]:
    """The usual deviation of a sample from its neighbours, and the places of samples that are off along rows and columns.

    :param field: (h + 4, w + 4), NaN where nothing is.
    :param least: deviations off that are worth a look.
    """
    inner = field[2:-2, 2:-2]
    across = inner - 0.5 * (field[2:-2, 1:-3] + field[2:-2, 3:-1])
    down = inner - 0.5 * (field[1:-3, 2:-2] + field[3:-1, 2:-2])
    np.abs(across, out=across)
    np.abs(down, out=down)
    known = across[np.isfinite(across)]
    usual = MAD / np.sqrt(1.5) * float(np.median(known[:: max(1, known.size // ENOUGH)])) if known.size else 0.0
    off = ~(across <= least * usual) & ~(down <= least * usual) & there
    return usual, np.flatnonzero(off)


def _parts(places: Array) -> Iterator[Array]:
    """Places, so many at a time that their neighbourhoods fit into memory."""
    for start in range(0, places.size, CHUNK):
        yield places[start : start + CHUNK]
