"""Scattered points with values, or with heights: their Delaunay triangulation, or a given one (TIN)."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import InputError
from meshflow.geometry.options import named_fields
from meshflow.geometry.planar_delaunay import delaunay_on_plane, rings_of, shorter_than, within
from meshflow.geometry.validation import Array, must_be_vertices, nowhere, positive, real, triangles_of
from meshflow.surfaces.irregular import Irregular, Vertices, present, used
from meshflow.surfaces.mesh import Mesh

__all__ = ["Scattered"]


@named_fields
@dataclass(frozen=True, eq=False, repr=False)
class Scattered(Irregular):
    """Scattered points on a plane or a terrain, whose values are smoothed; without values, their heights are.

    The triangles are those of Delaunay over x and y, without the flat ones at the rim of the convex hull. A point that is missing
    is left out, and the triangles go over its place.

    Example:

        >>> import numpy as np
        >>> from meshflow import Scattered, smooth
        >>> draw = np.random.default_rng(0)
        >>> places = draw.uniform(0, 100, (900, 2))  # metres
        >>> soundings = Scattered(places, np.sin(places[:, 0] / 15) + 0.2 * draw.normal(size=900))
        >>> after = smooth(soundings)
        >>> bool(np.std(after.values - np.sin(places[:, 0] / 15)) < 0.13)
        True

    :param points: (n, 2), or (n, 3) with heights: lengths are then measured on the terrain, or, without values, z moves.
    :param values: (n,) or (n, k); NaN: missing. None: the heights.
    :param faces: (m, 3), the triangles of a TIN; None: those of Delaunay.
    :param max_edge: triangles with a longer edge are left out, unit of the points. None: none.
    :param outline: triangles whose centre lies outside of this polygon (k, 2) are left out; of several, those inside others are
        holes. None: none.
    :param missing: (n,), further points that are missing.
    :raises InputError: for other shapes, two points at one place, points on one line, and limits that leave no triangle.
    """

    points: Array
    values: Array | None = None
    faces: Array | None = None
    max_edge: float | None = None
    outline: ArrayLike | Sequence[ArrayLike] | None = None
    missing: Array = field(default_factory=nowhere)

    def __post_init__(self) -> None:
        points = real(self.points, "scattered points")
        if points.ndim != 2 or points.shape[1] not in (2, 3):
            raise InputError(f"scattered points: shape (n, 2) or (n, 3) expected, got {points.shape}")
        if self.values is None and points.shape[1] == 2:
            raise InputError(
                "scattered points (n, 2): values (n,) or (n, k) expected beside them, or heights: points (n, 3)"
            )
        given = points[:, 2] if self.values is None else self.values
        values, missing = present(given, points, self.missing, "scattered points")
        if self.max_edge is not None:
            positive(self.max_edge, "max_edge")
        if self.faces is not None:
            faces = triangles_of(self.faces)
            must_be_vertices(faces, len(points))
            object.__setattr__(self, "faces", faces)
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "values", None if self.values is None else values)
        object.__setattr__(self, "missing", missing)
        _ = self.mesh

    @property
    def shape(self) -> tuple[int, ...]:
        """(n,)."""
        return (len(self.points),)

    @property
    def columns(self) -> Array:
        """The values, or the heights, (n, k)."""
        return (self.points[:, 2] if self.values is None else self.values).reshape(len(self.points), -1)

    def with_columns(self, columns: Array) -> "Scattered":
        """A copy with other values, or heights."""
        if self.values is not None:
            return replace(self, values=columns.reshape(self.values.shape))
        return replace(self, points=np.column_stack([self.points[:, :2], columns]).astype(self.points.dtype))

    def found(self) -> Vertices:
        """The points that are not missing."""
        return Vertices.of(self.missing)

    def spanned(self) -> Mesh:
        """The triangles; their vertices lie on the plane where heights move."""
        first = self.vertices.first
        points = self.points[first].astype(np.float64)
        flat = points[:, :2]
        if self.faces is None:
            faces = delaunay_on_plane(flat, "scattered points")
        else:
            faces = self.vertices.home[self.faces]
            faces = faces[(faces >= 0).all(axis=1)]
        if self.max_edge is not None:
            faces = shorter_than(flat, faces, self.max_edge)
        if self.outline is not None:
            faces = within(flat, faces, rings_of(self.outline, "outline"))
        measured = flat if self.values is None else points
        return used(faces, measured, self.vertices.means(self.columns), "scattered points")
