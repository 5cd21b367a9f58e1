"""Depth images of renderers: OpenEXR, floating point, with the depth in the channel Z."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshflow.errors import FormatError, InputError, need
from meshflow.geometry.validation import Array
from meshflow.io.atomic_write import beside
from meshflow.io.depth_units import in_metres
from meshflow.io.document import Document, Source, WriteOptions, depths_of
from meshflow.io.formats.cameras import calibration_for
from meshflow.io.metadata import ReadOptions
from meshflow.surfaces.range_image import RangeImage

__all__ = ["can_write", "read", "write"]

NAME: str = "an EXR"
READS: tuple[str, ...] = ("kind", "camera", "depth_scale", "measure", "time_unit", "jump")
WRITES: tuple[str, ...] = ("depth_scale",)

# The least value that means that a ray meets nothing (Blender writes 1e10), in the unit of the file.
NOTHING = 1e9
# Attributes of the header that follow from the channels and their storage.
_OF_STORAGE = frozenset({"channels", "chunkCount", "tiles", "type", "version", "name"})


@dataclass(frozen=True, eq=False)
class Layers(Source):
    """What an EXR contains besides the depths.

    :param header: its attributes.
    :param others: all channels by name, including the depths, ``name``, as they were read.
    :param scale: units per metre.
    """

    header: Mapping[str, object]
    others: Mapping[str, Array]
    name: str
    scale: float


def read(path: Path, options: ReadOptions) -> Document:
    """Read the depths of an EXR in metres, from its channel Z, Y, the one whose last part is Z, or its only channel.

    0, NaN, infinity, and values of 1e9 and more (rays that meet nothing) are missing.

    :param options: as in :func:`meshflow.io.formats.depth_images.read`.
    :raises MissingPackage: without OpenEXR.
    :raises FormatError: when the file cannot be read, or has no such channel.
    :raises InputError: without a camera, or with one of an image of another size.
    """
    if options.kind not in (None, "depth"):
        raise InputError(f"{path.name}: an EXR is read as a depth image, got kind={options.kind!r}; leave it out")
    header, channels = _loaded(path)
    name = _depth_of(path, channels)
    raw = channels[name]
    calibration = calibration_for(options.camera, (raw.shape[0], raw.shape[1]), path.name)
    values = raw.astype(np.float32) if raw.dtype == np.float16 else raw
    near = np.where(values < NOTHING, values, values.dtype.type(0))
    found = in_metres(near, calibration, options.depth_scale, path.name)
    notes = found.notes
    if raw.dtype == np.float16:
        step = float(np.spacing(np.float16(np.median(raw[~found.missing])))) / found.units
        notes += (f"its depths are of half precision: steps of {1000 * step:.3g} mm in the middle of the scene",)
    data = RangeImage(
        found.depth,
        calibration.camera,
        found.missing,
        jump=options.jump,
        measure=options.measure,
        time_unit=options.time_unit or "footprint",
        unit="m",
    )
    return Document(data, path, Layers(header, channels, name, found.units), notes)


def can_write(document: Document, suffix: str) -> bool:
    """Whether it is a range image and the file an EXR."""
    return isinstance(document.data, RangeImage) and suffix == ".exr"


def write(document: Document, path: Path, options: WriteOptions) -> tuple[str, ...]:
    """Write depths in float32; an EXR that was read keeps its other channels and attributes.

    Missing samples keep their stored value, or become 0 if they came from another format.

    :param options: tags are kept as attributes; ``depth_scale``, units per metre, by default as in the file read, else 1.
    :raises MissingPackage: without OpenEXR.
    :raises FormatError: where 0 would be a valid depth, or the file cannot be written.
    """
    exr, data = need("OpenEXR", "exr"), depths_of(document)
    if data.camera.signed:
        raise FormatError(
            f"{path.name}: values that count from a point of each sample's own may be 0, which a depth image keeps for what is "
            "missing; write .ply or .npy"
        )
    about = document.source if isinstance(document.source, Layers) else Layers({}, {}, "Z", 1.0)
    scale = about.scale if options.depth_scale is None else options.depth_scale
    raw = about.others.get(about.name)
    gone = np.zeros(data.depth.shape, np.float32) if raw is None else raw
    missing = np.asarray(data.missing)
    if raw is not None:  # samples that were dropped are written as missing
        gone = np.where(missing & (data.depth == 0) & (raw > 0) & (raw < NOTHING), 0, raw)
    z = np.where(missing, gone, data.depth * np.float64(scale)).astype(np.float32)
    header = {key: value for key, value in about.header.items() if key not in _OF_STORAGE}
    header |= {"type": exr.scanlineimage, "compression": header.get("compression", exr.ZIP_COMPRESSION), **options.tags}
    with beside(path) as temporary:
        try:
            with exr.File(header, {**about.others, about.name: z}) as made:
                made.write(str(temporary))
        except (RuntimeError, ValueError, TypeError) as cause:
            raise FormatError(f"{path.name} cannot be written ({cause}); .tif holds the same depths") from cause
    return ()


def _loaded(path: Path) -> tuple[dict[str, object], dict[str, Array]]:
    """Header and channels (h, w) of an EXR of one part."""
    exr = need("OpenEXR", "exr")
    try:
        with exr.File(str(path), separate_channels=True) as file:
            parts = len(file.parts)
            header = dict(file.header())
            channels = {name: np.array(channel.pixels) for name, channel in file.channels().items()}
    except (RuntimeError, ValueError, TypeError) as cause:
        raise FormatError(f"{path.name} cannot be read ({cause}); is it an EXR, and whole?") from cause
    if parts > 1 or any(pixels.dtype.kind not in "fu" for pixels in channels.values()):
        what = f"{parts} parts" if parts > 1 else "deep samples"
        raise FormatError(
            f"{path.name}: one part of flat samples expected, got {what}; split it (exrmultipart -separate)"
        )
    return header, channels


def _depth_of(path: Path, channels: Mapping[str, Array]) -> str:
    layered = [name for name in channels if name.rpartition(".")[2] == "Z"]
    only = list(channels) if len(channels) == 1 else []
    for name in ("Z", "Y", *(layered if len(layered) == 1 else ()), *only):
        if name in channels:
            return name
    raise FormatError(
        f"{path.name}: depths in a channel Z, Y, or the only one, expected, got {', '.join(channels) or 'none'}; take one out: "
        f"oiiotool {path.name} --ch NAME --chnames Z -o depth.exr"
    )
