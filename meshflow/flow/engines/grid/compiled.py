"""How the loops of this room are compiled, in one place.

Divisions do not ask whether they divide by zero (the formulas do), so that a loop over a row becomes SIMD; products and sums
may be fused, nothing else may be reordered: results do not depend on threads, tiles, or the place of a sample in a row.
"""

from typing import Any

from numba import njit

__all__ = ["EDGE", "FORMULA", "ROW", "SUM", "SWEEP", "width"]

_EXACT: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract"}}
# What is called from compiled code alone needs no way in from Python, which costs half of the time to compile it.
_INNER: dict[str, Any] = {**_EXACT, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}

# A formula, or a loop over a row: inlined with the constants it is given, which takes its choices out of the loop.
FORMULA: dict[str, Any] = {**_INNER, "forceinline": True}
# The work on a row: choices that the loops below it are given as constants.
ROW: dict[str, Any] = _INNER
# Sums of a row, in whatever order is fastest: of rows, not of bands or threads.
SUM: dict[str, Any] = {**_INNER, "fastmath": {"contract", "reassoc"}}
# The work on a band of rows, called from Python and kept on disk.
SWEEP: dict[str, Any] = {**_EXACT, "cache": True}

# Where the first cell of a row stands in a buffer: the cells beside the row, which are not there, stand before and after it.
EDGE = 16


@njit(**ROW)
def width(n):
    """The width of buffers for rows of n: no multiple of a page, or all would compete for the same lines of the cache."""
    return (n + 1023) // 1024 * 1024 + 7 * EDGE
