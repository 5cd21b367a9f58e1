"""Samples with a known truth, and their noisy measurements, each given by a seed."""

from dataclasses import dataclass

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array
from meshflow.surfaces.camera import Pinhole
from meshflow.synthetic.solids import Ball, Block, CappedBall, Panel, Solid

__all__ = ["CAMERA", "SCENE", "MeshSample", "Sample", "Scene", "depth_scene", "irregular_mesh", "picture", "terrain"]

# A camera of 320 x 240 pixels, 56 degrees wide, like those of small time-of-flight cameras.
CAMERA = Pinhole(300.0, 300.0, 159.5, 119.5)
# Two slanted panels with nothing between and above them, a ball, and a corner of a cube; metres, y down, z forward.
SCENE: tuple[Solid, ...] = (
    Panel((0.0, 0.28, 0.96), 2.1, high=0.75),
    Panel((-0.6, 0.0, 0.8), 1.1, low=0.85),
    Ball((-0.35, -0.1, 1.7), 0.4),
    Block((0.42, 0.25, 1.75), 0.3, (40.0, 35.0)),
)


@dataclass(frozen=True, eq=False)
class Sample:
    """A grid of samples.

    :ivar truth: (h, w) or (h, w, k), in the unit of the function that made it.
    :ivar noisy: the measurement.
    """

    truth: Array
    noisy: Array


@dataclass(frozen=True, eq=False)
class Scene:
    """A scene seen by a camera.

    :ivar truth: (h, w), depth along the optical axis, metres; NaN where nothing is seen.
    :ivar noisy: the measurement.
    :ivar solids: the objects.
    :ivar seen: (h, w), the index in ``solids`` of the object at each pixel, -1 for none.
    """

    truth: Array
    noisy: Array
    solids: tuple[Solid, ...]
    seen: Array


@dataclass(frozen=True, eq=False)
class MeshSample:
    """A closed triangle mesh.

    :ivar truth: (n, 3), on the surface of ``body``.
    :ivar noisy: (n, 3), the measurement.
    :ivar faces: (m, 3), normals outwards.
    :ivar body: the solid; ``body.distance`` is the distance of a point from its surface.
    """

    truth: Array
    noisy: Array
    faces: Array
    body: CappedBall


def terrain(n: int = 256, seed: int = 0, noise: float = 2.0, spacing: float = 10.0) -> Sample:
    """Elevations (n, n) in metres: fractal hills with ridges, a valley that winds through them, and a mesa with cliffs.

    Hills and valley are as large as n * spacing allows (by default 2560 m wide, a few hundred metres of relief); the mesa is
    90 m high, its cliff two to four samples wide.

    Example:

        >>> terrain(32).noisy.shape
        (32, 32)

    :param n: number of samples along each side.
    :param seed: of the noise.
    :param noise: standard deviation, metres, independent for each sample.
    :param spacing: of the samples, metres.
    :raises InputError: for fewer than 16 samples along a side.
    """
    if n < 16:
        raise InputError(f"terrain: at least 16 samples along a side expected, got {n}")
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0:n, 0:n] / n
    size = n * spacing
    hills = fractal(n, 2.4, rng)
    ridges = 1.0 - np.abs(fractal(n, 2.2, rng))
    roughness = fractal(n, 2.0, rng)
    relief = size * (0.02 * hills + 0.012 * ridges + 0.002 * roughness)
    winding = 0.3 + 0.08 * np.sin(2 * np.pi * (1.3 * y + rng.uniform())) + 0.04 * np.sin(2 * np.pi * 3.1 * y)
    across = np.hypot(x - winding, 0.01) / 0.09
    valley = np.exp(-across)
    relief = relief * (1.0 - 0.8 * valley) - 0.05 * size * valley + 0.03 * size * (1.0 - y)
    mesa, outline = _mesa(x, y, rng)
    cliff = 1.0 / (1.0 + np.exp(-np.clip(mesa * n, -60, 60)))
    flat = np.average(relief, weights=cliff) + 0.15 * (relief - np.average(relief, weights=cliff))
    talus = 0.01 * size * np.exp(-np.maximum(-mesa, 0.0) / (0.1 * outline))
    ground = relief + talus
    truth = ground + cliff * (flat + 90.0 + talus - ground)
    truth = truth - truth.min() + 300.0
    return Sample(truth, truth + noise * rng.normal(size=truth.shape))


def _mesa(x: Array, y: Array, rng: np.random.Generator) -> tuple[Array, float]:
    """Distance (n, n) inwards from a lobed outline, in sides of the terrain, and the mean radius of the outline."""
    radius = 0.16
    across, along = x - 0.7, y - 0.32
    angle = np.arctan2(along, across)
    lobes = sum(0.14 / k * np.sin(k * angle + rng.uniform(0, 2 * np.pi)) for k in (2, 3, 5, 8))
    return radius * (1.0 + lobes) - np.hypot(across, along), radius


def fractal(n: int, slope: float, rng: np.random.Generator) -> Array:
    """A random field (n, n) with the spectrum k^-slope: mean 0, standard deviation 1, not periodic.

    :param slope: 2 is as rough as mountains, 3 is smooth.
    """
    size = 2 * n  # a quarter of a periodic field is not periodic
    k = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None, :])
    k[0, 0] = np.inf
    field = np.fft.irfft2(np.fft.rfft2(rng.normal(size=(size, size))) * k**-slope, s=(size, size))[:n, :n]
    return (field - field.mean()) / field.std()


def depth_scene(
    camera: Pinhole = CAMERA, shape: tuple[int, int] = (240, 320), seed: int = 0, noise: float = 0.002
) -> Scene:
    """Depths (h, w) of :data:`SCENE` in metres, computed exactly; pixels that see nothing are NaN.

    Example:

        >>> sample = depth_scene()
        >>> sample.noisy.shape
        (240, 320)

    :param camera: of the depth image.
    :param shape: (h, w).
    :param seed: of the noise.
    :param noise: c, per metre: the standard deviation of a depth is c z^2, as for stereo and structured light.
    """
    rays = camera.rays(shape)
    depths = np.stack([solid.cast(rays) for solid in SCENE])
    seen = depths.argmin(axis=0)
    nearest = depths.min(axis=0)
    nothing = ~np.isfinite(nearest)
    truth = np.where(nothing, np.nan, nearest)
    measured = truth + noise * truth**2 * np.random.default_rng(seed).normal(size=shape)
    return Scene(truth, measured, SCENE, np.where(nothing, -1, seen))


def irregular_mesh(n: int = 4000, seed: int = 0, noise: float = 0.01, density: float = 5.0) -> MeshSample:
    """A closed mesh of about n vertices on a :class:`CappedBall` of radius 1: round, flat, two sharp rims.

    The vertices lie on a spiral, displaced randomly by a third of their distance, and are ``density`` times denser at one end of
    the x axis than at the other. Vertices of the rims lie on the rims, so that the triangles resolve them.

    Example:

        >>> sample = irregular_mesh(500)
        >>> sample.noisy.shape[1]
        3

    :param n: approximate number of vertices.
    :param seed: of all random numbers.
    :param noise: standard deviation along the normals, in radii.
    :param density: vertices per solid angle at the dense end over those at the sparse end, at least 1.
    :raises InputError: for fewer than 200 vertices or a density below 1.
    """
    from scipy.spatial import ConvexHull

    if n < 200:
        raise InputError(f"irregular mesh: at least 200 vertices expected, got {n}")
    if not density >= 1:
        raise InputError(f"irregular mesh: a density of 1 or more expected, got {density}")
    rng, body = np.random.default_rng(seed), CappedBall()
    directions = _spiral(n, density, rng)
    gap = np.sqrt(4 * np.pi / n)
    for axis, height in zip(body.axes, body.heights, strict=True):
        away = np.abs(np.arccos(np.clip(directions @ np.array(axis), -1, 1)) - np.arccos(height)) > 0.5 * gap
        directions = np.concatenate([directions[away], _rim(axis, height, 0.6 * gap)])
    faces = ConvexHull(directions).simplices.astype(np.int64)
    a, b, c = np.moveaxis(directions[faces], 1, 0)
    inwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0
    faces[inwards] = faces[inwards][:, ::-1]
    truth = directions * body.cast(directions)[:, None]
    return MeshSample(truth, truth + noise * rng.normal(size=(len(truth), 1)) * body.normals(truth), faces, body)


def _spiral(n: int, density: float, rng: np.random.Generator) -> Array:
    """Directions (n, 3) on a golden spiral about x, their density falling linearly in x from ``density`` to 1, displaced
    randomly.
    """
    share = (np.arange(n) + 0.5) / n
    # The root of the cumulative density s + (density - 1) s^2 / 2 over its total, s = (1 + x) / 2 from the sparse end.
    more = density - 1.0
    s = 2.0 * share * (1.0 + 0.5 * more) / (1.0 + np.sqrt(1.0 + 2.0 * more * share * (1.0 + 0.5 * more)))
    x, angle = 2.0 * s - 1.0, np.pi * (1 + 5**0.5) * np.arange(n)
    across = np.sqrt(1.0 - x**2)
    spiral = np.stack([x, across * np.cos(angle), across * np.sin(angle)], axis=1)
    gap = np.sqrt(4 * np.pi / n * (1.0 + 0.5 * more) / (1.0 + more * s))
    shaken = spiral + gap[:, None] * rng.uniform(-1 / 3, 1 / 3, spiral.shape)
    return shaken / np.linalg.norm(shaken, axis=1, keepdims=True)


def _rim(axis: tuple[float, float, float], height: float, gap: float) -> Array:
    """Directions (k, 3) of points on the circle where a ball is cut, ``gap`` apart."""
    normal = np.array(axis)
    one = np.cross(normal, (1.0, 0.0, 0.0))
    one /= np.linalg.norm(one)
    radius = np.sqrt(1.0 - height**2)
    angle = 2 * np.pi * np.arange(k := int(np.ceil(2 * np.pi * radius / gap))) / k
    return height * normal + radius * (np.cos(angle)[:, None] * one + np.sin(angle)[:, None] * np.cross(normal, one))


def picture(shape: tuple[int, int] = (144, 192), seed: int = 0, noise: float = 12.0) -> Sample:
    """A colour picture (h, w, 3) of coloured discs on ramps, values 0 to 255; measurements are rounded and clipped.

    Example:

        >>> picture((16, 24)).noisy.shape
        (16, 24, 3)

    :param shape: (h, w).
    :param seed: of the noise.
    :param noise: standard deviation, in grey levels, independent for each channel.
    """
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0 : shape[0], 0 : shape[1]] / min(shape)
    truth = np.stack([60 + 80 * x, 170 - 70 * y, 90 + 50 * (x - y)], axis=-1)
    for _ in range(7):
        at = rng.uniform((0.1, 0.1), (0.9, 0.9 * shape[1] / shape[0]))
        radius, colour = rng.uniform(0.08, 0.22), rng.uniform(30, 225, 3)
        inside = np.hypot(y - at[0], x - at[1]) < radius
        truth[inside] = colour + 25 * ((x - at[1]) / radius)[inside][:, None]
    truth = np.clip(truth, 0.0, 255.0)
    return Sample(truth, np.clip(np.rint(truth + noise * rng.normal(size=truth.shape)), 0, 255))
