"""Folds of a mesh, and how far points may move without new ones."""

import numpy as np

from meshflow.geometry.connectivity import shared_sides
from meshflow.geometry.normals import measured
from meshflow.geometry.orientation import parts
from meshflow.geometry.validation import Array

__all__ = ["moved_without_folds", "new_folds"]

# The cosine between the normals of two neighbours below which the surface is folded there: they turn by more than 135 degrees.
FOLDED = -0.7
# How often what folds is moved by half as much.
HALVINGS = 8


def new_folds(before: Array, after: Array, faces: Array) -> Array:
    """The pairs of triangles (k, 2) that are folded over their edge, and were not before.

    :param before: points (n, 3), as ``after``.
    """
    one, other = shared_sides(faces)
    pairs = np.stack([one // 3, other // 3], axis=1)
    return pairs[_folded(after, faces, pairs) & ~_folded(before, faces, pairs)]


def moved_without_folds(before: Array, after: Array, faces: Array) -> tuple[Array, int]:
    """The points (n, 3) after a motion, those that would fold the surface where it was not folded moved less.

    What folds is moved half as far, with the vertices around it, again and again; where that does not help, the part of the mesh
    stays as it was.

    :param before: points (n, 3), as ``after``.
    :returns: the points, and how many of them are moved less.
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
    """Which pairs of triangles (k,) are folded; triangles without area are not."""
    normals, _ = measured(points, faces)
    return np.einsum("ij,ij->i", normals[pairs[:, 0]], normals[pairs[:, 1]]) < FOLDED
