"""Imports pictures of Pillow: grey, RGB and RGBA, of 8, 16 and 32 bits."""

from functools import partial

import numpy as np
from PIL.Image import Image as Picture
from PIL.Image import frombytes

from meshflow.errors import InputError
from meshflow.geometry.validation import Array
from meshflow.io.document import Imported
from meshflow.io.metadata import ReadOptions
from meshflow.io.rounding import rounded
from meshflow.surfaces.image import Image

__all__ = ["from_object"]

# Modes whose numbers are intensities; how many of their channels are smoothed, the others are transparency.
COLOURS = {"L": 1, "LA": 1, "RGB": 3, "RGBA": 3, "I;16": 1, "I;16L": 1, "I;16B": 1, "I": 1, "F": 1}


def from_object(data: object, options: ReadOptions) -> Imported:
    """Import a picture; results are new ones of the same mode, size and metadata, rounded where the mode holds whole numbers.

    Transparency is kept and not smoothed.

    :param options: ``kind`` (image), ``missing``.
    :raises InputError: for a palette, two levels, and colours of other models, with what to convert to.
    """
    if not isinstance(data, Picture):
        raise InputError(f"an image of Pillow expected, got {type(data).__name__}")
    options.must_belong("a picture of Pillow", ("kind", "missing", "nodata"))
    if options.kind not in (None, "image"):
        raise InputError(
            f"kind={options.kind!r}: a picture of Pillow is an image; give numpy.asarray(picture) otherwise"
        )
    if data.mode not in COLOURS:
        raise InputError(f"a picture of mode {data.mode!r}: grey or RGB expected; give picture.convert('RGB')")
    stored = np.asarray(data)
    values = _smoothed(stored, data.mode)
    declared = options.missing_in(values)
    image = Image(values) if declared is None else Image(values, missing=declared)
    return Imported(image, partial(_to_object, data, stored))


def _smoothed(stored: Array, mode: str) -> Array:
    """The channels that are smoothed, (h, w) or (h, w, 3)."""
    if stored.ndim == 2:
        return stored
    return stored[..., 0] if COLOURS[mode] == 1 else stored[..., : COLOURS[mode]]


def _to_object(source: Picture, stored: Array, image: Image) -> Picture:
    """A picture of the smoothed values."""
    values = image.values if stored.ndim == 2 else image.values.reshape(*stored.shape[:2], -1)
    gone = np.broadcast_to(image.missing if values.ndim == 2 else image.missing[..., None], values.shape)
    whole, _ = rounded(values, gone, stored.dtype)
    samples = stored.copy()
    if stored.ndim == 2:
        samples[...] = np.where(gone, stored, whole)
    else:
        count = whole.shape[2]
        samples[..., :count] = np.where(gone, stored[..., :count], whole)
    made = frombytes(source.mode, source.size, np.ascontiguousarray(samples).tobytes())
    made.info = dict(source.info)
    return made
