"""Offsets of scan lines: detects and removes shifts of rows or columns against each other."""

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
# The least number of lines, and of samples in a line.
LEAST = 16
# Second differences of independent offsets have a correlation of -2/3 from line to line; those of a smooth surface, above 0.
OPPOSED = -0.4
# Stripes are reported if they are this many times those of the lines across, and those that noise causes in the median of a line.
STANDING = 2.5
# Offsets are visible if the squared bends of the lines are this many times those of the lines across, and of noise.
SEEN = 1.5
# The number of updates of the weights of a fit.
FITS = 12
# The surface is at least as rough as this share of the offsets.
SLIGHT = 0.02
# The numbers of samples per line, and of lines, that are used.
ENOUGH, LINES = 512, 2048


@dataclass(frozen=True)
class Stripes:
    """Detected offsets of lines.

    :ivar along: ``rows`` or ``columns``, which have offsets.
    :ivar size: standard deviation of the offsets, unit of the values.
    """

    along: Level
    size: float


def stripes_of(values: Array, missing: Array) -> Stripes | None:
    """Whether rows or columns are shifted against each other; None where they are not.

    It uses the median of each line's second differences across the lines, which independent offsets make large and alternating in
    sign. Offsets are reported only if it exceeds that of the lines across, and that of noise.

    :param values: (h, w) or (h, w, k), of which the mean of the channels is used.
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

    The second differences of neighbouring lines are those of the offsets and of the surface. They are separated by the
    roughness of the surface in the other direction, which has no offsets. Slow variation from line to line, of surface or
    offsets, is kept.

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
    """The median second difference of each line except the outer ones, and its deviation for pure noise.

    :param whole: instead of the median the mean of values within three deviations of it, which is less noisy, for every line;
        NaN for lines that are too short, which are left out otherwise.
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
    """The offset of each line; zero where it cannot be determined.

    The bends of the lines are second differences of the offsets plus those of the surface, a few of which are large where an
    edge runs along the lines. The fit is by iteratively reweighted least squares (Cauchy weights).

    :param others: the same samples as lines in the other direction.
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
    # The mean noise of a line counts as part of its offset and is removed with it.
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
