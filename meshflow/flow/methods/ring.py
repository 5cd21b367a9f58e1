"""The scheme of the paper as printed: the ring of eight triangles around each sample (14)."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from meshflow.flow.contract import Flow
from meshflow.flow.engines.samples import SampleFlow, Samples
from meshflow.flow.methods.beltrami import SchemeMethod
from meshflow.geometry.options import named_fields
from meshflow.geometry.validation import Array
from meshflow.surfaces.grid import Grid

__all__ = ["PaperScheme", "RingScheme"]

# The ring of a sample: the neighbour on an axis and the diagonal neighbour of each of its eight triangles, (down, right).
RING = tuple(
    (axis, (axis[0] or side, axis[1] or side)) for axis in ((0, 1), (0, -1), (1, 0), (-1, 0)) for side in (1, -1)
)


@dataclass(frozen=True)
class RingScheme:
    """dI_i/dt = 1/(2 A) sum (cot alpha_ij + cot beta_ij) (I_j - I_i) over the eight neighbours, A the area of the ring (14).

    The ring has the diagonal of each of the four cells that meets the sample, hence an area of 4 dx dy on flat data. There the
    rate is a quarter of the Laplacian, so that dt = 1 sample^2 is the limit of explicit steps: for one channel every step is
    then a weighted mean of the four nearest neighbours and the sample, for any data.

    :ivar contrast: alpha of section 4.4.
    """

    contrast: float

    def rate(self, samples: Samples, start: Samples) -> Array:
        """du/dt; triangles of missing samples are left out."""
        v, (dx, dy) = samples.values * self.contrast, samples.spacing
        moved = samples.of(v)
        pull, area = np.zeros_like(v), np.zeros(v.shape[1:])
        for axis, corner in RING:
            # Legs from the right angle at the neighbour on the axis: to the sample, and to the diagonal neighbour.
            a, b = v - moved.at(*axis), moved.at(*corner) - moved.at(*axis)
            leg, other = (dx, dy) if axis[0] == 0 else (dy, dx)
            there = self._present(samples, axis, corner)
            aa, bb, ab = (np.einsum("khw,khw->hw", *pair) for pair in ((a, a), (b, b), (a, b)))
            aa, bb = aa + leg**2, bb + other**2
            doubled = np.sqrt(np.maximum(aa * bb - ab**2, (leg * other) ** 2))
            # The gradient of the area by the sample: (|b|^2 a - (a . b) b) / 4 T.
            pull -= there * (bb * a - ab * b) / (2.0 * doubled)
            area += there * 0.5 * doubled
        rate = np.divide(pull, area, out=np.zeros_like(pull), where=area > 0)
        return rate / self.contrast

    def fastest(self, spacing: tuple[float, float]) -> float:
        """A quarter of that of the five-point Laplacian."""
        dx, dy = spacing
        return 1.0 / dx**2 + 1.0 / dy**2

    def reach(self, samples: Samples, start: Samples) -> None:
        """Any value: as the paper prints it."""

    @staticmethod
    def _present(samples: Samples, axis: tuple[int, int], corner: tuple[int, int]) -> Array:
        """Whether (h, w) a triangle of the ring is there: on the grid, all three corners present."""
        h, w = samples.there.shape
        wide = np.pad(samples.there, 1)
        found = samples.there.copy()
        for down, right in (axis, corner):
            found &= wide[1 + down : 1 + down + h, 1 + right : 1 + right + w]
        return found


@named_fields
@dataclass(frozen=True, kw_only=True)
class PaperScheme(SchemeMethod):
    """The Beltrami flow of the paper as printed, over the ring of eight triangles around each sample (14).

    With ``contrast=1``, ``stop=Steps(300)`` and ``compute=Compute(stepper="explicit", dt=1)`` it is the run of figure 8. Time
    runs four times slower than that of the heat equation. Every sample has triangles of its own, so that no surface is moved as
    a whole, and no mean is conserved; ``beltrami`` is the same flow without that. Use it to repeat the paper.
    """

    word: ClassVar[str] = "paper"
    conserves: ClassVar[str] = "no mean; one channel does not leave the range of the start"
    slower: ClassVar[float] = 4.0

    def on_grid(self, grid: Grid, threads: int | None) -> Flow:
        """The scheme."""
        return SampleFlow(grid, RingScheme(grid.contrast), self.word, threads)
