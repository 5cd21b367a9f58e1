"""A triangulated surface in R^d of which each vertex may move along some free directions."""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array, mask_of

__all__ = ["Axes", "Boundary", "Rays", "Surface"]

Boundary = Literal["natural", "linear", "fixed"]


@dataclass(frozen=True)
class Axes:
    """Every vertex moves along the same coordinate axes: z of a height field, the channels of an image, all of a mesh.

    :param columns: the coordinates that are free, from 0 to d - 1.
    """

    columns: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Rays:
    """Every vertex moves along its own line, p(u) = o + u d: the lines of sight of a camera or a scanner.

    :param origins: o, (n, 3).
    :param directions: d, (n, 3), none of length zero where the vertex may move.
    :param along: u now, (n,).
    """

    origins: Array
    directions: Array
    along: Array

    def at(self, u: Array) -> Array:
        """Points (n, 3) at u (n, 1) along the lines."""
        return self.origins + u * self.directions


@dataclass(frozen=True, eq=False)
class Surface:
    """Points, triangles, and where each point may go.

    :param points: (n, d), finite; d >= 2. The unit is the data's.
    :param sheets: triangulations of the same points, each (m, 3): one for a mesh, two for the diagonals of a grid.
    :param free: :class:`Axes` or :class:`Rays`; by default all axes (full curvature flow).
    :param fixed: vertices (n,) that stay.
    :param boundary: ``natural``: nothing but the variational boundary; ``linear``: the pull of the boundary's conormal is
        taken out, so that tilted planes rest; ``fixed``: boundary vertices stay.
    :param turns: take the sheets in turn, one per rate evaluation (``alternate``), instead of all together.
    :param pace: (n,) factor of time of each vertex (pixel footprint squared of a range image); 1 by default.
    :param charts: for each sheet (m, 3, c), the coordinates that are not free of each triangle's corners in a chart of its
        own, where no common plane holds them (spacing per row on an ellipsoid); taken from ``points`` by default.
    :raises InputError: when shapes disagree, points are not finite, or a face names a vertex that is not there.
    """

    points: Array
    sheets: tuple[Array, ...]
    free: Axes | Rays | None = None
    fixed: Array | None = None
    boundary: Boundary = "natural"
    turns: bool = False
    pace: Array | None = field(default=None)
    charts: tuple[Array, ...] | None = None

    def __post_init__(self) -> None:
        points = np.ascontiguousarray(self.points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] < 2:
            raise InputError(f"points: shape (n, d) with d >= 2 expected, got {points.shape}")
        if not np.isfinite(points).all():
            bad = int((~np.isfinite(points)).any(axis=1).sum())
            raise InputError(
                f"points: finite numbers expected, {bad} of {len(points)} points hold NaN or infinity; drop them"
            )
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "sheets", tuple(_faces(f, len(points)) for f in self.sheets))
        object.__setattr__(self, "fixed", mask_of(self.fixed, (len(points),), "fixed"))
        if self.boundary not in ("natural", "linear", "fixed"):
            raise InputError(f"boundary: natural, linear or fixed expected, got {self.boundary!r}")
        if self.free is None:
            object.__setattr__(self, "free", Axes(tuple(range(points.shape[1]))))
        self._check_free(points.shape[1])
        if self.pace is not None and np.shape(self.pace) != (len(points),):
            raise InputError(f"pace: shape {(len(points),)} expected, got {np.shape(self.pace)}")

    def _check_free(self, d: int) -> None:
        if isinstance(self.free, Axes):
            columns = self.free.columns
            if not columns or len(set(columns)) != len(columns) or not set(columns) <= set(range(d)):
                raise InputError(f"free: different coordinates from 0 to {d - 1} expected, got {columns}")
            if d - len(columns) == 1:
                raise InputError("free: one coordinate that stays spans no area; at least two must stay, or none")
        elif self.points.shape[1] != 3:
            raise InputError(f"free: rays need points in R^3, got R^{d}")

    @property
    def start(self) -> Array:
        """The free coordinates now, (n, k)."""
        if isinstance(self.free, Rays):
            return np.array(self.free.along, dtype=np.float64)[:, None]
        assert self.free is not None
        return self.points[:, self.free.columns].copy()

    def points_at(self, u: Array) -> Array:
        """Points (n, d) when the free coordinates are u (n, k)."""
        if isinstance(self.free, Rays):
            return self.free.at(u)
        assert self.free is not None
        points = self.points.copy()
        points[:, self.free.columns] = u
        return points

    def moved(self, u: Array) -> "Surface":
        """The same surface with free coordinates u (n, k)."""
        free = replace(self.free, along=u[:, 0]) if isinstance(self.free, Rays) else self.free
        return replace(self, points=self.points_at(u), free=free)


def _faces(faces: Array, n: int) -> Array:
    """Triangles (m, 3) of vertices 0 to n - 1, as int64."""
    array = np.asarray(faces)
    if array.size == 0:
        return np.zeros((0, 3), np.int64)
    if array.ndim != 2 or array.shape[1] != 3:
        raise InputError(f"faces: triangles of shape (m, 3) expected, got {array.shape}; triangulate polygons first")
    if array.dtype.kind not in "iu":
        raise InputError(f"faces: whole numbers expected, got dtype {array.dtype}")
    low, high = int(array.min()), int(array.max())
    if low < 0 or high >= n:
        raise InputError(f"faces: vertices 0 to {n - 1} expected, got {low if low < 0 else high}")
    return np.ascontiguousarray(array, dtype=np.int64)
