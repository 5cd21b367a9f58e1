"""Offsets of scan lines: the shifts of rows or columns against each other that levelling removes."""

from typing import Literal

import numpy as np
from scipy.sparse import csr_array, diags_array, eye_array
from scipy.sparse.linalg import spsolve

from meshflow.estimate.noise_growth import MAD
from meshflow.geometry.validation import Array

__all__ = ["Level", "offsets_to_level"]

Level = Literal["rows", "columns"]
# The least number of lines, and of samples in a line.
LEAST = 16
# Offsets are visible if the squared bends of the lines are this many times those of the lines across, and of noise.
SEEN = 1.5
# The number of updates of the weights of a fit.
FITS = 12
# The surface is at least as rough as this share of the offsets.
SLIGHT = 0.02
# The number of samples per line that are used.
ENOUGH = 512


def offsets_to_level(values: Array, missing: Array, along: Level) -> Array:
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
        flat = np.where(missing, np.nan, channel.astype(np.float64))
        lines, others = (flat, flat.T) if along == "rows" else (flat.T, flat)
        made.append(_split(lines, others))
    offsets = np.stack(made, axis=-1)  # (lines, k)
    shaped = offsets[:, None, :] if along == "rows" else offsets[None, :, :]
    return shaped[..., 0] if values.ndim == 2 else shaped


def _bends(lines: Array) -> tuple[Array, float]:
    """The second difference of each line except the outer ones, NaN for lines that are too short; its deviation for noise.

    It is the mean of the values within three deviations of their median.
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
    bends, noise = _bends(lines)
    across, blur = _bends(others)
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
