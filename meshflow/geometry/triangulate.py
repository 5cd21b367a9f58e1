"""Grids to triangles: two diagonals of a cell, and what is left where samples are missing."""

from typing import Literal

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.gates import Array

__all__ = ["DIAGONALS", "Diagonals", "charts_of_rows", "grid_sheets"]

Diagonals = Literal["forward", "backward", "both", "alternate"]
DIAGONALS = ("forward", "backward", "both", "alternate")

# Corners of a cell as (row, column) offsets. The first corner of each triangle has the right angle; its legs run along a
# row and along a column. Seen with x to the right and y upwards (rows downwards) all turn counter-clockwise.
_FORWARD = (((0, 0), (1, 0), (0, 1)), ((1, 1), (0, 1), (1, 0)))
_BACKWARD = (((0, 1), (0, 0), (1, 1)), ((1, 0), (1, 1), (0, 0)))


def grid_sheets(valid: Array, diagonals: Diagonals) -> tuple[Array, ...]:
    """Triangles of a grid, one array (m, 3) for each triangulation.

    Vertex r * w + c is the sample in row r and column c. ``forward``: the diagonal from lower left to upper right of the
    picture; ``backward``: the other; ``both`` and ``alternate``: both triangulations.

    :param valid: (h, w), where there is a sample; a triangle with a missing corner is left out.
    :raises InputError: for an unknown word.
    """
    if diagonals not in DIAGONALS:
        raise InputError(f"diagonals: one of {', '.join(DIAGONALS)} expected, got {diagonals!r}")
    kinds = {"forward": (_FORWARD,), "backward": (_BACKWARD,)}.get(diagonals, (_FORWARD, _BACKWARD))
    return tuple(np.concatenate([_triangles(valid, corners) for corners in kind]) for kind in kinds)


def _triangles(valid: Array, corners: tuple[tuple[int, int], ...]) -> Array:
    """One triangle of each cell, (m, 3)."""
    h, w = valid.shape
    index = np.arange(h * w).reshape(h, w)
    there = np.ones((h - 1, w - 1), bool)
    columns = []
    for r, c in corners:
        window = (slice(r, h - 1 + r), slice(c, w - 1 + c))
        there &= valid[window]
        columns.append(index[window])
    return np.stack([column[there] for column in columns], axis=-1)


def charts_of_rows(faces: Array, width: int, dx: Array, dy: float) -> Array:
    """Corners (m, 3, 2) of grid triangles in a plane of their own: legs dx of their row and dy.

    On an ellipsoid the width of a sample changes from row to row; no plane holds such a grid. Each triangle has one leg in
    a row, whose spacing it takes.

    :param faces: (m, 3) of :func:`grid_sheets`: the first corner holds the right angle.
    :param dx: (h,), the spacing within each row; dy the spacing between rows.
    """
    rows, columns = np.divmod(faces, width)
    spacing = np.asarray(dx, dtype=np.float64)[rows[:, 0]]
    x = (columns - columns[:, :1]) * spacing[:, None]
    y = (rows[:, :1] - rows) * float(dy)
    return np.stack([x, y], axis=-1)
