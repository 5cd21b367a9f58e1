"""Replaces samples by the median of their known neighbours, from the rim inwards."""

import numpy as np

from meshflow.geometry.validation import Array

__all__ = ["RINGS", "filled_from_ring", "neighbours_of"]

# The number of rings that are filled; wider regions are not guessed.
RINGS = 3
# The least number of known neighbours, of eight.
LEAST = 3


def filled_from_ring(values: Array, out: Array, missing: Array) -> tuple[Array, Array]:
    """Values with replaced samples, and the mask of the replaced ones.

    Each is the median of the known samples among the eight around it, channel by channel, so that edges are kept; then those
    further inwards, up to three rings.

    :param values: (h, w) or (h, w, k); not changed.
    :param out: (h, w), samples to replace.
    :param missing: (h, w), unknown samples, which are unchanged.
    """
    known, changed = ~(out | missing), values.copy()
    done = np.zeros(out.shape, bool)
    for _ in range(RINGS):
        places = np.argwhere(out & ~done)
        if len(places) == 0:
            break
        rows, columns, there = neighbours_of(places, out.shape)
        there &= known[rows, columns]
        enough = there.sum(axis=1) >= LEAST
        if not enough.any():
            break
        at = places[enough]
        ring = values if done.sum() == 0 else changed
        around = ring[rows[enough], columns[enough]].astype(np.float64)  # (m, 8) or (m, 8, k)
        hidden = ~there[enough] if around.ndim == 2 else np.broadcast_to(~there[enough][..., None], around.shape)
        changed[at[:, 0], at[:, 1]] = np.nanmedian(np.where(hidden, np.nan, around), axis=1)
        done[at[:, 0], at[:, 1]] = known[at[:, 0], at[:, 1]] = True
    return changed, done


def neighbours_of(places: Array, shape: tuple[int, ...], reach: int = 1) -> tuple[Array, Array, Array]:
    """Rows and columns (m, n) of the n neighbours of places (m, 2), row by row, and the mask of those on the grid.

    :param shape: (h, w), of the grid.
    :param reach: samples along rows and columns; 1: the eight nearest.
    """
    way = range(-reach, reach + 1)
    steps = np.array([(r, c) for r in way for c in way if r or c])
    rows, columns = places[:, :1] + steps[:, 0], places[:, 1:] + steps[:, 1]
    inside = (rows >= 0) & (rows < shape[0]) & (columns >= 0) & (columns < shape[1])
    return np.clip(rows, 0, shape[0] - 1), np.clip(columns, 0, shape[1] - 1), inside
