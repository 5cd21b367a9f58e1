"""Pseudorandom numbers of vertices that depend on the shape of the mesh around them, not on their order or on the position of
the mesh.
"""

import numpy as np

from meshflow.geometry.normals import mean_edge
from meshflow.geometry.validation import Array

__all__ = ["drawn", "numbers_of"]

# Turns per mean edge of length: the numbers of neighbours differ by many turns, and rounding is a small part of one.
TURNS = 997.0 * (np.sqrt(5.0) - 1.0)


def numbers_of(points: Array, faces: Array) -> Array:
    """Uniformly distributed numbers (n,) in [0, 1), one per vertex: the sum of the lengths of its edges, times TURNS, modulo 1.

    They do not change, up to rounding, if the mesh is rotated, moved, reflected or scaled, or if vertices are reordered or
    triangles reversed, because they depend on the ratios of lengths only.

    :param points: (n, 3).
    """
    x = points.astype(np.float64)
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    lengths = np.linalg.norm(x[ends[:, 0]] - x[ends[:, 1]], axis=1) / mean_edge(x, faces)
    around = np.bincount(ends.ravel(), np.repeat(lengths, 2), len(x))
    return np.mod(TURNS * around, 1.0)


def drawn(values: Array, numbers: Array) -> Array:
    """A sample from values (k,): their quantiles at the numbers (n,) in [0, 1)."""
    order = np.sort(values)
    return order[np.minimum((numbers * len(order)).astype(np.intp), len(order) - 1)]
