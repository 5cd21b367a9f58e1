"""Samples on a grid that move along their channels or rays: what data objects on grids share."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from meshflow.geometry.options import named_fields
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

__all__ = ["Lines", "Grid", "Lift", "Spacing", "Whole", "held", "OnGrid"]


@named_fields
@dataclass(frozen=True)
class Lift:
    """How a data object is turned into a surface.

    :param contrast: alpha of section 4.4, which multiplies the free coordinates before the flow and divides them after it:
        length per unit of the value. It has no unit where value and spacing have the same.
    :param diagonals: of a grid's cells; ``alternate`` is as isotropic as ``both`` at half the cost.
    :param boundary: ``neumann | plane-preserving | fixed``; by default the one of the data object.
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
    :param directions: the three coordinates of d, likewise; d is not zero where a sample may move.
    :param footprint: width of each sample's pixel on the surface at the start, zero where missing, of a shape that broadcasts
        to (h, w): the unit of time is its square. None: time is in squared length.
    """

    origins: tuple[Array, Array, Array]
    directions: tuple[Array, Array, Array]
    footprint: Array | None = None

    @property
    def time_factor(self) -> Array | None:
        """The factor on the time of each sample: its squared footprint."""
        return None if self.footprint is None else self.footprint**2

    @property
    def pitch(self) -> tuple[float, float] | None:
        """Steps of x along the rows and of y down the columns where the lines are u (x, y, 1), evenly spaced; else None."""
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
class Whole:
    """What a window of a grid takes from the whole grid, so that it computes the same bits.

    :param spacing: (dx, dy) of the whole, dx a number or one per row.
    :param ends: the least and the greatest present number of its planes.
    :param ragged: whether triangles of it are missing.
    """

    spacing: Spacing
    ends: tuple[float, float]
    ragged: bool = False

    @property
    def step(self) -> float:
        """The typical distance of neighbours (the geometric mean of dx and dy)."""
        return float(np.sqrt(np.mean(self.spacing[0]) * self.spacing[1]))


@dataclass(frozen=True, eq=False)
class Grid:
    """A grid of samples for an engine; the data objects have checked it.

    :param planes: (k, h, w), the free coordinates of each sample, float32 or float64; any number where missing.
    :param missing: (h, w).
    :param fixed: (h, w), samples that stay.
    :param spacing: (dx, dy), dx a number or one per row.
    :param contrast: length per unit of the planes, 1 along lines.
    :param diagonals: ``forward | backward | both | alternate``.
    :param boundary: ``neumann | plane-preserving | fixed``.
    :param lines: the lines along which the samples move; None: they move vertically above the grid.
    :param jump: a triangle is left out where its values differ by more than this share of the least; None: none is.
    :param cuts: edges that no triangle has.
    :param whole: of the grid of which this is a window; None: this is the whole.
    :param apart: whether triangles are missing in the grids that lie side by side in this one; None: it is one grid.
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
    whole: Whole | None = None
    apart: bool | None = None

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
        """The triangles that exist (:func:`triangles_there`); None: all."""
        if self.jump is None and self.cuts is None and not self.missing.any():
            return None
        return triangles_there(self.missing, self.planes[0], self.jump, self.cuts)

    @property
    def ragged(self) -> bool:
        """Whether triangles are missing, here or elsewhere in the whole grid."""
        if self.apart is not None:
            return self.apart
        return self.there is not None if self.whole is None else self.whole.ragged

    @cached_property
    def lone(self) -> int:
        """The number of samples that are present and may move, but have no triangle."""
        there = self.there
        if there is None:
            return 0
        h, w = self.shape
        touched = np.zeros((h, w), bool)
        for row, column, bits in TOUCHES:
            touched[row : h - 1 + row, column : w - 1 + column] |= (there & bits) != 0
        return int((~(touched | self.missing | self.fixed)).sum())

    def surface(self) -> Surface:
        """The grid as explicit points and triangles, vertex r * w + c; free coordinates are the planes times the contrast."""
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
        """Points (h * w, 2 + k): the grid and u."""
        h, w = self.shape
        dx, dy = self.spacing
        row, column = np.mgrid[0:h, 0:w]
        widths = np.broadcast_to(np.asarray(dx, dtype=np.float64), (h,))
        x = (column - (0 if np.ndim(dx) == 0 else (w - 1) / 2)) * widths[:, None]
        return np.column_stack([x.ravel(), -(row * dy).ravel(), u])

    def _along(self, flat: Surface, lines: Lines, u: Array) -> Surface:
        """The surface with its samples moved onto their lines."""
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

    An array that belongs to the caller or is read-only is copied.
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
