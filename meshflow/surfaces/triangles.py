"""Triangulates grids: the diagonals of the cells, and the triangles that exist where samples are missing."""

from typing import Literal

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array
from meshflow.surfaces.discontinuities import Cuts

__all__ = [
    "DIAGONALS",
    "TOUCHES",
    "Diagonals",
    "charts_of_rows",
    "grid_triangulations",
    "triangles_of_cells",
    "triangles_there",
    "triangulations",
]

Diagonals = Literal["forward", "backward", "both", "alternate"]
DIAGONALS = ("forward", "backward", "both", "alternate")

# Corners of a cell as (row, column) offsets. The first corner of each triangle has the right angle; its legs run along a
# row and along a column. Seen with x to the right and y upwards (rows downwards) all turn counter-clockwise. The triangle on
# the upper side of the cell comes first.
_FORWARD = (((0, 0), (1, 0), (0, 1)), ((1, 1), (0, 1), (1, 0)))
_BACKWARD = (((0, 1), (0, 0), (1, 1)), ((1, 0), (1, 1), (0, 0)))
_CORNERS = (*_FORWARD, *_BACKWARD)

# Corners of a cell, and the bits of the triangles that have it.
TOUCHES = tuple(
    (r, c, sum(1 << bit for bit, corners in enumerate(_CORNERS) if (r, c) in corners)) for r in (0, 1) for c in (0, 1)
)

# Diagonals of a cell whose lengths differ by less than this share are equally long.
ALIKE = 1e-9

# Rows of cells handled at once, which keeps temporary arrays small.
_ROWS = 256


def triangulations(diagonals: Diagonals) -> tuple[int, ...]:
    """The triangulations that a word stands for: 0 forward, 1 backward.

    :raises InputError: for an unknown word.
    """
    if diagonals not in DIAGONALS:
        raise InputError(f"diagonals: one of {', '.join(DIAGONALS)} expected, got {diagonals!r}")
    return {"forward": (0,), "backward": (1,)}.get(diagonals, (0, 1))


def triangles_there(
    missing: Array, depth: Array | None = None, jump: float | None = None, cuts: Cuts | None = None
) -> Array:
    """Bits of the triangles that exist in each cell (h - 1, w - 1): 1, 2 forward, upper and lower; 4, 8 backward.

    :param missing: (h, w), missing samples; a triangle with a missing corner is left out.
    :param depth: (h, w), and ``jump``: a triangle whose depths differ by more than this share of the nearest is also left out.
    :param cuts: a triangle with a cut leg is also left out.
    """
    h, w = missing.shape
    there = np.zeros((h - 1, w - 1), np.uint8)
    for first in range(0, h - 1, _ROWS):
        last = min(first + _ROWS, h - 1)
        windows = {
            (r, c): (slice(first + r, last + r), slice(c, w - 1 + c)) for r in (0, 1) for c in (0, 1)
        }  # the corners of these cells
        for bit, corners in enumerate(_CORNERS):
            whole = ~np.logical_or.reduce([missing[windows[corner]] for corner in corners])
            if depth is not None and jump is not None:
                at = [depth[windows[corner]] for corner in corners]
                nearest = np.minimum.reduce(at)
                whole &= np.maximum.reduce(at) - nearest <= jump * nearest
            if cuts is not None:
                # The legs of a triangle are those of its cell's edges that meet at its right angle.
                row, column = corners[0]
                whole &= ~cuts.right[first + row : last + row] & ~cuts.down[first:last, column : w - 1 + column]
            there[first:last] |= whole.astype(np.uint8) << bit
    return there


def grid_triangulations(there: Array, diagonals: Diagonals) -> tuple[Array, ...]:
    """Triangles of a grid, one array (m, 3) for each triangulation.

    Vertex r * w + c is the sample in row r and column c. ``forward``: the diagonal from lower left to upper right of the
    picture; ``backward``: the other; ``both`` and ``alternate``: both triangulations.

    :param there: (h - 1, w - 1), :func:`triangles_there`.
    :raises InputError: for an unknown word.
    """
    return tuple(
        np.concatenate([_triangles(there, bit) for bit in (2 * which, 2 * which + 1)])
        for which in triangulations(diagonals)
    )


def _triangles(there: Array, bit: int) -> Array:
    """The triangles (m, 3) of one bit."""
    row, column = np.nonzero(there & (1 << bit))
    width = there.shape[1] + 1
    return np.stack([(row + r) * width + column + c for r, c in _CORNERS[bit]], axis=-1)


def triangles_of_cells(places: Array, missing: Array) -> Array:
    """Two triangles (m, 3) for each cell of a grid of any shape, cut by its shorter diagonal.

    Where both are equally long, as in rectangles, the diagonals of one row of cells lean the other way than those of the next: no
    direction is preferred, and every sample has six triangles and the same area.

    :param places: (h, w, d).
    :param missing: (h, w); a triangle with a missing corner is left out.
    """
    there = triangles_there(missing)
    forward = np.linalg.norm(places[1:, :-1] - places[:-1, 1:], axis=-1)
    backward = np.linalg.norm(places[:-1, :-1] - places[1:, 1:], axis=-1)
    tie = np.abs(forward - backward) <= ALIKE * np.maximum(forward, backward)
    leans = np.where(tie, (np.arange(len(there)) % 2 == 0)[:, None], forward < backward)
    # Where one corner is missing, one of the four triangles is there, whichever diagonal is its own.
    corners = [missing[r : r + there.shape[0], c : c + there.shape[1]] for r in (0, 1) for c in (0, 1)]
    whole = ~np.logical_or.reduce(corners)
    there = np.where(whole, there & np.where(leans, 3, 12).astype(np.uint8), there)
    return np.concatenate([_triangles(there, bit) for bit in range(4)])


def charts_of_rows(faces: Array, width: int, dx: Array, dy: float) -> Array:
    """Corners (m, 3, 2) of grid triangles in a plane of their own: legs dx of their row and dy.

    On an ellipsoid the width of a sample changes from row to row, so the grid does not fit in a plane. Each triangle takes the
    spacing of the row in which one of its legs lies.

    :param faces: (m, 3) of :func:`grid_triangulations`: the first corner holds the right angle.
    :param dx: (h,), the spacing within each row; dy the spacing between rows.
    """
    rows, columns = np.divmod(faces, width)
    spacing = np.asarray(dx, dtype=np.float64)[rows[:, 0]]
    x = (columns - columns[:, :1]) * spacing[:, None]
    y = (rows[:, :1] - rows) * float(dy)
    return np.stack([x, y], axis=-1)
