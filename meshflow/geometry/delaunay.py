"""Triangles known by the lengths of their sides alone: mollified where they are all but flat, flipped until they are Delaunay.

Lengths are all the operator needs, so both hold in every dimension. The surface is the same afterwards: a flip draws the other
diagonal of two triangles unfolded into a plane, as a straight line on the surface.
"""

from typing import Literal

import numpy as np

from meshflow.geometry.connectivity import shared_sides
from meshflow.geometry.validation import Array, indices_of
from meshflow.kernels import mesh_delaunay as kernels

__all__ = ["THIN", "Triangles", "clamped", "delaunay", "is_thin", "length_cotangents", "mollified", "side_lengths"]

Triangles = Literal["auto", "given", "delaunay", "clamped"]
# The cotangent of the smallest angle that is left alone, of a three hundredth of a degree: thinner ones make steps hopeless.
THIN = 2e4


def side_lengths(points: Array, faces: Array) -> Array:
    """Lengths (m, 3) of the sides opposite each corner, of triangles in R^d."""
    corners = points[faces].astype(np.float64)
    return np.linalg.norm(np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1), axis=2)


def mollified(lengths: Array, share: float = 1e-5) -> Array:
    """Lengths (m, 3) with so much added to all of them that every triangle has some area (Sharp and Crane 2020).

    The least e with a + b + e >= c + d for the sides of every triangle, d a ``share`` of the mean length; nothing where all have
    it already.
    """
    short = lengths.sum(axis=1) - 2.0 * lengths.max(axis=1)  # a + b - c, c the longest
    missing = share * float(lengths.mean()) - float(short.min(initial=np.inf))
    return lengths + max(missing, 0.0)


def is_thin(cot: Array) -> bool:
    """Whether a triangle of these cotangents (m, 3) is so thin that a system of them is all but singular, or has no area."""
    flat = ~cot.any(axis=1)
    return bool(flat.any() or np.abs(cot).max(initial=0.0) > THIN)


def clamped(cot: Array, one: Array, other: Array) -> Array:
    """Cotangents (m, 3) of which no edge has a weight below zero: those of the edges that would are zero.

    Sums of them are no longer the gradient of the area, nor exact on planes where triangles are obtuse; but what each vertex
    moves towards is a mean of its neighbours, and no value leaves the range of those around it.

    :param one: corners (e,), and ``other``, opposite to the edges of two triangles (:func:`shared_sides`).
    """
    flat = cot.ravel().copy()
    below = flat[one] + flat[other] < 0
    lone = np.ones(len(flat), bool)
    lone[one] = lone[other] = False
    flat[one[below]] = flat[other[below]] = 0.0
    flat[lone] = np.maximum(flat[lone], 0.0)
    return flat.reshape(-1, 3)


def length_cotangents(lengths: Array) -> tuple[Array, Array]:
    """Cotangents (m, 3) and areas (m,) of triangles of sides (m, 3), opposite each corner."""
    cot, area = np.empty(lengths.shape), np.empty(len(lengths))
    kernels.length_angles(np.ascontiguousarray(lengths, dtype=np.float64), cot, area)
    return cot, area


def delaunay(faces: Array, lengths: Array) -> tuple[Array, Array]:
    """Triangles (m, 3) of the same vertices with the lengths of their sides (m, 3), flipped until no cotangent weight is below 0.

    Edges at the border, of more than two triangles, or between triangles that are turned against each other stay. A triangle may
    name a vertex twice afterwards: its side is a loop on the surface.
    """
    glue = _glued(faces)
    faces, lengths = indices_of(faces).copy(), np.array(lengths, dtype=np.float64, order="C")
    kernels.flip_edges(faces, lengths, glue)
    return faces, lengths


def _glued(faces: Array) -> Array:
    """For each side 3 f + c the side it lies on (3 m,); -1 where it is not flipped."""
    tails, heads = (faces[:, [(c + shift) % 3 for c in range(3)]].ravel().astype(np.int64) for shift in (1, 2))
    one, other = shared_sides(faces)
    alike = (tails[one] == heads[other]) & (one // 3 != other // 3) & (tails[one] != heads[one])
    glue = np.full(faces.size, -1, np.int32)
    glue[one[alike]], glue[other[alike]] = other[alike], one[alike]
    return glue
