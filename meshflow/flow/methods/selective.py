"""Image selective smoothing: isophotes move by their curvature where the smoothed image has no edge [ALM92]."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from meshflow.flow.contract import Flow
from meshflow.flow.engines.samples import SampleFlow, Samples
from meshflow.flow.methods.beltrami import SchemeMethod, presmoothing_of
from meshflow.geometry.options import named_fields
from meshflow.geometry.validation import Array
from meshflow.surfaces.grid import Grid

__all__ = ["SelectiveScheme", "SelectiveSmoothing"]

# |grad u|^2 below which a sample is a peak or flat.
LEVEL = 1e-24


@dataclass(frozen=True)
class SelectiveScheme:
    """u_t = g(|grad G_sigma * u|) |grad u| div(grad u / |grad u|), central differences.

    :ivar contrast: g(s) = 1 / (1 + (contrast s)^2), all channels together.
    :ivar presmoothing: sigma, in samples.
    """

    contrast: float
    presmoothing: float

    def rate(self, samples: Samples, start: Samples) -> Array:
        """du/dt."""
        smooth_x, smooth_y = samples.of(samples.blurred(self.presmoothing)).slopes()
        g = 1.0 / (1.0 + self.contrast**2 * (smooth_x**2 + smooth_y**2).sum(axis=0))
        return g * along_isophotes(samples)

    def fastest(self, spacing: tuple[float, float]) -> float:
        """u_xi_xi has coefficients of at most one, and a mixed difference."""
        dx, dy = spacing
        return 4.0 / dx**2 + 4.0 / dy**2

    def reach(self, samples: Samples, start: Samples) -> tuple[Array, Array]:
        """Between its neighbours."""
        return samples.around()


def along_isophotes(samples: Samples) -> Array:
    """|grad u| div(grad u / |grad u|) = (u_xx u_y^2 - 2 u_x u_y u_xy + u_yy u_x^2) / (u_x^2 + u_y^2).

    At peaks, where isophotes have no direction, it is the mean over all directions, half the Laplacian.
    """
    x, y = samples.slopes()
    xx, xy, yy = samples.curvatures()
    square = x**2 + y**2
    found = xx * y**2 - 2 * x * y * xy + yy * x**2
    return np.divide(found, square, out=0.5 * (xx + yy), where=square > LEVEL)


@named_fields
@dataclass(frozen=True, kw_only=True)
class SelectiveSmoothing(SchemeMethod):
    """Selective smoothing by curvature motion of isophotes, slow at edges of the smoothed image [ALM92].

    u_t = g(|G_sigma * grad u|) |grad u| div(grad u / |grad u|), g(s) = 1 / (1 + (contrast s)^2): equation and g as in L. Alvarez,
    P.-L. Lions, J.-M. Morel, SIAM J. Numer. Anal. 29 (1992), 845-866, as surveys give them; the paper itself was
    not at hand. Each channel moves by its own isophotes, with one g for all. Use it for drawings and letters: it rounds
    corners, and keeps the levels of flat parts.
    """

    word: ClassVar[str] = "selective"
    conserves: ClassVar[str] = "no mean; no value leaves the range of the start"
    aliases: ClassVar[tuple[str, ...]] = ("alm92",)

    presmoothing: float = presmoothing_of(1.0)

    def on_grid(self, grid: Grid, threads: int | None) -> Flow:
        """The scheme."""
        return SampleFlow(grid, SelectiveScheme(grid.contrast, self.presmoothing), self.word, threads)
