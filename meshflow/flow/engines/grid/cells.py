"""Which triangles of a row of cells are there, and which of their edges are borders: runs of plain cells, codes for the rest.

A cell holds two triangles, the upper with its right angle at P on the upper edge, the lower opposite to it; Q is the other end
of the leg along the row, R of the leg along the column. The code of a cell has for the upper triangle the bits 1: it is there;
2, 4, 8: the edge opposite to P, Q, R is a border. For the lower one 16, 32, 64, 128.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from meshflow.flow.engines.grid.compiled import ROW, SWEEP
from meshflow.geometry.validation import Array

__all__ = ["Cells", "border_samples", "cells_of"]

PLAIN = 17
# What stands in the place of codes where a run has none: all cells plain, no triangle there.
ALL, NONE = -1, -2
# A run of plain cells shorter than this is not worth a loop of its own.
SHORT = 512


@dataclass(frozen=True, eq=False)
class Cells:
    """The cells of one triangulation.

    :ivar first: (h,), where the runs of each row of cells begin in ``runs``; the last entry is their number.
    :ivar runs: (m, 3): the first cell, the one after the last, and where their codes begin in ``codes``, or ALL, or
        NONE.
    :ivar codes: (c,), uint8.
    :ivar same: (h - 1,), rows of cells known to be like the one above them.
    """

    first: Array
    runs: Array
    codes: Array
    same: Array


def cells_of(there: Array | None, shape: tuple[int, int], which: int, borders: bool) -> Cells:
    """The cells of a triangulation.

    :param there: (h - 1, w - 1), the bits of :func:`meshflow.surfaces.triangles.triangles_there`; None: all are.
    :param shape: (h, w).
    :param which: 0 forward, 1 backward.
    :param borders: mark border edges (boundary ``plane-preserving``); without them a cell with both triangles is plain.
    """
    rows, columns = shape[0] - 1, shape[1] - 1
    if there is None:
        # The rows of a whole grid are those of one that is three cells high, the middle one again and again.
        few = min(rows, 3)
        pattern = cells_of(np.full((few, columns), 15, np.uint8), (few + 1, columns + 1), which, borders)
        return pattern if rows <= few else _repeated(pattern, rows)
    first = np.zeros(rows + 1, np.int64)
    nothing = np.zeros((0, 3), np.int32), np.zeros(0, np.uint8)
    runs, codes = _laid_out(there, which, borders, first, *nothing, True)
    kept = np.empty((runs, 3), np.int32), np.empty(codes, np.uint8)
    _laid_out(there, which, borders, first, *kept, False)
    return Cells(first, *kept, np.zeros(rows, bool))


def _repeated(pattern: Cells, rows: int) -> Cells:
    """A pattern of three rows of cells with its middle row repeated, codes shared."""
    top, middle, bottom = (pattern.runs[pattern.first[r] : pattern.first[r + 1]] for r in range(3))
    runs = np.concatenate([top, *[middle] * (rows - 2), bottom])
    first = np.concatenate([[0], len(top) + len(middle) * np.arange(rows - 1), [len(runs)]])
    same = np.zeros(rows, bool)
    same[2:-1] = True
    return Cells(first, runs, pattern.codes, same)


def border_samples(there: Array, which: int) -> Array:
    """Samples (h, w) at the ends of border edges of a triangulation."""
    held = np.zeros((there.shape[0] + 1, there.shape[1] + 1), bool)
    _mark_borders(there, which, held)
    return held


@njit(**ROW)
def _coded(there, r, which, borders, bits, codes):
    """The codes of row r of cells; ``bits`` (3, w + 1): of the rows around it, with a cell that is not there at each end."""
    for i in range(3):
        if 0 <= r - 1 + i < there.shape[0]:
            bits[i, 1:-1] = there[r - 1 + i]
        else:
            bits[i, :] = 0
    row = bits[1]
    upper, lower = np.uint8(1 << (2 * which)), np.uint8(2 << (2 * which))
    # The leg along the column stands on the left of the upper triangle where the diagonal is forward, else on its right.
    side = 2 * which - 1
    beside, beyond = row[1 + side : len(row) - 1 + side], row[1 - side : len(row) - 1 - side]
    here, over, under = row[1:-1], bits[0, 1:-1], bits[2, 1:-1]
    for c in range(len(codes)):
        code = 0
        if here[c] & upper:
            code |= 1
            if borders:
                code |= (0 if here[c] & lower else 2) | (0 if beside[c] & lower else 4) | (0 if over[c] & lower else 8)
        if here[c] & lower:
            code |= 16
            if borders:
                code |= (
                    (0 if here[c] & upper else 32) | (0 if beyond[c] & upper else 64) | (0 if under[c] & upper else 128)
                )
        codes[c] = code


@njit(**SWEEP)
def _laid_out(there, which, borders, first, runs, codes, counting):
    columns = there.shape[1]
    bits, row = np.zeros((3, columns + 2), np.uint8), np.empty(columns, np.uint8)
    run, at = 0, 0
    for r in range(there.shape[0]):
        first[r] = run
        _coded(there, r, which, borders, bits, row)
        c = 0
        while c < columns:
            begin, alike = c, _alike_from(row, c)
            kind = 0
            if alike - c >= SHORT and (row[c] == PLAIN or row[c] == 0):
                c, kind = alike, ALL if row[c] == PLAIN else NONE
            else:
                c = _mixed_from(row, c)
                if not counting:
                    codes[at : at + c - begin] = row[begin:c]
            if not counting:
                runs[run, 0], runs[run, 1], runs[run, 2] = begin, c, at if kind == 0 else kind
            at += c - begin if kind == 0 else 0
            run += 1
    first[there.shape[0]] = run
    return run, at


@njit(**ROW)
def _alike_from(row, c):
    """The first cell from c on whose code is another."""
    code = row[c]
    while c < len(row) and row[c] == code:
        c += 1
    return c


@njit(**ROW)
def _mixed_from(row, c):
    """The first cell from c on where a run of plain cells, or of none, is long enough for a loop of its own."""
    while c < len(row):
        alike = _alike_from(row, c)
        if alike - c >= SHORT and (row[c] == PLAIN or row[c] == 0):
            return c
        c = alike
    return c


@njit(**SWEEP)
def _mark_borders(there, which, held):
    columns = there.shape[1]
    bits, row = np.zeros((3, columns + 2), np.uint8), np.empty(columns, np.uint8)
    for r in range(there.shape[0]):
        _coded(there, r, which, True, bits, row)
        for c in range(columns):
            code = row[c]
            p, q = c + which, c + 1 - which  # columns of P and Q of the upper triangle; of Q and P of the lower one
            held[r + 1, p] |= code & (2 | 4) != 0  # R of the upper one
            held[r, q] |= code & (2 | 8) != 0
            held[r, p] |= code & (4 | 8) != 0
            held[r, q] |= code & (32 | 64) != 0  # R of the lower one
            held[r + 1, p] |= code & (32 | 128) != 0
            held[r + 1, q] |= code & (64 | 128) != 0
