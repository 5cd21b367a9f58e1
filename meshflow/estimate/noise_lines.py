"""Offsets of whole rows and columns: what scan lines, sensors read out row by row, and swaths of a survey leave.

The second difference from row to row, its median over a block of columns, is that of the rows' offsets, and a little of noise and
surface. Blocks beside each other share the offsets and nothing else, so what they have in common is the offsets' part. A few rows
at which the surface itself has a step are held to the size of the others.
"""

import numpy as np

from meshflow.geometry.validation import Array

__all__ = ["line_offsets"]

# Blocks of columns, the least columns of one, and those looked at in one.
BLOCKS, NARROWEST, COLUMNS = 4, 12, 48
# Rows in all that say something.
FEW = 40
# Second differences count up to so many of their own deviations, and what blocks share counts beyond so many of its own.
HELD, SURE = 2.5, 6.0
MAD = 1.4826


def line_offsets(parts: list[tuple[Array, Array]]) -> tuple[float, float]:
    """Standard deviations of the offsets of rows, and of those of columns; 0 where none are seen.

    :param parts: pieces of one channel (h, w), and which of their samples are there.
    """
    return _offsets(parts), _offsets([(z.T, there.T) for z, there in parts])


def _offsets(parts: list[tuple[Array, Array]]) -> float:
    """The standard deviation of the offsets of rows."""
    shared = [product for z, there in parts for product in _shared(z, there)]
    products = np.concatenate(shared) if shared else np.zeros(0)
    if products.size < FEW:
        return 0.0
    # A row takes part in three second differences: neighbours are not independent.
    error = float(products.std()) * np.sqrt(3.0 / products.size)
    mean = float(products.mean())
    return float(np.sqrt(mean / 6.0)) if mean > SURE * error else 0.0


def _shared(z: Array, there: Array) -> list[Array]:
    """For each row (h - 2,) the products of the second differences of blocks, averaged over the pairs of blocks."""
    h, w = z.shape
    blocks = min(BLOCKS, w // NARROWEST)
    if blocks < 2 or h < 8:
        return []
    known = z if there.all() else np.where(there, z, np.nan)
    medians = []
    for columns in np.array_split(np.arange(w), blocks):
        some = known[:, columns[:: max(1, len(columns) // COLUMNS)]]
        second = some[:-2] - 2.0 * some[1:-1] + some[2:]
        if known is not z and np.isnan(second).all(axis=1).any():
            return []
        middle = np.median(second, axis=1) if known is z else np.nanmedian(second, axis=1)
        medians.append(middle - np.median(middle))
    limit = HELD * MAD * np.median(np.abs(medians))
    held = np.clip(medians, -limit, limit)
    total = held.sum(axis=0) ** 2 - (held**2).sum(axis=0)
    return [total / (blocks * (blocks - 1))]
