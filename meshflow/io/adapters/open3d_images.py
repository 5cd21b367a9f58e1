"""Imports depth images of open3d: Image and RGBDImage, legacy and tensor classes."""

from functools import partial
from typing import Any

import numpy as np

from meshflow.errors import InputError, need
from meshflow.geometry.validation import Array
from meshflow.io.depth_units import in_metres
from meshflow.io.document import Imported
from meshflow.io.formats.cameras import calibration_for
from meshflow.io.metadata import ReadOptions
from meshflow.surfaces.range_image import RangeImage

__all__ = ["from_object", "is_image"]


def is_image(data: object) -> bool:
    """Whether it is an Image or an RGBDImage."""
    open3d = need("open3d", "scan")
    kinds = (open3d.geometry.Image, open3d.t.geometry.Image, open3d.geometry.RGBDImage, open3d.t.geometry.RGBDImage)
    return isinstance(data, kinds)


def from_object(data: object, options: ReadOptions) -> Imported:
    """Import a depth image; results are new ones of the same class in float32, in the original units.

    In an RGBDImage the depth moves and the colours are copied.

    :param options: ``camera``, as in :func:`meshflow.io.formats.cameras.calibration_for`, or a ``PinholeCameraIntrinsic``;
        ``depth_scale``, units per metre, by default that of the camera or 1000 for whole numbers, and 1 for floating point (the
        depth of an RGBDImage that open3d made is in metres); ``missing``, ``jump``, ``measure``, ``time_unit`` as in
        :class:`RangeImage`.
    :raises InputError: without a camera, for a camera of another size, for an image without depths, or an option that does not
        apply.
    """
    name = f"open3d {type(data).__name__}"
    options.must_belong(
        f"an {name}", ("kind", "camera", "depth_scale", "missing", "nodata", "jump", "measure", "time_unit")
    )
    if options.kind not in (None, "depth"):
        raise InputError(
            f"kind={options.kind!r}: an {name} is taken as depths; give numpy.asarray(image) for anything else"
        )
    raw = _raw(data)
    if raw.ndim != 2 or raw.dtype not in (np.uint16, np.float32, np.float64):
        raise InputError(
            f"{name}: depths (h, w) in uint16 or float32 expected, got shape {raw.shape} in {raw.dtype}; a picture shows depths, "
            "it does not hold them (numpy.asarray(image) is taken as an image)"
        )
    calibration = calibration_for(options.camera, (raw.shape[0], raw.shape[1]), name)
    found = in_metres(raw, calibration, options.depth_scale, name)
    declared = options.missing_in(raw)
    gone = found.missing if declared is None else found.missing | declared
    image = RangeImage(
        found.depth,
        calibration.camera,
        gone,
        jump=options.jump,
        measure=options.measure,
        time_unit=options.time_unit or "footprint",
        unit="m",
    )
    return Imported(image, partial(_to_object, data, raw, found.depth, found.units), found.notes)


def _raw(data: Any) -> Array:
    """A copy of the depths (h, w)."""
    image = getattr(data, "depth", data)
    if hasattr(image, "as_tensor"):
        values = image.as_tensor().cpu().numpy()
        return np.array(values[..., 0] if values.ndim == 3 and values.shape[2] == 1 else values)
    return np.array(image)


def _to_object(data: Any, raw: Array, start: Array, units: float, image: RangeImage) -> Any:
    open3d = need("open3d", "scan")
    still = np.asarray(image.missing) | (image.depth == start)  # these keep their stored numbers
    values = np.where(still, raw, image.depth * np.float64(units)).astype(np.float32)
    if isinstance(data, open3d.geometry.Image):
        return open3d.geometry.Image(values)
    if isinstance(data, open3d.geometry.RGBDImage):
        new = open3d.geometry.RGBDImage()
        new.color, new.depth = open3d.geometry.Image(np.array(data.color)), open3d.geometry.Image(values)
        return new
    depth = getattr(data, "depth", data)
    moved = open3d.t.geometry.Image(open3d.core.Tensor(values[..., None], device=depth.device))
    if isinstance(data, open3d.t.geometry.Image):
        return moved
    new = data.clone()
    new.depth = moved
    return new
