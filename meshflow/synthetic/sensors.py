"""Simulated depth sensors: measurements of known objects, and the truth."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array, number, positive, whole
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.visibility import Sight, met
from meshflow.synthetic.solids import Solid

__all__ = ["Body", "Frame", "Seen", "Sensor", "StructuredLight", "TimeOfFlight", "observe", "seen"]

Body = Mesh | Sequence[Solid]
# A ray of the projector that meets the object this close to its end is not in shadow.
OWN = 1e-4


@dataclass(frozen=True, eq=False)
class Seen:
    """The first hits of the rays of a camera.

    :ivar depth: (h, w), u of the line of sight; NaN where nothing is hit.
    :ivar normals: (h, w, 3), unit, towards the camera; NaN likewise.
    :ivar part: (h, w), index of the solid or the triangle that is hit; -1 for none.
    """

    depth: Array
    normals: Array
    part: Array


@dataclass(frozen=True, eq=False)
class Frame:
    """The measurement of a sensor, and the truth.

    :ivar depth: (h, w), measured; NaN where missing.
    :ivar truth: (h, w), NaN where there is nothing.
    :ivar normals: (h, w, 3), true ones, unit, towards the camera; NaN likewise.
    :ivar sigma: (h, w), standard deviation of the noise of each pixel, before rounding; NaN likewise.
    :ivar flying: (h, w), pixels that mix the depths of two surfaces.
    :ivar dark: (h, w), pixels that see a surface that the light of the sensor does not reach.
    """

    depth: Array
    truth: Array
    normals: Array
    sigma: Array
    flying: Array
    dark: Array


class Sensor(Protocol):
    """A model of the errors of a sensor."""

    def measured(self, body: Body, sight: Sight, there: Seen) -> Frame:
        """The frame measured from what is seen of an object."""
        ...


def seen(body: Body, sight: Sight) -> Seen:
    """Cast the rays of a camera at an object.

    Example:

        >>> from meshflow import Pinhole
        >>> from meshflow.surfaces.visibility import Sight
        >>> from meshflow.synthetic import Ball
        >>> sight = Sight.through(Pinhole(fx=50.0, fy=50.0, cx=16.0, cy=12.0), (25, 33))
        >>> seen([Ball((0.0, 0.0, 2.0), 0.4)], sight).depth.shape
        (25, 33)

    :param body: a :class:`Mesh` in R^3, or solids, of which the nearest is seen; the lines of sight start outside of them.
    :param sight: the rays of the camera.
    :raises InputError: for no solid, or a mesh that is not in R^3.
    """
    depth, part = _cast(body, sight.origins, sight.directions)
    there = np.isfinite(depth)
    depth = np.where(there, depth, np.nan)
    normals = np.full((*sight.shape, 3), np.nan)
    points = sight.at(depth)
    if isinstance(body, Mesh):
        a, b, c = np.moveaxis(body.points[body.faces[part[there]]].astype(np.float64), 1, 0)
        across = np.cross(b - a, c - a)
        normals[there] = across / np.linalg.norm(across, axis=1, keepdims=True)
    else:
        for i, solid in enumerate(body):
            normals[part == i] = solid.normals(points[part == i])
    away = np.einsum("...i,...i->...", normals, sight.directions) > 0
    return Seen(depth, np.where(away[..., None], -normals, normals), np.where(there, part, -1))


def observe(body: Body, sight: Sight, sensor: Sensor) -> Frame:
    """The measurement of an object by a sensor through a camera: ``observe(SCENE, Sight.through(camera, shape), sensor)``.

    Example:

        >>> from meshflow import Pinhole
        >>> from meshflow.surfaces.visibility import Sight
        >>> from meshflow.synthetic import Ball, StructuredLight
        >>> sight = Sight.through(Pinhole(fx=50.0, fy=50.0, cx=15.5, cy=11.5), (24, 32))
        >>> observe([Ball((0.0, 0.0, 2.0), 0.4)], sight, StructuredLight()).depth.shape
        (24, 32)

    :param body: as in :func:`seen`.
    :param sight: the rays of the camera.
    :param sensor: a :class:`StructuredLight` or :class:`TimeOfFlight` sensor.
    :raises InputError: as :func:`seen`, and where nothing is seen.
    """
    there = seen(body, sight)
    if (there.part < 0).all():
        raise InputError("observe: none of the rays meets the body; turn the camera, or check the unit of the body")
    return sensor.measured(body, sight, there)


@dataclass(frozen=True)
class StructuredLight:
    """A projector beside the camera: depth from disparity d = f b / z, in pixels, so that noise and steps grow as z^2.

    A pixel is missing where the light of the projector does not reach (the shadow at silhouettes), and where the surface is seen
    at a grazing angle. The window of the pattern and speckle are not modelled.

    :param baseline: b, from the camera to the projector along the rows, unit of the depths (0.075 m: the first Kinect).
    :param focal: f, in pixels of the disparity (575: the first Kinect).
    :param sigma: standard deviation of the disparity, pixels: that of the depth is z^2 sigma / (f b).
    :param step: disparity is rounded to its multiples, pixels; None: no rounding.
    :param grazing: angle between line of sight and normal, degrees, at and above which nothing is measured.
    :param flying: share of the pixels at jumps of depth that measure a depth between the two sides.
    :param jump: difference of neighbouring depths, as a share of the nearer, that is a jump unless the slope explains it.
    :param seed: of all random numbers.
    :raises InputError: for lengths that are not positive, a negative sigma, or an invalid angle or share.
    """

    baseline: float = 0.075
    focal: float = 575.0
    sigma: float = 0.05
    step: float | None = 0.125
    grazing: float = 75.0
    flying: float = 0.3
    jump: float = 0.03
    seed: int = 0

    def __post_init__(self) -> None:
        for name, unit in (("baseline", ""), ("focal", "pixels"), ("jump", "")):
            positive(getattr(self, name), name, unit)
        if self.step is not None:
            positive(self.step, "step", "pixels")
        _at_least_zero(self.sigma, "sigma")
        _sound(self.grazing, self.flying, self.seed)

    def measured(self, body: Body, sight: Sight, there: Seen) -> Frame:
        """The frame measured from what is seen of an object."""
        rng, truth = np.random.default_rng(self.seed), there.depth
        dark = self._shadow(body, sight, there)
        scale = self.focal * self.baseline
        mixed, flying = _mixed(sight, there, self.jump, self.flying, rng)
        disparity = scale / mixed + self.sigma * rng.normal(size=truth.shape)
        if self.step is not None:
            disparity = np.rint(disparity / self.step) * self.step
        lit = ~dark & (sight.tilt(there.normals) < self.grazing) & (disparity > 0)
        depth = np.divide(scale, disparity, out=np.full(truth.shape, np.nan), where=lit)
        return Frame(depth, truth, there.normals, truth**2 * self.sigma / scale, flying & lit, dark)

    def _shadow(self, body: Body, sight: Sight, there: Seen) -> Array:
        """Pixels (h, w) whose surface is hidden from the projector."""
        found = np.isfinite(there.depth)
        points = sight.at(there.depth)[found]
        projector = sight.origins[found] + (self.baseline, 0.0, 0.0)
        reach, _ = _cast(body, projector, points - projector)
        shadow = np.zeros(found.shape, bool)
        shadow[found] = reach < 1.0 - OWN
        return shadow


@dataclass(frozen=True)
class TimeOfFlight:
    """A time-of-flight camera: noise a + b z, more where less light returns; pixels at jumps mix the depths of both sides.

    Multiple reflections are not modelled.

    :param sigma: a, standard deviation at depth 0, unit of the depths.
    :param growth: b, its increase per unit of depth.
    :param lambert: divide the standard deviation by the cosine of the angle between line of sight and normal, since a matt
        surface returns less light at an angle.
    :param grazing: angle, degrees, at and above which nothing is measured.
    :param flying: share of the pixels at jumps of depth that measure a depth between the two sides.
    :param jump: as in :class:`StructuredLight`.
    :param seed: of all random numbers.
    :raises InputError: for a negative noise, or an invalid angle or share.
    """

    sigma: float = 0.002
    growth: float = 0.002
    lambert: bool = False
    grazing: float = 85.0
    flying: float = 0.5
    jump: float = 0.03
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("sigma", "growth"):
            _at_least_zero(getattr(self, name), name)
        positive(self.jump, "jump")
        _sound(self.grazing, self.flying, self.seed)

    def measured(self, body: Body, sight: Sight, there: Seen) -> Frame:
        """The frame measured from what is seen of an object."""
        rng, truth = np.random.default_rng(self.seed), there.depth
        mixed, flying = _mixed(sight, there, self.jump, self.flying, rng)
        tilt, sigma = sight.tilt(there.normals), self.sigma + self.growth * truth
        if self.lambert:
            sigma = sigma / np.cos(np.radians(tilt))
        depth = mixed + sigma * rng.normal(size=truth.shape)
        back = (tilt < self.grazing) & (depth > 0)
        none = np.zeros(truth.shape, bool)
        return Frame(np.where(back, depth, np.nan), truth, there.normals, sigma, flying & back, none)


def _at_least_zero(value: float, name: str) -> None:
    if number(value, name) < 0:
        raise InputError(f"{name}: a standard deviation of zero or more expected, got {value}")


def _sound(grazing: float, flying: float, seed: int) -> None:
    """Check the options that both sensors share."""
    if not 0 < number(grazing, "grazing") <= 90:
        raise InputError(f"grazing: an angle above 0 and up to 90 degrees expected, got {grazing}")
    if not 0 <= number(flying, "flying") <= 1:
        raise InputError(f"flying: a share between 0 and 1 expected, got {flying}")
    whole(seed, "seed", 0)


def _cast(body: Body, origins: Array, directions: Array) -> tuple[Array, Array]:
    """Factors (...,) at which rays (..., 3) first hit an object, infinite where they do not, and the index of what they hit."""
    if isinstance(body, Mesh):
        return _cast_mesh(body, origins, directions)
    if len(body) == 0:
        raise InputError("body: at least one solid expected, got none")
    depths = np.stack([solid.cast(directions, origins) for solid in body])
    return depths.min(axis=0), depths.argmin(axis=0)


def _cast_mesh(mesh: Mesh, origins: Array, directions: Array) -> tuple[Array, Array]:
    """Cast rays at a mesh: the tree of libigl, in single precision, finds the triangle; the place is computed again."""
    import igl

    if mesh.points.shape[1] != 3:
        raise InputError(f"body: a mesh in R^3 expected, got points in R^{mesh.points.shape[1]}")
    points, faces = np.ascontiguousarray(mesh.points, dtype=np.float64), np.ascontiguousarray(mesh.faces)
    starts = np.ascontiguousarray(np.broadcast_to(origins, directions.shape).reshape(-1, 3), dtype=np.float64)
    rays = np.ascontiguousarray(directions.reshape(-1, 3), dtype=np.float64)
    tree = igl.AABB()
    tree.init(points, faces)
    part = np.asarray(tree.intersect_ray_first(points, faces, starts, rays)[0])
    depth, hit = np.full(len(rays), np.inf), part >= 0
    # The tolerance at edges is that of single precision.
    depth[hit] = met(starts[hit], rays[hit], points[faces[part[hit]]], edge=1e-3)
    part = np.where(np.isfinite(depth), part, -1)
    return depth.reshape(directions.shape[:-1]), part.reshape(directions.shape[:-1])


def _mixed(sight: Sight, there: Seen, jump: float, share: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Depths (h, w), of which a share at jumps lies between both sides, and the mask of those."""
    other = _across(sight, there, jump)
    chosen, weight = rng.uniform(size=other.shape) < share, rng.uniform(0.1, 0.9, size=other.shape)
    flying = chosen & np.isfinite(other)
    return np.where(flying, there.depth + weight * (other - there.depth), there.depth), flying


def _across(sight: Sight, there: Seen, jump: float) -> Array:
    """The depth (h, w) on the other side of the largest jump beside each pixel; NaN where there is none.

    A difference is no jump where the tangent plane of either side explains it.
    """
    z, n = there.depth, there.normals
    points, other, most = sight.at(z), np.full(z.shape, np.nan), np.zeros(z.shape)

    def led(from_: tuple[slice, slice], to: tuple[slice, slice]) -> Array:
        """Where the lines of sight of one pixel meet the tangent planes of its neighbour."""
        plane = np.einsum("...i,...i->...", n[from_], points[from_] - sight.origins[to])
        slope = np.einsum("...i,...i->...", n[from_], sight.directions[to])
        return np.divide(plane, slope, out=np.full(plane.shape, np.nan), where=slope != 0)

    every, first, last = slice(None), slice(None, -1), slice(1, None)
    for one, two in (((every, first), (every, last)), ((first, every), (last, every))):
        limit = jump * np.fmin(z[one], z[two])
        leap = np.abs(z[one] - z[two])
        jumps = (leap > limit) & (np.abs(led(one, two) - z[two]) > limit) & (np.abs(led(two, one) - z[one]) > limit)
        for here, there_ in ((one, two), (two, one)):
            greater = jumps & (leap > most[here])
            other[here] = np.where(greater, z[there_], other[here])
            most[here] = np.where(greater, leap, most[here])
    return other
