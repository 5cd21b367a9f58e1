"""Intrinsic triangles, given by edge lengths: mollified where they are nearly flat, and flipped until they are Delaunay.

The operator needs lengths only, so both work in every dimension. The surface stays the same: a flip takes the other diagonal of
two triangles that are unfolded into a plane, which is a straight line on the surface.
"""

from typing import Literal

import numpy as np

from meshflow.geometry.connectivity import shared_sides
from meshflow.geometry.validation import Array, indices_of
from meshflow.kernels import mesh_delaunay as kernels

__all__ = ["THIN", "Triangles", "clamped", "delaunay", "is_thin", "length_cotangents", "mollified"]

Triangles = Literal["auto", "given", "delaunay", "clamped"]
# The cotangent of a three hundredth of a degree; triangles with smaller angles would make steps hopelessly short.
THIN = 2e4


def mollified(lengths: Array, share: float = 1e-5) -> Array:
    """Lengths (m, 3), all increased by e so that every triangle has some area (Sharp and Crane 2020).

    e is the smallest number with a + b + e >= c + d for the edges of every triangle, where d is a ``share`` of the mean length;
    it is 0 where all triangles satisfy this already.
    """
    short = lengths.sum(axis=1) - 2.0 * lengths.max(axis=1)  # a + b - c, c the longest
    missing = share * float(lengths.mean()) - float(short.min(initial=np.inf))
    return lengths + max(missing, 0.0)


def is_thin(cot: Array) -> bool:
    """Whether a triangle with these cotangents (m, 3) has no area, or is so thin that systems are nearly singular."""
    flat = ~cot.any(axis=1)
    return bool(flat.any() or np.abs(cot).max(initial=0.0) > THIN)


def clamped(cot: Array, one: Array, other: Array) -> Array:
    """Cotangents (m, 3), set to zero for edges that would have a negative weight.

    Their sums are no longer the gradient of the area, and not exact on planes with obtuse triangles. But each vertex moves
    towards a mean of its neighbours, so that no value leaves the range of its neighbours.

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
    """Triangles (m, 3) of the same vertices and their edge lengths (m, 3), flipped until no cotangent weight is negative.

    Edges at the border, of more than two triangles, or between triangles of opposite orientation are kept. Afterwards a triangle
    may contain a vertex twice: its edge is then a loop on the surface.
    """
    glue = _glued(faces)
    faces, lengths = indices_of(faces).copy(), np.array(lengths, dtype=np.float64, order="C")
    kernels.flip_edges(faces, lengths, glue)
    return faces, lengths


def _glued(faces: Array) -> Array:
    """For each edge 3 f + c of a triangle the matching edge of its neighbour (3 m,); -1 where it is not flipped."""
    tails, heads = (faces[:, [(c + shift) % 3 for c in range(3)]].ravel().astype(np.int64) for shift in (1, 2))
    one, other = shared_sides(faces)
    alike = (tails[one] == heads[other]) & (one // 3 != other // 3) & (tails[one] != heads[one])
    glue = np.full(faces.size, -1, np.int32)
    glue[one[alike]], glue[other[alike]] = other[alike], one[alike]
    return glue
