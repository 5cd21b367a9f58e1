"""Triangles known by the lengths of their sides alone: mollified where they are all but flat, flipped until they are Delaunay.

Lengths are all the operator needs, so both hold in every dimension. The surface is the same afterwards: a flip draws the other
diagonal of two triangles unfolded into a plane, as a straight line on the surface.
"""

from typing import Literal

import numpy as np
from numba import njit

from meshflow.geometry import triangle
from meshflow.geometry.connectivity import shared_sides
from meshflow.geometry.validation import Array

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
    _cotangents(np.ascontiguousarray(lengths), cot, area)
    return cot, area


def delaunay(faces: Array, lengths: Array) -> tuple[Array, Array]:
    """Triangles (m, 3) of the same vertices with the lengths of their sides (m, 3), flipped until no cotangent weight is below 0.

    Edges at the border, of more than two triangles, or between triangles that are turned against each other stay. A triangle may
    name a vertex twice afterwards: its side is a loop on the surface.
    """
    glue = _glued(faces)
    faces, lengths = faces.astype(np.int64).copy(), lengths.copy()
    _flip(faces, lengths, glue)
    return faces, lengths


def _glued(faces: Array) -> Array:
    """For each side 3 f + c the side it lies on (3 m,); -1 where it is not flipped."""
    tails, heads = (faces[:, [(c + turn) % 3 for c in range(3)]].ravel().astype(np.int64) for turn in (1, 2))
    one, other = shared_sides(faces)
    alike = (tails[one] == heads[other]) & (one // 3 != other // 3) & (tails[one] != heads[one])
    glue = np.full(faces.size, -1, np.int64)
    glue[one[alike]], glue[other[alike]] = other[alike], one[alike]
    return glue


@njit(cache=True)
def _sides(a, b, c):
    # Dots at the corners opposite a, b, c, and four times the squared area by Kahan's order of factors.
    high, low = max(a, b, c), min(a, b, c)
    middle = a + b + c - high - low
    det = (high + (middle + low)) * (low - (high - middle)) * (low + (high - middle)) * (high + (middle - low)) / 4.0
    return 0.5 * (b * b + c * c - a * a), 0.5 * (c * c + a * a - b * b), 0.5 * (a * a + b * b - c * c), max(det, 0.0)


@njit(cache=True)
def _cotangents(lengths, cot, area):
    for f in range(len(lengths)):
        dot0, dot1, dot2, det = _sides(lengths[f, 0], lengths[f, 1], lengths[f, 2])
        cot[f, 0], cot[f, 1], cot[f, 2], area[f] = triangle.cotangents(dot0, dot1, dot2, det)


@njit(cache=True)
def _cotangent(lengths, side):
    f, c = side // 3, side % 3
    dot0, dot1, dot2, det = _sides(lengths[f, c], lengths[f, (c + 1) % 3], lengths[f, (c + 2) % 3])
    return dot0 / np.sqrt(det) if det > 0.0 else 1e300 * np.sign(dot0)


@njit(cache=True)
def _flip(faces, lengths, glue):
    m = len(faces)
    stack, waits = np.arange(3 * m), np.ones(3 * m, np.bool_)
    top, left = 3 * m, 200 * m + 1000
    outer, images, across = np.empty(4, np.int64), np.empty(4, np.int64), np.empty(4, np.int64)
    while top > 0 and left > 0:
        top -= 1
        side = stack[top]
        waits[side] = False
        other = glue[side]
        if other < 0 or other // 3 == side // 3 or _cotangent(lengths, side) + _cotangent(lengths, other) >= -1e-12:
            continue
        left -= 1
        f, c, g, d = side // 3, side % 3, other // 3, other % 3
        c1, c2, d1, d2 = (c + 1) % 3, (c + 2) % 3, (d + 1) % 3, (d + 2) % 3
        k, i, j, e = faces[f, c], faces[f, c1], faces[f, c2], faces[g, d]
        base, ki, kj = lengths[f, c], lengths[f, c2], lengths[f, c1]
        li, lj = lengths[g, d1], lengths[g, d2]
        # Both unfolded above and below the edge i j, i at the origin.
        xk, xl = (base * base + ki * ki - kj * kj) / (2 * base), (base * base + li * li - lj * lj) / (2 * base)
        yk, yl = np.sqrt(max(ki * ki - xk * xk, 0.0)), np.sqrt(max(li * li - xl * xl, 0.0))
        new = np.sqrt((xk - xl) ** 2 + (yk + yl) ** 2)
        outer[0], outer[1], outer[2], outer[3] = 3 * g + d1, 3 * f + c2, 3 * f + c1, 3 * g + d2
        images[0], images[1], images[2], images[3] = 3 * f, 3 * f + 2, 3 * g, 3 * g + 2
        for t in range(4):
            across[t] = glue[outer[t]]
        for t in range(4):
            for s in range(4):
                if across[t] == outer[s]:
                    across[t] = images[s]
                    break
        faces[f, 0], faces[f, 1], faces[f, 2] = k, i, e
        faces[g, 0], faces[g, 1], faces[g, 2] = e, j, k
        lengths[f, 0], lengths[f, 1], lengths[f, 2] = li, new, ki
        lengths[g, 0], lengths[g, 1], lengths[g, 2] = kj, new, lj
        glue[3 * f + 1], glue[3 * g + 1] = 3 * g + 1, 3 * f + 1
        for t in range(4):
            glue[images[t]] = across[t]
            if across[t] >= 0:
                glue[across[t]] = images[t]
                if not waits[images[t]] and top < len(stack):
                    stack[top] = images[t]
                    waits[images[t]] = True
                    top += 1
