"""open3d depth images in, new ones out: Image and RGBDImage, the legacy classes and the tensor classes."""

from functools import partial
from typing import Any

import numpy as np

from meshflow.errors import InputError, need
from meshflow.geometry.validation import Array
from meshflow.io.depth_units import in_metres
from meshflow.io.formats.cameras import calibration_for
from meshflow.io.metadata import belong
from meshflow.io.objects import Adopted
from meshflow.surfaces.camera import Pinhole
from meshflow.surfaces.lift import RangeImage

__all__ = ["adopt", "is_image"]


def is_image(thing: Any) -> bool:
    """Whether it is an Image or an RGBDImage."""
    open3d = need("open3d", "scan")
    kinds = (open3d.geometry.Image, open3d.t.geometry.Image, open3d.geometry.RGBDImage, open3d.t.geometry.RGBDImage)
    return isinstance(thing, kinds)


def adopt(
    thing: Any,
    *,
    camera: Any = None,
    depth_scale: float | None = None,
    missing: Any = None,
    fixed: Any = None,
    jump: Any = "noise",
    measure: Any = None,
    pace: Any = "footprint",
    kind: Any = None,
    **other: Any,
) -> Adopted:
    """Take a depth image in; what comes back is a new one of the same class in float32, in the units that came.

    Of an RGBDImage the depth moves, the colours are copied.

    :param camera: what :func:`meshflow.io.formats.cameras.calibration_for` takes, or an open3d ``PinholeCameraIntrinsic``.
    :param depth_scale: units per metre; by default what the camera says or 1000 for whole numbers, and 1 for floating point (the
        depth of an RGBDImage that open3d made is in metres).
    :raises InputError: without a camera, for one of another size, for an image that holds no depths, or a hint that does not
        belong.
    """
    name = f"open3d {type(thing).__name__}"
    belong(other, f"an {name}", ("camera", "depth_scale", "missing", "fixed", "jump", "measure", "pace"))
    if kind not in (None, "depth"):
        raise InputError(f"kind={kind!r}: an {name} is taken as depths; give numpy.asarray(image) for anything else")
    raw = _raw(thing)
    if raw.ndim != 2 or raw.dtype not in (np.uint16, np.float32, np.float64):
        raise InputError(
            f"{name}: depths (h, w) in uint16 or float32 expected, got shape {raw.shape} in {raw.dtype}; a picture shows depths, "
            "it does not hold them (numpy.asarray(image) is taken as an image)"
        )
    shape = (raw.shape[0], raw.shape[1])
    calibration = calibration_for(_own(camera, name, shape), shape, name)
    found = in_metres(raw, calibration, depth_scale, name)
    gone = found.missing if missing is None else found.missing | missing
    noun = RangeImage(found.depth, calibration.camera, gone, fixed, jump, measure, pace, unit="m")
    return Adopted(noun, partial(_restored, thing, raw, found.depth, found.units), found.notes)


def _own(camera: Any, name: str, shape: tuple[int, int]) -> Any:
    """A camera of open3d as ours."""
    if not type(camera).__module__.startswith("open3d"):
        return camera
    k = np.asarray(getattr(camera, "intrinsic_matrix", np.zeros((0, 0))))
    if k.shape != (3, 3):
        raise InputError(f"camera: a PinholeCameraIntrinsic of open3d expected, got {type(camera).__name__}")
    if (camera.height, camera.width) != shape:
        raise InputError(
            f"camera saw {camera.width} x {camera.height} pixels, {name} has {shape[1]} x {shape[0]}; "
            "give the camera of this image"
        )
    return Pinhole(k[0, 0], k[1, 1], k[0, 2], k[1, 2])


def _raw(thing: Any) -> Array:
    """A copy of the depths (h, w)."""
    image = getattr(thing, "depth", thing)
    if hasattr(image, "as_tensor"):
        values = image.as_tensor().cpu().numpy()
        return np.array(values[..., 0] if values.ndim == 3 and values.shape[2] == 1 else values)
    return np.array(image)


def _restored(thing: Any, raw: Array, start: Array, units: float, noun: RangeImage) -> Any:
    open3d = need("open3d", "scan")
    still = noun.missing | (noun.depth == start)  # these keep the numbers that they had
    values = np.where(still, raw, noun.depth * np.float64(units)).astype(np.float32)
    if isinstance(thing, open3d.geometry.Image):
        return open3d.geometry.Image(values)
    if isinstance(thing, open3d.geometry.RGBDImage):
        new = open3d.geometry.RGBDImage()
        new.color, new.depth = open3d.geometry.Image(np.array(thing.color)), open3d.geometry.Image(values)
        return new
    depth = getattr(thing, "depth", thing)
    moved = open3d.t.geometry.Image(open3d.core.Tensor(values[..., None], device=depth.device))
    if isinstance(thing, open3d.t.geometry.Image):
        return moved
    new = thing.clone()
    new.depth = moved
    return new
