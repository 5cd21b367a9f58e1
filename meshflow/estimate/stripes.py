"""Rows or columns that are shifted against each other: offsets of scan lines, told and taken out."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.sparse import csr_array, diags_array, eye_array
from scipy.sparse.linalg import spsolve

from meshflow.geometry.validation import Array

__all__ = ["Level", "Stripes", "line_offsets", "stripes_of"]

Level = Literal["rows", "columns"]
# Median absolute deviation of a Gaussian to its standard deviation.
MAD = 1.4826
# Fewer lines than these, or samples in a line, say nothing of stripes.
LEAST = 16
# Second differences of offsets that are independent are correlated by -2/3 from line to line; of land, which is smooth, above 0.
OPPOSED = -0.4
# Stripes are told where they are so many times what the lines across show, and what noise makes of a line's median.
STANDING = 2.5
# Offsets are seen where the lines bend by so many times the square of what the lines across, or noise, do.
SEEN = 1.5
# How often the weights of a fit are made anew.
FITS = 12
# The land is at least as rough as this share of the offsets.
SLIGHT = 0.02
# Samples of a line that are looked at, and lines.
ENOUGH, LINES = 512, 2048


@dataclass(frozen=True)
class Stripes:
    """Offsets of lines that are seen in the data.

    :ivar along: ``rows`` or ``columns``, which are shifted as wholes.
    :ivar size: standard deviation of the offsets, unit of the values.
    """

    along: Level
    size: float


def stripes_of(values: Array, missing: Array) -> Stripes | None:
    """Whether rows or columns are shifted against each other; None where they are not.

    The median of each line's second differences across the lines: offsets that are independent make it large, of opposed signs
    from line to line. Told only where it stands out of the same across, and of what noise leaves of it.

    :param values: (h, w) or (h, w, k), of which the mean of the channels is looked at.
    :param missing: (h, w).
    """
    flat = _flat(values, missing)
    found = {along: _bends((flat if along == "rows" else flat.T)[:LINES]) for along in ("rows", "columns")}
    for along, other in (("rows", "columns"), ("columns", "rows")):
        bends, noise = found[along]
        across, _ = found[other]
        if bends.size < LEAST or across.size < LEAST:
            continue
        size = MAD * float(np.median(np.abs(bends)))
        usual = max(MAD * float(np.median(np.abs(across))), noise)
        clipped = np.clip(bends, -4.0 * size, 4.0 * size)
        power = float(np.mean(clipped**2))
        if power > 0 and size > STANDING * usual and float(np.mean(clipped[1:] * clipped[:-1])) < OPPOSED * power:
            return Stripes("rows" if along == "rows" else "columns", size / float(np.sqrt(6.0)))
    return None


def line_offsets(values: Array, missing: Array, along: Level) -> Array:
    """The offset of each line, (h, 1) or (1, w), for images (h, 1, k) or (1, w, k), of mean zero.

    The second differences of neighbouring lines are those of the offsets and of the land. They are told apart by how rough the
    land is the other way, where there are no offsets: what varies slowly from line to line stays, land as well as offsets.

    :param values: (h, w) or (h, w, k).
    :param missing: (h, w).
    """
    stack = values.reshape(*missing.shape, -1)
    made = []
    for channel in np.moveaxis(stack, 2, 0):
        flat = _flat(channel, missing)
        flat, other = (flat, flat.T) if along == "rows" else (flat.T, flat)
        made.append(_split(flat, other))
    offsets = np.stack(made, axis=-1)  # (lines, k)
    shaped = offsets[:, None, :] if along == "rows" else offsets[None, :, :]
    return shaped[..., 0] if values.ndim == 2 else shaped


def _flat(values: Array, missing: Array) -> Array:
    """The mean of the channels in double precision, NaN where missing."""
    flat = values.astype(np.float64)
    flat = flat if flat.ndim == 2 else flat.mean(axis=2)
    return np.where(missing, np.nan, flat)


def _bends(lines: Array, whole: bool = False) -> tuple[Array, float]:
    """The median second difference of each line but the outer ones, and the deviation of such a number where only noise is.

    :param whole: the mean of what lies within three deviations of the median instead, which is less noisy, for every line: NaN
        of those that are too short, which are left out else.
    """
    lines = lines[:, :: max(1, lines.shape[1] // ENOUGH)]
    if len(lines) < 3:
        return np.zeros(0), 0.0
    bends = lines[:-2] - 2.0 * lines[1:-1] + lines[2:]
    there = np.isfinite(bends).sum(axis=1)
    long = there >= LEAST
    if not long.any():
        return np.zeros(0), 0.0
    kept = bends[long]
    off = kept - np.nanmedian(kept, axis=1)[:, None]
    spread = MAD * float(np.nanmedian(np.abs(off)))
    middle = np.full(len(bends), np.nan)
    if not whole:
        return np.nanmedian(kept, axis=1), 1.2533 * spread / float(np.sqrt(np.median(there[long])))
    near = np.maximum(3.0 * spread, np.nanmin(np.abs(off), axis=1, keepdims=True))
    middle[long] = np.nanmean(np.where(np.abs(off) <= near, kept, np.nan), axis=1)
    return middle, spread / float(np.sqrt(np.median(there[long])))


def _split(lines: Array, others: Array) -> Array:
    """The offset of each line; none where the lines say nothing.

    The bends of the lines are second differences of offsets, and those of the land, of which a few are large where an edge runs
    along the lines: least squares, weighted anew as the land's bends follow from the fit (Cauchy's weights).

    :param others: the same samples, taken as lines the other way.
    """
    count = len(lines)
    bends, noise = _bends(lines, whole=True)
    across, blur = _bends(others, whole=True)
    if len(bends) < LEAST or not np.isfinite(bends).any() or across.size == 0:
        return np.zeros(count)
    size = MAD * float(np.nanmedian(np.abs(bends)))
    usual = (MAD * float(np.nanmedian(np.abs(across)))) ** 2
    spread = (size**2 - max(usual, noise**2)) / 6.0
    if size**2 <= SEEN * max(usual, noise**2):
        return np.zeros(count)
    # What noise makes of a line counts as its offset: it leaves with it.
    land = max(float(np.sqrt(max(usual - blur**2, 0.0))), SLIGHT * size)
    there = np.isfinite(bends)
    rows = np.arange(count - 2).repeat(3)
    columns = rows + np.tile([0, 1, 2], count - 2)
    bend = csr_array((np.tile([1.0, -2.0, 1.0], count - 2), (rows, columns)), shape=(count - 2, count))[there]
    seen, offsets = bends[there], np.zeros(count)
    weights = 1.0 / np.maximum(land**2, seen**2 / 6.0) if len(seen) else seen
    for _ in range(FITS):
        weighted = bend.T @ diags_array(weights)
        offsets = spsolve((eye_array(count) / spread + weighted @ bend).tocsc(), weighted @ seen)
        weights = 1.0 / (land**2 + (seen - bend @ offsets) ** 2)
    return offsets - offsets.mean()
