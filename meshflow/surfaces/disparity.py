"""Range images as height fields of inverse depths over the pixels of a pinhole, and back."""

from dataclasses import replace

import numpy as np

from meshflow.errors import InputError
from meshflow.surfaces.camera import Pinhole
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.range_image import RangeImage

__all__ = ["from_disparity", "has_disparity", "in_disparity"]


def has_disparity(image: RangeImage) -> bool:
    """Whether planes stay planes in inverse depths: for depths of a pinhole without distortion."""
    return isinstance(image.camera, Pinhole) and not image.camera.distortion and image.measure == "depth"


def in_disparity(image: RangeImage) -> HeightField:
    """Inverse depths of a pinhole without distortion, as a height field over the pixels; planes stay planes.

    It suits sensors that measure disparity: the noise of the depth grows with the square of the depth, while the noise of the
    inverse depth, and hence the right contrast, is the same everywhere.

    :returns: 1 / depth over pixels of width 1 (and height fx / fy), cut where the depth jumps.
    :raises InputError: for another camera, or ranges, for which planes do not stay planes.
    """
    camera = image.camera
    if not isinstance(camera, Pinhole) or not has_disparity(image):
        raise InputError(
            f"domain='disparity': depths of a pinhole without distortion expected, since only there planes stay planes; got "
            f"{image.measure}s of {type(camera).__name__} ({camera.summary}); undistort the image, or leave the domain out"
        )
    missing = image.missing
    whole = np.where(missing, 1.0, image.depth)
    sides = float(np.sqrt(camera.fy / camera.fx)), float(np.sqrt(camera.fx / camera.fy))
    inverse = np.where(missing, 0.0, 1.0 / whole).astype(image.depth.dtype)
    unit = f"1/{image.unit}" if image.unit else "1 / depth"
    return HeightField(inverse, sides, missing, image.fixed, unit, image.cuts)


def from_disparity(image: RangeImage, field: HeightField) -> RangeImage:
    """Depths from inverse depths; unchanged and missing samples keep the depth of ``image``.

    :raises InputError: where an inverse depth is zero or negative, which is no finite depth.
    """
    before = in_disparity(image)
    still = image.missing | (field.z == before.z)
    if (field.z[~still] <= 0).any():
        raise InputError(
            f"domain='disparity': {int((field.z[~still] <= 0).sum())} inverse depths are no longer above zero; give MaxChange"
        )
    return replace(
        image, depth=np.where(still, image.depth, 1.0 / np.where(still, 1.0, field.z)).astype(image.depth.dtype)
    )
