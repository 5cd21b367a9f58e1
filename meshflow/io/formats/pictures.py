"""Pictures: PNG, JPEG, BMP, WebP and TIFF with 8 or 16 bit, grey or colour, with or without alpha."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rasterio.enums import ColorInterp

from meshflow.errors import FormatError, InputError
from meshflow.geometry.validation import Array
from meshflow.io.document import Document, WriteOptions, samples_of
from meshflow.io.formats.raster_bands import load, merged, save
from meshflow.io.formats.raster_encoding import Encoding
from meshflow.io.formats.raster_frame import Frame, Framed
from meshflow.io.formats.rasters import Raster
from meshflow.io.metadata import ReadOptions
from meshflow.io.rounding import DTYPES, rounded
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image

__all__ = ["Picture", "can_write", "read", "write"]

NAME: str = "a picture"
READS: tuple[str, ...] = ("kind",)
WRITES: tuple[str, ...] = ("dtype",)

# What each driver stores unchanged: types of samples, numbers of colours, and whether it has alpha.
_ROOM = {
    ".png": ("PNG", ("uint8", "uint16"), (1, 3), True),
    ".jpg": ("JPEG", ("uint8",), (1, 3), False),
    ".jpeg": ("JPEG", ("uint8",), (1, 3), False),
    ".bmp": ("BMP", ("uint8",), (1, 3), False),
    ".webp": ("WEBP", ("uint8",), (3,), True),
    ".tif": ("GTiff", DTYPES, None, True),
    ".tiff": ("GTiff", DTYPES, None, True),
}
# The share of zeros, and that of the median below which there is nothing else, by which depths are told from grey values.
_HOLES, _NEAREST = 0.002, 0.05
_CREATION: dict[str, dict[str, str | int | bool]] = {
    "JPEG": {"quality": 95},
    "WEBP": {"lossless": True, "exact": True},
    "GTiff": {"compress": "deflate", "bigtiff": "IF_SAFER"},
}


@dataclass(frozen=True, eq=False)
class Picture(Framed):
    """A picture that was read."""


def read(path: Path, options: ReadOptions) -> Document:
    """Read a picture, values as stored: 0 to 255, or 0 to 65535.

    A palette is expanded. Alpha is kept unchanged; fully transparent samples are missing.

    :param options: ``kind``: ``image``, or ``terrain`` for a grey picture whose values are heights.
    :raises FormatError: when the file cannot be read.
    :raises InputError: for a terrain in colour, and for grey values that look like depths if nobody says what they are.
    """
    kind = options.kind
    if kind not in (None, "image", "terrain"):
        raise InputError(f"{path.name}: a picture is an image or a terrain, got kind={kind!r}")
    values, frame = load(path)
    notes: tuple[str, ...] = ()
    if frame.palette is not None:
        values, frame = _expanded(values, frame, frame.palette)
        notes = ("the palette was expanded to colours",)
    missing: Array = np.any(frame.gone, axis=0)
    if kind is None and len(values) == 1 and frame.dtype in ("uint16", "int16"):
        _must_not_be_depths(values[0], path)
        notes += ("grey of 16 bit is taken as an image; if these are depths, name their camera (camera=)",)
    if kind == "terrain":
        if len(values) > 1:
            raise InputError(f"{path.name}: a grey picture expected as a terrain, got {len(values)} colours")
        return Document(HeightField(values[0], missing=missing), path, Picture(frame), notes)
    channels = values[0] if len(values) == 1 else np.moveaxis(values, 0, 2)
    return Document(Image(channels, missing=missing), path, Picture(frame), notes)


def _must_not_be_depths(grey: Array, path: Path) -> None:
    """Ask what a grey picture of 16 bit is that has holes as depth images have: zeros, and nothing that is nearly black.

    :raises InputError: with the two answers.
    """
    holes = int((grey == 0).sum())
    if holes < _HOLES * grey.size or holes == grey.size:
        return
    there = grey[grey > 0]
    least = float(there.min())
    if least < _NEAREST * float(np.median(there)):
        return
    raise InputError(
        f"{path.name}: grey of 16 bit with {holes} holes (0) and nothing between them and {least:g}, as depth images have; name "
        "its camera (camera='tum', or a file), or say that it is a picture (kind='image')"
    )


def can_write(document: Document, suffix: str) -> bool:
    """Whether it is an image without georeference; :mod:`.rasters` writes the others."""
    return isinstance(document.data, Image) and suffix in _ROOM and not isinstance(document.source, Raster)


def must_fit(document: Document, path: Path, options: WriteOptions) -> None:
    """Refuse a number type or a count of colours that the extension does not hold.

    :raises FormatError: naming those that it holds.
    """
    values, frame = merged(document.source, samples_of(document))
    _driver, dtypes, counts, _room = _ROOM[path.suffix.lower()]
    kind = _stored(frame, options)
    if kind not in dtypes:
        raise FormatError(
            f"{path.name}: {' or '.join(dtypes)} fits into {path.suffix}, got {kind}; give it as dtype= "
            "(values are rounded and clipped, not stretched), or write .tif or .npy"
        )
    if counts is not None and len(values) not in counts:
        raise FormatError(
            f"{path.name}: {' or '.join(map(str, counts))} colours fit into {path.suffix}, got {len(values)}; "
            "write .tif or .npy"
        )


def _stored(frame: Frame, options: WriteOptions) -> str:
    """The number type that samples are stored in: that of the file, where nobody gives one."""
    return frame.dtype if options.dtype in (None, "source") else str(options.dtype)


def write(document: Document, path: Path, options: WriteOptions) -> tuple[str, ...]:
    """Write a picture, rounded and clipped to the type of the one that was read.

    :param options: tags are kept in TIFF only; ``dtype``: ``uint8``, ``uint16``, or ``float32`` (TIFF only), instead of that
        type.
    :returns: notes on clipped samples, and on lost alpha.
    :raises FormatError: when the format does not hold the picture, or the file cannot be written.
    """
    must_fit(document, path, options)
    values, frame = merged(document.source, samples_of(document))
    driver, _dtypes, _counts, room = _ROOM[path.suffix.lower()]
    kind = _stored(frame, options)
    notes: tuple[str, ...] = ()
    if frame.alpha is not None and not room:
        frame = replace(frame, alpha=None)
        notes += (f"{path.suffix} has no room for alpha: it is lost",)
    if kind not in ("float32", "float64") and not np.isfinite(values).all():
        notes += (f"{int((~np.isfinite(values)).sum())} missing samples (NaN) became 0",)
    samples, clipped = rounded(values, frame.gone, np.dtype(kind))
    encoding = Encoding(driver, frame.nodata, _CREATION.get(driver, {}))
    save(samples, _coloured(frame, len(values)), path, encoding, options.tags if driver == "GTiff" else {})
    return notes + clipped


def _expanded(values: Array, frame: Frame, palette: Array) -> tuple[Array, Frame]:
    """Colours (1 or 3, h, w) for the indices of a palette, and its alpha, if any."""
    picture = palette[values[0].astype(int)]
    grey = bool((picture[..., :1] == picture[..., 1:3]).all())
    alpha = picture[..., 3]
    colours = np.moveaxis(picture[..., : 1 if grey else 3], 2, 0).astype(values.dtype)
    gone = np.broadcast_to(alpha == 0, colours.shape)
    return colours, Frame(
        "uint8",
        gone,
        alpha=None if (alpha == 255).all() else alpha,
        transform=frame.transform,
        crs=frame.crs,
        tags=frame.tags,
    )


def _coloured(frame: Frame, count: int) -> Frame:
    """The frame with named colours, where the file does not name them."""
    if frame.colours or count not in (1, 3):
        return frame
    rgb = (ColorInterp.red, ColorInterp.green, ColorInterp.blue)
    return replace(frame, colours=rgb if count == 3 else (ColorInterp.gray,))
