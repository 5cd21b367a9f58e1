"""The nouns: height field, image, range image, mesh. Each is lifted to a Surface, and lowered back to itself."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import InputError
from meshflow.geometry.normals import mean_edge, normals_at
from meshflow.geometry.validation import Array, Spacing, brief, mask_of, nowhere, real, samples, spacing_of
from meshflow.surfaces.camera import Pinhole
from meshflow.surfaces.discontinuities import Cuts
from meshflow.surfaces.free import Axes
from meshflow.surfaces.grid import Lattice, Lift, held
from meshflow.surfaces.range_image import Pace, RangeImage
from meshflow.surfaces.surface import Boundary, Surface

__all__ = [
    "HeightField",
    "Image",
    "Lift",
    "Mesh",
    "Noun",
    "Pace",
    "RangeImage",
    "data_of",
    "from_disparity",
    "in_disparity",
    "together",
]

Moves = Literal["points", "channels", "all"]


@dataclass(frozen=True, eq=False)
class _Grid:
    """What all samples on a grid share."""

    boundary: Boundary = field(default="natural", init=False)

    def _lattice(self, planes: Array, missing: Array, fixed: Array, spacing: Spacing, lift: Lift) -> Lattice:
        """Free coordinates (k, h, w) above a grid."""
        boundary = lift.boundary or self.boundary
        return Lattice(planes, missing, fixed, spacing, lift.contrast, lift.diagonals, boundary)


@dataclass(frozen=True, eq=False)
class HeightField(_Grid):
    """Elevations on a grid; z alone is free.

    :param z: (h, w), row 0 in the north; NaN, infinite and masked samples are missing. Integers become floating point.
    :param spacing: one number or (dx, dy) in the horizontal unit, dx a number or one per row (degrees on an ellipsoid).
    :param missing: (h, w), further samples that are missing.
    :param fixed: (h, w), samples that stay.
    :param unit: the name of the unit of z, for reports and pictures.
    :param cuts: edges of the grid that no triangle has: what is on one side of a fault does not touch what is on the other.
    :raises InputError: for fewer than 2 x 2 samples, nothing but missing ones, or a spacing that is not positive.
    """

    z: Array
    spacing: Spacing = (1.0, 1.0)
    missing: Array = field(default_factory=nowhere)
    fixed: Array = field(default_factory=nowhere)
    unit: str = ""
    cuts: Cuts | None = None
    boundary: Boundary = field(default="linear", init=False)

    def __post_init__(self) -> None:
        z, missing = samples(self.z, self.missing, (2,), "height field")
        object.__setattr__(self, "z", z)
        object.__setattr__(self, "missing", missing)
        object.__setattr__(self, "fixed", mask_of(self.fixed, z.shape, "fixed"))
        object.__setattr__(self, "spacing", spacing_of(self.spacing, z.shape[0]))

    def __repr__(self) -> str:
        return brief(self, self.z, self.missing, f"spacing {self.step:.6g}", self.unit and f"heights in {self.unit}")

    @property
    def step(self) -> float:
        """h: the typical distance of neighbours, in the horizontal unit (the geometric mean of dx and dy)."""
        return float(np.sqrt(np.mean(self.spacing[0]) * self.spacing[1]))

    def gridded(self, lift: Lift) -> Lattice:
        """The grid that a grid engine moves, z as it is; nothing is copied."""
        lattice = self._lattice(self.z[None], self.missing, self.fixed, self.spacing, lift)
        return replace(lattice, cuts=self.cuts)

    def lifted(self, lift: Lift) -> Surface:
        """The surface (x, y, contrast z), of h * w vertices; missing ones have no triangle."""
        return self.gridded(lift).surface()

    def lowered(self, u: Array) -> "HeightField":
        """A copy whose elevations are u (h * w, 1), in their unit; missing ones keep their bits."""
        return replace(self, z=held(self.z, u, self.missing))


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
    missing: Array = field(default_factory=nowhere)
    fixed: Array = field(default_factory=nowhere)

    def __post_init__(self) -> None:
        values, missing = samples(self.values, self.missing, (2, 3), "image")
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "missing", missing)
        object.__setattr__(self, "fixed", mask_of(self.fixed, missing.shape, "fixed"))
        object.__setattr__(self, "spacing", spacing_of(self.spacing, missing.shape[0]))

    def __repr__(self) -> str:
        return brief(self, self.values, self.missing)

    @property
    def step(self) -> float:
        """h: the typical distance of neighbours (the geometric mean of dx and dy)."""
        return float(np.sqrt(np.mean(self.spacing[0]) * self.spacing[1]))

    def gridded(self, lift: Lift) -> Lattice:
        """The grid that a grid engine moves, the channels as they are; nothing is copied."""
        planes = self.values[None] if self.values.ndim == 2 else np.moveaxis(self.values, 2, 0)
        return self._lattice(planes, self.missing, self.fixed, self.spacing, lift)

    def lifted(self, lift: Lift) -> Surface:
        """The surface (x, y, contrast c1, ..., contrast ck), of h * w vertices."""
        return self.gridded(lift).surface()

    def lowered(self, u: Array) -> "Image":
        """A copy whose channels are u (h * w, k), in their unit; missing samples keep their bits."""
        return replace(self, values=held(self.values, u, self.missing))


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
    fixed: Array = field(default_factory=nowhere)
    boundary: Boundary = field(default="linear", init=False)

    def __post_init__(self) -> None:
        points = real(self.points, "mesh points")
        surface = Surface(points, (self.faces,), fixed=self.fixed)  # the gate of points, faces and fixed
        if len(surface.triangulations[0]) == 0:
            raise InputError(
                f"mesh: at least one triangle expected, got {len(points)} points and none; a point cloud has no surface"
            )
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "faces", surface.triangulations[0])
        object.__setattr__(self, "fixed", surface.fixed)
        object.__setattr__(self, "channels", self._checked(self.channels))
        if self.moves is None:
            object.__setattr__(self, "moves", "points" if self.channels is None else "channels")
        if self.moves not in ("points", "channels", "all"):
            raise InputError(f"moves: points, channels or all expected, got {self.moves!r}")
        if self.moves != "points" and self.channels is None:
            raise InputError(f"moves={self.moves!r}: the mesh has no channels; give channels (n, k)")

    def __repr__(self) -> str:
        channels = "" if self.channels is None else f", {self.channels.shape[1]} channels"
        n, d = self.points.shape
        return (
            f"Mesh({n} points in R^{d} {self.points.dtype}, {len(self.faces)} triangles{channels}, {self.moves} move)"
        )

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
        return normals_at(self.points, self.faces)

    @property
    def step(self) -> float:
        """h: the mean length of the edges of the triangles, in the unit of the points."""
        return mean_edge(self.points, self.faces)

    def lifted(self, lift: Lift) -> Surface:
        """The surface in R^d, or in R^(d + k) where channels move; contrast multiplies the channels."""
        d = self.points.shape[1]
        points, axes = self.points, Axes(tuple(range(d)))
        if self.channels is not None and self.moves != "points":
            points = np.column_stack([self.points.astype(np.float64), self.channels * np.float64(lift.contrast)])
            axes = self._axes(self.channels.astype(np.float64), lift.contrast)
        elif lift.contrast != 1.0:
            raise InputError(f"contrast: a factor on the channels, and the points move alone; got {lift.contrast}")
        return Surface(points, (self.faces,), axes, self.fixed, lift.boundary or self.boundary)

    def _axes(self, channels: Array, contrast: float) -> Axes:
        """The axes of the channels, or of the points and the channels."""
        (_, d), (_, k) = self.points.shape, channels.shape
        if self.moves == "channels":
            return Axes(tuple(range(d, d + k)), contrast, channels)
        return Axes(tuple(range(d + k)), (1.0,) * d + (contrast,) * k, np.column_stack([self.points, channels]))

    def lowered(self, u: Array) -> "Mesh":
        """A copy with the points, the channels, or both of u (n, free coordinates), in their units."""
        d = self.points.shape[1]
        points, channels = self.points, self.channels
        if self.moves != "channels":
            points = (points + (u[:, :d] - points)).astype(points.dtype)
        if channels is not None and self.moves != "points":
            channels = (channels + (u[:, -channels.shape[1] :] - channels)).astype(channels.dtype)
        return replace(self, points=points, channels=channels)


Noun = HeightField | Image | RangeImage | Mesh


def data_of(noun: Noun) -> Array:
    """What of a noun is smoothed, as its caller knows it: z (h, w), values (h, w) or (h, w, k), depth (h, w), points (n, d) or
    channels (n, k); of a mesh of which both move, the channels.
    """
    if isinstance(noun, Mesh):
        return noun.points if noun.channels is None or noun.moves == "points" else noun.channels
    return noun.z if isinstance(noun, HeightField) else noun.values if isinstance(noun, Image) else noun.depth


def in_disparity(image: RangeImage) -> HeightField:
    """Inverse depths above the pixels, of a pinhole without distortion: there, too, planes are planes.

    To take where the noise is that of a disparity: sigma of the depth grows with its square, that of the inverse depth is the
    same everywhere, and so is the contrast that suits it.

    :returns: 1 / depth over pixels of width 1 (of height fx / fy), cut where the depth jumps.
    :raises InputError: for another camera, or ranges: their planes are not planes there.
    """
    camera = image.camera
    if not isinstance(camera, Pinhole) or camera.distortion or image.measure != "depth":
        raise InputError(
            f"space='disparity': planes are planes in the inverse depth of a pinhole without distortion only, got "
            f"{image.measure}s of {type(camera).__name__} ({camera.summary}); undistort the image, or leave the space out"
        )
    missing = image.missing
    whole = np.where(missing, 1.0, image.depth)
    sides = float(np.sqrt(camera.fy / camera.fx)), float(np.sqrt(camera.fx / camera.fy))
    inverse = np.where(missing, 0.0, 1.0 / whole).astype(image.depth.dtype)
    unit = f"1/{image.unit}" if image.unit else "1 / depth"
    return HeightField(inverse, sides, missing, image.fixed, unit, image.cuts)


def from_disparity(image: RangeImage, field: HeightField) -> RangeImage:
    """The depths of inverse ones; where nothing moved, and where samples are missing, those of ``image``.

    :raises InputError: where an inverse depth is zero or less: a depth beyond the horizon.
    """
    before = in_disparity(image)
    still = image.missing | (field.z == before.z)
    if (field.z[~still] <= 0).any():
        raise InputError(
            f"space='disparity': {int((field.z[~still] <= 0).sum())} inverse depths are no longer above zero; give a limit"
        )
    return replace(
        image, depth=np.where(still, image.depth, 1.0 / np.where(still, 1.0, field.z)).astype(image.depth.dtype)
    )


def together(nouns: Sequence[Noun]) -> Mesh:
    """Meshes as one, their vertices one after the other.

    :raises InputError: for other nouns, and meshes of which not the same moves.
    """
    meshes = [one for one in nouns if isinstance(one, Mesh)]
    kinds = {
        (one.points.shape[1], one.moves, None if one.channels is None else one.channels.shape[1]) for one in meshes
    }
    if len(meshes) < len(nouns) or len(kinds) != 1:
        raise InputError("parts that are no meshes of one kind cannot be taken as one; take them one by one")
    starts = np.cumsum([0, *(len(one.points) for one in meshes)])
    channels = [one.channels for one in meshes if one.channels is not None]
    return Mesh(
        np.concatenate([one.points for one in meshes]),
        np.concatenate([one.faces + start for one, start in zip(meshes, starts, strict=False)]),
        np.concatenate(channels) if channels else None,
        moves=meshes[0].moves,
        fixed=np.concatenate([one.fixed for one in meshes]),
    )
