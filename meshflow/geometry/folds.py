"""Folds of a mesh, and motions without new folds."""

import numpy as np

from meshflow.geometry.connectivity import shared_sides
from meshflow.geometry.normals import measured
from meshflow.geometry.orientation import parts
from meshflow.geometry.validation import Array

__all__ = ["moved_without_folds", "new_folds"]

# The cosine between the normals of two neighbours below which the surface is folded there: they turn by more than 135 degrees.
FOLDED = -0.7
# The largest number of halvings of a motion that folds.
HALVINGS = 8


def new_folds(before: Array, after: Array, faces: Array) -> Array:
    """The pairs of triangles (k, 2) that are folded at their common edge after a motion, but not before.

    :param before: points (n, 3); ``after`` likewise.
    """
    one, other = shared_sides(faces)
    pairs = np.stack([one // 3, other // 3], axis=1)
    return pairs[_folded(after, faces, pairs) & ~_folded(before, faces, pairs)]


def moved_without_folds(before: Array, after: Array, faces: Array) -> tuple[Array, int]:
    """The points (n, 3) after a motion without new folds: points that would cause one move less.

    The motion of the vertices of new folds and of those around them is halved repeatedly. If that does not help, the part of
    the mesh does not move.

    :param before: points (n, 3); ``after`` likewise.
    :returns: the points, and the number of those that move less.
    """
    one, other = shared_sides(faces)
    pairs = np.stack([one // 3, other // 3], axis=1)
    were = _folded(before, faces, pairs)
    share, points = np.ones(len(before)), after
    for halving in range(HALVINGS + 2):
        bad = pairs[_folded(points, faces, pairs) & ~were]
        if not len(bad):
            break
        near = np.zeros(len(before), bool)
        near[faces[bad]] = True
        near[faces[near[faces].any(axis=1)]] = True
        if halving < HALVINGS:
            share[near] *= 0.5
        else:
            label = parts(faces, len(before))[1]
            share[np.isin(label, label[near]) if halving > HALVINGS else near] = 0.0
        points = np.where(share[:, None] == 1.0, after, before + share[:, None] * (after - before))
        points = np.where(share[:, None] == 0.0, before, points).astype(after.dtype)
    return points, int(np.count_nonzero(share < 1.0))


def _folded(points: Array, faces: Array, pairs: Array) -> Array:
    """Mask (k,) of the folded pairs of triangles; those with a triangle without area are not folded."""
    normals, _ = measured(points, faces)
    return np.einsum("ij,ij->i", normals[pairs[:, 0]], normals[pairs[:, 1]]) < FOLDED
