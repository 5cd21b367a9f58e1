"""The flow on a grid, without faces: the same rate as the mesh engine's on the same triangles. The loops are in C++ (kernels)."""

from functools import cached_property
from typing import Any

import numpy as np

from meshflow.flow.blend import RATE, Blend
from meshflow.flow.contract import FEW_RATES, MANY_RATES
from meshflow.flow.engines.grid_layout import Layout, border_samples
from meshflow.flow.engines.grid_system import GridSystem
from meshflow.flow.engines.planes import cleaned, fits_single
from meshflow.flow.family import Variant
from meshflow.geometry.operator import mass_kind
from meshflow.geometry.validation import Array, whole
from meshflow.kernels import grid as kernels
from meshflow.surfaces.grid import Grid
from meshflow.surfaces.triangles import triangulations

__all__ = ["GridFlow"]

# Of a grid of more numbers than LARGE, every so manieth row says enough of an error.
LARGE, ROUGHLY = 1 << 20, 8
# One channel with gamma below -1 has slivers where its bound is so many times that of the flat grid.
STEEP = 1e4
# Lengths below which a pull is rounding, in units of the typical spacing, by bytes of a number.
ROUNDING = {4: 1e-5, 8: 1e-9}
# Planes, geometry, codes, kinds and rows of them, samples that stay; lines, where they stand, factors of time; taps; options.
Asked = tuple[
    Array, Array, Array, Array, Array, Array | None, Array, Array, Array | None, Array, kernels.GridOptions
]  # fmt: skip


class GridFlow:
    """dX/dt = -s P B on the triangles of a grid, s = (edge indicator)^gamma (7), (10), (14).

    Free coordinates are those of the data, not multiplied by the contrast; they are held as planes, of which the (n, k) arrays
    of the contract are views. float32 data is moved in float32 where its slopes allow it.

    :param grid: the samples and where they may go.
    :param variant: which flow of the family.
    :param threads: how many; by default as many as the process may use (``MESHFLOW_NUM_THREADS``).
    :raises InputError: for a variant without meaning here, or slopes so steep that their powers overflow.
    """

    def __init__(self, grid: Grid, variant: Variant | None = None, threads: int | None = None) -> None:
        self.grid, self.variant = grid, variant or Variant()
        self.threads = None if threads is None else whole(threads, "threads", 1)
        self.variant.check(along_rays=grid.lines is not None, on_grid=True)
        self._contrast = 0.0 if self.variant.linear else float(grid.contrast)
        self.shape = (len(grid.planes), *grid.shape)
        widths = np.broadcast_to(np.asarray(grid.spacing[0], dtype=np.float64), (self.shape[1],))
        of_all = widths if grid.whole is None else np.atleast_1d(np.asarray(grid.whole.spacing[0], dtype=np.float64))
        # A power of two, so that counting lengths in it costs no bit and tiles of a grid agree with the whole.
        typical = 1.0 if grid.lines is not None else np.sqrt(np.median(of_all)) * np.sqrt(grid.spacing[1])
        self._unit = float(2.0 ** np.floor(np.log2(typical)))
        self._all_widths = of_all / self._unit
        self._widths, self._height = widths / self._unit, grid.spacing[1] / self._unit
        self.dtype = self._number_type()
        self._begin = self._cleaned()
        which = triangulations(grid.diagonals)
        self._spans = [(i, i + 1) for i in which] if grid.diagonals == "alternate" else [(which[0], which[-1] + 1)]
        m = self.variant
        # Whether one channel, or samples on lines, are moved by areas alone, without cotangents.
        by_area = m.mass != "voronoi" and (m.gamma == 0 or m.indicator == "metric") and m.patch == 0
        self._alone = by_area and len(grid.planes) == 1 and grid.lines is None
        self._by_rays = by_area and grid.lines is not None
        # Where a mean is conserved, alternating triangulations count the samples alike.
        alternating = grid.diagonals == "alternate" and grid.boundary == "neumann" and grid.lines is None
        self._evened = alternating and m.conserves
        self._by_forms = False  # laws compare the loops for few coordinates with those for any number
        self._made_options: dict[tuple[tuple[int, int], bool], kernels.GridOptions] = {}
        self.patience = self._patience()
        self.pace = 0.5 if grid.diagonals == "alternate" and grid.ragged else 1.0

    # --- the contract ---------------------------------------------------------------------------------------------------

    def start(self) -> Array:
        """The free coordinates (n, k) as they came, zero where missing; read-only."""
        return self._columns(self._begin)

    def rate(self, u: Array, diagonal: int = 0, blend: Blend = RATE, out: Array | None = None) -> Array:
        """du/dt (n, k), unit of the data per time, or a blend; zero where a sample is missing, fixed, or without triangles."""
        out = self._columns(np.empty(self.shape, self.dtype), writeable=True) if out is None else out
        (one, a), (two, b) = (*blend.toward, *((0.0, None),) * (2 - len(blend.toward)))
        three, c = blend.drift or (0.0, None)
        factors = kernels.GridBlend(blend.keep, blend.dt / self._unit**2, one, two, three)
        beside = self._beside(a), self._beside(b), self._beside(c)
        asked = self._asked(u, self._spans[diagonal % len(self._spans)])
        kernels.grid_rate(*asked, self._planes(out, writeable=True), *beside, factors, self.threads)
        return out

    def area(self, u: Array) -> float:
        """Area of the surface at u, squared length; the mean over its triangulations."""
        count = self._spans[-1][1] - self._spans[0][0]
        return sum(self._measured(u, span, kernels.AREA)[0] for span in self._spans) * self._unit**2 / count

    def bound(self, u: Array) -> float:
        """Upper bound of the fastest decay, per time: that of the flat grid where it holds whatever the data.

        On a grid of spacing h every triangle with barycentric mass allows at most 12 / h^2 (DESIGN.md, section 2); one channel
        keeps within it down to gamma = -1, since it moves along the gradient of an area of which no second derivative is above
        that of the flat Dirichlet energy. Elsewhere the triangles are asked.
        """
        if u.__array_interface__["data"][0] == self._begin.__array_interface__["data"][0]:
            return self._bound_at_start  # a run asks for it several times before its first step
        return self._bound(u)

    def _patience(self) -> float:
        """Finite where stable steps may shorten without bound: of several channels with gamma below 0; along rays, which may
        nearly meet; and of cliffs below -1.
        """
        if self.grid.lines is not None:
            return MANY_RATES
        if len(self.grid.planes) > 1 or self.variant.gamma >= -1:
            return FEW_RATES if len(self.grid.planes) > 1 and self.variant.gamma < 0 else np.inf
        return MANY_RATES if self._by_gradients and self._bound_at_start > STEEP * self._flat_bound else np.inf

    @cached_property
    def _bound_at_start(self) -> float:
        return self._bound(self.start())

    @property
    def uniform(self) -> bool:
        """Whether the bound holds for any data: then a window of the grid moves as the whole does."""
        return self._by_gradients and (self.variant.gamma >= -1 or not self._alone)

    @property
    def _by_gradients(self) -> bool:
        """Whether the flat grid bounds the decay, but for a factor where gamma of one channel is below -1."""
        m = self.variant
        return self.grid.lines is None and m.mass != "voronoi" and (m.gamma >= 0 or self._alone)

    def bound_within(self, u: Array, window: tuple[slice, slice]) -> float:
        """:meth:`bound` in a window: the greatest one of windows that cover the grid is that of the grid."""
        return self._bound(u, window)

    def _bound(self, u: Array, window: tuple[slice, slice] | None = None) -> float:
        """:meth:`bound`, measured anew; in a window, or everywhere."""
        m = self.variant
        if self._by_gradients:
            if self.uniform:
                return self._flat_bound / (3.0 if m.mass == "ring" else 1.0)
            return self._flat_bound * max(self._measured(u, span, kernels.BOUND, window)[1] for span in self._spans)
        # Where the indicator is left out, masses do not matter, and all triangles are asked at once.
        spans = [(self._spans[0][0], self._spans[-1][1])] if self._by_rays and m.gamma >= 0 else self._spans
        return max(self._measured(u, span, kernels.BOUND, window)[1] for span in spans) / self._unit**2

    def system(self, u: Array, diagonal: int = 0) -> GridSystem:
        """Mass and stiffness of the present metric, as seven-point weights (nine with both diagonals); no matrix is made."""
        h, w = self.grid.shape
        edges, inverses = np.zeros((4, h, w), self.dtype), np.empty((h, w), self.dtype)
        asked = self._asked(u, self._spans[diagonal % len(self._spans)])
        kernels.grid_weights(*asked, edges, inverses, self.threads)
        return GridSystem.of(edges, inverses, self._held, self._rays, self._unit, self.threads)

    def size(self, *terms: tuple[float, Array], roughly: bool = False) -> tuple[float, float]:
        """The sum of c a over at most four ``terms``, (n, k): root mean square of the samples, and the greatest length.

        :param roughly: look at every eighth row of a large grid: enough to choose a step by.
        """
        every = ROUGHLY if roughly and self._begin.size > LARGE else 1
        factors, found = np.zeros(4), np.empty(2)
        factors[: len(terms)] = [c for c, _ in terms]
        a, b, c, d = (*(self._planes(array) for _, array in terms), *(None,) * (4 - len(terms)))
        kernels.grid_size(factors, a, b, c, d, every, found, self.threads)
        samples = -(-self.shape[1] // every) * self.shape[2]
        return float(np.sqrt(found[0] / samples)), float(np.sqrt(found[1]))

    # --- what never changes ---------------------------------------------------------------------------------------------

    def _number_type(self) -> Any:
        """The number type of the planes; double precision where powers of their slopes would overflow."""
        grid, m = self.grid, self.variant
        least, greatest = _extent(grid.planes, grid.missing) if grid.whole is None else grid.whole.ends
        nearest = min(self._unit * self._all_widths.min(), self._unit * self._height)
        alone = len(grid.planes) == 1 and grid.lines is None
        power = max((2.0 if alone else 4.0) * max(m.sharpness, 1.0), abs(m.gamma) + 2.0)
        fits = fits_single((least, greatest), self._contrast, nearest, power)
        return grid.planes.dtype if fits else np.dtype(np.float64)

    def _cleaned(self) -> Array:
        """Planes (k, h, w) in a row, zero where missing; what came if that is so already."""
        return cleaned(self.grid.planes, self.grid.missing, self.dtype)

    @cached_property
    def _layout(self) -> Layout:
        """Which triangles are there, and which of their edges are borders."""
        grid = self.grid
        return Layout.of(grid.there, grid.shape, grid.diagonals, grid.boundary == "plane-preserving", self.threads)

    @cached_property
    def _held(self) -> Array | None:
        """Samples (h, w) that stay, as uint8; None where none does."""
        held, grid = self.grid.fixed, self.grid
        if grid.boundary == "fixed":
            held = held | border_samples(grid.there, grid.shape, grid.diagonals)
        return np.ascontiguousarray(held, dtype=np.uint8) if held.any() else None

    @cached_property
    def _geometry(self) -> Array:
        """(h, 7), what a triangle with a leg in each row is measured by; lengths in units of the typical spacing."""
        x, y = self._widths, np.broadcast_to(self._height, self._widths.shape)
        a = self._contrast / self._unit
        columns = [(a / x) ** 2, (a / y) ** 2, y / (2 * x), x / (2 * y), x * y / 6, x, y]
        return np.stack(columns, axis=-1).astype(self.dtype)

    @cached_property
    def _flat_bound(self) -> float:
        """What every triangle allows, whatever the data; per squared length."""
        x, y = self._all_widths, self._height
        bound = np.maximum(6 / x**2 + 6 / y**2, 9 / np.minimum(x, y) ** 2)
        if self._evened:  # 4/3 of what a flat triangle allows, which is no more where cells are squares
            a, b = 1 / x**2, 1 / y**2
            bound = np.maximum(bound, 4 * (a + b + np.sqrt(a * a - a * b + b * b)))
        return float(bound.max()) / self._unit**2

    @property
    def _rays(self) -> Array | None:
        """d (3, h, w) of the lines."""
        lines = self.grid.lines
        if lines is None:
            return None
        return np.stack([np.broadcast_to(part, self.grid.shape) for part in lines.directions])

    @cached_property
    def _lines(self) -> tuple[Array, Array, Array | None]:
        """Origins and directions of the lines in a row, where each stands and its steps (6, 3), and factors of time (h, w)."""
        lines, where = self.grid.lines, np.zeros((6, 3), np.int64)
        if lines is None:
            return np.zeros(0, self.dtype), where, None
        parts, at = [*lines.origins, *lines.directions], 0
        for i, part in enumerate(parts):
            rows, columns = part.shape
            where[i] = at, columns if rows > 1 else 0, columns > 1
            at += part.size
        time_factor = lines.time_factor
        if time_factor is not None:
            time_factor = np.ascontiguousarray(np.broadcast_to(time_factor, self.grid.shape), dtype=self.dtype)
        return np.concatenate([part.ravel() for part in parts]).astype(self.dtype), where, time_factor

    @cached_property
    def _taps(self) -> Array:
        """The Gaussian of the patches, of no size where there are none."""
        return (self.variant.taps if self.variant.patch > 0 else np.zeros(0)).astype(self.dtype)

    # --- what the kernels ask for -----------------------------------------------------------------------------------------

    def _options(self, span: tuple[int, int]) -> kernels.GridOptions:
        """The options for triangulations ``span``; made once, since that takes as long as a rate of a small grid."""
        made = self._made_options.get((span, self._by_forms))
        if made is None:
            made = self._made_options[span, self._by_forms] = self._options_of(span)
        return made

    def _options_of(self, span: tuple[int, int]) -> kernels.GridOptions:
        m, grid = self.variant, self.grid
        kind, across, down = kernels.CHANNELS, 0.0, 0.0
        if grid.lines is not None:
            kind, pitch = kernels.LINES, grid.lines.pitch
            if pitch is not None:
                kind, across, down = kernels.PINHOLE, 1.0 / pitch[0], 1.0 / pitch[1]
        gamma = (
            -1.0 if self._evened else m.gamma
        )  # 1/s is then the expansion of area, also where a linear flow has none
        scale, small = (self._contrast / self._unit) ** 2, ROUNDING[self.dtype.itemsize]
        gaps, forms = int(grid.there is not None), int(self._by_forms)
        projected = int(m.indicator == "projection" and not self._evened)
        kinds = mass_kind(m.mass), projected, kind, gaps, forms, int(self._evened)
        return kernels.GridOptions(m.sharpness, gamma, m.floor, scale, small, across, down, *span, *kinds)

    def _asked(self, u: Array, span: tuple[int, int]) -> Asked:
        """The parameters that all kernels of a surface have."""
        layout, (lines, where, time_factor) = self._layout, self._lines
        fixed = self._geometry, layout.codes, layout.kinds, layout.row_of, self._held
        return self._planes(u), *fixed, lines, where, time_factor, self._taps, self._options(span)

    def _beside(self, array: Array | None) -> Array | None:
        """An array of a blend, as planes."""
        return None if array is None else self._planes(array)

    def _measured(
        self, u: Array, span: tuple[int, int], asked: int, window: tuple[slice, slice] | None = None
    ) -> Array:
        """Area, and what bounds ask for: the greatest s M_flat / M of one channel, else the bound of the triangles times s.

        :param window: in which; None: everywhere.
        """
        found, (h, w) = np.empty(2), self.shape[1:]
        rows, columns = window or (slice(0, h), slice(0, w))
        ends = np.array([rows.start, rows.stop, columns.start, columns.stop], np.int64)
        kernels.grid_measured(*self._asked(u, span), asked, ends, found, self.threads)
        return found

    def _planes(self, u: Array, writeable: bool = False) -> Array:
        """(n, k) as (k, h, w), a view where it is laid out as :meth:`start`; read-only unless it shall be written."""
        planes = u.T.reshape(self.shape)
        if writeable:
            return planes
        planes = np.ascontiguousarray(planes, dtype=self.dtype).view()
        planes.flags.writeable = False
        return planes

    def _columns(self, planes: Array, writeable: bool = False) -> Array:
        """(k, h, w) as (n, k)."""
        columns = planes.reshape(len(planes), -1).T
        columns.flags.writeable = writeable
        return columns


def _extent(planes: Array, missing: Array) -> tuple[float, float]:
    """Least and greatest of the samples that are there."""
    if not missing.any():
        return float(planes.min()), float(planes.max())
    there = np.broadcast_to(~missing, planes.shape)
    return float(planes.min(where=there, initial=np.inf)), float(planes.max(where=there, initial=-np.inf))
