"""Triangle meshes: points, channels of the vertices, and which of them move."""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import InputError
from meshflow.geometry.normals import mean_edge, normals_at
from meshflow.geometry.options import named_fields
from meshflow.geometry.validation import Array, must_have_areas, must_have_squares, nowhere, real
from meshflow.surfaces.free import Axes
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.surface import Boundary, Surface

__all__ = ["Mesh", "Moves"]

Moves = Literal["points", "channels", "all"]


@named_fields
@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh whose points, channels, or both are free.

    :param points: (n, d), d >= 2, finite.
    :param faces: (m, 3), vertices 0 to n - 1. Degenerate triangles contribute nothing; isolated vertices stay.
    :param channels: (n, k) per vertex: colour, temperature, a vector.
    :param moves: ``points`` (channels keep their values), ``channels`` (the points stay), or ``all`` (coupled). By default the
        channels where there are any, else the points.
    :param fixed: (n,), vertices that stay.
    :raises InputError: for an empty mesh, NaN or infinity, a face with an index out of range, or channels of another length.
    """

    points: Array
    faces: Array
    channels: Array | None = None
    moves: Moves | None = None
    fixed: Array = field(default_factory=nowhere)
    boundary: Boundary = field(default="plane-preserving", init=False)

    def __post_init__(self) -> None:
        points = real(self.points, "mesh points")
        must_have_squares(points, "mesh points")
        surface = Surface(points, (self.faces,), fixed=self.fixed)  # checks points, faces and fixed
        must_have_areas(points, "mesh points")
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
        """Unit normals (n, 3) of the vertices, area-weighted means of their triangles; zero where undefined; None outside 3D."""
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
        return Surface(points, (self.faces,), axes, self.fixed, lift.boundary or self.boundary, irregular=True)

    def _axes(self, channels: Array, contrast: float) -> Axes:
        """The axes of the channels, or of the points and the channels."""
        (_, d), (_, k) = self.points.shape, channels.shape
        if self.moves == "channels":
            return Axes(tuple(range(d, d + k)), contrast, channels)
        return Axes(tuple(range(d + k)), (1.0,) * d + (contrast,) * k, np.column_stack([self.points, channels]))

    def lowered(self, u: Array) -> "Mesh":
        """A copy with the points, the channels, or both taken from u (n, free coordinates), in their units."""
        d = self.points.shape[1]
        points, channels = self.points, self.channels
        if self.moves != "channels":
            points = (points + (u[:, :d] - points)).astype(points.dtype)
        if channels is not None and self.moves != "points":
            channels = (channels + (u[:, -channels.shape[1] :] - channels)).astype(channels.dtype)
        return replace(self, points=points, channels=channels)
