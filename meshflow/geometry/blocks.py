"""Triangles in blocks that fit in the cache of a core: cotangents, masses and gradients in R^3 without temporary arrays.

A block owns vertices that are close together, and contains every triangle that touches one of them, with local numbers. Each
vertex is therefore read about once, whatever the order of the vertices; no two threads write to the same place; and sums do not
depend on the number of threads. On 655 362 vertices a step takes a quarter of the time of a loop over the corners of each vertex.
"""

from dataclasses import dataclass

import numpy as np

from meshflow.geometry.nearness import near_order
from meshflow.geometry.validation import Array, indices_of
from meshflow.kernels import mesh_blocks as kernels

__all__ = ["Blocks", "blocked", "march_blocks"]

# Vertices of a block: 4096 vertices and their sums take 230 kB. Small meshes have smaller blocks, so that more threads have work.
LARGEST, SMALLEST, SHARES = 4096, 256, 64


@dataclass(frozen=True, eq=False)
class Blocks:
    """Vertices assigned to blocks, and the triangles around them.

    :ivar vertices: block after block, the vertices that it owns, then those around them; int32.
    :ivar start: (b + 1,), the start of the vertices of each block.
    :ivar owned: (b,), the number of vertices that it owns.
    :ivar triangles: (t, 3), block after block, by the local numbers of their corners; uint16.
    :ivar first: (b + 1,), the start of the triangles of each block.
    :ivar kind: of the mass, :func:`meshflow.geometry.operator.mass_kind`.
    :ivar held: (n,), vertices that do not move.
    """

    vertices: Array
    start: Array
    owned: Array
    triangles: Array
    first: Array
    kind: int
    held: Array

    @property
    def order(self) -> Array:
        """The vertices (n,), block after block; neighbours are close in this order."""
        runs = [self.vertices[a : a + k] for a, k in zip(self.start[:-1], self.owned, strict=True)]
        return np.concatenate(runs) if runs else np.empty(0, np.int32)


def blocked(points: Array, faces: Array, kind: int, held: Array) -> Blocks | None:
    """The blocks of a mesh in R^3; None where vertices have too many neighbours for local numbers."""
    n, faces = len(points), indices_of(faces)
    size = int(np.clip(n // SHARES, SMALLEST, LARGEST))
    count = (n + size - 1) // size
    order = near_order(points)
    block = np.empty(n, np.int32)
    block[order] = np.arange(n, dtype=np.int32) // size
    first, start = np.empty(count + 1, np.int64), np.empty(count + 1, np.int64)
    triangles = np.empty((kernels.count_blocks(faces, block, first), 3), np.uint16)
    # A block has at most its own vertices and those of its triangles; two thirds of this room are never used.
    vertices = np.empty(triangles.size + n, np.int32)
    most = kernels.number_blocks(faces, order, block, size, first, vertices, start, triangles)
    if most > np.iinfo(np.uint16).max:
        return None
    owned = np.diff(np.minimum(np.arange(count + 1) * size, n))
    return Blocks(vertices[: start[-1]].copy(), start, owned, triangles, first, kind, held)


def march_blocks(blocks: Blocks, points: Array, keep: float, dt: float, out: Array, inverse: Array | None) -> float:
    """keep X - dt M^-1 L X (n, 3) into ``out``; returns the largest cotangent, infinite where a triangle has no area.

    With keep = 1 it is an explicit step, with keep = 0 and dt = 1 the rate. ``inverse``, (n,), receives dt / M if given.
    """
    b, sharpest = blocks, np.empty(len(blocks.owned))
    kernels.march_blocks(
        b.vertices, b.start, b.owned, b.triangles, b.first, points, b.kind, b.held, keep, dt, out, inverse, sharpest
    )
    return float(sharpest.max(initial=0.0))
