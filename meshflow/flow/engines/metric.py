"""Metrics: how triangles are measured while the surface moves: as given, intrinsic Delaunay, conformal, or clamped."""

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from meshflow.errors import InputError
from meshflow.flow.engines.triangulation import Triangulation
from meshflow.geometry import operator
from meshflow.geometry.connectivity import Connectivity, shared_sides
from meshflow.geometry.delaunay import (
    THIN,
    Triangles,
    clamped,
    delaunay,
    is_thin,
    length_cotangents,
    mollified,
)
from meshflow.geometry.normals import normals_at, side_lengths
from meshflow.geometry.operator import MassKind
from meshflow.geometry.validation import Array, positive
from meshflow.surfaces.surface import Surface

__all__ = ["Clamped", "Conformal", "Delaunay", "Given", "Measured", "Metric", "NormalChannels", "metric_of"]


@dataclass(frozen=True, eq=False)
class Measured:
    """Measured triangles of a surface in one state; its own triangles, or others of the same surface.

    :ivar connectivity: of the triangles.
    :ivar cot: (m, 3), cotangents, from which masses and indicators are computed.
    :ivar area: (m,).
    :ivar weights: (m, 3), the weights of the edges; by default the cotangents.
    """

    connectivity: Connectivity
    cot: Array
    area: Array
    weights: Array

    @classmethod
    def by(cls, connectivity: Connectivity, cot: Array, area: Array) -> "Measured":
        """Triangles with the cotangents as weights."""
        return cls(connectivity, cot, area, cot)


class Metric(Protocol):
    """Measures triangles in one state; evaluated at every rate.

    :ivar thinnest: where no cotangent is above this, explicit steps are those of the given triangles; 0: never.
    :ivar keeps_range: no weight is negative, so that explicit steps can be bounded to keep every coordinate in its range.
    """

    @property
    def thinnest(self) -> float:
        """The largest cotangent up to which the given triangles are used."""
        ...

    @property
    def keeps_range(self) -> bool:
        """Whether no weight is negative."""
        ...

    def settled(self, surface: Surface, triangulation: Triangulation, mass: MassKind) -> "Metric":
        """The metric for a surface at its start; :class:`Given` where it is not defined.

        :raises InputError: where it contradicts the boundary or the mass.
        """
        ...

    def measured(self, triangulation: Triangulation, x: Array, sharpness: float) -> Measured:
        """The triangles, measured by their charts and coordinates x (n, c)."""
        ...

    def area(self, triangulation: Triangulation, x: Array, sharpness: float) -> float:
        """Area of the surface, squared length."""
        ...


def _as_they_are(triangulation: Triangulation, x: Array, sharpness: float) -> Measured:
    faces = triangulation.connectivity.faces
    return Measured.by(triangulation.connectivity, *operator.cotangents(x, faces, triangulation.forms, sharpness))


class Given:
    """The given triangles."""

    thinnest = np.inf
    keeps_range = False

    def settled(self, surface: Surface, triangulation: Triangulation, mass: MassKind) -> "Metric":
        """The metric itself, which is always defined."""
        return self

    def measured(self, triangulation: Triangulation, x: Array, sharpness: float) -> Measured:
        """The triangles as they are."""
        return _as_they_are(triangulation, x, sharpness)

    def area(self, triangulation: Triangulation, x: Array, sharpness: float) -> float:
        """The sum of their areas."""
        return float(self.measured(triangulation, x, sharpness).area.sum())


@dataclass(frozen=True)
class Delaunay:
    """The intrinsic Delaunay triangulation of the same surface, where all coordinates are free.

    The edges of nearly flat triangles are lengthened slightly, so that no weight is negative and no system is singular.

    :param always: also where no triangle is thin.
    """

    always: bool = True
    keeps_range = False

    @property
    def thinnest(self) -> float:
        """0 where the Delaunay triangulation is always used, else the threshold for thin triangles."""
        return 0.0 if self.always else THIN

    def settled(self, surface: Surface, triangulation: Triangulation, mass: MassKind) -> "Metric":
        """The metric itself where all coordinates are free."""
        return self if surface.is_free and not surface.alternate else Given()

    def measured(self, triangulation: Triangulation, x: Array, sharpness: float) -> Measured:
        """The Delaunay triangles, or the given ones where none is thin."""
        given = _as_they_are(triangulation, x, sharpness)
        return given if not self.always and not is_thin(given.cot) else self.unfolded(triangulation, x)

    def unfolded(self, triangulation: Triangulation, x: Array) -> Measured:
        """The Delaunay triangles, by the lengths of their edges."""
        faces = triangulation.connectivity.faces
        flipped, lengths = delaunay(faces, mollified(side_lengths(x, faces)))
        return Measured.by(Connectivity.of((flipped,), triangulation.connectivity.size), *length_cotangents(lengths))

    def area(self, triangulation: Triangulation, x: Array, sharpness: float) -> float:
        """The sum of their areas."""
        return float(self.measured(triangulation, x, sharpness).area.sum())


@dataclass(frozen=True, eq=False)
class Clamped:
    """Negative weights are set to zero, so that no coordinate leaves its range (maximum principle).

    The flow is then not the gradient of the area. It needs a Neumann or fixed boundary.

    :param pairs: corners (e,) and (e,) opposite to the edges of two triangles; found by :meth:`settled`.
    """

    pairs: tuple[Array, Array] = field(default=(np.zeros(0, np.int64), np.zeros(0, np.int64)), repr=False)
    thinnest = 0.0
    keeps_range = True

    def settled(self, surface: Surface, triangulation: Triangulation, mass: MassKind) -> "Metric":
        """With the pairs of the triangles.

        :raises InputError: with a plane-preserving boundary or Voronoi mass, which have negative weights themselves.
        """
        if surface.boundary == "plane-preserving":
            raise InputError(
                "triangles='clamped': boundary neumann or fixed expected, got 'plane-preserving', which leaves the range"
            )
        if mass == "voronoi":
            raise InputError(
                "triangles='clamped': mass barycentric or ring expected, got 'voronoi', which asks for all angles"
            )
        return Clamped(shared_sides(triangulation.connectivity.faces))

    def measured(self, triangulation: Triangulation, x: Array, sharpness: float) -> Measured:
        """The given triangles with clamped cotangents."""
        given = _as_they_are(triangulation, x, sharpness)
        return Measured.by(given.connectivity, clamped(given.cot, *self.pairs), given.area)

    def area(self, triangulation: Triangulation, x: Array, sharpness: float) -> float:
        """The area of the given triangles."""
        return float(_as_they_are(triangulation, x, sharpness).area.sum())


@dataclass(frozen=True, eq=False)
class Conformal:
    """The stiffness of the start with the current mass (Kazhdan, Solomon, Ben-Chen 2012).

    Necks do not pinch off, and surfaces of genus zero become spheres. For surfaces whose coordinates are all free.

    :param inner: how the start is measured: as given, or clamped.
    :param first: (m, 3), the cotangents of the start; found by :meth:`settled`.
    """

    inner: Metric
    first: Array = field(default_factory=lambda: np.zeros((0, 3)), repr=False)
    thinnest = 0.0

    @property
    def keeps_range(self) -> bool:
        """Whether the metric of the start keeps the range."""
        return self.inner.keeps_range

    def settled(self, surface: Surface, triangulation: Triangulation, mass: MassKind) -> "Metric":
        """The metric with the cotangents of the surface, where all coordinates are free."""
        if not surface.is_free or surface.alternate:
            return Given()
        inner = self.inner.settled(surface, triangulation, mass)
        return Conformal(inner, inner.measured(triangulation, surface.points, 1.0).cot)

    def measured(self, triangulation: Triangulation, x: Array, sharpness: float) -> Measured:
        """The current areas with the cotangents of the start."""
        area = _as_they_are(triangulation, x, sharpness).area
        return Measured.by(triangulation.connectivity, self.first, area)

    def area(self, triangulation: Triangulation, x: Array, sharpness: float) -> float:
        """The current area."""
        return float(_as_they_are(triangulation, x, sharpness).area.sum())


@dataclass(frozen=True)
class NormalChannels:
    """Triangles are measured in (x, width n), n the current vertex normals, and move in x only.

    Points with different normals are far apart, so that faces become flat and creases stay. For points in R^3, all free.

    :param width: a length; a curvature above its inverse is a feature.
    :param inner: how triangles are measured in that space: as given, or intrinsic Delaunay.
    """

    width: float
    inner: Metric
    thinnest = 0.0

    @property
    def keeps_range(self) -> bool:
        """Whether the inner metric keeps the range."""
        return self.inner.keeps_range

    def __post_init__(self) -> None:
        positive(self.width, "contrast")

    def settled(self, surface: Surface, triangulation: Triangulation, mass: MassKind) -> "Metric":
        """The metric itself where all coordinates are free."""
        if not surface.is_free or surface.alternate:
            return Given()
        return NormalChannels(self.width, self.inner.settled(surface, triangulation, mass))

    def measured(self, triangulation: Triangulation, x: Array, sharpness: float) -> Measured:
        """The triangles in the space of points and normals."""
        wide = np.column_stack([x, self.width * normals_at(x, triangulation.connectivity.faces)])
        return self.inner.measured(triangulation, wide, sharpness)

    def area(self, triangulation: Triangulation, x: Array, sharpness: float) -> float:
        """The area of the surface itself, without normals."""
        return operator.total_area(x, triangulation.connectivity.faces)


def metric_of(triangles: Triangles) -> Metric:
    """The metric of a name: ``given``, ``delaunay``, ``auto`` (Delaunay where triangles are thin) or ``clamped``."""
    return {"given": Given(), "delaunay": Delaunay(), "auto": Delaunay(always=False), "clamped": Clamped()}[triangles]
