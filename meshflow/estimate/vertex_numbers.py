"""Numbers that look random and belong to the place of a vertex in its mesh: not to its number, nor to where the mesh lies."""

import numpy as np

from meshflow.geometry.normals import mean_edge
from meshflow.geometry.validation import Array

__all__ = ["drawn", "numbers_of"]

# Turns per mean edge of the lengths around a vertex: neighbours are many turns apart, and rounding is a small part of one.
TURNS = 997.0 * (np.sqrt(5.0) - 1.0)


def numbers_of(points: Array, faces: Array) -> Array:
    """A number (n,) in [0, 1) of each vertex, evenly spread: of the lengths of the edges around it, many times round a circle.

    Lengths stay where a mesh is turned, moved or mirrored, its vertices numbered otherwise or its triangles turned round, and in
    mean edges where it is scaled: so do these, to rounding.

    :param points: (n, 3).
    """
    x = points.astype(np.float64)
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    lengths = np.linalg.norm(x[ends[:, 0]] - x[ends[:, 1]], axis=1) / mean_edge(x, faces)
    around = np.bincount(ends.ravel(), np.repeat(lengths, 2), len(x))
    return np.mod(TURNS * around, 1.0)


def drawn(values: Array, numbers: Array) -> Array:
    """Values drawn from those that are there, (k,), one for each number (n,) in [0, 1): their quantile at it."""
    order = np.sort(values)
    return order[np.minimum((numbers * len(order)).astype(np.intp), len(order) - 1)]
