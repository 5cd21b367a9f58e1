"""A triangulated surface in R^d whose vertices may move along free directions."""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.options import named_fields
from meshflow.geometry.validation import Array, mask_of, must_be_vertices, nowhere, triangles_of
from meshflow.surfaces.free import ALL, Free

__all__ = ["BOUNDARIES", "Boundary", "Surface", "known_boundary"]

Boundary = Literal["neumann", "plane-preserving", "fixed"]
BOUNDARIES = ("neumann", "plane-preserving", "fixed")


def known_boundary(boundary: str) -> None:
    """Check the name of a boundary condition.

    :raises InputError: for an unknown one.
    """
    if boundary not in BOUNDARIES:
        raise InputError(f"boundary: neumann, plane-preserving or fixed expected, got {boundary!r}")


@named_fields
@dataclass(frozen=True, eq=False)
class Surface:
    """Points, triangles, and the free directions of each point.

    :param points: (n, d), finite; d >= 2. The unit is the data's.
    :param triangulations: of the same points, each (m, 3): one for a mesh, two for the diagonals of a grid.
    :param free: :class:`Axes` or :class:`Rays`; by default all axes (full curvature flow).
    :param fixed: vertices (n,) that stay; by default none.
    :param boundary: ``neumann``: the variational boundary condition; ``plane-preserving``: the pull of the boundary's conormal is
        removed, so that tilted planes do not move; ``fixed``: boundary vertices stay.
    :param irregular: triangles of any shape, as meshes have: a ``plane-preserving`` boundary then moves as a curve of its own
        (:func:`meshflow.geometry.border.border_operator`), instead of without the conormals of the triangles at border edges.
    :param alternate: take the triangulations in turn, one per rate evaluation, instead of all together.
    :param time_factor: (n,), factor on the rate of each vertex (the squared pixel footprint of a range image); None: 1 for all.
    :param charts: for each triangulation (m, 3, c), the coordinates of corners that are not free, in a chart of each triangle,
        where there is no common plane (spacing per row on an ellipsoid). By default taken from ``points``.
    :raises InputError: when shapes disagree, points are not finite, or a face has an index out of range.
    """

    points: Array
    triangulations: tuple[Array, ...]
    free: Free = ALL
    fixed: Array = field(default_factory=nowhere)
    boundary: Boundary = "neumann"
    irregular: bool = False
    alternate: bool = False
    time_factor: Array | None = None
    charts: tuple[Array, ...] = ()

    def __post_init__(self) -> None:
        points = np.ascontiguousarray(self.points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] < 2:
            raise InputError(f"points: shape (n, d) with d >= 2 expected, got {points.shape}")
        if not np.isfinite(points).all():
            bad = int((~np.isfinite(points)).any(axis=1).sum())
            raise InputError(
                f"points: finite numbers expected, {bad} of {len(points)} points hold NaN or infinity; drop them"
            )
        n, d = points.shape
        triangulations = tuple(_faces(faces, n) for faces in self.triangulations)
        free = self.free.checked(d)
        known_boundary(self.boundary)
        if self.time_factor is not None and np.shape(self.time_factor) != (n,):
            raise InputError(f"time factor: shape {(n,)} expected, got {np.shape(self.time_factor)}")
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "triangulations", triangulations)
        object.__setattr__(self, "free", free)
        object.__setattr__(self, "fixed", mask_of(self.fixed, (n,), "fixed"))

    @property
    def start(self) -> Array:
        """The current free coordinates (n, k), in the unit of the data."""
        now = self.free.now
        return self.free.coordinates(self.points) if now is None else np.array(now, dtype=np.float64)

    @property
    def corners(self) -> tuple[Array, ...]:
        """For each triangulation, the fixed coordinates (m, 3, c) of its corners; c is 0 where there are none."""
        staying = list(self.free.staying(self.points.shape[1]))
        return self.charts or tuple(self.points[:, staying][faces] for faces in self.triangulations)

    @property
    def is_free(self) -> bool:
        """Whether all coordinates of all points are free."""
        return not self.free.per_vertex and not self.free.staying(self.points.shape[1])

    def points_at(self, u: Array) -> Array:
        """Points (n, d) when the free coordinates are u (n, k)."""
        return self.free.at(self.points, u)

    def moved(self, u: Array) -> "Surface":
        """The same surface with free coordinates u (n, k)."""
        return replace(self, points=self.points_at(u), free=self.free.moved(u))


def _faces(faces: Array, n: int) -> Array:
    """Triangles (m, 3) of vertices 0 to n - 1, as int64."""
    array = triangles_of(faces)
    must_be_vertices(array, n)
    return np.ascontiguousarray(array, dtype=np.int64)
