"""Triangles of a mesh that cross each other, and how far points may move without new crossings."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from meshflow.geometry.connectivity import connect
from meshflow.geometry.folds import moved_without_folds, new_folds, unfolded_normals
from meshflow.geometry.laplacians import neighbour_means
from meshflow.geometry.normals import followed
from meshflow.geometry.validation import Array, indices_of
from meshflow.kernels import mesh_crossings as kernels

__all__ = ["crossing_pairs", "moved_less", "moved_without_harm", "new_crossings"]

# The number of pairs for which memory is taken at first.
SOME = 1024
# Rounds in which what crosses or folds is moved to the middle of its neighbours, then moves half as far, and then not at all,
# each time with one more ring around what still does. The data is the last resort, because its noise folds and crosses. After 5
# rounds without success one of 12 terrains on scattered points, with slivers along its rim, was left as it was.
SMOOTHED, HALVED, STAYED = 8, 3, 20
# Sweeps in which what was mended follows the normals around it, and rounds in which what does not fit is left as it is.
FITTED, LEFT = 10, 3
# Rounds in which what folds or crosses by being drawn to the data stays as it is, each time with one more ring around it; and
# rounds in which it is put back to the data, likewise.
DRAWN, BACK = 8, 20


def crossing_pairs(points: Array, faces: Array) -> Array:
    """The pairs (k, 2) of triangles that cross each other; those that share an edge, or only touch, do not.

    :param points: (n, 3).
    :param faces: (m, 3).
    """
    x, faces = np.ascontiguousarray(points, dtype=np.float64), indices_of(faces)
    pairs = np.empty((SOME, 2), np.int32)
    count = kernels.crossing_pairs(x, faces, pairs)
    if count > len(pairs):
        pairs = np.empty((count, 2), np.int32)
        kernels.crossing_pairs(x, faces, pairs)
    return pairs[:count]


def new_crossings(before: Array, after: Array, faces: Array) -> Array:
    """The pairs (k, 2) of triangles that cross each other, unless both crossed something before.

    :param before: points (n, 3), as ``after``.
    """
    return _Before(before, faces).new_crossings(after)


@dataclass(frozen=True, eq=False)
class _Before:
    """Points (n, 3) before a motion, with their triangles (m, 3)."""

    points: Array
    faces: Array

    @cached_property
    def crossed(self) -> Array:
        """Mask (m,) of the triangles that cross another one."""
        found = np.zeros(len(self.faces), bool)
        found[crossing_pairs(self.points, self.faces)] = True
        return found

    def new_crossings(self, after: Array) -> Array:
        """The pairs (k, 2) of triangles that cross each other after the motion, unless both crossed something before."""
        pairs = crossing_pairs(after, self.faces)
        return pairs[~self.crossed[pairs].all(axis=1)] if len(pairs) else pairs

    def harmed(self, after: Array) -> Array:
        """The pairs (k, 2) of triangles that cross or are folded after the motion, and were not before."""
        return np.concatenate([self.new_crossings(after), new_folds(self.points, after, self.faces)])


def moved_without_harm(before: Array, after: Array, faces: Array, held: Array) -> tuple[Array, int]:
    """The points (n, 3) after a motion, those that would fold the surface or let it cross itself moved otherwise.

    Folds are mended first (:func:`moved_without_folds`). Then the corners of what still folds or crosses are moved to the middle
    of their neighbours, again and again; where that does not help, half as far as they were to go, and at last not at all,
    together with their neighbours. If there is harm after all this, nothing moves. Where the data itself folds and crosses, what
    goes back to it does so as well: then the best of the first rounds is the result, if it has less of both. What was mended
    follows the normals of the triangles that were not folded, so that creases are not rounded there.

    :param before: points (n, 3), as ``after``.
    :param held: (n,), points that stay.
    :returns: the points, and how many of them are moved otherwise.
    """
    points, bad, mean = moved_without_folds(before, after, faces, held)[0], np.zeros(len(after), bool), None
    best, fewest, went_back, start = points, np.inf, False, _Before(before, faces)
    for turn in range(SMOOTHED + HALVED + STAYED + 1):
        pairs = start.new_crossings(points)
        if turn > 0:
            pairs = np.concatenate([pairs, new_folds(before, points, faces)])
        if 0 < turn <= SMOOTHED and len(pairs) < fewest:
            best, fewest = points, len(pairs)
        if not len(pairs):
            break
        points = points.copy()
        if turn < SMOOTHED:
            mean = neighbour_means(faces, len(before), "free") if mean is None else mean
            worst = np.unique(faces[pairs])
            worst = worst[~held[worst]]
            points[worst] = mean[worst] @ points
            continue
        went_back = True
        if turn == SMOOTHED + HALVED + STAYED:
            points = before
            break
        bad |= _around(pairs, faces, len(bad), max(turn - SMOOTHED - HALVED, 0))
        less = bad & ~held
        points[less] = 0.5 * (before[less] + points[less]) if turn < SMOOTHED + HALVED else before[less]
    if went_back and _harm(best, faces) < _harm(points, faces):
        points = best
    points = _fitted(start, after, points)
    return points, int((points != after).any(axis=1).sum())


def moved_less(before: Array, points: Array, nearer: Array, faces: Array) -> Array:
    """Points (n, 3) that are drawn to where they are ``nearer`` to the data, as far as the surface does not fold or cross by it;
    those of which that cannot be said stay where the data has them, with their neighbours, if that is no harm.

    :param before: the data (n, 3).
    """
    start, found = _Before(before, faces), nearer.copy()
    for _ in range(DRAWN):
        left = np.isin(faces, faces[start.harmed(found)]).any(axis=1)
        if not left.any():
            break
        found[faces[left]] = points[faces[left]]
    else:
        found = points
    far = (found != nearer).any(axis=1)
    for rings in range(BACK if far.any() else 0):
        back = np.where(far[:, None], before, found)
        harmed = start.harmed(back)
        if not len(harmed):
            return back
        far |= _around(harmed, faces, len(far), rings)
    return found


def _around(pairs: Array, faces: Array, count: int, rings: int) -> Array:
    """Mask (n,) of the corners of pairs (k, 2) of triangles, with rings of triangles around them."""
    near = np.zeros(count, bool)
    near[faces[pairs]] = True
    for _ in range(rings):
        near[faces[near[faces].any(axis=1)]] = True
    return near


def _harm(points: Array, faces: Array) -> int:
    """How many pairs of triangles cross or are folded."""
    return len(crossing_pairs(points, faces)) + len(new_folds(np.zeros_like(points), points, faces))


def _fitted(start: _Before, after: Array, points: Array) -> Array:
    """Points (n, 3) of which those that differ from ``after`` are moved to the planes of the triangles that were not folded."""
    moved, faces = (points != after).any(axis=1), start.faces
    if not moved.any() or points is start.points:
        return points
    around = moved[faces].any(axis=1)
    used, near = np.unique(faces[around], return_inverse=True)
    normals = np.ascontiguousarray(unfolded_normals(after, faces)[around])
    fitted = points.astype(np.float64)
    there = connect((near.reshape(-1, 3),), len(used))
    fitted[used] = followed(np.ascontiguousarray(fitted[used]), there, normals, ~moved[used], FITTED)
    for _ in range(LEFT):
        pairs = np.concatenate([start.new_crossings(fitted), new_folds(points, fitted, faces)])
        if not len(pairs):
            return fitted.astype(points.dtype)
        left = np.isin(faces, faces[pairs]).any(axis=1)
        fitted[faces[left]] = points[faces[left]]
    return points
