"""The data objects: a height field, an image, a range image, or a mesh."""

from meshflow.geometry.validation import Array
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage

__all__ = ["Data", "array_of"]

Data = HeightField | Image | RangeImage | Mesh


def array_of(data: Data) -> Array:
    """The array of a data object that is smoothed.

    It is z (h, w), values (h, w) or (h, w, k), depth (h, w), points (n, d) or channels (n, k); where points and channels of a
    mesh both move, the channels.
    """
    if isinstance(data, Mesh):
        return data.points if data.channels is None or data.moves == "points" else data.channels
    return data.z if isinstance(data, HeightField) else data.values if isinstance(data, Image) else data.depth
