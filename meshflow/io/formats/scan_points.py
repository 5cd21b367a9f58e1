"""Points of a scanner that lie on a grid, as a range image along their lines of sight."""

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array
from meshflow.io.metadata import ReadOptions
from meshflow.surfaces.range_image import RangeImage
from meshflow.surfaces.scanner import Scanner

__all__ = ["ALONG", "range_image_of"]

# A scanner whose position is not known looks along -z, as one of Cyberware does.
ALONG = (0.0, 0.0, -1.0)


def range_image_of(points: Array, eye: Array | None, options: ReadOptions, name: str) -> RangeImage:
    """The range image of points on a grid, in their unit.

    :param points: (h, w, 3), NaN where a sample is missing.
    :param eye: (3,), the position of the scanner: values are distances from it. None: lines of sight are parallel to z, and
        values are -z.
    :param options: ``jump`` and ``time_unit``.
    :param name: of the file, for the messages.
    :raises InputError: where the scanner stands at one of its points.
    """
    missing = np.asarray(~np.isfinite(points).all(axis=-1))
    if eye is None:
        along = np.broadcast_to(ALONG, points.shape)
        values = points @ np.array(ALONG)
        camera = Scanner(along, points - values[..., None] * along)
    else:
        values = np.linalg.norm(points - eye, axis=2)
        if (values == 0).any():
            raise InputError(
                f"{name}: viewpoint {tuple(map(float, eye))} is a point of the scan; it is where the scanner stood"
            )
        camera = Scanner(points - eye, eye)
    return RangeImage(values, camera, missing, jump=options.jump, time_unit=options.time_unit or "footprint")
