"""Depth images with a camera: whole numbers in a PNG, metres in a TIFF."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from meshflow.errors import FormatError, InputError
from meshflow.geometry.validation import Array, positive
from meshflow.io.depth_units import LARGEST, default_units, in_metres
from meshflow.io.document import Document, WriteOptions, depths_of
from meshflow.io.formats.cameras import calibration_for
from meshflow.io.formats.raster_bands import load, merged, save
from meshflow.io.formats.raster_encoding import Encoding
from meshflow.io.formats.raster_frame import Framed
from meshflow.io.metadata import ReadOptions
from meshflow.surfaces.range_image import RangeImage

__all__ = ["can_write", "read", "write"]

NAME: str = "a depth image"
READS: tuple[str, ...] = ("kind", "camera", "depth_scale", "measure", "time_unit", "jump")
WRITES: tuple[str, ...] = ("depth_scale", "left")

# A rounding error of this share of the noise increases the noise by an eighth.
ADDS = 0.5


@dataclass(frozen=True, eq=False)
class Depths(Framed):
    """What a depth image contains besides metres; the frame is that of its only band.

    :param scale: units per metre.
    :param whole: whether it holds whole numbers.
    :param raw: (h, w), the numbers as stored; those of missing samples are written again.
    """

    scale: float
    whole: bool
    raw: Array


def read(path: Path, options: ReadOptions) -> Document:
    """Read a depth image, in metres.

    0 is missing, and in whole numbers 65535 too.

    :param options: ``camera``, a :class:`Pinhole` or another one, the name of a convention, or the path of a file: what
        :func:`meshflow.io.formats.cameras.read_camera` reads. ``depth_scale``, units per metre: by default that of the
        camera, else 1000 for whole numbers (millimetres) and 1 for floating point. ``measure``, by default the usual one of the
        camera. ``time_unit`` and ``jump`` as in :class:`RangeImage`.
    :raises FormatError: when the file cannot be read, has no depths of 16 bit or floating point, or has rotated bits.
    :raises InputError: without a camera, or with one of an image of another size.
    """
    if options.kind not in (None, "depth"):
        raise InputError(
            f"{path.name}: a depth image expected, got kind={options.kind!r}; leave the camera out to read something else"
        )
    values, frame = load(path)
    if len(values) != 1 or frame.palette is not None or frame.dtype not in ("uint16", "int16", "float32", "float64"):
        raise FormatError(
            f"{path.name}: one band of 16 bit or floating point expected in a depth image, got {len(values)} of "
            f"{frame.dtype}; a picture in 8 bit or colour shows depths, it does not hold them"
        )
    calibration = calibration_for(options.camera, (values.shape[1], values.shape[2]), path.name)
    whole = not frame.dtype.startswith("float")
    raw = values[0].astype(frame.dtype) if whole and not frame.scaled else values[0]
    found = in_metres(raw, calibration, options.depth_scale, path.name)
    data = RangeImage(
        found.depth,
        calibration.camera,
        found.missing | frame.gone[0],
        jump=options.jump,
        measure=options.measure,
        time_unit=options.time_unit or "footprint",
        unit="m",
    )
    return Document(data, path, Depths(frame, found.units, whole, values[0]), found.notes)


def can_write(document: Document, suffix: str) -> bool:
    """Whether it is a range image and the file a PNG or a TIFF."""
    return isinstance(document.data, RangeImage) and suffix in (".png", ".tif", ".tiff")


def write(document: Document, path: Path, options: WriteOptions) -> tuple[str, ...]:
    """Write depths: ``.png`` rounded to whole numbers of 16 bit, ``.tif`` exactly, as metres with nodata 0.

    Missing samples keep their stored number (0, 65535 or NaN), or become 0 in another format.

    :param options: ``depth_scale``, units per metre of the file: by default that of the file that was read, else 1000
        in a PNG and 1 in a TIFF. ``left``, standard deviation of the noise left in the depths, metres, with which rounding is
        compared; None: not known, then rounding is compared with the change since the file was read.
    :returns: notes on the rounding error in millimetres, where it is half a millimetre or more, or large beside the noise.
    :raises FormatError: when the file cannot be written, or 0 would be a valid depth.
    """
    about = document.source if isinstance(document.source, Depths) else None
    data, left = depths_of(document), options.left
    values, frame = merged(document.source, data)
    missing = np.asarray(data.missing)
    if data.camera.signed:
        raise FormatError(
            f"{path.name}: values that count from a point of each sample's own may be 0, which a depth image keeps for what is "
            "missing; write .ply or .npy"
        )
    whole = path.suffix.lower() == ".png"
    same = about is not None and about.whole == whole
    default = about.scale if about is not None and same else default_units(whole)
    scale = positive(default if options.depth_scale is None else options.depth_scale, "depth_scale", "units per metre")
    counts = values[0] * np.float64(scale)
    if whole:
        kept = _missing_as_read(about.raw, values[0]) if about is not None and same else 0
        changed = None if about is None else (values[0] - about.raw / about.scale)[~missing] * scale
        counts = np.rint(np.where(missing, 1, counts))
        samples = np.where(missing, kept, counts.clip(1, LARGEST - 1)).astype(np.uint16)
        save(samples[None], frame.bare(), path, Encoding("PNG"), {})
        much = None if changed is None else float(np.sqrt(np.mean(np.square(changed))))
        return _cost(counts, scale, much, None if left is None else left * scale)
    samples = np.where(missing, np.where(np.isnan(values[0]), np.nan, 0), counts).astype(values.dtype)
    creation = {"compress": "deflate", "predictor": 2, "bigtiff": "IF_SAFER"}
    save(
        samples[None], replace(frame.without_scale(), alpha=None), path, Encoding("GTiff", 0.0, creation), options.tags
    )
    return ()


def _missing_as_read(raw: Array, depth: Array) -> Array:
    """The numbers written for missing samples: those that were read, but 0 where a depth was dropped."""
    return np.where((depth == 0) & (raw < LARGEST), 0, raw)


def _cost(counts: Array, scale: float, changed: float | None, left: float | None) -> tuple[str, ...]:
    """Notes on rounding; ``changed`` is the rms change since the file was read, ``left`` the noise, in units of the file."""
    notes: tuple[str, ...] = ()
    error = 1 / np.sqrt(12.0)
    if left is not None and (changed is None or changed > 1e-3) and error > ADDS * left:
        finer = f" or a depth_scale of {10 ** np.ceil(np.log10(scale * error / (ADDS * left))):g}" if left > 0 else ""
        notes += (
            f"rounding to {1000 / scale:g} mm errs by {1000 * error / scale:.2g} mm (rms): the {1000 * left / scale:.2g} mm "
            f"of noise that are left become {1000 * np.hypot(error, left) / scale:.2g} mm; "
            f"write .tif, .npy or .exr, which hold float32{finer}",
        )
    elif left is None and changed is not None and 1e-3 < changed < 1:
        notes += (
            f"depths changed by {changed * 1000 / scale:.3g} mm (rms), less than the steps of {1000 / scale:g} mm that they are "
            "rounded to; .tif holds them, or a larger depth_scale",
        )
    if scale <= 1000 and not notes:
        notes += (f"depths are rounded to {1000 / scale:g} mm, up to {500 / scale:g} mm off; .tif holds them exactly",)
    outside = int(((counts < 1) | (counts >= LARGEST)).sum())
    if outside:
        notes += (
            f"{outside} depths do not fit into 16 bit at {scale:g} units per metre and were clipped; "
            "give another depth_scale, or .tif",
        )
    return notes
