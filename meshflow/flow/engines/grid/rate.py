"""The flow on a grid, without faces: the same rate as the mesh engine's on the same triangles."""

from functools import cached_property
from typing import Any

import numpy as np

from meshflow.errors import InputError
from meshflow.flow.blend import RATE, Blend
from meshflow.flow.engines.grid.bands import bands, worked
from meshflow.flow.engines.grid.cells import Cells, border_samples, cells_of
from meshflow.flow.engines.grid.coupled_sweep import coupled_measured, coupled_swept
from meshflow.flow.engines.grid.patch_sweep import patched_measured
from meshflow.flow.engines.grid.ray_sweep import rays_measured, rays_swept
from meshflow.flow.engines.grid.sizes import sized
from meshflow.flow.engines.grid.sweep import swept
from meshflow.flow.engines.grid.system import GridSystem
from meshflow.flow.methods.beltrami import Member
from meshflow.geometry.operator import mass_kind
from meshflow.geometry.validation import Array, whole
from meshflow.surfaces.grid import Lattice
from meshflow.surfaces.triangles import triangulations

__all__ = ["GridFlow"]

# Of a grid of more numbers than LARGE, every so manieth row says enough of an error.
LARGE, ROUGHLY = 1 << 20, 8
NOWHERE: Array = np.zeros((0, 0), np.uint8)


class GridFlow:
    """dX/dt = -s P B on the triangles of a grid, s = (edge indicator)^gamma (7), (10), (14).

    Free coordinates are those of the data, not multiplied by the contrast; they are held as planes, of which the (n, k) arrays
    of the contract are views. float32 data is moved in float32 where its slopes allow it.

    :param lattice: the samples and where they may go.
    :param member: which flow of the family.
    :param threads: how many; by default as many as numba uses (``NUMBA_NUM_THREADS``, ``numba.set_num_threads``).
    :raises InputError: for a member without meaning here, or slopes so steep that their powers overflow.
    """

    slivers = False

    def __init__(self, lattice: Lattice, member: Member | None = None, threads: int | None = None) -> None:
        self.lattice, self.member = lattice, member or Member()
        self.threads = None if threads is None else whole(threads, "threads", 1)
        self.member.check(along_rays=lattice.fibres is not None, on_grid=True)
        self.shape = (len(lattice.planes), *lattice.shape)
        widths = np.broadcast_to(np.asarray(lattice.spacing[0], dtype=np.float64), (self.shape[1],))
        # A power of two, so that counting lengths in it costs no bit and tiles of a grid agree with the whole.
        typical = 1.0 if lattice.fibres is not None else np.sqrt(np.median(widths)) * np.sqrt(lattice.spacing[1])
        self._unit = float(2.0 ** np.floor(np.log2(typical)))
        self._widths, self._height = widths / self._unit, lattice.spacing[1] / self._unit
        self.dtype = self._number_type()
        self._begin = self._cleaned()
        which = triangulations(lattice.diagonals)
        self._turns = [(i, i + 1) for i in which] if lattice.diagonals == "alternate" else [(which[0], which[-1] + 1)]
        m = self.member
        plain = len(lattice.planes) == 1 and lattice.fibres is None
        self._single = plain and m.mass != "voronoi" and (m.gamma == 0 or m.indicator == "metric")
        self._alone = self._single and m.patch == 0
        by_rays = lattice.fibres is not None and m.patch == 0
        self._by_rays = by_rays and m.mass != "voronoi" and (m.gamma == 0 or m.indicator == "metric")

    # --- the contract ---------------------------------------------------------------------------------------------------

    def start(self) -> Array:
        """The free coordinates (n, k) as they came, zero where missing; read-only."""
        return self._columns(self._begin)

    def rate(self, u: Array, diagonal: int = 0, blend: Blend = RATE, out: Array | None = None) -> Array:
        """du/dt (n, k), unit of the data per time, or a blend; zero where a sample is missing, fixed, or without triangles."""
        (one, a), (two, b) = (*blend.toward, *((0.0, u),) * (2 - len(blend.toward)))
        three, c = blend.drift or (0.0, u)
        second = len(blend.toward) > 1 or blend.drift is not None
        factors = np.array((blend.keep, blend.dt, one, two, three), dtype=np.float64)
        factors[1] /= self._unit**2
        mix = (factors.astype(self.dtype), second, tuple(self._planes(array) for array in (a, b, c)))
        out = self._columns(np.empty(self.shape, self.dtype), writeable=True) if out is None else out
        self._swept(self._turns[diagonal % len(self._turns)], self._planes(u), self._planes(out, writeable=True), mix)
        return out

    def area(self, u: Array) -> float:
        """Area of the surface at u, squared length; the mean over its triangulations."""
        sheets = self._turns[-1][1] - self._turns[0][0]
        return sum(self._measured(u, turn, 0)[0] for turn in self._turns) * self._unit**2 / sheets

    def bound(self, u: Array) -> float:
        """Upper bound of the fastest decay, per time: that of the flat grid where it holds whatever the data.

        On a grid of spacing h every triangle with barycentric mass allows at most 12 / h^2 (DESIGN.md, section 2); one channel
        keeps within it down to gamma = -1, since it moves along the gradient of an area of which no second derivative is above
        that of the flat Dirichlet energy. Elsewhere the triangles are asked.
        """
        if u.__array_interface__["data"][0] == self._begin.__array_interface__["data"][0]:
            return self._bound_at_start  # a run asks for it several times before its first step
        return self._bound(u)

    @cached_property
    def _bound_at_start(self) -> float:
        return self._bound(self.start())

    def _bound(self, u: Array) -> float:
        """:meth:`bound`, measured anew."""
        m = self.member
        if self.lattice.fibres is None and m.mass != "voronoi" and (m.gamma >= 0 or self._alone):
            flat = self._flat_bound / (3.0 if m.mass == "ring" else 1.0)
            if m.gamma >= -1 or not self._alone:
                return flat
            return self._flat_bound * max(self._measured(u, turn, 1)[1] for turn in self._turns)
        # Where the indicator is left out, masses do not matter, and all triangles are asked at once.
        turns = [(self._turns[0][0], self._turns[-1][1])] if self._by_rays and m.gamma >= 0 else self._turns
        return max(self._measured(u, turn, 1)[1] for turn in turns) / self._unit**2

    def system(self, u: Array, diagonal: int = 0) -> GridSystem:
        """Mass and stiffness of the present metric, as seven-point weights (nine with both diagonals); no matrix is made."""
        h, w = self.lattice.shape
        planes, nothing = self._planes(u), np.empty((0, 0, 0), self.dtype)
        edges, inverses = np.zeros((4, h, w), self.dtype), np.empty((h, w), self.dtype)
        fixed = (self._geometry, *self._layout, self._held)
        asked = (self._turns[diagonal % len(self._turns)], planes, nothing, self._no_mix(planes), fixed)
        self._worked(lambda rows: _COUPLED(rows, *asked, *self._coupled, edges, inverses))
        return GridSystem.of(edges, inverses, self._held, self._rays, self._unit, self.threads)

    def size(self, *terms: tuple[float, Array], roughly: bool = False) -> tuple[float, float]:
        """The sum of c a over at most four ``terms``, (n, k): root mean square of the samples, and the greatest length.

        :param roughly: look at every eighth row of a large grid: enough to choose a step by.
        """
        every = ROUGHLY if roughly and self._begin.size > LARGE else 1
        count = max(2, len(terms))
        terms = (*terms, *[(0.0, terms[0][1])] * (4 - len(terms)))
        factors, arrays = np.array([c for c, _ in terms], self.dtype), tuple(self._planes(a) for _, a in terms)
        found = self._worked(lambda rows: sized(rows, every, count, factors, arrays))
        samples = -(-self.shape[1] // every) * self.shape[2]
        return float(np.sqrt(sum(total for total, _ in found) / samples)), float(
            np.sqrt(max(most for _, most in found))
        )

    # --- what never changes ---------------------------------------------------------------------------------------------

    def _number_type(self) -> Any:
        """The number type of the planes; double precision where powers of their slopes would overflow."""
        lattice, m = self.lattice, self.member
        least, greatest = _extent(lattice.planes, lattice.missing)
        steep = float(lattice.contrast) / min(self._unit * self._widths.min(), self._unit * self._height)
        sizes = np.array([greatest - least, steep * (greatest - least), steep, max(abs(least), abs(greatest))])
        sizes = np.log10(sizes[sizes > 0])
        alone = len(lattice.planes) == 1 and lattice.fibres is None
        power = max((2.0 if alone else 4.0) * max(m.sharpness, 1.0), abs(m.gamma) + 2.0)
        digits = power * float(np.abs(sizes).max(initial=0.0))
        if digits > 300.0:
            raise InputError(
                f"values from {least:.3g} to {greatest:.3g} with contrast {lattice.contrast:.3g} and spacing {self._unit:.3g}: "
                "powers of such slopes do not fit into double precision; scale the data, or give another contrast"
            )
        return np.dtype(np.float64) if digits > 36.0 else lattice.planes.dtype

    def _cleaned(self) -> Array:
        """Planes (k, h, w) in a row, zero where missing; what came if that is so already."""
        planes = self.lattice.planes
        if self.lattice.missing.any():
            planes = np.where(self.lattice.missing, 0, planes)
        planes = np.ascontiguousarray(planes, dtype=self.dtype).view()
        planes.flags.writeable = False
        return planes

    @cached_property
    def _cells(self) -> tuple[Cells, Cells]:
        """The cells of both triangulations; of the one that there is, twice."""
        borders = self.lattice.boundary == "linear"
        made = [
            cells_of(self.lattice.there, self.lattice.shape, which, borders)
            for which in triangulations(self.lattice.diagonals)
        ]
        return made[0], made[-1]

    @cached_property
    def _layout(self) -> tuple[Any, ...]:
        """The cells as the sweeps take them, and which rows are like the ones above."""
        one, two = self._cells
        pairs = (one.first, two.first), (one.runs, two.runs), (one.codes, two.codes)
        return pairs, one.same & two.same

    @cached_property
    def _held(self) -> Array:
        """Samples (h, w) that stay, as uint8; of no size where none does."""
        held, lattice = self.lattice.fixed, self.lattice
        if lattice.boundary == "fixed":
            there = lattice.there
            if there is None:
                there = np.full((self.shape[1] - 1, self.shape[2] - 1), 15, np.uint8)
            for which in triangulations(lattice.diagonals):
                held = held | border_samples(there, which)
        return held.astype(np.uint8) if held.any() else NOWHERE

    @cached_property
    def _geometry(self) -> Array:
        """(h, 7), what a triangle with a leg in each row is measured by; lengths in units of the typical spacing."""
        x, y = self._widths, np.broadcast_to(self._height, self._widths.shape)
        a = self.lattice.contrast / self._unit
        columns = [(a / x) ** 2, (a / y) ** 2, y / (2 * x), x / (2 * y), x * y / 6, x, y]
        return np.stack(columns, axis=-1).astype(self.dtype)

    @cached_property
    def _flat_bound(self) -> float:
        """What every triangle allows, whatever the data; per squared length."""
        x, y = self._widths, self._height
        return float(np.maximum(6 / x**2 + 6 / y**2, 9 / np.minimum(x, y) ** 2).max()) / self._unit**2

    @property
    def _rays(self) -> Array | None:
        """d (3, h, w) of the fibres."""
        fibres = self.lattice.fibres
        if fibres is None:
            return None
        return np.stack([np.broadcast_to(part, self.lattice.shape) for part in fibres.directions])

    @cached_property
    def _pitch(self) -> tuple[Any, Any]:
        """Of the fibres, in the number type of the planes."""
        fibres = self.lattice.fibres
        across, down = (None if fibres is None else fibres.pitch) or (np.inf, np.inf)
        return self.dtype.type(1.0 / across), self.dtype.type(1.0 / down)

    @cached_property
    def _lines(self) -> tuple[Any, Any]:
        """Origins and directions of the fibres, each in its number of rows and columns."""
        fibres = self.lattice.fibres
        none = (np.zeros((1, 1), self.dtype),) * 3
        if fibres is None:
            return none, none
        made = tuple(
            tuple(np.array(part, dtype=self.dtype, order="C") for part in parts)  # all writeable: one type for numba
            for parts in (fibres.origins, fibres.directions)
        )
        return made[0], made[1]

    # --- one sweep ------------------------------------------------------------------------------------------------------

    def _measured(self, u: Array, sheets: tuple[int, int], bounding: int) -> tuple[float, float]:
        """Area, and what bounds ask for: the greatest s M_flat / M of one channel, else the bound of the triangles times s.

        :param bounding: 1 where the second is asked for, else 0; the other one is zero where there is no need to know it.
        """
        planes = self._planes(u)
        if self._alone:
            found = self._swept(sheets, planes, np.empty((0, 0, 0), self.dtype), self._no_mix(planes))
        else:
            fixed = (self._geometry, *self._layout, self._held)
            found = self._worked(
                (lambda rows: _RAYS_MEASURED(rows, sheets, planes, fixed, *self._coupled[:4], self._pitch, bounding))
                if self._by_rays
                else (lambda rows: patched_measured(rows, sheets, planes, fixed, *self._coupled[1:]))
                if self._single
                else (lambda rows: coupled_measured(rows, sheets, planes, fixed, *self._coupled))
            )
        return sum(area for area, _ in found), max(fastest for _, fastest in found)

    def _swept(self, sheets: tuple[int, int], u: Array, out: Array, mix: tuple[Any, ...]) -> list[Any]:
        """A sweep that writes, or of one channel, where ``out`` has no size, measures."""
        asked = (sheets, u, out, mix, (self._geometry, *self._layout, self._held))
        if self._by_rays:
            return self._worked(lambda rows: _RAYS(rows, *asked, *self._coupled[:4], self._pitch))
        if not self._single:
            none: tuple[Any, ...] = (*self._coupled, np.empty((0, 0, 0), self.dtype), np.empty((0, 0), self.dtype))
            return self._worked(lambda rows: _COUPLED(rows, *asked, *none))
        m, number, whole = self.member, self.dtype.type, (0, self.shape[2])
        kinds = (_quarters(m.sharpness / 2), _quarters(m.gamma), 3 if m.mass == "ring" else 1)
        exponents = (number(m.sharpness / 2), number(m.gamma))
        scale, gaps, taps = self._coupled[3][3], self.lattice.there is not None, self._coupled[4]
        return self._worked(lambda rows: _SINGLE(rows, whole, *asked, kinds, exponents, (taps, scale, gaps)))

    def _no_mix(self, planes: Array) -> tuple[Any, ...]:
        """For sweeps that write nothing."""
        return np.zeros(5, self.dtype), False, (planes, planes, planes)

    @cached_property
    def _coupled(self) -> tuple[Any, ...]:
        """What the sweeps of several coordinates ask beside: lines, factors of time, kinds and exponents."""
        m, lattice, number = self.member, self.lattice, self.dtype.type
        fibres = lattice.fibres
        pace = (
            np.empty((0, 0)) if fibres is None or fibres.pace is None else np.broadcast_to(fibres.pace, lattice.shape)
        )
        pace = np.ascontiguousarray(pace, dtype=self.dtype)
        scale, small = (lattice.contrast / self._unit) ** 2, 1e-9 if self.dtype == np.float64 else 1e-5
        sharp, projection, spatial = m.sharpness != 1.0, m.indicator == "projection", fibres is not None
        gaps = int(lattice.there is not None)
        kinds = (int(sharp), _quarters(m.gamma), mass_kind(m.mass), int(projection), int(spatial), gaps)
        exponents = tuple(number(x) for x in (m.sharpness, m.gamma, m.floor, scale, small))
        taps = np.empty((0, 0), self.dtype) if m.patch == 0 else m.taps.astype(self.dtype)
        return self._lines, pace, kinds, exponents, taps

    def _worked(self, work: Any) -> list[Any]:
        return worked(work, bands(self.shape[1], self.shape[2]), self.threads)

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


# Typed as what they are called with, which pyright does not see.
_COUPLED: Any = coupled_swept
_SINGLE: Any = swept
_RAYS: Any = rays_swept
_RAYS_MEASURED: Any = rays_measured


def _quarters(exponent: float) -> int:
    """Four times an exponent that roots reach, else 99: what the compiled power knows."""
    return {-2.0: -8, -1.0: -4, -0.5: -2, 0.0: 0, 0.5: 2, 0.75: 3, 1.0: 4}.get(exponent, 99)
