"""Edges across which a mesh is flat up to rounding, which occur in designed shapes, but not in noisy surfaces."""

import numpy as np

from meshflow.geometry.connectivity import shared_sides
from meshflow.geometry.normals import measured
from meshflow.geometry.validation import Array

__all__ = ["beside_flat_edges"]

# The rounding error of designed points relative to the largest coordinate, some units in the last place of single precision.
ROUNDING = 4.0 * float(np.finfo(np.float32).eps)


def beside_flat_edges(points: Array, faces: Array) -> Array:
    """Mask (n,) of the vertices of two neighbouring triangles that are coplanar up to rounding.

    The tolerance is the rounding error of single precision, extrapolated along the plane of a triangle to the opposite corner
    of its neighbour, because the plane of a thin triangle is uncertain. In designed meshes (planes; cylinders, cones and balls
    as strips of quadrilaterals) these are almost all vertices, in measured ones hardly any.

    :param points: (n, 3), float64.
    """
    one, other = shared_sides(faces)
    triangle = one // 3
    start, end = (faces[triangle, (one + turn) % 3] for turn in (1, 2))
    here, beyond = faces.ravel()[one], faces.ravel()[other]
    normals, areas = measured(points, faces)
    edge = np.linalg.norm(points[end] - points[start], axis=1)
    height = np.divide(2.0 * areas[triangle], edge, out=np.zeros_like(edge), where=edge > 0)
    offset = points[beyond] - points[start]
    off = np.abs(np.einsum("ij,ij->i", offset, normals[triangle]))
    far = np.divide(np.linalg.norm(offset, axis=1), height, out=np.full_like(edge, np.inf), where=height > 0)
    used = points[np.unique(faces)]
    single = np.array_equal(used, used.astype(np.float32))  # stored in single precision
    size = float(np.abs(used if single else used - used.mean(axis=0)).max(initial=0.0))
    flat = off <= ROUNDING * size * (1.0 + far)
    found = np.zeros(len(points), bool)
    for corner in (start, end, here, beyond):
        found[corner[flat]] = True
    return found
