"""The flow of a volume, whose cells are tetrahedra: the rate on a grid of three axes. The loops are in C++ (kernels)."""

from functools import cached_property
from typing import Any

import numpy as np

from meshflow.errors import InputError
from meshflow.flow.blend import RATE, Blend
from meshflow.flow.contract import FEW_RATES
from meshflow.flow.engines.grid import LARGE, ROUGHLY
from meshflow.flow.engines.planes import cleaned, fits_single
from meshflow.flow.engines.volume_system import VolumeSystem
from meshflow.flow.family import Variant
from meshflow.geometry.validation import Array, whole
from meshflow.kernels import volume as kernels
from meshflow.kernels.grid import GridBlend, grid_size
from meshflow.surfaces.volume import Block

__all__ = ["VolumeFlow"]


class VolumeFlow:
    """dX/dt = -s P B on the tetrahedra of a volume in R^(3 + k), s = (edge indicator)^gamma.

    It is the flow of :class:`.grid.GridFlow` with one more axis. B is the gradient of the volume over the mass, by the cotangent
    operator of a tetrahedron, which has a meaning in every dimension: minus a sixth of the length of the opposite edge times the
    cotangent of the angle at it. Each cell is cut into six tetrahedra around one of its four main diagonals; they take turns
    from rate to rate, so that no direction is preferred.

    Free coordinates are those of the data, not multiplied by the contrast. float32 volumes of one channel are moved in float32
    where their slopes allow it.

    :param block: the samples.
    :param variant: which flow of the family.
    :param threads: how many; by default as many as the process may use (``MESHFLOW_NUM_THREADS``).
    :raises InputError: for a variant without meaning here, or slopes so steep that their powers overflow.
    """

    pace = 1.0

    def __init__(self, block: Block, variant: Variant | None = None, threads: int | None = None) -> None:
        self.block, self.variant = block, variant or Variant()
        self.threads = None if threads is None else whole(threads, "threads", 1)
        self._check()
        self._contrast = 0.0 if self.variant.linear else float(block.contrast)
        self.shape = (len(block.planes), *block.shape)
        self._alone = len(block.planes) == 1
        self.patience = FEW_RATES if not self._alone and self.variant.gamma < 0 else np.inf
        # A power of two, so that counting lengths in it costs no bit.
        self._unit = float(2.0 ** np.floor(np.log2(np.prod(block.spacing)) / 3.0))
        self.dtype = self._number_type()
        self._begin = self._cleaned()
        self._by_forms = False  # laws compare the loop for one channel with that for several

    def _check(self) -> None:
        self.variant.check_on_tetrahedra()
        if len(self.block.planes) > kernels.MOST_CHANNELS:
            raise InputError(
                f"a volume of up to {kernels.MOST_CHANNELS} channels expected, got {len(self.block.planes)}"
            )

    # --- the contract ---------------------------------------------------------------------------------------------------

    def start(self) -> Array:
        """The free coordinates (n, k) as they came, zero where missing; read-only."""
        return self._columns(self._begin)

    def rate(self, u: Array, diagonal: int = 0, blend: Blend = RATE, out: Array | None = None) -> Array:
        """du/dt (n, k), unit of the data per time, or a blend; zero where a sample is missing, fixed, or without tetrahedra."""
        out = self._columns(np.empty(self.shape, self.dtype), writeable=True) if out is None else out
        (one, a), (two, b) = (*blend.toward, *((0.0, None),) * (2 - len(blend.toward)))
        three, c = blend.drift or (0.0, None)
        factors = GridBlend(blend.keep, blend.dt / self._unit**2, one, two, three)
        beside = [None if array is None else self._planes(array) for array in (a, b, c)]
        to = out.T.reshape(self.shape)
        kernels.volume_rate(*self._asked(u, diagonal), to, beside[0], beside[1], beside[2], factors, self.threads)
        return out

    def area(self, u: Array) -> float:
        """The volume of the lifted tetrahedra at u, cubed length; the mean over the diagonals."""
        spans = self.block.spans
        count, total = spans[0][1] - spans[0][0], 0.0
        for i in range(len(spans)):
            total += self._measured(u, i, kernels.AREA)[0]
        return total * self._unit**3 / (count * len(spans))

    def bound(self, u: Array) -> float:
        """Upper bound of the fastest decay, per time; explicit steps within it keep the values of one channel in their range.

        On the ground a tetrahedron joins its four corners by its three legs, with V0 / x^2, V0 / y^2, V0 / z^2, and gives each
        corner V0 / 4: no corner has more than two legs, so that the sum of the weights of a sample over its mass is at most
        four times the two largest of 1 / x^2, 1 / y^2, 1 / z^2, and no eigenvalue is above twice that (Gershgorin). The same
        holds of any data. One channel: a leg has the weight V0 / x^2 / W^q, W^q >= 1, a corner V0 W^q / 4, and the indicator
        divides by no more than that down to gamma = -1; no second derivative of W^q is above that of the flat Dirichlet
        energy. Several channels: adj(I + s P) / det(I + s P) is at most 1, as I + s P is at least 1, and volumes are the masses
        where gamma >= 0. Elsewhere the tetrahedra are asked.
        """
        m = self.variant
        if not self.uniform:
            found = [self._measured(u, i, kernels.BOUND) for i in range(len(self.block.spans))]
            factor = max(one[1] * (1.0 if self._alone else max(one[2], 1.0)) for one in found)
        else:
            factor = 1.0
        return self._flat_bound * factor / (4.0 if m.mass == "ring" else 1.0)

    @property
    def uniform(self) -> bool:
        """Whether the bound holds for any data: then a window of the volume moves as the whole does."""
        return self.variant.gamma >= (-1.0 if self._alone else 0.0)

    def system(self, u: Array, diagonal: int = 0) -> VolumeSystem:
        """Mass and stiffness of the present metric; no matrix is made."""
        edges = np.zeros((3 if self._alone else len(kernels.DIRECTIONS), *self.shape[1:]), self.dtype)
        inverses = np.empty(self.shape[1:], self.dtype)
        kernels.volume_weights(*self._asked(u, diagonal), edges, inverses, self.threads)
        return VolumeSystem.of(edges, inverses, self._held, self._unit, self.threads)

    def size(self, *terms: tuple[float, Array], roughly: bool = False) -> tuple[float, float]:
        """The sum of c a over at most four ``terms``, (n, k): root mean square of the samples, and the greatest length.

        :param roughly: look at every eighth row of a large volume: enough to choose a step by.
        """
        every = ROUGHLY if roughly and self._begin.size > LARGE else 1
        k, d, h, w = self.shape
        factors, found = np.zeros(4), np.empty(2)
        factors[: len(terms)] = [c for c, _ in terms]
        rows = [self._planes(array).reshape(k, d * h, w) for _, array in terms]
        one, two, three, four = (*rows, *(None,) * (4 - len(rows)))
        grid_size(factors, one, two, three, four, every, found, self.threads)
        return float(np.sqrt(found[0] / (-(-d * h // every) * w))), float(np.sqrt(found[1]))

    # --- what never changes ---------------------------------------------------------------------------------------------

    def _number_type(self) -> Any:
        """The number type of the planes; double precision of several channels, and where powers of slopes would overflow."""
        block, m = self.block, self.variant
        least, greatest = block.ends
        power = max((2.0 if self._alone else 6.0) * max(m.sharpness, 1.0), abs(m.gamma) + 2.0)
        fits = fits_single((least, greatest), self._contrast, min(block.spacing), power)
        return block.planes.dtype if fits and self._alone else np.dtype(np.float64)

    def _cleaned(self) -> Array:
        """Channels (k, d, h, w) in a row, zero where missing; what came if that is so already."""
        return cleaned(self.block.planes, self.block.missing, self.dtype)

    @cached_property
    def _there(self) -> Array | None:
        """Samples (d, h, w) that are present, as uint8; None where all are, here and in the whole, which has the same loops."""
        return np.ascontiguousarray(~self.block.missing, dtype=np.uint8) if self.block.ragged else None

    @cached_property
    def _held(self) -> Array | None:
        """Samples (d, h, w) that stay, as uint8; None where none does."""
        fixed = self.block.fixed
        if self.block.boundary == "fixed":
            fixed = fixed | self.block.border
        return np.ascontiguousarray(fixed, dtype=np.uint8) if fixed.any() else None

    @cached_property
    def _flat_bound(self) -> float:
        """What every tetrahedron allows, whatever the data."""
        first, second, _ = sorted(self.block.spacing)
        return 8.0 * (1.0 / first**2 + 1.0 / second**2)

    # --- what the kernels ask for -----------------------------------------------------------------------------------------

    def _asked(self, u: Array, turn: int) -> tuple[Array, Array | None, Array | None, kernels.VolumeOptions]:
        """The parameters that all kernels of a volume have."""
        m, spans = self.variant, self.block.spans
        z, y, x = (size / self._unit for size in self.block.spacing)
        kinds = *spans[turn % len(spans)], int(m.mass == "ring"), int(self._by_forms)
        scale = (self._contrast / self._unit) ** 2
        return (
            self._planes(u),
            self._there,
            self._held,
            kernels.VolumeOptions(m.sharpness, m.gamma, scale, x, y, z, *kinds),
        )

    def _measured(self, u: Array, turn: int, asked: int) -> Array:
        """The volume, or what bounds ask for."""
        found = np.empty(3)
        kernels.volume_measured(*self._asked(u, turn), asked, found, self.threads)
        return found

    def _planes(self, u: Array) -> Array:
        """(n, k) as (k, d, h, w), read-only; a view where it is laid out as :meth:`start`."""
        planes = np.ascontiguousarray(u.T.reshape(self.shape), dtype=self.dtype).view()
        planes.flags.writeable = False
        return planes

    def _columns(self, planes: Array, writeable: bool = False) -> Array:
        """(k, d, h, w) as (n, k)."""
        columns = planes.reshape(len(planes), -1).T
        columns.flags.writeable = writeable
        return columns
