"""Depth images: whole numbers in a PNG, metres in a TIFF; a camera tells what they see."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from meshflow.errors import FormatError, InputError
from meshflow.geometry.camera import Pinhole
from meshflow.geometry.gates import Array, positive
from meshflow.geometry.lift import RangeImage
from meshflow.io.bands import Frame, load, merged, save
from meshflow.io.cameras import camera_for
from meshflow.io.files import Document, Kind

__all__ = ["read", "write"]

_LARGEST = 65535  # missing, as 0 is: some cameras write the one, some the other


@dataclass(frozen=True, eq=False)
class Depths:
    """What a depth image held besides metres.

    :param frame: of its one band.
    :param scale: units per metre.
    :param whole: whether it holds whole numbers.
    :param raw: (h, w), the numbers as stored, of which the missing ones are written again.
    """

    frame: Frame
    scale: float
    whole: bool
    raw: Array


def read(
    path: Path,
    *,
    kind: Kind | None = None,
    camera: Pinhole | str | Path | None = None,
    depth_scale: float | None = None,
    jump: float | None = 0.05,
) -> Document:
    """Read a depth image: depths along the optical axis, in metres.

    0 is missing, and in whole numbers 65535 too.

    :param camera: a :class:`Pinhole`, or the path of its JSON (see :func:`meshflow.io.cameras.camera_for`).
    :param depth_scale: units per metre; by default 1000 for whole numbers (millimetres) and 1 for floating point.
    :param jump: no triangle where depths differ by more than this share of the nearest; None: no limit.
    :raises FormatError: when the file cannot be read, or holds no depths of 16 bit or floating point.
    :raises InputError: without a camera, or with one of an image of another size.
    """
    if kind not in (None, "depth"):
        raise InputError(
            f"{path.name}: a depth image expected, got kind={kind!r}; leave the camera out to read something else"
        )
    values, frame = load(path)
    if len(values) != 1 or frame.palette is not None or frame.dtype not in ("uint16", "int16", "float32", "float64"):
        raise FormatError(
            f"{path.name}: one band of 16 bit or floating point expected in a depth image, got {len(values)} of "
            f"{frame.dtype}; a picture in 8 bit or colour shows depths, it does not hold them"
        )
    pinhole = camera_for(camera, values.shape[1:], path.name)
    whole = not frame.dtype.startswith("float")
    scale = positive(_scale(whole) if depth_scale is None else depth_scale, "depth_scale", "units per metre")
    missing = frame.gone[0] | (values[0] == 0)
    if whole:
        missing |= values[0] == _LARGEST
    depth = (values[0] / scale).astype(values.dtype)
    noun = RangeImage(depth, pinhole, missing, jump=jump)
    notes = () if scale == 1.0 else (f"depths of {scale:g} units per metre are taken, and told, in metres",)
    return Document(noun, "depth", path, Depths(frame, scale, whole, values[0]), "depths", notes)


def write(
    document: Document, path: Path, *, tags: Mapping[str, str], depth_scale: float | None = None
) -> tuple[str, ...]:
    """Write depths: ``.png`` rounded to whole numbers of 16 bit, ``.tif`` exactly, as metres with nodata 0.

    Missing samples come out as they came in, 0 or 65535 or NaN, or as 0 where the format is another.

    :param depth_scale: units per metre of the file; by default as it was read, 1000 in a PNG and 1 in a TIFF where it was not.
    :returns: a note of what rounding costs, in millimetres, where that is half a millimetre or more.
    :raises FormatError: when the file cannot be written.
    """
    about = document.about if isinstance(document.about, Depths) else None
    values, frame = merged(about.frame if about else document.about, document.noun)
    assert isinstance(document.noun, RangeImage)
    assert document.noun.missing is not None
    missing = document.noun.missing
    whole = path.suffix.lower() == ".png"
    same = about is not None and about.whole == whole
    default = about.scale if about is not None and same else _scale(whole)
    scale = positive(default if depth_scale is None else depth_scale, "depth_scale", "units per metre")
    counts = values[0] * np.float64(scale)
    if whole:
        kept = about.raw if about is not None and same else 0
        counts = np.rint(np.where(missing, 1, counts))
        samples = np.where(missing, kept, counts.clip(1, _LARGEST - 1)).astype(np.uint16)
        save(samples[None], frame.bare(), path, driver="PNG", nodata=None, tags={})
        return _cost(counts, scale)
    samples = np.where(missing, np.where(np.isnan(values[0]), np.nan, 0), counts).astype(values.dtype)
    save(
        samples[None],
        replace(frame.without_scale(), alpha=None),
        path,
        driver="GTiff",
        nodata=0.0,
        tags=tags,
        compress="deflate",
        predictor=3,
        bigtiff="IF_SAFER",
    )
    return ()


def _scale(whole: bool) -> float:
    return 1000.0 if whole else 1.0


def _cost(counts: Array, scale: float) -> tuple[str, ...]:
    notes: tuple[str, ...] = ()
    if scale <= 1000:
        notes += (f"depths are rounded to {1000 / scale:g} mm, up to {500 / scale:g} mm off; .tif holds them exactly",)
    outside = int(((counts < 1) | (counts >= _LARGEST)).sum())
    if outside:
        notes += (
            f"{outside} depths do not fit into 16 bit at {scale:g} units per metre and were clipped; "
            "give another depth_scale, or .tif",
        )
    return notes
