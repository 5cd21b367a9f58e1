"""The error of pictures that were compressed by JPEG, from the steps of their cosine transform.

A decoded picture has coefficients, in blocks of 8 x 8, that are multiples of the steps of a table, which is known but for the
quality (Annex K of ISO 10918-1, with the scaling of the Independent JPEG Group). The quality is the one at which they are; at
others, and in pictures that were never compressed, they lie anywhere between (Fan and de Queiroz 2003). The error of a
coefficient follows from its step, and from how the true ones are distributed: as by Laplace, so that the share of those that
are not zero tells their width.
"""

from dataclasses import dataclass

import numpy as np
from scipy.fft import dctn

from meshflow.geometry.validation import Array

__all__ = ["Jpeg", "jpeg_of"]

SIDE = 8
# The steps of luminance at quality 50.
TABLE = np.array([
    [16, 11, 10, 16, 24, 40, 51, 61], [12, 12, 14, 19, 26, 58, 60, 55], [14, 13, 16, 24, 40, 57, 69, 56],
    [14, 17, 22, 29, 51, 87, 80, 62], [18, 22, 37, 56, 68, 109, 103, 77], [24, 35, 55, 64, 81, 104, 113, 92],
    [49, 64, 78, 87, 103, 121, 120, 101], [72, 92, 95, 98, 112, 100, 103, 99],
])  # fmt: skip
# The luminance of red, green and blue.
LUMINANCE = np.array([0.299, 0.587, 0.114])
# Qualities that are looked for. Above the last one the error is below that of most cameras, and nothing is gained.
QUALITIES = range(5, 87)
# Coefficients are multiples of the steps if the mean cosine of their phase is above this. Of 10 pictures at qualities 10 to 90 it
# is 0.55 to 1.0, without compression up to 0.27. So many coefficients that are not zero are needed.
SURE, ENOUGH, BLOCKS = 0.45, 60, 16
# The lowest frequencies, by the sum of their indices, have most of them.
LOW = 5
# The side of the part in the middle that is looked at.
PART = 768
# Blocks are divided by how busy they are into so many groups of at least so many.
GROUPS, EACH = 8, 40
# Shares of coefficients other than zero from which the width of their distribution is known; it falls with the frequency.
KNOWN, STEEPEST = (0.01, 0.9), 3.0
FREQUENCY = np.hypot(*np.mgrid[:SIDE, :SIDE])


@dataclass(frozen=True)
class Jpeg:
    """What compression has done to a picture.

    :ivar quality: 1 to 100, as programs have it.
    :ivar sigma: the standard deviation of the error, in the unit of the values.
    """

    quality: int
    sigma: float


def jpeg_of(values: Array, missing: Array) -> Jpeg | None:
    """The compression of a picture of whole numbers from 0 to 255; None where there was none, or hardly any.

    Pictures may be cut out: the lattice of blocks is found where differences of neighbours are largest.

    :param values: (h, w), or (h, w, 3) in red, green and blue; ``missing``: (h, w).
    """
    rows, columns = (slice(max(0, (side - PART) // 2), (side + PART) // 2) for side in missing.shape)
    grey, missing = _luminance(values[rows, columns]), missing[rows, columns]
    if grey is None or missing.any() or min(grey.shape) < 4 * SIDE:
        return None
    best: tuple[float, int, Array] | None = None
    for offset in {(0, 0), (_begin(grey.T), _begin(grey))}:
        found = _coefficients(grey, offset)
        if len(found) < BLOCKS:
            continue
        for quality in QUALITIES:
            score = _score(found, table_of(quality))
            if best is None or score > best[0]:
                best = score, quality, found
    if best is None or best[0] < SURE:
        return None
    return Jpeg(best[1], float(np.sqrt(_error(best[2], table_of(best[1])))))


def table_of(quality: int) -> Array:
    """The steps (8, 8) of a quality."""
    scale = float(5000 // quality) if quality < 50 else 200.0 - 2.0 * quality
    return np.clip(np.floor((TABLE * scale + 50.0) / 100.0), 1.0, 255.0)


def _luminance(values: Array) -> Array | None:
    """The luminance (h, w) of a picture of eight bits; None for anything else."""
    if values.ndim == 3 and values.shape[2] != 3:
        return None
    some = values[:: max(1, len(values) // 64)].astype(np.float64)
    if not (np.isfinite(some).all() and some.min() >= 0 and some.max() <= 255 and (some == np.rint(some)).all()):
        return None
    whole = values.astype(np.float64)
    return whole if values.ndim == 2 else whole @ LUMINANCE


def _begin(grey: Array) -> int:
    """The first column of a block."""
    jump = np.abs(np.diff(grey, axis=1)).mean(axis=0)
    return (int(np.argmax([jump[k::SIDE].mean() for k in range(SIDE)])) + 1) % SIDE


def _coefficients(grey: Array, offset: tuple[int, int]) -> Array:
    """Cosine transforms (n, 8, 8) of blocks that reach neither black nor white, where values are cut off."""
    row, column = offset
    h, w = (grey.shape[0] - row) // SIDE, (grey.shape[1] - column) // SIDE
    blocks = grey[row : row + h * SIDE, column : column + w * SIDE].reshape(h, SIDE, w, SIDE)
    blocks = blocks.swapaxes(1, 2).reshape(-1, SIDE, SIDE)
    inside = (blocks.min(axis=(1, 2)) > 0) & (blocks.max(axis=(1, 2)) < 255)
    return np.asarray(dctn(blocks[inside] - 128.0, axes=(1, 2), norm="ortho"))


def _score(found: Array, table: Array) -> float:
    """The mean cosine of the phase of coefficients other than zero, 1 where all are multiples of the steps; 0 for too few."""
    total, count = 0.0, 0
    for i in range(LOW):
        for j in range(LOW - i):
            step, values = table[i, j], found[:, i, j]
            if step >= 2 and i + j > 0:  # means of blocks are multiples of a step in drawings, too
                values = values[np.abs(values) > 0.5 * step]
                total += float(np.cos(2 * np.pi * values / step).sum())
                count += values.size
    return total / count if count > ENOUGH else 0.0


def _error(found: Array, table: Array) -> float:
    """The mean squared error of all coefficients.

    Blocks that are alike have one distribution: they are grouped by how many of their coefficients are not zero.
    """
    share = np.mean(np.abs(found) > table / 2, axis=0)
    known = (share >= KNOWN[0]) & (share < KNOWN[1]) & (FREQUENCY > 0)
    slope = 1.5
    if known.sum() >= 4:
        widths = np.log(_width(share[known], table[known]))
        slope = -float(np.polyfit(np.log(FREQUENCY[known]), widths, 1)[0])
    slope = float(np.clip(slope, 1.0, STEEPEST))
    size = np.abs(found).sum(axis=(1, 2))
    busy = (np.abs(found) > table / 2).sum(axis=(1, 2)) + size / (1.0 + size.max() * SIDE * SIDE)
    order = np.argsort(busy, kind="stable")
    groups = np.array_split(order, max(1, min(GROUPS, len(found) // EACH)))
    return float(np.mean([_error_of_group(found[group], table, slope) for group in groups]))


def _error_of_group(found: Array, table: Array, slope: float) -> float:
    """The mean squared error of the coefficients of blocks with one distribution.

    :param slope: of the logarithm of widths, which falls with that of the frequency.
    """
    share = np.mean(np.abs(found) > table / 2, axis=0)
    known = (share >= max(KNOWN[0], 4 / len(found))) & (share < KNOWN[1]) & (FREQUENCY > 0)
    lower, most = slope * np.log(np.maximum(FREQUENCY, 1.0)), table / (2.0 * np.log(2.0 * len(found)))
    if known.any():
        level = float(np.mean(np.log(_width(share[known], table[known])) + lower[known]))
    else:
        level = float(np.min((np.log(most) + lower)[FREQUENCY > 0]))  # none is seen: all are narrower than that
    width = np.minimum(np.exp(level - lower), most)
    width[known] = _width(share[known], table[known])
    half = table / 2.0
    zeroed = 2 * width**2 - np.exp(-half / width) * (half**2 + 2 * half * width + 2 * width**2)
    error = np.where(share >= KNOWN[1], table**2 / 12.0, zeroed + share * table**2 / 12.0)
    error[0, 0] = table[0, 0] ** 2 / 12.0
    return float(error.mean())


def _width(share: Array, step: Array) -> Array:
    """The parameter b of Laplace's distribution exp(-|x| / b) / 2b from the share of values beyond half a step."""
    return -step / (2.0 * np.log(share))
