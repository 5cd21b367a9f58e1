"""How the triangles of a surface are measured while it moves: as they are, as Delaunay's, with weights held or clamped."""

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from meshflow.errors import InputError
from meshflow.flow.engines.triangulation import Triangulation
from meshflow.geometry import operator
from meshflow.geometry.connectivity import Connectivity, connect, shared_sides
from meshflow.geometry.delaunay import (
    THIN,
    Triangles,
    clamped,
    delaunay,
    is_thin,
    length_cotangents,
    mollified,
    side_lengths,
)
from meshflow.geometry.normals import normals_at
from meshflow.geometry.operator import MassKind
from meshflow.geometry.validation import Array, positive
from meshflow.surfaces.surface import Surface

__all__ = ["Clamped", "Conformal", "Delaunay", "Given", "Measured", "Metric", "NormalChannels", "metric_of"]


@dataclass(frozen=True, eq=False)
class Measured:
    """Triangles of a surface at one moment, its own or others of the same surface.

    :ivar connectivity: of the triangles.
    :ivar cot: (m, 3), cotangents, of which masses and indicators are made.
    :ivar area: (m,).
    :ivar weights: (m, 3), by which neighbours draw each other: the cotangents, if nothing else is said.
    """

    connectivity: Connectivity
    cot: Array
    area: Array
    weights: Array

    @classmethod
    def by(cls, connectivity: Connectivity, cot: Array, area: Array) -> "Measured":
        """With the cotangents as weights."""
        return cls(connectivity, cot, area, cot)


class Metric(Protocol):
    """How triangles are measured at one moment; asked at every rate.

    :ivar thinnest: explicit steps on triangles of which no cotangent is above this are those of the triangles as they are; 0:
        they are others.
    :ivar keeps_range: no weight is below zero: an explicit step can be bounded so that no coordinate leaves its range.
    """

    @property
    def thinnest(self) -> float:
        """The greatest cotangent up to which triangles are taken as they are."""
        ...

    @property
    def keeps_range(self) -> bool:
        """Whether no weight is below zero."""
        ...

    def settled(self, surface: Surface, triangulation: Triangulation, mass: MassKind) -> "Metric":
        """The same for a surface at its start; :class:`Given` where it has no meaning.

        :raises InputError: where it contradicts the boundary or the mass.
        """
        ...

    def measured(self, triangulation: Triangulation, x: Array, sharpness: float) -> Measured:
        """The triangles when the coordinates beside their charts are x (n, c)."""
        ...

    def area(self, triangulation: Triangulation, x: Array, sharpness: float) -> float:
        """Of the surface, squared length."""
        ...


def _as_they_are(triangulation: Triangulation, x: Array, sharpness: float) -> Measured:
    faces = triangulation.connectivity.faces
    return Measured.by(triangulation.connectivity, *operator.cotangents(x, faces, triangulation.forms, sharpness))


class Given:
    """Triangles as they are."""

    thinnest = np.inf
    keeps_range = False

    def settled(self, surface: Surface, triangulation: Triangulation, mass: MassKind) -> "Metric":
        """The same: it has meaning everywhere."""
        return self

    def measured(self, triangulation: Triangulation, x: Array, sharpness: float) -> Measured:
        """The triangles as they are."""
        return _as_they_are(triangulation, x, sharpness)

    def area(self, triangulation: Triangulation, x: Array, sharpness: float) -> float:
        """The sum of their areas."""
        return float(self.measured(triangulation, x, sharpness).area.sum())


@dataclass(frozen=True)
class Delaunay:
    """Those of the intrinsic Delaunay triangulation of the same surface, where all coordinates are free.

    Sides of all but flat ones are made longer by a hair, so that no weight is below zero and no system singular.

    :param always: not only where thin triangles ask for it.
    """

    always: bool = True
    keeps_range = False

    @property
    def thinnest(self) -> float:
        """None are taken as they are, or all but thin ones."""
        return 0.0 if self.always else THIN

    def settled(self, surface: Surface, triangulation: Triangulation, mass: MassKind) -> "Metric":
        """The same where all coordinates are free."""
        return self if surface.is_free and not surface.alternate else Given()

    def measured(self, triangulation: Triangulation, x: Array, sharpness: float) -> Measured:
        """The triangles of Delaunay, or as they are where none is thin."""
        given = _as_they_are(triangulation, x, sharpness)
        return given if not self.always and not is_thin(given.cot) else self.unfolded(triangulation, x)

    def unfolded(self, triangulation: Triangulation, x: Array) -> Measured:
        """The triangles of Delaunay, by the lengths of their sides."""
        faces = triangulation.connectivity.faces
        flipped, lengths = delaunay(faces, mollified(side_lengths(x, faces)))
        return Measured.by(connect((flipped,), triangulation.connectivity.size), *length_cotangents(lengths))

    def area(self, triangulation: Triangulation, x: Array, sharpness: float) -> float:
        """The sum of their areas."""
        return float(self.measured(triangulation, x, sharpness).area.sum())


@dataclass(frozen=True, eq=False)
class Clamped:
    """Weights below zero are zero, so that no coordinate leaves its range (the maximum principle).

    It is not the gradient of the area. With the Neumann boundary, or a fixed one.

    :param pairs: corners (e,) and (e,) opposite to the edges of two triangles; found when it is settled.
    """

    pairs: tuple[Array, Array] = field(default=(np.zeros(0, np.int64), np.zeros(0, np.int64)), repr=False)
    thinnest = 0.0
    keeps_range = True

    def settled(self, surface: Surface, triangulation: Triangulation, mass: MassKind) -> "Metric":
        """With the pairs of the triangles.

        :raises InputError: with a plane-preserving boundary or Voronoi mass, which have weights below zero of their own.
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
        """The triangles as they are, with clamped cotangents."""
        given = _as_they_are(triangulation, x, sharpness)
        return Measured.by(given.connectivity, clamped(given.cot, *self.pairs), given.area)

    def area(self, triangulation: Triangulation, x: Array, sharpness: float) -> float:
        """That of the triangles as they are."""
        return float(_as_they_are(triangulation, x, sharpness).area.sum())


@dataclass(frozen=True, eq=False)
class Conformal:
    """The stiffness stays that of the start, the mass is that of now (Kazhdan, Solomon, Ben-Chen 2012).

    No neck pinches off, and what is like a sphere becomes one. Where all coordinates are free.

    :param inner: how the start is measured: as it is, or clamped.
    :param first: (m, 3), the cotangents of the start; found when it is settled.
    """

    inner: Metric
    first: Array = field(default_factory=lambda: np.zeros((0, 3)), repr=False)
    thinnest = 0.0

    @property
    def keeps_range(self) -> bool:
        """That of the start."""
        return self.inner.keeps_range

    def settled(self, surface: Surface, triangulation: Triangulation, mass: MassKind) -> "Metric":
        """With the cotangents of the surface where all coordinates are free."""
        if not surface.is_free or surface.alternate:
            return Given()
        inner = self.inner.settled(surface, triangulation, mass)
        return Conformal(inner, inner.measured(triangulation, surface.points, 1.0).cot)

    def measured(self, triangulation: Triangulation, x: Array, sharpness: float) -> Measured:
        """The areas of now with the cotangents of the start."""
        area = _as_they_are(triangulation, x, sharpness).area
        return Measured.by(triangulation.connectivity, self.first, area)

    def area(self, triangulation: Triangulation, x: Array, sharpness: float) -> float:
        """That of now."""
        return float(_as_they_are(triangulation, x, sharpness).area.sum())


@dataclass(frozen=True)
class NormalChannels:
    """Triangles are measured in (x, width n), n the vertex normals of now, and move in x alone.

    What turns counts as far away, so faces become flat and creases stay. Points in R^3, all coordinates free.

    :param width: a length: what is curved more than its inverse is a feature.
    :param inner: how triangles are measured in that space: as they are, or as Delaunay's.
    """

    width: float
    inner: Metric
    thinnest = 0.0

    @property
    def keeps_range(self) -> bool:
        """As the inner one."""
        return self.inner.keeps_range

    def __post_init__(self) -> None:
        positive(self.width, "contrast")

    def settled(self, surface: Surface, triangulation: Triangulation, mass: MassKind) -> "Metric":
        """The same where all coordinates are free."""
        if not surface.is_free or surface.alternate:
            return Given()
        return NormalChannels(self.width, self.inner.settled(surface, triangulation, mass))

    def measured(self, triangulation: Triangulation, x: Array, sharpness: float) -> Measured:
        """The triangles in the wider space."""
        wide = np.column_stack([x, self.width * normals_at(x, triangulation.connectivity.faces)])
        return self.inner.measured(triangulation, wide, sharpness)

    def area(self, triangulation: Triangulation, x: Array, sharpness: float) -> float:
        """That of the surface itself, without its normals."""
        return operator.total_area(x, triangulation.connectivity.faces)


def metric_of(triangles: Triangles) -> Metric:
    """The metric of a word: ``given``, ``delaunay``, ``auto`` (Delaunay's where thin ones ask for it) or ``clamped``."""
    return {"given": Given(), "delaunay": Delaunay(), "auto": Delaunay(always=False), "clamped": Clamped()}[triangles]
