"""Grids whose rows end where they begin, around a globe or a scanner: unrolled beyond both ends, and cut back."""

from dataclasses import replace

import numpy as np

from meshflow.geometry.validation import Array
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.range_image import RangeImage
from meshflow.surfaces.scanner import Spherical

__all__ = ["Gridded", "columns_around", "cut_back", "own_samples", "period_of", "unrolled"]

Gridded = HeightField | Image | RangeImage
# Columns beyond each end, where all rows are equally wide; where they are not, half a turn, since near a pole it is a short way.
MARGIN = 128


def period_of(data: object) -> int:
    """The number of columns after which the rows of a grid repeat; 0: they have two ends."""
    if isinstance(data, (HeightField, Image)):
        return data.period if data.missing.shape[1] - data.period in (0, 1) and data.period > 1 else 0
    if isinstance(data, RangeImage) and isinstance(data.camera, Spherical):
        depth, period = data.depth, data.camera.period(data.depth.shape[1])
        same = period == depth.shape[1] or np.array_equal(depth[:, 0], depth[:, -1], equal_nan=True)
        return period if same else 0
    return 0


def own_samples(data: object) -> Array | None:
    """The samples (h, w) of an unrolled grid that are no copies of others; None of any other data."""
    if isinstance(data, (HeightField, Image)):
        period, (height, width) = data.period, data.missing.shape
    elif isinstance(data, RangeImage) and isinstance(data.camera, Spherical):
        height, width = data.depth.shape
        period = data.camera.columns_of_a_turn(width)
    else:
        return None
    if period < 2 or width <= period + 1:
        return None
    first = (width - period) // 2
    own = np.zeros((height, width), bool)
    own[:, first : first + period] = True
    return own


def columns_around(data: Gridded) -> tuple[Array, int]:
    """The columns of the unrolled grid, and how many of them are before the first.

    A column of which there is a copy at the other end of the row is taken from the beginning.
    """
    period, width = period_of(data), data.missing.shape[1]
    even = isinstance(data, RangeImage) or np.ndim(data.spacing[0]) == 0
    margin = min(period, MARGIN) if even else (period + 1) // 2
    return np.arange(-margin, width + margin) % period, margin


def unrolled(data: Gridded, columns: Array) -> Gridded:
    """The grid of these columns, which has two ends.

    :param columns: of :func:`columns_around`.
    """
    missing, fixed = np.take(data.missing, columns, axis=1), np.take(data.fixed, columns, axis=1)
    if isinstance(data, HeightField):
        z, sigma = np.take(data.z, columns, axis=1), _taken(data.sigma, columns)
        return replace(data, z=z, missing=missing, fixed=fixed, sigma=sigma)
    if isinstance(data, Image):
        return replace(data, values=np.take(data.values, columns, axis=1), missing=missing, fixed=fixed)
    camera = data.camera
    if isinstance(camera, Spherical):
        width = data.depth.shape[1]
        camera = camera.wound((len(columns) - width) // 2, width)
    depth, sigma = np.take(data.depth, columns, axis=1), _taken(data.sigma, columns)
    return replace(data, depth=depth, missing=missing, fixed=fixed, camera=camera, sigma=sigma)


def _taken(sigma: Array | float | None, columns: Array) -> Array | float | None:
    """The noise of these columns."""
    return np.take(sigma, columns, axis=1) if isinstance(sigma, np.ndarray) else sigma


def cut_back(data: Gridded, wide: object, margin: int) -> Gridded:
    """The grid with the values of the unrolled one.

    :param data: as it was before it was unrolled.
    :param wide: the unrolled grid, smoothed.
    :param margin: of :func:`columns_around`.
    :raises TypeError: for two kinds of data.
    """
    middle = np.s_[:, margin : margin + data.missing.shape[1]]
    if isinstance(data, HeightField) and isinstance(wide, HeightField):
        return replace(data, z=wide.z[middle], missing=wide.missing[middle])
    if isinstance(data, Image) and isinstance(wide, Image):
        return replace(data, values=wide.values[middle], missing=wide.missing[middle])
    if isinstance(data, RangeImage) and isinstance(wide, RangeImage):
        return replace(data, depth=wide.depth[middle], missing=wide.missing[middle])
    raise TypeError(f"cut_back: a {type(data).__name__} expected, got a {type(wide).__name__}")
