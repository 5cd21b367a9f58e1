"""Lines of sight of any camera: rays cast at triangles, and the pixels at which points are seen."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array
from meshflow.surfaces.grid import Lines
from meshflow.surfaces.range_image import RangeImage

__all__ = ["Sight", "met"]

# How far outside a triangle, as a share of it, a ray still hits it, since rays run exactly through vertices and along edges.
EDGE = 1e-7
# How far, as a share of a triangle of about one pixel, a surface may be away from the centre of a pixel that still sees it. A
# vertex of a silhouette lies exactly there, and rounding alone would hide it. A surface nearer by the share NEARER wins.
SLACK, NEARER = 0.05, 0.01
# Newton steps for the pixel of a point. For a pinhole the equations are bilinear, and two or three steps are enough.
NEWTON = 6


@dataclass(frozen=True, eq=False)
class Sight:
    """The line of each pixel, p(u) = o + u d, where u is the depth of the camera.

    :param origins: o, (h, w, 3), or what broadcasts to it.
    :param directions: d, (h, w, 3), none of length zero.
    :raises InputError: for directions of another shape, fewer than 2 x 2 of them, or directions that are zero or not finite.
    """

    origins: Array
    directions: Array

    def __post_init__(self) -> None:
        directions = np.asarray(self.directions, dtype=np.float64)
        if directions.ndim != 3 or directions.shape[2] != 3 or min(directions.shape[:2]) < 2:
            raise InputError(f"sight: directions (h, w, 3) of 2 x 2 pixels or more expected, got {directions.shape}")
        bad = int((~(np.isfinite(directions).all(axis=2) & directions.any(axis=2))).sum())
        if bad:
            raise InputError(f"sight: directions that are finite and not zero expected, {bad} pixels have none")
        try:
            origins = np.broadcast_to(np.asarray(self.origins, dtype=np.float64), directions.shape)
        except ValueError as cause:
            got = np.shape(self.origins)
            raise InputError(f"sight: origins that fit directions {directions.shape} expected, got {got}") from cause
        object.__setattr__(self, "directions", directions)
        object.__setattr__(self, "origins", origins)

    @classmethod
    def through(cls, camera: Any, shape: tuple[int, int]) -> "Sight":
        """The lines (h, w) of a camera that a :class:`RangeImage` takes."""
        return cls.along(RangeImage(np.ones(shape), camera).lines, shape)

    @classmethod
    def along(cls, lines: Lines, shape: tuple[int, int]) -> "Sight":
        """The lines of the samples of a grid of this shape."""
        origins, directions = (
            np.stack([np.broadcast_to(part, shape) for part in parts], axis=-1)
            for parts in (lines.origins, lines.directions)
        )
        return cls(origins, directions)

    @property
    def shape(self) -> tuple[int, int]:
        """(h, w)."""
        h, w, _ = self.directions.shape
        return h, w

    def at(self, depth: Array) -> Array:
        """The points (h, w, 3) at depths (h, w); NaN where there is none."""
        return self.origins + depth[..., None] * self.directions

    def tilt(self, normals: Array) -> Array:
        """Angle (h, w), 0 to 90 degrees, between the line of sight and the normal (h, w, 3) of the surface."""
        facing = np.abs(np.einsum("...i,...i->...", normals, self.directions))
        return np.degrees(np.arccos(np.clip(facing / np.linalg.norm(self.directions, axis=2), 0.0, 1.0)))

    def pixels(self, points: Array, near: Array | None = None) -> tuple[Array, Array]:
        """Where points (n, 3) are seen: column and row (n, 2), with fractions of a pixel, and depths (n,).

        The lines near that of a pixel are extrapolated linearly, which is exact for a pinhole: p = o + u d + a (o_c + u d_c) +
        b (o_r + u d_r), indices c and r the differences from column to column and row to row, by Newton's method.

        :param near: (n,), the index r * w + c of a pixel near which each point is seen; by default the index of the point.
        """
        own = np.arange(len(points)) if near is None else near
        o, d, oc, dc, orow, drow = (part.reshape(-1, 3)[own] for part in self._around)
        u = np.einsum("ij,ij->i", points - o, d) / np.einsum("ij,ij->i", d, d)
        a, b = np.zeros(len(points)), np.zeros(len(points))
        for _ in range(NEWTON):
            along = d + a[:, None] * dc + b[:, None] * drow
            right, down = oc + u[:, None] * dc, orow + u[:, None] * drow
            left = points - (o + a[:, None] * oc + b[:, None] * orow + u[:, None] * along)
            step = _solved(along, right, down, left)
            u, a, b = u + step[:, 0], a + step[:, 1], b + step[:, 2]
        row, column = np.divmod(own, self.shape[1])
        return np.stack([column + a, row + b], axis=1), u

    @cached_property
    def _around(self) -> tuple[Array, ...]:
        """o, d, and their differences along rows and down columns, (h, w, 3) each."""
        o, d = self.origins, self.directions
        return o, d, np.gradient(o, axis=1), np.gradient(d, axis=1), np.gradient(o, axis=0), np.gradient(d, axis=0)

    def rendered(self, points: Array, faces: Array) -> Array:
        """Depths (h, w) of a moved surface whose vertex r * w + c belongs to pixel (r, c); NaN where no triangle is seen.

        Rays are cast at each triangle from the pixels of the bounding rectangle of its corners. A pixel still sees a surface
        whose edge is at most 0.05 pixels away.

        :param points: (h * w, 3).
        :param faces: (m, 3).
        """
        h, w = self.shape
        seen, _ = self.pixels(points)
        corners = seen[faces]
        low = np.ceil(corners.min(axis=1) - SLACK).clip(0).astype(np.int64)
        high = np.floor(corners.max(axis=1) + SLACK).clip(-1, (w - 1, h - 1)).astype(np.int64)
        size = (high - low + 1).clip(0)
        count = size.prod(axis=1)
        triangle = np.repeat(np.arange(len(faces)), count)
        place = np.arange(len(triangle)) - np.repeat(np.cumsum(count) - count, count)
        column = low[triangle, 0] + place % size[triangle, 0].clip(1)
        row = low[triangle, 1] + place // size[triangle, 0].clip(1)
        pixel = row * w + column
        lines = self.origins.reshape(-1, 3)[pixel], self.directions.reshape(-1, 3)[pixel]
        exact, around = np.full(h * w, np.inf), np.full(h * w, np.inf)
        for nearest, edge in ((exact, EDGE), (around, SLACK)):
            np.minimum.at(nearest, pixel, met(*lines, points[faces[triangle]], edge))
        depth = np.where(around < exact * (1.0 - NEARER), around, exact)
        return np.where(np.isfinite(depth), depth, np.nan).reshape(h, w)


def _solved(one: Array, two: Array, three: Array, right: Array) -> Array:
    """x (n, 3) with x_0 one + x_1 two + x_2 three = right, by Cramer's rule; zero where the three span no space."""
    across = np.cross(two, three)
    volume = np.einsum("ij,ij->i", one, across)
    parts = np.stack(
        [
            np.einsum("ij,ij->i", right, across),
            np.einsum("ij,ij->i", one, np.cross(right, three)),
            np.einsum("ij,ij->i", one, np.cross(two, right)),
        ],
        axis=1,
    )
    return np.divide(parts, volume[:, None], out=np.zeros_like(parts), where=volume[:, None] != 0)


def met(origins: Array, directions: Array, corners: Array, edge: float = 0.0) -> Array:
    """The factor (n,) at which each ray hits its triangle (Möller and Trumbore 1997); infinite where it does not.

    :param origins: (n, 3).
    :param directions: (n, 3).
    :param corners: (n, 3, 3).
    :param edge: how far outside its edges a triangle is still hit, as a share of it.
    """
    a, b, c = np.moveaxis(corners, 1, 0)
    one, two, start = b - a, c - a, origins - a
    normal, aside = np.cross(one, two), np.cross(start, directions)
    facing = -np.einsum("ij,ij->i", normal, directions)
    sizes = np.linalg.norm(normal, axis=1) * np.linalg.norm(directions, axis=1)
    sound = np.abs(facing) > 1e-12 * sizes
    scale = np.divide(1.0, facing, out=np.zeros_like(facing), where=sound)
    v = np.einsum("ij,ij->i", two, aside) * scale
    w = -np.einsum("ij,ij->i", one, aside) * scale
    t = np.einsum("ij,ij->i", normal, start) * scale
    inside = sound & (v >= -edge) & (w >= -edge) & (v + w <= 1.0 + edge) & (t > 0)
    return np.where(inside, t, np.inf)
