"""Folds of a mesh, and how far points may move without new ones."""

import numpy as np

from meshflow.geometry.connectivity import shared_sides
from meshflow.geometry.laplacians import neighbour_means
from meshflow.geometry.normals import measured
from meshflow.geometry.validation import Array
from meshflow.kernels import mesh_crossings as kernels

__all__ = ["moved_without_folds", "new_folds", "unfolded_normals"]

# The cosine between the normals of two neighbours below which the surface is folded there: they turn by more than 135 degrees.
FOLDED = -0.7
# Rounds in which what folds is moved to the middle of its neighbours, and then half as far, and then not at all.
SMOOTHED, HALVED, STAYED = 12, 4, 4


def new_folds(before: Array, after: Array, faces: Array) -> Array:
    """The pairs of triangles (k, 2) that are folded over their edge, and were not before.

    :param before: points (n, 3), as ``after``.
    """
    one, other = shared_sides(faces)
    pairs = np.stack([one // 3, other // 3], axis=1)
    return pairs[_folded(after, faces, pairs) & ~_folded(before, faces, pairs)]


def moved_without_folds(before: Array, after: Array, faces: Array, held: Array) -> tuple[Array, int]:
    """The points (n, 3) after a motion, those that would fold the surface where it was not folded moved otherwise.

    The corners of what folds are moved to the middle of their neighbours, again and again; where that does not help, half as far
    as they were to go, and then not at all. If more is folded after all this than was before, nothing moves. Folds that were
    there before are unfolded in the same way if a motion passes through them, as noise has made them; some may remain.

    :param before: points (n, 3), as ``after``.
    :param held: (n,), points that stay.
    :returns: the points, and how many of them are moved otherwise.
    """
    one, other = shared_sides(faces)
    pairs = np.stack([one // 3, other // 3], axis=1)
    were = _folded(before, faces, pairs)
    points, mean = after, None
    moving = (after != before).any(axis=1)[faces].all(axis=1)[pairs].all(axis=1)
    for turn in range(SMOOTHED + HALVED + STAYED):
        mended = ~were | (moving if turn < SMOOTHED else False)
        bad = np.unique(faces[pairs[_folded(points, faces, pairs) & mended]])
        bad = bad[~held[bad]]
        if not len(bad):
            break
        mean = neighbour_means(faces, len(before), "free") if mean is None else mean
        points = points.copy()
        if turn < SMOOTHED:
            points[bad] = mean[bad] @ points
        elif turn < SMOOTHED + HALVED:
            points[bad] = 0.5 * (before[bad] + points[bad])
        else:
            points[bad] = before[bad]
    if _folded(points, faces, pairs).sum() > were.sum():
        points = before
    return points, int((points != after).any(axis=1).sum())


def unfolded_normals(points: Array, faces: Array) -> Array:
    """Unit normals (m, 3) of the triangles; zero for the smaller one of two that are folded over their edge."""
    normals, areas = measured(points, faces)
    one, other = shared_sides(faces)
    pairs = np.stack([one // 3, other // 3], axis=1)
    pairs = pairs[_folded(points, faces, pairs)]
    normals[np.where(areas[pairs[:, 0]] < areas[pairs[:, 1]], pairs[:, 0], pairs[:, 1])] = 0.0
    return normals


def _folded(points: Array, faces: Array, pairs: Array) -> Array:
    """Which pairs of triangles (k,) are folded; triangles without area are not."""
    folded = np.empty(len(pairs), np.bool_)
    kernels.folded_pairs(measured(points, faces)[0], pairs, FOLDED, folded)
    return folded
