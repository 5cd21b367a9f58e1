"""Stored depths in metres: units, codes for missing depths, and plausibility checks."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshflow.errors import FormatError, NothingThere
from meshflow.geometry.validation import Array, positive, real
from meshflow.io.formats.cameras import Calibration
from meshflow.surfaces.camera import Pinhole

__all__ = ["LARGEST", "Metres", "default_units", "doubtful_depths", "in_metres"]

LARGEST = 65535  # missing, as 0 is: cameras write one or the other
# Median depths, metres, outside of which the unit is doubtful, because no depth camera measures them.
NEAREST, FARTHEST = 0.03, 300.0
# The field of view, degrees, below which the focal length is doubtful.
NARROW = 1.0
# This many different numbers are not all multiples of 8 by chance.
MANY = 16


@dataclass(frozen=True, eq=False)
class Metres:
    """Depths in metres.

    :param depth: (h, w), metres, float32 or float64.
    :param missing: (h, w).
    :param units: of the stored numbers, per metre.
    :param notes: sentences for the user.
    """

    depth: Array
    missing: Array
    units: float
    notes: tuple[str, ...]


def default_units(whole: bool) -> float:
    """The default units per metre: millimetres for whole numbers, metres for floating point."""
    return 1000.0 if whole else 1.0


def in_metres(raw: Array, calibration: Calibration, depth_scale: float | None, name: str) -> Metres:
    """Convert stored depths (h, w) to metres; 0 is missing, and in whole numbers also 65535.

    :param depth_scale: units per metre; by default that of the camera for whole numbers, else :func:`default_units`.
    :param name: of the image, for the messages.
    :raises NothingThere: when all are missing.
    :raises FormatError: when the bits are rotated as in SUN RGB-D, and no ``depth_scale`` is given.
    :raises InputError: for a ``depth_scale`` that is not positive.
    """
    whole = raw.dtype.kind in "iu"
    given = depth_scale if depth_scale is not None else calibration.units if whole else None
    units = positive(default_units(whole) if given is None else given, "depth_scale", "units per metre")
    values = real(raw, name)
    missing = ~np.isfinite(values)
    if not calibration.camera.signed:
        missing |= values == 0
    if whole:
        missing |= values == LARGEST
    if missing.all():
        raise NothingThere(
            f"{Path(name).name}: {_nothing(raw)}; is it the right file, and has the camera seen anything?"
        )
    if whole and depth_scale is None:
        _must_not_be_turned(raw[~missing], name)
    depth = (values / units).astype(values.dtype)
    plain = units == 1.0 or depth_scale is not None  # what the caller gives, he need not be told
    notes = () if plain else (f"depths of {units:g} units per metre are converted to, and reported in, metres",)
    return Metres(depth, missing, units, notes + _doubts(depth[~missing], missing.shape, calibration, units))


def _nothing(raw: Array) -> str:
    """How many depths have which code, where all are missing."""
    counts = (("0", raw == 0), (str(LARGEST), raw == LARGEST), ("NaN or infinite", ~np.isfinite(raw)))
    reasons = " and ".join(f"{int(where.sum())} are {word}" for word, where in counts if where.any())
    return f"all its {raw.size} depths are missing, {reasons}"


def _must_not_be_turned(counts: Array, name: str) -> None:
    """SUN RGB-D stores x as (x << 3) | (x >> 13): multiples of 8, with the bits of what lies beyond 8 m below."""
    if counts.dtype != np.uint16 or counts.size == 0:
        return
    low = counts & 7
    if np.mean(low == 0) < 0.95:
        return
    shifted = counts[low == 0] >> 3
    if len(np.unique(shifted)) >= MANY and (shifted & 1).any():
        raise FormatError(
            f"{Path(name).name}: nearly all its numbers, {counts.min()} to {counts.max()}, are multiples of 8: depths whose bits "
            "are turned, as SUN RGB-D has them. Turn them back, (x >> 3) | (x << 13), or give depth_scale 8000 (right up "
            "to 8 m), or the scale that they have if they are not turned"
        )


def _doubts(depth: Array, shape: tuple[int, ...], calibration: Calibration, units: float) -> tuple[str, ...]:
    """Notes on values that are probably in another unit."""
    notes: tuple[str, ...] = ()
    if 0 < depth.size < 3:
        notes += (f"only {depth.size} of {shape[0] * shape[1]} depths is there: no triangle, so nothing can move",)
    notes += _of_distance(depth, units)
    camera = calibration.camera
    if isinstance(camera, Pinhole) and max(view := camera.view((shape[0], shape[1]))) < NARROW:
        notes += (
            f"camera fx = {camera.fx:g}, fy = {camera.fy:g} pixels give this image a field of view of {view[0]:.2g} x "
            f"{view[1]:.2g} degrees; is it so small a part, and are they in pixels (f_px = f_mm * width_px / sensor_width_mm)?",
        )
    if isinstance(camera, Pinhole):
        notes += _beside(camera, shape)
    return notes


def _of_distance(depth: Array, units: float) -> tuple[str, ...]:
    """A note on depths (n,), metres, that no depth camera measures."""
    middle = float(np.median(depth)) if depth.size else 1.0
    if NEAREST <= middle <= FARTHEST or middle <= 0:
        return ()
    factor, unit = (1e-3, "km") if middle > FARTHEST else (1e3, "mm")
    return (
        f"the scene is {depth.min() * factor:.3g} to {depth.max() * factor:.3g} {unit} away with {units:g} units per metre; "
        "is that so? else give depth_scale (units per metre: 1000 for millimetres, 5000 for TUM)",
    )


def doubtful_depths(depth: Array, calibration: Calibration) -> tuple[str, ...]:
    """A note on depths (n,) of a pinhole camera in floating point that are given without a unit and can hardly be metres."""
    known = depth[depth > 0]
    return _of_distance(known, 1.0) if isinstance(calibration.camera, Pinhole) else ()


def _beside(camera: Pinhole, shape: tuple[int, ...]) -> tuple[str, ...]:
    """A note on a principal point on or outside the edge of the image: a crop may have one, or the camera has another size."""
    places = ((camera.cx, shape[1], "cx", "wide"), (camera.cy, shape[0], "cy", "high"))
    off = [f"{name} = {c:g} of an image {n} pixels {way}" for c, n, name, way in places if not 0 < c < n - 1]
    if not off:
        return ()
    return (
        f"the principal point lies on the edge of the image or outside ({', '.join(off)}); is it the camera of this image, and "
        "are its numbers in pixels? of a crop it may be so",
    )
