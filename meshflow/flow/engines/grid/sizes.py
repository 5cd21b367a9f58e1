"""How large a combination of arrays is: for errors and ways of a run, without an array between."""

import numpy as np
from numba import njit

from meshflow.flow.engines.grid.compiled import FORMULA, SUM, SWEEP

__all__ = ["sized"]


@njit(**SWEEP)
def sized(rows, every, count, factors, arrays):
    """Sum of the squares and greatest square of the samples of every so many rows of a band, of the sum of factor times array.

    :param rows: the first row of the band and the one after the last; those that ``every`` divides are looked at.
    :param arrays: four (k, h, w), of which ``count`` are taken, 2, 3 or 4.
    """
    total, greatest = 0.0, 0.0
    squares = np.empty(arrays[0].shape[2], arrays[0].dtype)
    for r in range(-(-rows[0] // every) * every, rows[1], every):
        squares[:] = 0
        for q in range(len(arrays[0])):
            a, b, c, d = arrays[0][q, r], arrays[1][q, r], arrays[2][q, r], arrays[3][q, r]
            if count == 2:
                _squared(2, factors[0], factors[1], factors[2], factors[3], a, b, c, d, squares)
            elif count == 3:
                _squared(3, factors[0], factors[1], factors[2], factors[3], a, b, c, d, squares)
            else:
                _squared(4, factors[0], factors[1], factors[2], factors[3], a, b, c, d, squares)
        total += _total(squares)
        greatest = max(greatest, _greatest(squares))
    return total, greatest


@njit(**FORMULA)
def _squared(count, e, f, g, h, a, b, c, d, squares):
    for j in range(len(squares)):
        x = e * a[j] + f * b[j]
        if count >= 3:
            x += g * c[j]
        if count >= 4:
            x += h * d[j]
        squares[j] += x * x


@njit(**SUM)
def _total(squares):
    total = 0.0
    for j in range(len(squares)):
        total += float(squares[j])
    return total


@njit(**SUM)
def _greatest(squares):
    """The greatest; not a number where one of them is not."""
    greatest, sound = squares[0], True
    for j in range(len(squares)):
        sound &= squares[j] == squares[j]
        greatest = squares[j] if squares[j] > greatest else greatest
    return float(greatest) if sound else np.nan
