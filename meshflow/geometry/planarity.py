"""Edges across which a mesh is flat to the rounding of its numbers: how shapes are drawn, and no noisy surface looks."""

import numpy as np

from meshflow.geometry.connectivity import shared_sides
from meshflow.geometry.normals import measured
from meshflow.geometry.validation import Array

__all__ = ["beside_flat_edges"]

# Units in the last place of single precision, of the largest coordinate, by which drawn points are off.
ROUNDING = 4.0 * float(np.finfo(np.float32).eps)


def beside_flat_edges(points: Array, faces: Array) -> Array:
    """The vertices (n,) of two triangles that lie in one plane to rounding.

    The corner beyond an edge may be off the plane of the triangle by the rounding of single precision, carried along the plane
    as far as that corner lies: thin triangles say little of their plane. On a mesh that was drawn (planes, and cylinders, cones
    and balls in strips of quadrilaterals) all vertices but a few are such; of a measured one hardly any is.

    :param points: (n, 3), float64.
    """
    one, other = shared_sides(faces)
    triangle = one // 3
    start, end = (faces[triangle, (one + turn) % 3] for turn in (1, 2))
    here, beyond = faces.ravel()[one], faces.ravel()[other]
    normals, areas = measured(points, faces)
    edge = np.linalg.norm(points[end] - points[start], axis=1)
    height = np.divide(2.0 * areas[triangle], edge, out=np.zeros_like(edge), where=edge > 0)
    way = points[beyond] - points[start]
    off = np.abs(np.einsum("ij,ij->i", way, normals[triangle]))
    far = np.divide(np.linalg.norm(way, axis=1), height, out=np.full_like(edge, np.inf), where=height > 0)
    used = points[np.unique(faces)]
    single = np.array_equal(used, used.astype(np.float32))  # then that is how they were stored, wherever they lie
    size = float(np.abs(used if single else used - used.mean(axis=0)).max(initial=0.0))
    flat = off <= ROUNDING * size * (1.0 + far)
    found = np.zeros(len(points), bool)
    for corner in (start, end, here, beyond):
        found[corner[flat]] = True
    return found
