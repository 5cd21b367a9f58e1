"""Pseudorandom numbers of vertices that depend on the shape of the mesh around them, not on their order or on the position of
the mesh.
"""

import numpy as np

from meshflow.geometry.normals import mean_edge, side_lengths
from meshflow.geometry.validation import Array

__all__ = ["again", "drawn", "numbers_of", "signs_of"]

# Turns per mean edge of length: the numbers of neighbours differ by many turns, and rounding is a small part of one.
TURNS = 997.0 * (np.sqrt(5.0) - 1.0)
# The factor between numbers and further numbers.
FURTHER = 17.0
# The number of frequencies: more would turn rounding into other signs.
WAVES = 16


def numbers_of(points: Array, faces: Array) -> Array:
    """Uniformly distributed numbers (n,) in [0, 1), one per vertex: the sum of the lengths of its edges, times TURNS, modulo 1.

    They do not change, up to rounding, if the mesh is rotated, moved, reflected or scaled, or if vertices are reordered or
    triangles reversed, because they depend on the ratios of lengths only.

    :param points: (n, 3).
    """
    lengths = side_lengths(points, faces)
    step = float(lengths.mean()) if len(faces) else 1.0
    beside = lengths.sum(axis=1, keepdims=True) - lengths  # of both sides at a corner
    around = np.bincount(faces.ravel(), beside.ravel() / step, len(points))
    return np.mod(TURNS * around, 1.0)


def again(numbers: Array, times: int = 1) -> Array:
    """Other uniform numbers (n,) in [0, 1) that are hardly correlated with these: their multiple by a prime, modulo 1.

    :param times: how often it is taken.
    """
    return np.mod(numbers * FURTHER**times, 1.0)


def drawn(values: Array, numbers: Array) -> Array:
    """A sample from values (k,): their quantiles at the numbers (n,) in [0, 1)."""
    order = np.sort(values)
    return order[np.minimum((numbers * len(order)).astype(np.intp), len(order) - 1)]


def signs_of(points: Array, faces: Array, channels: Array) -> Array:
    """Random signs (n, k), one for each value of the channels, which do not depend on the order of vertices or triangles.

    They depend on the lengths of edges and on the differences of the values along them, so that evenly sampled meshes have them,
    too. The signs of two channels are square waves of one number, whose frequencies have a ratio of a power of the root of 2:
    these are not correlated.

    :param points: (n, d); ``channels``: (n, k).
    """
    x, values = points.astype(np.float64), channels.astype(np.float64)
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    rough = float(np.sqrt(np.mean(np.square(values[ends[:, 0]] - values[ends[:, 1]])))) or 1.0
    numbers = numbers_of(np.column_stack([x / mean_edge(x, faces), values / rough]), faces)
    waves = TURNS * np.sqrt(2.0) ** (np.arange(channels.shape[1]) % WAVES)
    return np.where(np.mod(numbers[:, None] * waves, 1.0) < 0.5, 1.0, -1.0)
