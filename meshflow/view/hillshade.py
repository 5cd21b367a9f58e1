"""Shaded relief without OpenGL: grids as pictures seen from above, or from their camera."""

from collections.abc import Callable

import numpy as np

from meshflow.geometry.validation import Array
from meshflow.surfaces.image import Image
from meshflow.view.geometry import Geometry
from meshflow.view.look import Look
from meshflow.view.scale import Scale

__all__ = ["coloured", "imaged", "pictured", "shaded"]

_STONE = np.array([0.90, 0.87, 0.82])
_MISSING = np.array([0.80, 0.84, 0.88])
_AMBIENT = 0.18


def shaded(geometry: Geometry, shape: tuple[int, int], look: Look) -> Array:
    """Hillshade (h, w), NaN where there is no triangle.

    Lambert's law for one triangle of each cell, without averaging, so that noise is visible.

    :param geometry: of a grid; its faces start at the right angle and turn counter-clockwise for the viewer.
    :param shape: (h, w) of that grid.
    """
    a, b, c = geometry.points[geometry.faces].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    light = np.clip(normals @ (look.light @ geometry.view.ground) / np.where(length > 0, length, 1.0), 0.0, None)
    shade = np.full(shape, np.nan)
    corners = geometry.samples[geometry.faces]
    lower = corners[:, 1] < corners[:, 0]
    for kind in (lower, ~lower):  # the triangle to the lower right wins, where it exists
        for corner in (2, 1, 0):
            shade.ravel()[corners[kind, corner]] = light[kind]
    return shade


def pictured(geometry: Geometry, shape: tuple[int, int], look: Look) -> Array:
    """A relief as colours (h, w, 3) in uint8; missing samples in a neutral blue grey.

    Level ground has the same brightness for any altitude of the light.
    """
    shade = shaded(geometry, shape, look) * (0.62 / max(look.light[2], 0.3))
    bright = (_AMBIENT + (1 - _AMBIENT) * np.clip(shade, 0.0, 1.0))[..., None]
    return _bytes(np.where(np.isnan(bright), _MISSING, bright * _STONE))


def imaged(image: Image, step: int, shown: Callable[[Array], Array]) -> Array:
    """An image as a picture (h, w, 3) in uint8; missing samples as in :func:`pictured`.

    :param step: take every ``step``-th sample.
    :param shown: its channels as colours: :func:`meshflow.view.geometry.as_shown`.
    """
    values = image.values if image.values.ndim == 3 else image.values[..., None]
    values, missing = values[::step, ::step], image.missing[::step, ::step, None]
    return np.where(missing, _bytes(_MISSING), shown(values))


def coloured(scale: Scale) -> Array:
    """The colours (h, w, 3) in uint8 of a scale over a grid; missing samples as in :func:`pictured`."""
    share = (scale.values - scale.low) / (scale.high - scale.low)
    colours = scale.colour_map(np.clip(np.nan_to_num(share), 0.0, 1.0))[..., :3]
    return _bytes(np.where(np.isnan(scale.values)[..., None], _MISSING, colours))


def _bytes(colours: Array) -> Array:
    """Colours from 0 to 1 as uint8."""
    return np.round(255 * colours).astype(np.uint8)
