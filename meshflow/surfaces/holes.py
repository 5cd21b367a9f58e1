"""Which samples of a grid are missing."""

import numpy as np

from meshflow.geometry.validation import Array
from meshflow.surfaces.lift import HeightField, Image, RangeImage

__all__ = ["holes"]


def holes(grid: HeightField | Image | RangeImage) -> Array:
    """The mask (h, w) of the samples that are missing.

    :param grid: a height field, an image or a range image.
    """
    if grid.missing is not None:
        return grid.missing
    values = grid.z if isinstance(grid, HeightField) else grid.depth if isinstance(grid, RangeImage) else grid.values
    return np.zeros(values.shape[:2], bool)
