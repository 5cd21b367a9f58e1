"""Offsets of whole rows and columns, as of scan lines, of sensors with row-wise readout, and of swaths of a survey.

The median over a block of columns of the second difference from row to row is that of the offsets of the rows, plus a small
part of noise and surface. Different blocks share only the offsets, so the mean product of two blocks is the variance of the
offsets. Rows at which the surface itself has a step are clipped to the size of the others.
"""

import numpy as np

from meshflow.estimate.noise_growth import MAD
from meshflow.geometry.validation import Array

__all__ = ["line_offsets"]

# The largest number of blocks of columns, the least number of columns of a block, and the number of columns used in one.
BLOCKS, NARROWEST, COLUMNS = 4, 12, 48
# The least total number of rows.
FEW = 40
# Second differences are clipped at HELD deviations. Offsets are reported if their variance exceeds SURE standard errors.
HELD, SURE = 2.5, 6.0


def line_offsets(parts: list[tuple[Array, Array]]) -> tuple[float, float]:
    """Standard deviations of the offsets of rows, and of those of columns; 0 where none are found.

    :param parts: pieces of one channel (h, w), and masks of their present samples.
    """
    return _offsets(parts), _offsets([(z.T, there.T) for z, there in parts])


def _offsets(parts: list[tuple[Array, Array]]) -> float:
    """The standard deviation of the offsets of rows."""
    shared = [found for found in (_shared(z, there) for z, there in parts) if found is not None]
    count = sum(products.size for products, _ in shared)
    if count < FEW:
        return 0.0
    # Each row occurs in three second differences, so that neighbours are not independent.
    error = float(np.sqrt(3.0 * sum(products.size * own**2 for products, own in shared))) / count
    mean = float(np.concatenate([products for products, _ in shared]).mean())
    return float(np.sqrt(mean / 6.0)) if mean > SURE * error else 0.0


def _shared(z: Array, there: Array) -> tuple[Array, float] | None:
    """For each row (h - 2,) the products of the second differences of blocks, averaged over the pairs of blocks.

    Beside them the deviation that these would have if blocks had nothing in common; None for too few rows or columns.
    """
    h, w = z.shape
    blocks = min(BLOCKS, w // NARROWEST)
    if blocks < 2 or h < 8:
        return None
    known = z if there.all() else np.where(there, z, np.nan)
    medians = []
    for columns in np.array_split(np.arange(w), blocks):
        some = known[:, columns[:: max(1, len(columns) // COLUMNS)]]
        second = some[:-2] - 2.0 * some[1:-1] + some[2:]
        if known is not z and np.isnan(second).all(axis=1).any():
            return None
        middle = np.median(second, axis=1) if known is z else np.nanmedian(second, axis=1)
        medians.append(middle - np.median(middle))
    limit = HELD * MAD * np.median(np.abs(medians))
    held = np.clip(medians, -limit, limit)
    pairs = blocks * (blocks - 1)
    own = float(held.var(axis=0, ddof=1).mean()) * np.sqrt(2.0 / pairs)
    return (held.sum(axis=0) ** 2 - (held**2).sum(axis=0)) / pairs, own
