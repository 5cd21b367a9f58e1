"""The free directions of the vertices of a surface: coordinate axes shared by all, or one line for each."""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.connectivity import Connectivity
from meshflow.geometry.operator import gather_seen
from meshflow.geometry.options import named_fields
from meshflow.geometry.validation import Array

__all__ = ["ALL", "Axes", "Free", "Rays"]


class Free(Protocol):
    """The positions that each vertex may take, as a function of its free coordinates u (n, k).

    u is in the unit of the data; measured coordinates are lengths.

    :ivar now: u of the surface as it is; None where it follows exactly from the points.
    :ivar per_vertex: every vertex has its own direction, and the triangles have no common base plane.
    :ivar length2: squared length per squared unit of u (n,) where each vertex has its own direction; 1 where they share theirs.
    :ivar directions: d (n, 3) where each vertex has its own; None where they share theirs.
    """

    @property
    def now(self) -> Array | None:
        """u (n, k), where computing it from the points would round it."""
        ...

    @property
    def per_vertex(self) -> bool:
        """Whether every vertex has a direction of its own."""
        ...

    @property
    def length2(self) -> Array | float:
        """Squared lengths of the directions."""
        ...

    @property
    def directions(self) -> Array | None:
        """The directions (n, 3), where they differ."""
        ...

    def checked(self, d: int) -> "Free":
        """The same directions, checked for points in R^d.

        :raises InputError: where they do not fit.
        """
        ...

    def staying(self, d: int) -> tuple[int, ...]:
        """The coordinates of R^d in which no vertex moves."""
        ...

    def coordinates(self, points: Array) -> Array:
        """Free coordinates (n, k) of points (n, d)."""
        ...

    def at(self, points: Array, u: Array) -> Array:
        """Points (n, d) with free coordinates u (n, k) and the other coordinates of ``points``."""
        ...

    def moved(self, u: Array) -> "Free":
        """The same directions for vertices at u (n, k)."""
        ...

    def measured(self, u: Array) -> Array:
        """The coordinates (n, c) at u, as lengths, that measure triangles in addition to their charts."""
        ...

    def along(self, vectors: Array) -> Array:
        """The components (n, k) of vectors (n, c) along the directions, times length2."""
        ...

    def share(self, vectors: Array) -> Array:
        """Length (n,) of the component of each vector (n, c) in the free directions."""
        ...

    def seen(self, connectivity: Connectivity, x: Array, flat: Array) -> tuple[Array, float]:
        """A third of the area (n,) of the triangles around each vertex, projected along its free directions.

        Also the least share of the true area that the projected area counts as.

        :param x: (n, c), as :meth:`measured` gives it.
        :param flat: (n,), the same of the charts of the triangles.
        """
        ...


@named_fields
@dataclass(frozen=True, eq=False)
class Axes:
    """All vertices move along the same coordinate axes: z of a height field, the channels of an image, all axes of a mesh.

    :param columns: the coordinates that are free, from 0 to d - 1; none: all of them.
    :param contrast: length per unit of u, one number or one per column (alpha of section 4.4).
    :param now: u (n, k), where dividing the points by the contrast would round it.
    """

    columns: tuple[int, ...] = ()
    contrast: float | tuple[float, ...] = 1.0
    now: Array | None = None
    per_vertex = False
    length2 = 1.0
    directions = None

    def checked(self, d: int) -> "Axes":
        """The same axes, checked for points in R^d; all of them named.

        :raises InputError: for repeated columns, columns outside 0 to d - 1, or all columns but one.
        """
        if self is ALL:
            return Axes(tuple(range(d)))
        columns = self.columns
        if not columns or len(set(columns)) != len(columns) or not set(columns) <= set(range(d)):
            raise InputError(f"free: different coordinates from 0 to {d - 1} expected, got {columns}")
        if d - len(columns) == 1:
            raise InputError("free: one coordinate that stays spans no area; at least two must stay, or none")
        return self

    def staying(self, d: int) -> tuple[int, ...]:
        """All other coordinates."""
        return tuple(q for q in range(d) if q not in self.columns)

    def coordinates(self, points: Array) -> Array:
        """The free columns (n, k) over the contrast."""
        columns = points[:, self.columns].copy()
        return columns if self.contrast == 1.0 else columns / self.contrast

    def at(self, points: Array, u: Array) -> Array:
        """Points (n, d) with the free columns u."""
        moved = points.copy()
        moved[:, self.columns] = self.measured(u)
        return moved

    def moved(self, u: Array) -> "Axes":
        """The same, at u (n, k)."""
        return self if self.now is None else replace(self, now=u)

    def measured(self, u: Array) -> Array:
        """The contrast times u (n, k); the other coordinates are in the charts."""
        return np.ascontiguousarray(u if self.contrast == 1.0 else u * np.asarray(self.contrast))

    def along(self, vectors: Array) -> Array:
        """The vectors (n, k) over the contrast."""
        return vectors if self.contrast == 1.0 else vectors / np.asarray(self.contrast)

    def share(self, vectors: Array) -> Array:
        """Their lengths."""
        return np.linalg.norm(vectors, axis=1)

    def seen(self, connectivity: Connectivity, x: Array, flat: Array) -> tuple[Array, float]:
        """The area of the charts."""
        return flat, 0.0


# All axes of the space, however many there are.
ALL = Axes()


@named_fields
@dataclass(frozen=True, eq=False)
class Rays:
    """Every vertex moves along its own line, p(u) = o + u d: the lines of sight of a camera or a scanner.

    :param origins: o, (n, 3).
    :param directions: d, (n, 3), none of length zero where the vertex may move.
    :param now: u, (n, 1).
    """

    origins: Array
    directions: Array
    now: Array
    per_vertex = True

    @property
    def length2(self) -> Array:
        """Squared lengths (n,)."""
        return np.einsum("ij,ij->i", self.directions, self.directions)

    def checked(self, d: int) -> "Rays":
        """The same.

        :raises InputError: for points outside R^3.
        """
        if d != 3:
            raise InputError(f"free: rays need points in R^3, got R^{d}")
        return self

    def staying(self, d: int) -> tuple[int, ...]:
        """None."""
        return ()

    def coordinates(self, points: Array) -> Array:
        """u (n, 1) of the nearest place on each line to its point."""
        return (np.einsum("ij,ij->i", points - self.origins, self.directions) / self.length2)[:, None]

    def at(self, points: Array, u: Array) -> Array:
        """o + u d (n, 3)."""
        return self.measured(u)

    def moved(self, u: Array) -> "Rays":
        """The same, at u (n, 1)."""
        return replace(self, now=u)

    def measured(self, u: Array) -> Array:
        """The points (n, 3) at u (n, 1) along the lines."""
        return self.origins + u * self.directions

    def along(self, vectors: Array) -> Array:
        """d . v (n, 1)."""
        return np.einsum("ij,ij->i", vectors, self.directions)[:, None]

    def share(self, vectors: Array) -> Array:
        """The component (n,) along each line."""
        length = np.linalg.norm(self.directions, axis=1)
        return np.divide(np.abs(self.along(vectors)[:, 0]), length, out=np.zeros_like(length), where=length > 0)

    def seen(self, connectivity: Connectivity, x: Array, flat: Array) -> tuple[Array, float]:
        """The area across each line. A vertex seen edge-on has none, and must not divide by zero where gamma < 0."""
        return gather_seen(connectivity, x, self.directions) / 3.0, 1e-6
