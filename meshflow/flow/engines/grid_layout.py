"""The triangles of a grid as its kernels take them: which are there, which of their edges are borders."""

from dataclasses import dataclass

import numpy as np

from meshflow.geometry.validation import Array
from meshflow.kernels.grid import BLOCK, laid_out
from meshflow.surfaces.triangles import Diagonals, triangulations

__all__ = ["Layout", "border_samples"]

# Bits of the codes (kernels/grid_cells.h) of the borders opposite to the corners P, Q, R of the upper triangle of an element,
# and to S, N and O, the corner above S, of the lower one.
OPPOSITE_P, OPPOSITE_Q, OPPOSITE_R, OPPOSITE_S, OPPOSITE_N, OPPOSITE_O = 2, 4, 8, 32, 64, 128


@dataclass(frozen=True, eq=False)
class Layout:
    """Rows of codes, those that are alike once.

    :ivar codes: (m, w), uint8.
    :ivar kinds: (m, blocks), uint8.
    :ivar row_of: (2, h - 1), int32: the row of codes of each row of cells, of forward and of backward diagonals.
    """

    codes: Array
    kinds: Array
    row_of: Array

    @classmethod
    def of(
        cls,
        there: Array | None,
        shape: tuple[int, int],
        diagonals: Diagonals,
        borders: bool,
        threads: int | None = None,
    ) -> "Layout":
        """Lay out the triangulations that a word names.

        :param there: (h - 1, w - 1), the bits of :func:`meshflow.surfaces.triangles.triangles_there`; None: all are.
        :param shape: (h, w).
        :param borders: mark border edges (boundary ``plane-preserving``).
        """
        rows, columns = shape[0] - 1, shape[1] - 1
        row = np.arange(rows, dtype=np.int32)
        if there is None:
            # The rows of a whole grid are those of one that is three cells high, the middle one again and again.
            there = np.full((min(rows, 3), columns), 15, np.uint8)
            row = np.where(row == rows - 1, len(there) - 1, np.minimum(row, 1)).astype(np.int32)
        row_of, parts = np.zeros((2, rows), np.int32), []
        for i, which in enumerate(triangulations(diagonals)):
            parts.append(_codes(np.ascontiguousarray(there), which, borders, threads))
            row_of[which] = row + i * len(there)
        return cls(np.concatenate([codes for codes, _ in parts]), np.concatenate([kinds for _, kinds in parts]), row_of)


def _codes(there: Array, which: int, borders: bool, threads: int | None) -> tuple[Array, Array]:
    """Codes (m, w) and kinds (m, blocks) of a triangulation: 0 forward, 1 backward."""
    m, w = there.shape[0], there.shape[1] + 1
    codes, kinds = np.empty((m, w), np.uint8), np.empty((m, -(-w // BLOCK)), np.uint8)
    laid_out(there, which, int(borders), codes, kinds, threads)
    return codes, kinds


def border_samples(there: Array | None, shape: tuple[int, int], diagonals: Diagonals) -> Array:
    """Samples (h, w) at the ends of border edges of any of the triangulations.

    :param there: as of :meth:`Layout.of`.
    """
    if there is None:
        there = np.full((shape[0] - 1, shape[1] - 1), 15, np.uint8)
    held = np.zeros(shape, bool)
    for which in triangulations(diagonals):
        codes, _ = _codes(np.ascontiguousarray(there), which, True, None)
        # Corners of element j: P (r, j), Q (r, j + e), R (r + 1, j); S (r + 1, j), N (r + 1, j - e), O (r, j).
        held[:-1] |= codes & (OPPOSITE_Q | OPPOSITE_R | OPPOSITE_S | OPPOSITE_N) != 0
        held[1:] |= codes & (OPPOSITE_P | OPPOSITE_Q | OPPOSITE_N | OPPOSITE_O) != 0
        at_q, at_n = codes & (OPPOSITE_P | OPPOSITE_R) != 0, codes & (OPPOSITE_S | OPPOSITE_O) != 0
        if which:
            held[:-1, :-1] |= at_q[:, 1:]
            held[1:, 1:] |= at_n[:, :-1]
        else:
            held[:-1, 1:] |= at_q[:, :-1]
            held[1:, :-1] |= at_n[:, 1:]
    return held
