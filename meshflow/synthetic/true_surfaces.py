"""True surfaces with distances, for the comparison of meshes."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from meshflow.geometry.validation import Array

__all__ = ["Blob", "Box", "Dome", "LPart", "Ring", "TrueSurface"]

# Steps from a point to the nearest one of a level set. Each reduces the error by the factor curvature times distance, a quarter
# for points at a distance of a tenth.
STEPS = 60


class TrueSurface(Protocol):
    """The surface that a mesh samples."""

    def distance(self, points: Array) -> Array:
        """Distance (k,) of points (k, 3) from the surface, not negative, in their unit."""
        ...


@dataclass(frozen=True)
class Box:
    """A box about the origin, |x_i| <= half_i."""

    half: tuple[float, float, float]

    def distance(self, points: Array) -> Array:
        """Distance (k,) of points (k, 3) from its sides, inside or outside."""
        return _from_walls(np.abs(points) - np.array(self.half))


@dataclass(frozen=True)
class Ring:
    """A torus about the z axis; with ``radius`` 0 a sphere.

    :param radius: of its central circle.
    :param thickness: distance of the surface from that circle.
    """

    radius: float
    thickness: float

    def distance(self, points: Array) -> Array:
        """Distance (k,) of points (k, 3) from the surface."""
        aside = np.hypot(points[:, 0], points[:, 1]) - self.radius
        return np.abs(np.hypot(aside, points[:, 2]) - self.thickness)


@dataclass(frozen=True)
class Dome:
    """The upper half of the unit sphere, with its border at z = 0."""

    def distance(self, points: Array) -> Array:
        """Distance (k,) of points (k, 3) from the half sphere; below the border, from the border."""
        aside = np.hypot(points[:, 0], points[:, 1])
        above = np.abs(np.linalg.norm(points, axis=1) - 1.0)
        return np.where(points[:, 2] >= 0, above, np.hypot(aside - 1.0, points[:, 2]))


@dataclass(frozen=True)
class LPart:
    """An L of foot 1 x width and leg width x height, extruded by ``depth`` about z = 0, a fillet in its corner, a round hole.

    :param width: of foot and leg.
    :param height: of the leg.
    :param fillet: its radius.
    :param middle: of the hole.
    :param hole: its radius.
    :param depth: along z.
    """

    width: float = 0.35
    height: float = 0.8
    fillet: float = 0.15
    middle: tuple[float, float] = (0.72, 0.175)
    hole: float = 0.09
    depth: float = 0.3

    @property
    def corners(self) -> tuple[tuple[tuple[float, float], tuple[float, float]], ...]:
        """The straight pieces of the outline, from and to, anticlockwise; the fillet lies between the third and the fourth."""
        w, h, r = self.width, self.height, self.fillet
        outline = ((0.0, 0.0), (1.0, 0.0), (1.0, w), (w + r, w), (w, w + r), (w, h), (0.0, h))
        pieces = tuple(zip(outline, (*outline[1:], outline[0]), strict=True))
        return pieces[:3] + pieces[4:]

    @property
    def centre(self) -> tuple[float, float]:
        """Of the circle of the fillet."""
        return (self.width + self.fillet, self.width + self.fillet)

    def inside(self, flat: Array) -> Array:
        """Whether (k,) points (k, 2) lie within the outline."""
        x, y = flat[:, 0], flat[:, 1]
        foot = (x >= 0) & (x <= 1) & (y >= 0) & (y <= self.width)
        leg = (x >= 0) & (x <= self.width) & (y >= 0) & (y <= self.height)
        c = self.centre
        corner = (x >= self.width) & (x <= c[0]) & (y >= self.width) & (y <= c[1])
        corner &= np.hypot(x - c[0], y - c[1]) >= self.fillet
        return (foot | leg | corner) & (np.hypot(x - self.middle[0], y - self.middle[1]) >= self.hole)

    def from_outline(self, flat: Array) -> Array:
        """Distance (k,) of points (k, 2) from the outline and the hole, inside negative."""
        away = [_from_segment(flat, np.array(a), np.array(b)) for a, b in self.corners]
        dx, dy = flat[:, 0] - self.centre[0], flat[:, 1] - self.centre[1]
        # Beside its quarter of a circle the fillet is nearest at its ends, which are those of straight pieces.
        away.append(np.where((dx <= 0) & (dy <= 0), np.abs(np.hypot(dx, dy) - self.fillet), np.inf))
        away.append(np.abs(np.hypot(flat[:, 0] - self.middle[0], flat[:, 1] - self.middle[1]) - self.hole))
        nearest = np.min(away, axis=0)
        return np.where(self.inside(flat), -nearest, nearest)

    def distance(self, points: Array) -> Array:
        """Distance (k,) of points (k, 3) from walls, hole and the two flat ends."""
        return _from_walls(
            np.stack([self.from_outline(points[:, :2]), np.abs(points[:, 2]) - 0.5 * self.depth], axis=1)
        )


@dataclass(frozen=True)
class Blob:
    """The points where a sum of Gaussians, exp(-|x - c|^2 / r^2), is ``level``: smooth, with waists and humps.

    :param centres: c.
    :param radii: r.
    :param level: below it is outside.
    """

    centres: tuple[tuple[float, float, float], ...] = (
        (-0.35, -0.2, 0.0),
        (0.3, -0.25, 0.15),
        (0.05, 0.35, -0.1),
        (0.45, 0.3, 0.4),
        (-0.3, 0.25, 0.45),
        (0.1, -0.1, -0.5),
    )
    radii: tuple[float, ...] = (0.36, 0.34, 0.36, 0.24, 0.22, 0.28)
    level: float = 0.5

    def value(self, points: Array) -> Array:
        """Sum of the Gaussians minus the level (k,), at points (k, 3): positive inside."""
        return self._measured(points)[0]

    def projected(self, points: Array) -> Array:
        """The points (k, 3) where points close to the surface meet it along the gradient (Newton)."""
        x = points.copy()
        for _ in range(20):
            value, slope = self._measured(x)
            x -= (value / np.einsum("ij,ij->i", slope, slope))[:, None] * slope
        return x

    def distance(self, points: Array) -> Array:
        """Distance (k,) of points (k, 3) that are closer to the surface than its radii of curvature."""
        x = self.projected(points)
        for _ in range(STEPS):
            value, slope = self._measured(x)
            steep = np.einsum("ij,ij->i", slope, slope)[:, None]
            away = points - x
            # Along the surface towards the point, and back onto the surface.
            x = x + away - slope * ((np.einsum("ij,ij->i", away, slope) + value)[:, None] / steep)
        return np.linalg.norm(points - self.projected(x), axis=1)

    def _measured(self, points: Array) -> tuple[Array, Array]:
        """Value (k,) and its gradient (k, 3)."""
        value, slope = np.full(len(points), -self.level), np.zeros((len(points), 3))
        for centre, radius in zip(self.centres, self.radii, strict=True):
            away = points - np.array(centre)
            bump = np.exp(-np.einsum("ij,ij->i", away, away) / radius**2)
            value += bump
            slope -= (2.0 / radius**2 * bump)[:, None] * away
        return value, slope


def _from_walls(away: Array) -> Array:
    """Distance (k,) from the surface of a product of bodies, from the signed distance (k, j) to each, inside negative."""
    outside = np.linalg.norm(np.maximum(away, 0.0), axis=1)
    return outside + np.abs(np.minimum(away.max(axis=1), 0.0))


def _from_segment(flat: Array, a: Array, b: Array) -> Array:
    """Distance (k,) of points (k, 2) from the segment a b."""
    along = b - a
    share = np.clip((flat - a) @ along / (along @ along), 0.0, 1.0)
    return np.linalg.norm(flat - a - share[:, None] * along, axis=1)
