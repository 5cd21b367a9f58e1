"""The data objects: a height field, an image, a range image, or a mesh."""

from meshflow.geometry.validation import Array
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage

__all__ = ["Noun", "data_of"]

Noun = HeightField | Image | RangeImage | Mesh


def data_of(noun: Noun) -> Array:
    """What of a noun is smoothed, as its caller knows it: z (h, w), values (h, w) or (h, w, k), depth (h, w), points (n, d) or
    channels (n, k); of a mesh of which both move, the channels.
    """
    if isinstance(noun, Mesh):
        return noun.points if noun.channels is None or noun.moves == "points" else noun.channels
    return noun.z if isinstance(noun, HeightField) else noun.values if isinstance(noun, Image) else noun.depth
