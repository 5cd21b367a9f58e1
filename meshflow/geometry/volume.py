"""The volume that triangles enclose."""

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array

__all__ = ["is_closed", "volume", "volume_gradient", "volume_shares"]


def volume(points: Array, faces: Array) -> float:
    """The volume of a closed mesh, in cubed unit of the points; negative where its normals point inwards.

    :param points: (n, 3).
    :param faces: (m, 3).
    :raises InputError: when the points are not in R^3, or the mesh is not closed (see :func:`is_closed`).
    """
    if np.ndim(points) != 2 or np.shape(points)[1] != 3:
        raise InputError(f"volume: points (n, 3) expected, got shape {np.shape(points)}")
    if not is_closed(faces):
        raise InputError(
            "volume: a closed mesh expected, got one with a border or with triangles of opposite orientation"
        )
    return float(volume_shares(points, faces).sum() / 6.0)


def volume_shares(points: Array, faces: Array) -> Array:
    """Six times the volume (m,) between each triangle and the centre of the points (n, 3); of a closed surface the sum is six
    times its volume.
    """
    # Relative to the centre of the mesh, so that large coordinates of a map cost no digits of the volume.
    a, b, c = np.moveaxis((points - np.mean(points, axis=0, dtype=np.float64))[faces], 1, 0)
    return np.einsum("ij,ij->i", a, np.cross(b, c))


def is_closed(faces: Array) -> bool:
    """Whether triangles (m, 3) form a closed surface: each edge occurs once in each direction."""
    faces = np.asarray(faces)
    if len(faces) == 0:
        return False
    tails, heads = faces.ravel().astype(np.int64), np.roll(faces, -1, axis=1).ravel().astype(np.int64)
    size = int(faces.max()) + 1
    there, back = np.sort(tails * size + heads), np.sort(heads * size + tails)
    return bool((np.diff(there) > 0).all() and np.array_equal(there, back))


def volume_gradient(points: Array, faces: Array) -> Array:
    """The gradient (n, 3) of the volume, in squared unit of the points: a third of the area vectors around each point."""
    a, b, c = np.moveaxis((points - points.mean(axis=0))[faces], 1, 0)
    pulls = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1) / 6.0
    flat = faces.ravel()
    return np.stack([np.bincount(flat, part, len(points)) for part in pulls.reshape(-1, 3).T], axis=1)
