"""The nouns: height field, image, range image, mesh. Each is lifted to a Surface, and lowered back to itself."""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import InputError
from meshflow.geometry.camera import Camera, Measure
from meshflow.geometry.gates import Array, Spacing, mask_of, positive, real, samples, spacing_of
from meshflow.geometry.lattice import Fibres, Lattice, held, lowered
from meshflow.geometry.surface import Axes, Boundary, Surface
from meshflow.geometry.triangulate import Diagonals

__all__ = ["HeightField", "Image", "Lift", "Mesh", "Noun", "Pace", "RangeImage", "data_of"]

Moves = Literal["points", "channels", "all"]
Pace = Literal["footprint", "length"]


@dataclass(frozen=True)
class Lift:
    """How a noun becomes a surface.

    :param contrast: alpha of section 4.4, which multiplies the free coordinates before the flow and divides them after it:
        length of the surface per unit of the value. No unit where value and spacing share theirs.
    :param diagonals: of a grid's cells; ``alternate`` is as isotropic as ``both`` at half the cost.
    :param boundary: ``natural | linear | fixed``; by default what suits the noun.
    """

    contrast: float = 1.0
    diagonals: Diagonals = "alternate"
    boundary: Boundary | None = None

    def __post_init__(self) -> None:
        positive(self.contrast, "contrast")


@dataclass(frozen=True, eq=False)
class _Grid:
    """What all samples on a grid share."""

    boundary: Boundary = field(default="natural", init=False)

    def _lattice(self, planes: Array, missing: Array, fixed: Array, spacing: Spacing, lift: Lift) -> Lattice:
        """Free coordinates (k, h, w) above a grid."""
        boundary = lift.boundary or self.boundary
        return Lattice(planes, missing, fixed, spacing, lift.contrast, lift.diagonals, boundary)


def _where(mask: Array | None) -> Array:
    """A mask that the gate of its noun has made."""
    assert mask is not None
    return mask


@dataclass(frozen=True, eq=False)
class HeightField(_Grid):
    """Elevations on a grid; z alone is free.

    :param z: (h, w), row 0 in the north; NaN, infinite and masked samples are missing. Integers become floating point.
    :param spacing: one number or (dx, dy) in the horizontal unit, dx a number or one per row (degrees on an ellipsoid).
    :param missing: (h, w), further samples that are missing.
    :param fixed: (h, w), samples that stay.
    :param unit: the name of the unit of z, for reports and pictures.
    :raises InputError: for fewer than 2 x 2 samples, nothing but missing ones, or a spacing that is not positive.
    """

    z: Array
    spacing: Spacing = (1.0, 1.0)
    missing: Array | None = None
    fixed: Array | None = None
    unit: str = ""
    boundary: Boundary = field(default="linear", init=False)

    def __post_init__(self) -> None:
        z, missing = samples(self.z, self.missing, (2,), "height field")
        object.__setattr__(self, "z", z)
        object.__setattr__(self, "missing", missing)
        object.__setattr__(self, "fixed", mask_of(self.fixed, z.shape, "fixed"))
        object.__setattr__(self, "spacing", spacing_of(self.spacing, z.shape[0]))

    @property
    def step(self) -> float:
        """h: the typical distance of neighbours, in the horizontal unit (the geometric mean of dx and dy)."""
        return float(np.sqrt(np.mean(self.spacing[0]) * self.spacing[1]))

    def gridded(self, lift: Lift) -> Lattice:
        """The grid that a grid engine moves, z as it is; nothing is copied."""
        return self._lattice(self.z[None], _where(self.missing), _where(self.fixed), self.spacing, lift)

    def holding(self, planes: Array) -> "HeightField":
        """A copy whose elevations are planes (1, h, w); missing ones keep their bits."""
        return replace(self, z=held(self.z, planes[0], _where(self.missing)))

    def lifted(self, lift: Lift) -> Surface:
        """The surface (x, y, contrast z), of h * w vertices; missing ones have no triangle."""
        return self.gridded(lift).surface()

    def lowered(self, u: Array, lift: Lift) -> "HeightField":
        """A copy whose elevations are u (h * w, 1) over the contrast."""
        missing = _where(self.missing)
        start = np.where(missing, 0.0, self.z * np.float64(lift.contrast)).reshape(-1, 1)
        return replace(self, z=lowered(self.z, start, u, lift.contrast, missing))


@dataclass(frozen=True, eq=False)
class Image(_Grid):
    """Channels on a grid: grey, colour, a vector or tensor field; the channels are free, all together.

    :param values: (h, w) or (h, w, k); a sample with a channel that is NaN, infinite or masked is missing.
    :param spacing: one number or (dx, dy), pixels by default.
    :param missing: (h, w), further samples that are missing.
    :param fixed: (h, w), samples that stay.
    :raises InputError: as :class:`HeightField`.
    """

    values: Array
    spacing: Spacing = (1.0, 1.0)
    missing: Array | None = None
    fixed: Array | None = None

    def __post_init__(self) -> None:
        values, missing = samples(self.values, self.missing, (2, 3), "image")
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "missing", missing)
        object.__setattr__(self, "fixed", mask_of(self.fixed, missing.shape, "fixed"))
        object.__setattr__(self, "spacing", spacing_of(self.spacing, missing.shape[0]))

    @property
    def step(self) -> float:
        """h: the typical distance of neighbours (the geometric mean of dx and dy)."""
        return float(np.sqrt(np.mean(self.spacing[0]) * self.spacing[1]))

    def gridded(self, lift: Lift) -> Lattice:
        """The grid that a grid engine moves, the channels as they are; nothing is copied."""
        planes = self.values[None] if self.values.ndim == 2 else np.moveaxis(self.values, 2, 0)
        return self._lattice(planes, _where(self.missing), _where(self.fixed), self.spacing, lift)

    def holding(self, planes: Array) -> "Image":
        """A copy whose channels are planes (k, h, w); missing samples keep their bits."""
        values = planes[0] if self.values.ndim == 2 else np.ascontiguousarray(np.moveaxis(planes, 0, 2))
        return replace(self, values=held(self.values, values, _where(self.missing)))

    def lifted(self, lift: Lift) -> Surface:
        """The surface (x, y, contrast c1, ..., contrast ck), of h * w vertices."""
        return self.gridded(lift).surface()

    def lowered(self, u: Array, lift: Lift) -> "Image":
        """A copy whose channels are u (h * w, k) over the contrast."""
        missing = _where(self.missing)
        start = self.values.reshape(missing.size, -1) * np.float64(lift.contrast)
        start[missing.ravel()] = 0.0
        return replace(self, values=lowered(self.values, start, u, lift.contrast, missing))


@dataclass(frozen=True, eq=False)
class RangeImage:
    """Depths seen by a camera; each point may move along the ray of its pixel.

    Time is counted in pixel footprints, if nothing else is said: the motion of a vertex is multiplied by h_i squared, h_i the
    width of its pixel on the surface at the start (z_i / f of a pinhole), so that near and far are smoothed over the same
    number of pixels.

    :param depth: (h, w), in the unit that the result shall have (metres); 0, NaN, infinite and masked samples are missing.
        (Of a scanner of which each sample has an origin of its own, 0 and what is below it are samples: :class:`Scanner`.)
    :param camera: what saw it: :class:`Pinhole`, :class:`Orthographic`, :class:`Spherical` or :class:`Scanner`.
    :param missing: (h, w), further samples that are missing.
    :param fixed: (h, w), samples that stay.
    :param jump: a triangle is left out where depths differ by more than this share of the nearest: what is behind does not
        touch what is before it. None: no triangle is left out. (None where each sample has an origin of its own: a share of
        what may be zero means nothing.)
    :param measure: what the depths are, ``depth`` along the optical axis or ``range`` along the ray; by default what suits the
        camera.
    :param pace: time is counted in squares of each pixel's ``footprint``, or the same everywhere, in squared ``length``.
    :raises InputError: for a camera that cannot have seen it, negative depths, fewer than 2 x 2 samples, or
        nothing but missing ones.
    """

    depth: Array
    camera: Camera
    missing: Array | None = None
    fixed: Array | None = None
    jump: float | None = 0.05
    measure: Measure | None = None
    pace: Pace = "footprint"
    boundary: Boundary = field(default="linear", init=False)

    def __post_init__(self) -> None:
        depth, missing = samples(self.depth, self.missing, (2,), "range image")
        if not isinstance(self.camera, Camera):
            raise InputError(
                f"camera: a Pinhole, Orthographic, Spherical or Scanner expected, got {type(self.camera).__name__}; "
                "meshflow.read_camera reads one from a file"
            )
        if not self.camera.signed:
            missing = missing | (depth == 0)
        if missing.all():
            raise InputError(
                f"range image: all {missing.size} depths are missing (0, NaN or masked); nothing to smooth"
            )
        if not self.camera.signed and (depth[~missing] < 0).any():
            raise InputError(
                f"range image: depths above zero expected, got {depth[~missing].min()}; 0 or NaN mark what is missing"
            )
        if self.jump is not None:
            positive(self.jump, "jump")
        if self.pace not in ("footprint", "length"):
            raise InputError(f"pace: footprint or length expected, got {self.pace!r}")
        measure = self.measure or self.camera.usual
        self.camera.check((depth.shape[0], depth.shape[1]), measure, missing)
        object.__setattr__(self, "measure", measure)
        object.__setattr__(self, "depth", depth)
        object.__setattr__(self, "missing", missing)
        object.__setattr__(self, "fixed", mask_of(self.fixed, depth.shape, "fixed"))

    def gridded(self, lift: Lift) -> Lattice:
        """The grid that a grid engine moves, the depths as they are; nothing is copied.

        :raises InputError: for a contrast other than 1: along rays through one point it scales the scene and nothing else.
        """
        if lift.contrast != 1.0:
            raise InputError(
                f"contrast: for range images only 1 has a meaning (a factor on all depths scales the scene), "
                f"got {lift.contrast}; use gamma to keep edges"
            )
        boundary = lift.boundary or self.boundary
        return Lattice(
            self.depth[None],
            _where(self.missing),
            _where(self.fixed),
            diagonals=lift.diagonals,
            boundary=boundary,
            fibres=replace(self._fibres, footprint=self._footprint if self.pace == "footprint" else None),
            jump=None if self.camera.signed else self.jump,
        )

    @property
    def step(self) -> float:
        """h: 1 where time is counted in pixel footprints, else their median, a length."""
        if self.pace == "footprint":
            return 1.0
        return float(np.median(self._footprint[~_where(self.missing)]))

    @property
    def cloud(self) -> Array:
        """The points (h, w, 3) that were seen, NaN where missing."""
        return np.where(_where(self.missing)[..., None], np.nan, self._fibres.at(self.depth.astype(np.float64)))

    @property
    def _fibres(self) -> Fibres:
        assert self.measure is not None
        return self.camera.fibres((self.depth.shape[0], self.depth.shape[1]), self.measure)

    @property
    def _footprint(self) -> Array:
        """(h, w), in double precision, zero where missing."""
        assert self.measure is not None
        there = np.where(_where(self.missing), np.nan, self.depth).astype(np.float64)
        return np.nan_to_num(self.camera.footprint(there, self.measure), nan=0.0)

    def holding(self, planes: Array) -> "RangeImage":
        """A copy whose depths are planes (1, h, w); missing ones keep their bits."""
        return replace(self, depth=held(self.depth, planes[0], _where(self.missing)))

    def lifted(self, lift: Lift) -> Surface:
        """The surface of the points that were seen, each free along its ray.

        :raises InputError: for a contrast other than 1.
        """
        return self.gridded(lift).surface()

    def lowered(self, u: Array, lift: Lift) -> "RangeImage":
        """A copy whose depths are u (h * w, 1)."""
        missing = _where(self.missing)
        start = np.where(missing, 0.0, self.depth).astype(np.float64).reshape(-1, 1)
        return replace(self, depth=lowered(self.depth, start, u, lift.contrast, missing))


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh, its points or its channels or both free.

    :param points: (n, d), d >= 2, finite.
    :param faces: (m, 3), vertices 0 to n - 1. Degenerate triangles contribute nothing, isolated vertices stay.
    :param channels: (n, k) per vertex: colour, temperature, a vector.
    :param moves: ``points`` (the channels ride along), ``channels`` (on a surface that stays), or ``all`` (coupled); by default
        the channels where there are any, else the points.
    :param fixed: (n,), vertices that stay.
    :raises InputError: for an empty mesh, NaN or infinity, a face that names no vertex, or channels of another length.
    """

    points: Array
    faces: Array
    channels: Array | None = None
    moves: Moves | None = None
    fixed: Array | None = None
    boundary: Boundary = field(default="linear", init=False)

    def __post_init__(self) -> None:
        points = real(self.points, "mesh points")
        surface = Surface(points, (self.faces,), fixed=self.fixed)  # the gate of points, faces and fixed
        if len(surface.sheets[0]) == 0:
            raise InputError(
                f"mesh: at least one triangle expected, got {len(points)} points and none; a point cloud has no surface"
            )
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "faces", surface.sheets[0])
        object.__setattr__(self, "fixed", surface.fixed)
        object.__setattr__(self, "channels", self._checked(self.channels))
        if self.moves is None:
            object.__setattr__(self, "moves", "points" if self.channels is None else "channels")
        if self.moves not in ("points", "channels", "all"):
            raise InputError(f"moves: points, channels or all expected, got {self.moves!r}")
        if self.moves != "points" and self.channels is None:
            raise InputError(f"moves={self.moves!r}: the mesh has no channels; give channels (n, k)")

    def _checked(self, channels: ArrayLike | None) -> Array | None:
        if channels is None:
            return None
        values = real(channels, "mesh channels")
        values = values[:, None] if values.ndim == 1 else values
        if values.ndim != 2 or len(values) != len(self.points):
            raise InputError(f"mesh channels: shape ({len(self.points)}, k) expected, got {np.shape(channels)}")
        if not np.isfinite(values).all():
            raise InputError("mesh channels: finite numbers expected, got NaN or infinity")
        return values

    @property
    def normals(self) -> Array | None:
        """Unit normals (n, 3) of the vertices, the mean of their triangles by area; zero where there is none; None outside 3D."""
        if self.points.shape[1] != 3:
            return None
        corners = self.points[self.faces].astype(np.float64)
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        sums = np.stack(
            [np.bincount(self.faces.ravel(), np.repeat(part, 3), len(self.points)) for part in across.T], axis=1
        )
        lengths = np.linalg.norm(sums, axis=1, keepdims=True)
        return np.divide(sums, lengths, out=np.zeros_like(sums), where=lengths > 0)

    @property
    def step(self) -> float:
        """h: the mean length of the edges of the triangles, in the unit of the points."""
        corners = self.points[self.faces].astype(np.float64)
        return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())

    def lifted(self, lift: Lift) -> Surface:
        """The surface in R^d, or in R^(d + k) where channels move; contrast multiplies the channels."""
        d = self.points.shape[1]
        points, free = self.points, tuple(range(d))
        if self.channels is not None and self.moves != "points":
            points = np.column_stack([self.points.astype(np.float64), self.channels * np.float64(lift.contrast)])
            free = tuple(range(d if self.moves == "channels" else 0, points.shape[1]))
        elif lift.contrast != 1.0:
            raise InputError(f"contrast: a factor on the channels, and the points move alone; got {lift.contrast}")
        return Surface(points, (self.faces,), Axes(free), self.fixed, lift.boundary or self.boundary)

    def lowered(self, u: Array, lift: Lift) -> "Mesh":
        """A copy with the points, the channels, or both of u (n, free coordinates)."""
        d = self.points.shape[1]
        points, channels = self.points, self.channels
        if self.moves != "channels":
            points = (points + (u[:, :d] - points)).astype(points.dtype)
        if channels is not None and self.moves != "points":
            part = u[:, -channels.shape[1] :]
            channels = (channels + (part - channels * np.float64(lift.contrast)) / lift.contrast).astype(channels.dtype)
        return replace(self, points=points, channels=channels)


Noun = HeightField | Image | RangeImage | Mesh


def data_of(noun: Noun) -> Array:
    """What of a noun is smoothed, as its caller knows it: z (h, w), values (h, w) or (h, w, k), depth (h, w), points (n, d) or
    channels (n, k); of a mesh of which both move, the channels.
    """
    if isinstance(noun, Mesh):
        return noun.points if noun.channels is None or noun.moves == "points" else noun.channels
    return noun.z if isinstance(noun, HeightField) else noun.values if isinstance(noun, Image) else noun.depth
