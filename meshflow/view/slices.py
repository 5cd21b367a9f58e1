"""Bodies in pictures: the three slices of a volume through the middle, side by side, and the skin of tetrahedra."""

import numpy as np

from meshflow.geometry.validation import Array
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.tet_mesh import TetMesh
from meshflow.surfaces.volume import Volume

__all__ = ["skin_mesh", "three_slices"]

# Pixels between two slices, as a share of the widest.
GAP = 0.04


def three_slices(volume: Volume) -> Image:
    """The slices through the middle across z, y and x, from left to right, as an image whose pixels are as large as samples.

    Samples that are farther apart along one axis are repeated along it, so that all lengths are shown alike. Between the slices
    nothing is there.
    """
    least = min(volume.spacing)
    parts, gone = [], []
    for axis in range(3):
        middle = volume.missing.shape[axis] // 2
        steps = [step for i, step in enumerate(volume.spacing) if i != axis]
        for array, found in ((volume.values, parts), (volume.missing, gone)):
            found.append(_repeated(np.take(array, middle, axis=axis), steps, least))
    high = max(part.shape[0] for part in parts)
    wide = max(1, round(GAP * max(part.shape[1] for part in parts)))
    values = [_padded(part, high, wide, 0.0) for part in parts]
    missing = [_padded(part, high, wide, True) for part in gone]
    return Image(np.concatenate(values, axis=1)[:, :-wide], (least, least), np.concatenate(missing, axis=1)[:, :-wide])


def skin_mesh(body: TetMesh) -> Mesh:
    """The surface of a body, and of its holes, with its values as channels."""
    vertices, faces = np.unique(body.skin, return_inverse=True)
    values = body.values.reshape(len(body.points), -1)[vertices]
    return Mesh(body.points[vertices], faces.reshape(-1, 3), values, "channels")


def _repeated(part: Array, steps: list[float], least: float) -> Array:
    """A slice (rows, columns, ...) with its samples repeated to pixels of one size."""
    for axis, step in enumerate(steps):
        count = max(1, round(part.shape[axis] * step / least))
        part = np.take(part, np.arange(count) * part.shape[axis] // count, axis=axis)
    return part


def _padded(part: Array, high: int, wide: int, filling: float) -> Array:
    """A slice in a column of this height, in its middle, and a gap behind it."""
    above = (high - part.shape[0]) // 2
    places = [(above, high - part.shape[0] - above), (0, wide), *((0, 0),) * (part.ndim - 2)]
    return np.pad(part, places, constant_values=filling)
