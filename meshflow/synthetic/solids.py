"""Solids with exact ray casting and distances from their surface."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from meshflow.geometry.validation import Array

__all__ = ["Ball", "Block", "CappedBall", "Panel", "Solid"]


class Solid(Protocol):
    """An object of a scene."""

    def cast(self, rays: Array, origins: Array | None = None) -> Array:
        """The factor (...,) at which each ray (..., 3) first hits the surface; infinite where it does not.

        :param origins: of the rays, (..., 3) or (3,), outside of the solid; by default the origin.
        """
        ...

    def normals(self, points: Array) -> Array:
        """Unit normals (..., 3) at points (..., 3) of the surface, outwards; for a panel, which has no inside, that of its
        plane.
        """
        ...

    def distance(self, points: Array) -> Array:
        """Distance (...,) of points (..., 3) from the surface, whose flat parts are extended to infinity; in the unit of the
        points.
        """
        ...


@dataclass(frozen=True)
class Panel:
    """A flat, slanted panel: the points of normal . p = offset with low < x < high.

    :param normal: of length 1.
    :param offset: distance of its plane from the origin.
    :param low: least x of the panel.
    :param high: greatest x of the panel.
    """

    normal: tuple[float, float, float]
    offset: float
    low: float = -np.inf
    high: float = np.inf

    def cast(self, rays: Array, origins: Array | None = None) -> Array:
        """The factors at which rays (..., 3) hit the panel."""
        start = np.zeros(3) if origins is None else origins
        slope, gap = rays @ np.array(self.normal), self.offset - start @ np.array(self.normal)
        z = np.divide(gap, slope, out=np.full(slope.shape, np.inf), where=slope * gap > 0)
        x = start[..., 0] + np.where(np.isfinite(z), z, 0.0) * rays[..., 0]
        return np.where((x > self.low) & (x < self.high), z, np.inf)

    def normals(self, points: Array) -> Array:
        """The normal of its plane, for each point (..., 3)."""
        return np.broadcast_to(np.array(self.normal), points.shape)

    def distance(self, points: Array) -> Array:
        """Distance of points (..., 3) from the plane of the panel."""
        return np.abs(points @ np.array(self.normal) - self.offset)


@dataclass(frozen=True)
class Ball:
    """The points at ``radius`` from ``centre``."""

    centre: tuple[float, float, float]
    radius: float

    def cast(self, rays: Array, origins: Array | None = None) -> Array:
        """The factors at which rays (..., 3) from outside hit the ball: the smaller root of |o + t r - c|^2 = R^2."""
        centre = np.array(self.centre) - (np.zeros(3) if origins is None else origins)
        a, b = np.einsum("...i,...i->...", rays, rays), np.einsum("...i,...i->...", rays, centre)
        discriminant = b**2 - a * (np.einsum("...i,...i->...", centre, centre) - self.radius**2)
        root = np.sqrt(np.maximum(discriminant, 0.0))
        return np.where((discriminant >= 0) & (b > root), (b - root) / a, np.inf)

    def distance(self, points: Array) -> Array:
        """Distance of points (..., 3) from the sphere."""
        return np.abs(np.linalg.norm(points - np.array(self.centre), axis=-1) - self.radius)

    def normals(self, points: Array) -> Array:
        """Unit normals away from the centre, at points (..., 3)."""
        away = points - np.array(self.centre)
        return away / np.linalg.norm(away, axis=-1, keepdims=True)


@dataclass(frozen=True)
class Block:
    """A rotated cube: |R^T (p - c)| = half in the largest coordinate.

    :param centre: c.
    :param half: half its edge.
    :param turned: R, the rotation about y and then about x by these angles, degrees.
    """

    centre: tuple[float, float, float]
    half: float
    turned: tuple[float, float]

    @property
    def _turn(self) -> Array:
        """R (3, 3): columns are the edges of the cube."""
        y, x = np.radians(self.turned)
        about_y = np.array([[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]])
        about_x = np.array([[1, 0, 0], [0, np.cos(x), -np.sin(x)], [0, np.sin(x), np.cos(x)]])
        return about_x @ about_y

    def _inside_out(self, vectors: Array) -> Array:
        """Vectors (..., 3) in the frame of the cube."""
        return vectors @ self._turn

    def cast(self, rays: Array, origins: Array | None = None) -> Array:
        """The factors at which rays (..., 3) from outside hit the cube: the last of three slabs that they enter."""
        start = np.zeros(3) if origins is None else origins
        along, centre = self._inside_out(rays), self._inside_out(np.array(self.centre) - start)
        with np.errstate(divide="ignore"):
            one, other = (centre - self.half) / along, (centre + self.half) / along
        enter, leave = np.minimum(one, other).max(axis=-1), np.maximum(one, other).min(axis=-1)
        return np.where((enter <= leave) & (enter > 0), enter, np.inf)

    def distance(self, points: Array) -> Array:
        """Distance of points (..., 3) near a face from that face."""
        size = np.abs(self._inside_out(points - np.array(self.centre)))
        return np.abs(size.max(axis=-1) - self.half)

    def normals(self, points: Array) -> Array:
        """Normals of the faces that contain the points (..., 3)."""
        inside = self._inside_out(points - np.array(self.centre))
        face = np.abs(inside).argmax(axis=-1)[..., None]
        return np.sign(np.take_along_axis(inside, face, axis=-1)) * self._turn.T[face[..., 0]]


@dataclass(frozen=True)
class CappedBall:
    """The unit ball about the origin with flat cuts, and sharp rims around them.

    :param axes: unit vectors perpendicular to the cuts, which may not touch each other.
    :param heights: distance of each cut from the centre, in (0, 1).
    """

    axes: tuple[tuple[float, float, float], ...] = ((0.0, 0.0, 1.0), (0.0, 0.8, -0.6))
    heights: tuple[float, ...] = (0.6, 0.75)

    def cast(self, rays: Array) -> Array:
        """The factors at which rays (..., 3) from the centre leave the solid."""
        reach = 1.0 / np.linalg.norm(rays, axis=-1)
        for axis, height in zip(self.axes, self.heights, strict=True):
            slope = rays @ np.array(axis)
            cut = np.divide(height, slope, out=np.full(slope.shape, np.inf), where=slope > 0)
            reach = np.minimum(reach, cut)
        return reach

    def distance(self, points: Array) -> Array:
        """Distance of points (..., 3) from the surface, inside or outside: the least of round part, flat parts and rims."""
        length = np.linalg.norm(points, axis=-1)
        nearest, on_round = np.full(length.shape, np.inf), np.ones(length.shape, bool)
        for axis, height in zip(self.axes, self.heights, strict=True):
            along = points @ np.array(axis)
            aside = np.sqrt(np.maximum(length**2 - along**2, 0.0))
            rim = np.sqrt(1.0 - height**2)
            above = np.abs(along - height)
            flat = np.where(aside <= rim, above, np.hypot(above, aside - rim))
            nearest, on_round = np.minimum(nearest, flat), on_round & (along <= height * length)
        return np.where(on_round, np.minimum(nearest, np.abs(length - 1.0)), nearest)

    def normals(self, points: Array) -> Array:
        """Outward unit normals (n, 3) at points (n, 3) of the surface; on a rim the mean of both sides."""
        length = np.linalg.norm(points, axis=1, keepdims=True)
        total = np.where(np.abs(length - 1.0) < 1e-9, points, 0.0)
        for axis, height in zip(self.axes, self.heights, strict=True):
            on_flat = np.abs(points @ np.array(axis) - height) < 1e-9
            total = total + on_flat[:, None] * np.array(axis)
        return total / np.linalg.norm(total, axis=1, keepdims=True)
