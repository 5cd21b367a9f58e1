"""Quality of a smoothed range image against the truth."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import InputError
from meshflow.geometry.validation import Array, positive
from meshflow.surfaces.visibility import Sight

__all__ = ["AWAY", "BROAD", "JUMP", "REACH", "RangeQuality", "jumps_of", "range_quality"]

# The broad part of the error, a Gaussian mean over this many pixels, is due to the calibration of the camera, and no filter of a
# few pixels can remove it.
BROAD = 8.0
# A smaller error, in the unit of the depths, is noise; with a larger one a pixel took the wrong side of a jump. 50 mm, in metres.
REACH = 0.05
# Neighbours in the truth that differ by more than this share of the nearer lie on two surfaces; normals are compared only at this
# distance in pixels from such jumps, and from missing pixels.
JUMP, AWAY = 0.05, 3


@dataclass(frozen=True)
class RangeQuality:
    """Differences of depths from the true ones, over the pixels present in both.

    :ivar normal_error: mean angle, degrees, between the normals of both, 3 pixels or more away from jumps of the truth and from
        missing pixels; NaN without such pixels.
    :ivar fine: root mean square of the error minus its Gaussian mean over 8 pixels, over the pixels whose error is within reach;
        unit of the depths.
    :ivar median: median of \\|error\\|.
    :ivar rms: root mean square of the error over the pixels within reach.
    :ivar inverse_rms: root mean square of 1 / found - 1 / truth over all pixels; times focal length and baseline it is the
        error of a disparity.
    :ivar kept: share of the pixels of the truth that have a depth.
    """

    normal_error: float
    fine: float
    median: float
    rms: float
    inverse_rms: float
    kept: float


def range_quality(found: ArrayLike, truth: ArrayLike, camera: Any, reach: float | ArrayLike = REACH) -> RangeQuality:
    """Compare depths along the axis of a camera with the truth.

    Example:

        >>> from meshflow import Pinhole
        >>> from meshflow.synthetic import depth_scene
        >>> camera = Pinhole(fx=50.0, fy=50.0, cx=26.5, cy=19.5)
        >>> sample = depth_scene(camera, (40, 54))
        >>> range_quality(sample.noisy, sample.truth, camera).rms > 0
        True

    :param found: (h, w); 0, negative and NaN are missing.
    :param truth: (h, w), likewise.
    :param camera: a camera that :class:`meshflow.RangeImage` takes.
    :param reach: the largest error that counts as noise, in the unit of the depths: a number or (h, w).
    :raises InputError: for different shapes, a reach that is not positive, or no pixel present in both.
    """
    one, other = (np.asarray(z, dtype=np.float64) for z in (found, truth))
    if one.ndim != 2 or one.shape != other.shape:
        raise InputError(f"range quality: two images (h, w) of one shape expected, got {one.shape} and {other.shape}")
    if np.ndim(reach) == 0:
        positive(float(reach), "reach")  # pyright: ignore[reportArgumentType]
    there = _there(one) & _there(other)
    if not there.any():
        raise InputError("range quality: a pixel that has a depth in both expected, got none")
    error = np.where(there, one - other, 0.0)
    noise = there & (np.abs(error) < np.asarray(reach))
    inside = np.where(noise, error, 0.0)
    inverse = 1.0 / one[there] - 1.0 / other[there]
    angles = _angles(one, other, there, Sight.through(camera, (one.shape[0], one.shape[1])))
    return RangeQuality(
        normal_error=float(angles.mean()) if angles.size else np.nan,
        fine=_rms((inside - _mean(inside, noise))[noise]),
        median=float(np.median(np.abs(error[there]))),
        rms=_rms(error[noise]),
        inverse_rms=_rms(inverse),
        kept=float(there.sum() / _there(other).sum()),
    )


def jumps_of(truth: ArrayLike, share: float = JUMP) -> Array:
    """The pixels (h, w) on both sides of a jump, where neighbours differ by more than a share of the nearer.

    Example:

        >>> import numpy as np
        >>> jumps_of(np.array([[1.0, 1.0, 2.0, 2.0]] * 2)).tolist()[0]
        [False, True, True, False]

    :param truth: (h, w); missing pixels give no jump.
    :param share: of the nearer depth, above 0.
    """
    z = np.asarray(truth, dtype=np.float64)
    z, jumps = np.where(_there(z), z, np.nan), np.zeros(np.shape(truth), bool)
    every, first, last = slice(None), slice(None, -1), slice(1, None)
    for one, two in (((every, first), (every, last)), ((first, every), (last, every))):
        leaps = np.abs(z[two] - z[one]) > share * np.fmin(z[one], z[two])
        jumps[one] |= leaps
        jumps[two] |= leaps
    return jumps


def _there(z: Array) -> Array:
    return np.isfinite(z) & (z > 0)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else np.nan


def _mean(values: Array, weight: Array) -> Array:
    """Gaussian mean (h, w) over :data:`BROAD` pixels of values that are zero where the weight is zero."""
    from scipy.ndimage import gaussian_filter

    return np.asarray(gaussian_filter(values, BROAD)) / np.maximum(
        gaussian_filter(weight.astype(np.float64), BROAD), 1e-9
    )


def _angles(one: Array, other: Array, there: Array, sight: Sight) -> Array:
    """Degrees (n,) between the normals of two images at the pixels away from jumps of the other."""
    from scipy.ndimage import binary_dilation

    near: Array = np.asarray(binary_dilation(jumps_of(other) | ~there, iterations=AWAY), dtype=bool)
    away = ~near[1:-1, 1:-1]
    a, b = (_normals(sight.at(z))[away] for z in (one, other))
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum("ij,ij->i", a, b)))


def _normals(points: Array) -> Array:
    """Normals (h - 2, w - 2, 3) by central differences of points (h, w, 3), of any length."""
    return np.cross(points[1:-1, 2:] - points[1:-1, :-2], points[2:, 1:-1] - points[:-2, 1:-1])
