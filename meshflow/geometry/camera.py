"""Pixel to ray, depth to point."""

from dataclasses import dataclass

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.gates import Array, positive

__all__ = ["Pinhole"]


@dataclass(frozen=True)
class Pinhole:
    """A pinhole camera: x' = (u - cx) / fx, y' = (v - cy) / fy, the point of depth z is z (x', y', 1).

    :param fx: focal lengths and principal point, in pixels; pixel centres have whole coordinates (u, v),
    :param fy: u to the right along a row, v downwards, as in OpenCV and Open3D.
    :param cx: horizontal principal point, pixels.
    :param cy: vertical principal point, pixels.
    :raises InputError: when a focal length is not positive or a principal point is not finite.
    """

    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        for name in ("fx", "fy"):
            object.__setattr__(self, name, positive(getattr(self, name), f"camera {name}", "pixels"))
        for name in ("cx", "cy"):
            value = float(getattr(self, name))
            if not np.isfinite(value):
                raise InputError(f"camera {name}: a finite number of pixels expected, got {value}")
            object.__setattr__(self, name, value)

    def rays(self, shape: tuple[int, int]) -> Array:
        """Rays (h, w, 3) of all pixels, z = 1, so that depth along the axis times ray is the point."""
        rays = np.ones((*shape, 3))
        x, y = self.spread(shape)
        rays[..., 0], rays[..., 1] = x, y[:, None]
        return rays

    def spread(self, shape: tuple[int, int]) -> tuple[Array, Array]:
        """x' (w,) of all columns and y' (h,) of all rows."""
        return (np.arange(shape[1]) - self.cx) / self.fx, (np.arange(shape[0]) - self.cy) / self.fy

    @property
    def pixel(self) -> float:
        """Width of a pixel at depth 1: the geometric mean of 1/fx and 1/fy."""
        return float(1.0 / np.sqrt(self.fx * self.fy))
