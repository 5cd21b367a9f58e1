"""Pieces of a large mesh, on which its noise is estimated and methods are tried."""

from dataclasses import replace

import numpy as np

from meshflow.estimate.vertex_numbers import numbers_of
from meshflow.geometry.connectivity import connect
from meshflow.geometry.normals import beyond
from meshflow.geometry.once import once
from meshflow.geometry.validation import Array
from meshflow.surfaces.mesh import Mesh

__all__ = ["pieces"]

# The largest number of vertices of a mesh without pieces, the number of pieces, and of rings at their cuts that are not counted.
ENOUGH, PIECES, RINGS = 12_000, 4, 3


def pieces(data: Mesh) -> tuple[Mesh, Array, Array]:
    """The mesh, or pieces of a large one.

    A piece consists of rings around a triangle. The choice depends on the lengths of edges only, not on the order of triangles or
    vertices, nor on the position of the mesh.

    :returns: the mesh; the mask (v,) of its counted vertices; the indices (v,) of its vertices in the whole.
    """
    if len(data.points) <= ENOUGH:
        return data, ~data.fixed, np.arange(len(data.points))
    held = np.asarray(data.fixed[data.faces].all(axis=1))
    taken = _chosen(data.points, data.faces, held) if held.any() else _taken(data.points, data.faces)
    faces = data.faces[taken]
    kept, inverse = np.unique(faces, return_inverse=True)
    around = np.diff(connect((data.faces,), len(data.points)).first)[kept]
    cut, faces = around > np.bincount(inverse.ravel()), inverse.reshape(-1, 3)
    for _ in range(RINGS):
        cut[faces[cut[faces].any(axis=1)]] = True
    alone = data.channels is None or data.moves == "points"
    channels = None if data.channels is None or alone else data.channels[kept]
    moves = "points" if alone else data.moves
    piece = replace(data, points=data.points[kept], faces=faces, channels=channels, moves=moves, fixed=data.fixed[kept])
    counted = ~(cut | data.fixed[kept])
    return piece, counted if counted.any() else ~data.fixed[kept], kept


@once
def _taken(points: Array, faces: Array) -> Array:
    """The mask (m,) of the triangles of the pieces, where all may move."""
    return _chosen(points, faces, np.zeros(len(faces), bool))


def _chosen(points: Array, faces: Array, held: Array) -> Array:
    """The mask (m,) of the triangles of the pieces around some of those that are not held (m,), unless all are."""
    across, m = beyond(faces), len(faces)
    taken = np.zeros(m, bool)
    drawn = numbers_of(points, faces)[faces].sum(axis=1)
    drawn[held & ~held.all()] = np.inf
    some = np.argpartition(drawn, min(64 * PIECES, m - 1))[: 64 * PIECES]
    first = some[np.argsort(drawn[some])]
    first = first[np.isfinite(drawn[first])]
    for _ in range(PIECES):
        left = first[~taken[first]]
        if not len(left):
            break
        front, size = left[:1], 0
        while len(front) and size < 2 * ENOUGH // PIECES:
            front = front[~taken[front]]
            taken[front] = True
            size += len(front)
            front = np.unique(across[front][across[front] >= 0])
    return taken
