"""An order of the vertices and triangles of a mesh in which neighbours are near, so that loops over them stay in the cache."""

import numpy as np

from meshflow.geometry.once import once
from meshflow.geometry.validation import Array

__all__ = ["near_order", "nearest_first"]

# Vertices above which loops run in such an order: less fit the cache in any order.
LARGE = 50_000
# Bits per coordinate of the curve along which vertices are ordered.
BITS = 10


def near_order(points: Array) -> Array:
    """The vertices (n,) in the order of a space-filling curve (Morton 1966), int32."""
    at = np.where(np.isfinite(points), points, 0.0) - np.nanmin(points, axis=0, initial=np.inf)
    widest = float(at.max(initial=0.0))
    cells = np.clip(at * ((1 << BITS) - 1) / widest if widest > 0 else at, 0, (1 << BITS) - 1).astype(np.int32)
    code = np.zeros(len(points), np.int32)
    for bit in range(BITS):
        for axis in range(3):
            code |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return np.argsort(code, kind="stable").astype(np.int32)


@once
def nearest_first(points: Array, faces: Array) -> tuple[Array | None, Array]:
    """The vertices (n,) in such an order, and the triangles (m, 3) of their places in it, themselves in the order of these; None
    and the triangles as they are where there are few.
    """
    if len(points) <= LARGE:
        return None, faces
    order = near_order(points)
    place = np.empty_like(order)
    place[order] = np.arange(len(order), dtype=order.dtype)
    placed = place[faces]
    return order, placed[np.argsort(placed.min(axis=1, initial=len(order)), kind="stable")]
