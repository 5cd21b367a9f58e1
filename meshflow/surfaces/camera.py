"""Cameras of range images: from pixels to rays, from values to points, and back."""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, ClassVar, Literal, Protocol, runtime_checkable

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.options import named_fields
from meshflow.geometry.validation import Array, positive
from meshflow.surfaces.distortion import coefficients, distorted, undistorted
from meshflow.surfaces.grid import Lines

__all__ = ["Camera", "Measure", "Orthographic", "Pinhole", "known"]

Measure = Literal["depth", "range"]

# The widest field of view, degrees; beyond it the focal length is probably not in pixels.
WIDEST = 150.0
# The same to one side of the principal point, as the tangent of 80 degrees.
STEEPEST = 5.7


@runtime_checkable
class Camera(Protocol):
    """The camera of a range image: the line of each sample, p(u) = o + u d.

    :cvar usual: what its values are by default: ``depth`` along the optical axis, or ``range`` along the ray.
    """

    usual: ClassVar[Measure]

    @property
    def signed(self) -> bool:
        """Whether each sample has its own origin, so that 0 and negative values are valid."""
        ...

    @property
    def summary(self) -> str:
        """A short description."""
        ...

    def check(self, shape: tuple[int, int], measure: Measure, missing: Array | None = None) -> None:
        """Refuse an image that does not fit the camera.

        :param missing: (h, w), samples whose rays are not checked.
        :raises InputError: for a size or a measure that does not fit.
        """
        ...

    def lines(self, shape: tuple[int, int], measure: Measure) -> Lines:
        """The lines of all samples; d has z = 1 for ``depth`` and length 1 for ``range``."""
        ...

    def footprint(self, u: Array, measure: Measure) -> Array:
        """Width of each pixel on the surface at values u (h, w), perpendicular to its ray, in the unit of u; NaN where u is."""
        ...

    def project(self, points: Array, shape: tuple[int, int] | None = None) -> Array:
        """Pixel coordinates (n, 2), column and row, of points (n, 3); NaN for points that it does not see.

        :param shape: (h, w) of the image, which a spherical camera needs.
        """
        ...

    def thinned(self, step: int, shape: tuple[int, int]) -> "Camera":
        """The camera of an image (h, w) of which every ``step``-th row and column is kept."""
        ...


@named_fields
@dataclass(frozen=True)
class Pinhole:
    """A pinhole camera: x' = (u - cx) / fx, y' = (v - cy) / fy, the point of depth z is z (x', y', 1).

    With lens distortion, (x', y') is the inverse of OpenCV's model (:mod:`meshflow.surfaces.distortion`).

    :param fx: focal lengths and principal point, in pixels; pixel centres have whole coordinates (u, v),
    :param fy: u to the right along a row, v downwards, as in OpenCV and Open3D.
    :param cx: horizontal principal point, pixels.
    :param cy: vertical principal point, pixels.
    :param distortion: k1, k2, p1, p2[, k3[, k4, k5, k6]] of OpenCV: 0, 4, 5 or 8 numbers.
    :raises InputError: when a focal length is not positive, a principal point or a coefficient is not finite, or the number
        of coefficients is wrong.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()
    usual: ClassVar[Measure] = "depth"

    def __post_init__(self) -> None:
        for name in ("fx", "fy"):
            object.__setattr__(self, name, positive(getattr(self, name), f"camera {name}", "pixels"))
        for name in ("cx", "cy"):
            value = float(getattr(self, name))
            if not np.isfinite(value):
                raise InputError(f"camera {name}: a finite number of pixels expected, got {value}")
            object.__setattr__(self, name, value)
        lens = coefficients(self.distortion)
        object.__setattr__(self, "distortion", lens if any(lens) else ())

    @property
    def signed(self) -> bool:
        """Depths count from the pinhole."""
        return False

    @property
    def summary(self) -> str:
        """Focal lengths and principal point."""
        lens = f", distortion {' '.join(f'{k:g}' for k in self.distortion)}" if self.distortion else ""
        return f"fx {self.fx:g}, fy {self.fy:g}, cx {self.cx:g}, cy {self.cy:g} pixels{lens}"

    def view(self, shape: tuple[int, int]) -> tuple[float, float]:
        """Horizontal and vertical field of view of an image (h, w) without distortion, degrees."""
        pairs = ((shape[1], self.cx, self.fx), (shape[0], self.cy, self.fy))
        across, down = (np.arctan((n - 0.5 - c) / f) + np.arctan((c + 0.5) / f) for n, c, f in pairs)
        return float(np.degrees(across)), float(np.degrees(down))

    def check(self, shape: tuple[int, int], measure: Measure, missing: Array | None = None) -> None:
        """Refuse a focal length that is not in pixels, judged by the field of view."""
        known(measure)
        sides = ((shape[1], self.cx, self.fx), (shape[0], self.cy, self.fy))
        for angle, (n, c, f), name in zip(self.view(shape), sides, ("fx", "fy"), strict=True):
            if angle > WIDEST or max(n - 0.5 - c, c + 0.5) > STEEPEST * f:
                raise InputError(
                    f"camera {name} = {f:g} pixels gives {n} pixels a field of view of {angle:.1f} degrees, at most "
                    f"{WIDEST:g} are expected; a focal length in millimetres? f_px = f_mm * width_px / sensor_width_mm"
                )

    def rays(self, shape: tuple[int, int]) -> Array:
        """Rays (h, w, 3) of all pixels with z = 1: depth times ray is the point."""
        rays = np.ones((*shape, 3))
        rays[..., 0], rays[..., 1] = self._spread(shape)
        return rays

    def lines(self, shape: tuple[int, int], measure: Measure) -> Lines:
        """The lines through the pinhole."""
        x, y = self._spread(shape)
        still = np.zeros((1, 1))
        directions = (x, y, still + 1.0)
        if measure == "range":
            length = np.sqrt(x * x + y * y + 1.0)
            directions = (x / length, y / length, 1.0 / length)
        return Lines((still, still, still), directions)

    def footprint(self, u: Array, measure: Measure) -> Array:
        """z / sqrt(fx fy), for a surface that faces the camera."""
        if measure == "range":
            u = u * self.lines(u.shape, measure).directions[2]
        return np.float64(1.0 / np.sqrt(self.fx * self.fy)) * u

    def project(self, points: Array, shape: tuple[int, int] | None = None) -> Array:
        """Pixel coordinates (n, 2) with lens distortion; NaN for points that are not in front of the camera."""
        points = np.asarray(points, dtype=np.float64)
        z = np.where(points[:, 2] > 0, points[:, 2], np.nan)
        x, y = points[:, 0] / z, points[:, 1] / z
        if self.distortion:
            x, y = distorted(x, y, self.distortion)
        return np.stack([x * self.fx + self.cx, y * self.fy + self.cy], axis=-1)

    def thinned(self, step: int, shape: tuple[int, int]) -> "Pinhole":
        """The camera of every ``step``-th row and column."""
        return replace(self, fx=self.fx / step, fy=self.fy / step, cx=self.cx / step, cy=self.cy / step)

    def _spread(self, shape: tuple[int, int]) -> tuple[Array, Array]:
        """x' and y' of all pixels: (1, w) and (h, 1), or both (h, w) with distortion."""
        return _undistorted(self, (shape[0], shape[1])) if self.distortion else _ideal(self, shape)


def _ideal(camera: Pinhole, shape: tuple[int, int]) -> tuple[Array, Array]:
    x, y = (np.arange(shape[1]) - camera.cx) / camera.fx, (np.arange(shape[0]) - camera.cy) / camera.fy
    return x[None, :], y[:, None]


@lru_cache(maxsize=2)  # depends on the camera and the size only, and is used several times in a run
def _undistorted(camera: Pinhole, shape: tuple[int, int]) -> tuple[Array, Array]:
    ideal, down = _ideal(camera, shape)
    x, y = undistorted(np.broadcast_to(ideal, shape), np.broadcast_to(down, shape), camera.distortion)
    x.flags.writeable = y.flags.writeable = False
    return x, y


@named_fields
@dataclass(frozen=True)
class Orthographic:
    """Parallel rays along z: the point of depth z in row r and column c is (c dx, r dy, z).

    :param dx: pitch of the columns, in the unit of the depths.
    :param dy: pitch of the rows, downwards.
    :raises InputError: when a pitch is not positive.
    """

    dx: float
    dy: float
    usual: ClassVar[Measure] = "depth"

    def __post_init__(self) -> None:
        for name in ("dx", "dy"):
            object.__setattr__(self, name, positive(getattr(self, name), f"camera {name}", "length per pixel"))

    @property
    def signed(self) -> bool:
        """Depths count from the plane z = 0."""
        return False

    @property
    def summary(self) -> str:
        """The pitches."""
        return f"orthographic, {self.dx:g} x {self.dy:g} per pixel"

    def check(self, shape: tuple[int, int], measure: Measure, missing: Array | None = None) -> None:
        """Accepts any size; depth and range are the same."""
        known(measure)

    def lines(self, shape: tuple[int, int], measure: Measure) -> Lines:
        """The lines along z."""
        still = np.zeros((1, 1))
        x, y = np.arange(shape[1])[None, :] * self.dx, np.arange(shape[0])[:, None] * self.dy
        return Lines((x, y, still), (still, still, still + 1.0))

    def footprint(self, u: Array, measure: Measure) -> Array:
        """sqrt(dx dy), everywhere."""
        return np.where(np.isnan(u), np.nan, np.sqrt(self.dx * self.dy))

    def project(self, points: Array, shape: tuple[int, int] | None = None) -> Array:
        """(x / dx, y / dy)."""
        return np.asarray(points, dtype=np.float64)[:, :2] / (self.dx, self.dy)

    def thinned(self, step: int, shape: tuple[int, int]) -> "Orthographic":
        """The camera of every ``step``-th row and column."""
        return Orthographic(self.dx * step, self.dy * step)


def known(measure: Any) -> Measure:
    """Check the name of a measure.

    :raises InputError: for an unknown one.
    """
    if measure not in ("depth", "range"):
        raise InputError(f"measure: depth (along the optical axis) or range (along the ray) expected, got {measure!r}")
    return measure
