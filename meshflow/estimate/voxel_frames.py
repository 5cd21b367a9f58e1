"""Directions of the axes of a grid of voxels, from the few differences between the corners of triangles that it allows."""

from collections.abc import Iterator
from itertools import permutations, product

import numpy as np

from meshflow.geometry.validation import Array

__all__ = ["voxel_frames"]

# The number of triangles that are looked at. Marching cubes of a binary volume have 27 different edges up to their sign,
# marching tetrahedra 62; and the share of edges that may be others.
LOOKED_AT, EDGES, OTHERS = 1000, 62, 0.03
# Differences that are closer than this share of the mean edge are the same; and the largest share, where coordinates are rounded.
SAME, LARGEST = 1e-3, 0.02
# Rounds of the reduction of a basis; the cosine between axes that are orthogonal.
ROUNDS, STRAIGHT = 60, 1e-3


def voxel_frames(x: Array, faces: Array, rounding: float) -> Iterator[Array]:
    """Unit vectors (3, 3), as rows, along which the axes of a grid of voxels may be; none for most other meshes.

    The differences between the middles of the edges of a grid generate a lattice of which that grid is one of seven sublattices
    of index four (vectors of two halves and a zero, in voxels). Between the corners of voxels, or of tetrahedra, it is that
    lattice itself, or the one of twice its vectors.

    :param x: points (n, 3), float64.
    :param faces: (m, 3).
    :param rounding: the largest error of a coordinate.
    """
    some = faces[:: max(len(faces) // LOOKED_AT, 1)]
    edges = np.concatenate([x[some[:, k]] - x[some[:, k - 1]] for k in range(3)])
    mean = float(np.linalg.norm(edges, axis=1).mean())
    same = max(SAME * mean, 4.0 * rounding)
    if not same <= LARGEST * mean:
        return
    kinds = _kinds(np.concatenate([edges, -edges]), same)
    basis = None if kinds is None else _basis(kinds, 3.0 * same)
    if basis is None:
        return
    for chosen in product((0, 1), repeat=3):
        double = basis.copy()
        if any(chosen):
            double *= 2.0
            double[chosen.index(1)] = np.array(chosen) @ basis
        reduced = _reduced([*double], 3.0 * same)
        if reduced is not None and len(reduced) == 3:
            yield from _slanted(_directions(np.array(reduced)), np.array(reduced))


def _slanted(directions: Array, basis: Array) -> Iterator[Array]:
    """The directions of the three shortest vectors; then, if they are not orthogonal, those of slices of a tilted gantry."""
    yield directions
    if np.abs(directions @ directions.T - np.eye(3)).max() < STRAIGHT:
        return
    for long, short in permutations(range(3), 2):
        for times in (1, -1, 2, -2, 3, -3):
            tilted = basis.copy()
            tilted[long] += times * basis[short]
            yield _directions(tilted)


def _kinds(edges: Array, same: float) -> Array | None:
    """The different edges (k, 3), each the mean of those that are the same; None for many."""
    left, found = edges, []
    for _ in range(2 * EDGES):
        near = np.linalg.norm(left - left[0], axis=1) <= same
        found.append(left[near].mean(axis=0))
        left = left[~near]
        if len(left) <= OTHERS * len(edges):
            return np.array(found)
    return None


def _basis(vectors: Array, zero: float) -> Array | None:
    """A basis (3, 3), as rows, of the lattice that vectors (k, 3) generate; None where they generate none."""
    found: list[Array] | None = []
    for vector in vectors[np.argsort(np.linalg.norm(vectors, axis=1))]:
        found = _reduced([*found, vector], zero)
        if found is None:
            return None
    return np.array(found) if len(found) == 3 else None


def _reduced(vectors: list[Array], zero: float) -> list[Array] | None:
    """Short generators of the lattice of a few vectors, as many as it has dimensions; None where there is no end."""
    for _ in range(ROUNDS):
        vectors = sorted((v for v in vectors if np.linalg.norm(v) > zero), key=np.linalg.norm)
        for k in range(1, len(vectors)):
            shorter = np.array(vectors[:k])
            nearest = np.rint(np.linalg.lstsq(shorter.T, vectors[k], rcond=1e-6)[0])
            less = min(
                (vectors[k] - (nearest + np.array(more)) @ shorter for more in product((0, 1, -1), repeat=k)),
                key=lambda v: round(float(np.linalg.norm(v)) / zero),
            )
            if np.linalg.norm(less) < np.linalg.norm(vectors[k]) - zero:
                vectors[k] = less
                break
        else:
            return vectors if len(vectors) <= 3 else None
    return None


def _directions(basis: Array) -> Array:
    """Unit vectors along the rows."""
    return basis / np.linalg.norm(basis, axis=1, keepdims=True)
