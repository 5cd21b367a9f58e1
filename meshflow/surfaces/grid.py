"""Samples on a grid, each free along its channels or along its ray: what the data objects of a grid have in common."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from meshflow.geometry.validation import Array, Spacing, positive
from meshflow.surfaces.discontinuities import Cuts
from meshflow.surfaces.free import Axes, Rays
from meshflow.surfaces.surface import Boundary, Surface, known_boundary
from meshflow.surfaces.triangles import (
    TOUCHES,
    Diagonals,
    charts_of_rows,
    grid_triangulations,
    triangles_there,
    triangulations,
)

__all__ = ["Lines", "Grid", "Lift", "Spacing", "held", "OnGrid"]


@dataclass(frozen=True)
class Lift:
    """How a data object becomes a surface.

    :param contrast: alpha of section 4.4, which multiplies the free coordinates before the flow and divides them after it:
        length of the surface per unit of the value. No unit where value and spacing share theirs.
    :param diagonals: of a grid's cells; ``alternate`` is as isotropic as ``both`` at half the cost.
    :param boundary: ``neumann | plane-preserving | fixed``; by default what suits the data object.
    """

    contrast: float = 1.0
    diagonals: Diagonals = "alternate"
    boundary: Boundary | None = None

    def __post_init__(self) -> None:
        positive(self.contrast, "contrast")


@dataclass(frozen=True, eq=False)
class Lines:
    """The line of each sample, p(u) = o + u d, in R^3.

    :param origins: the three coordinates of o, each an array that broadcasts to (h, w): (h or 1, w or 1).
    :param directions: the three coordinates of d, likewise; none of length zero where a sample may move.
    :param footprint: width of each sample's pixel on the surface at the start, zero where missing, of a shape that broadcasts
        to (h, w): time is counted in its squares; None: in squared length.
    """

    origins: tuple[Array, Array, Array]
    directions: tuple[Array, Array, Array]
    footprint: Array | None = None

    @property
    def time_factor(self) -> Array | None:
        """Factor of time of each sample, squared footprints."""
        return None if self.footprint is None else self.footprint**2

    @property
    def pitch(self) -> tuple[float, float] | None:
        """Differences of x along the rows and of y along the columns where all lines are u (x, y, 1), evenly spaced, or None."""
        x, y, z = self.directions
        if any(part.any() for part in self.origins) or (z != 1.0).any() or x.shape[0] != 1 or y.shape[1] != 1:
            return None
        steps = np.diff(x[0]), np.diff(y[:, 0])
        if any(step.size == 0 for step in steps):
            return None
        means = float(steps[0].mean()), float(steps[1].mean())
        even = all(np.allclose(step, mean, rtol=1e-9, atol=0.0) for step, mean in zip(steps, means, strict=True))
        return means if even and all(means) else None

    def at(self, u: Array) -> Array:
        """Points (h, w, 3) at u (h, w)."""
        return np.stack([o + u * d for o, d in zip(self.origins, self.directions, strict=True)], axis=-1)


@dataclass(frozen=True, eq=False)
class Grid:
    """A grid of samples as an engine sees it. The data objects have checked it.

    :param planes: (k, h, w), the free coordinates of each sample as they came: float32 or float64, anything where missing.
    :param missing: (h, w).
    :param fixed: (h, w), samples that stay.
    :param spacing: (dx, dy), dx a number or one per row.
    :param contrast: length per unit of the planes, 1 along lines.
    :param diagonals: ``forward | backward | both | alternate``.
    :param boundary: ``neumann | plane-preserving | fixed``.
    :param lines: the lines along which the samples move; None: straight up from their places on the grid.
    :param jump: a triangle is left out where its planes differ by more than this share of the least; None: none is.
    :param cuts: edges that no triangle has.
    :raises InputError: for an unknown word for the diagonals or the boundary.
    """

    planes: Array
    missing: Array
    fixed: Array
    spacing: Spacing = (1.0, 1.0)
    contrast: float = 1.0
    diagonals: Diagonals = "alternate"
    boundary: Boundary = "neumann"
    lines: Lines | None = None
    jump: float | None = None
    cuts: Cuts | None = None

    def __post_init__(self) -> None:
        triangulations(self.diagonals)
        known_boundary(self.boundary)

    @property
    def shape(self) -> tuple[int, int]:
        """(h, w)."""
        h, w = self.missing.shape
        return h, w

    @cached_property
    def there(self) -> Array | None:
        """Which triangles are there, :func:`triangles_there`; None: all."""
        if self.jump is None and self.cuts is None and not self.missing.any():
            return None
        return triangles_there(self.missing, self.planes[0], self.jump, self.cuts)

    @cached_property
    def lone(self) -> int:
        """How many samples are there, could move, and have no triangle."""
        there = self.there
        if there is None:
            return 0
        h, w = self.shape
        touched = np.zeros((h, w), bool)
        for row, column, bits in TOUCHES:
            touched[row : h - 1 + row, column : w - 1 + column] |= (there & bits) != 0
        return int((~(touched | self.missing | self.fixed)).sum())

    def surface(self) -> Surface:
        """The same with explicit points and triangles, vertex r * w + c; free coordinates are contrast times the planes."""
        there = self.there
        if there is None:
            there = np.full((self.shape[0] - 1, self.shape[1] - 1), 15, np.uint8)
        u = self.planes.reshape(len(self.planes), -1).T.astype(np.float64)
        u[self.missing.ravel()] = 0.0
        flat = Surface(
            self._grid(u * np.float64(self.contrast)),
            grid_triangulations(there, self.diagonals),
            free=Axes(tuple(range(2, 2 + u.shape[1])), float(self.contrast), u),
            fixed=self.fixed.ravel(),
            boundary=self.boundary,
            alternate=self.diagonals == "alternate",
        )
        if self.lines is not None:
            return self._along(flat, self.lines, u)
        dx, dy = self.spacing
        if np.ndim(dx) == 0:
            return flat
        return replace(
            flat, charts=tuple(charts_of_rows(f, self.shape[1], np.asarray(dx), dy) for f in flat.triangulations)
        )

    def _grid(self, u: Array) -> Array:
        """Points (h * w, 2 + k) of the grid, u above it."""
        h, w = self.shape
        dx, dy = self.spacing
        row, column = np.mgrid[0:h, 0:w]
        widths = np.broadcast_to(np.asarray(dx, dtype=np.float64), (h,))
        x = (column - (0 if np.ndim(dx) == 0 else (w - 1) / 2)) * widths[:, None]
        return np.column_stack([x.ravel(), -(row * dy).ravel(), u])

    def _along(self, flat: Surface, lines: Lines, u: Array) -> Surface:
        """Its samples moved onto their lines."""
        origins, directions = (
            np.stack([np.broadcast_to(part, self.shape).ravel() for part in parts], axis=-1).astype(np.float64)
            for parts in (lines.origins, lines.directions)
        )
        rays = Rays(origins, directions, u)
        time_factor = (
            None
            if lines.time_factor is None
            else np.broadcast_to(lines.time_factor, self.shape).ravel().astype(np.float64)
        )
        return replace(flat, points=rays.measured(u), free=rays, time_factor=time_factor)


def held(values: Array, u: Array, missing: Array) -> Array:
    """u (n, k) as values (h, w) or (h, w, k) in their number type; missing samples keep their bits.

    Nothing is copied that need not be, but what is the caller's or must not be written to.
    """
    moved = np.ascontiguousarray(u.reshape(values.shape), dtype=values.dtype)
    if not moved.flags.writeable or np.may_share_memory(moved, values):
        moved = moved.copy()
    if not missing.any():
        return moved
    gone = missing if values.ndim == missing.ndim else missing[..., None]
    return np.where(gone, values, moved)


@dataclass(frozen=True, eq=False)
class OnGrid:
    """What height fields and images share: samples above a grid."""

    boundary: Boundary = field(default="neumann", init=False)

    def grid(self, planes: Array, missing: Array, fixed: Array, spacing: Spacing, lift: Lift) -> Grid:
        """Free coordinates (k, h, w) above a grid."""
        boundary = lift.boundary or self.boundary
        return Grid(planes, missing, fixed, spacing, lift.contrast, lift.diagonals, boundary)
