"""Motion by the smaller principal curvature where the greater is large: creases are smoothed along themselves."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from meshflow.flow.contract import Flow
from meshflow.flow.engines.samples import SampleFlow, Samples
from meshflow.flow.methods.beltrami import SchemeMethod, presmoothing_of
from meshflow.geometry.options import named_fields, option
from meshflow.geometry.validation import Array, positive
from meshflow.surfaces.grid import Grid

__all__ = ["SmallerCurvature", "SmallerCurvatureScheme"]


@dataclass(frozen=True)
class SmallerCurvatureScheme:
    """u_t = sum over i of d_i e_i' (Hessian of u) e_i, central differences.

    e_i are the principal directions of the graph of the presmoothed values, of length one on the graph, so that with d_1 = d_2
    = 1 it is mean curvature motion, u_t = W (k_1 + k_2). With |k_1| <= |k_2|, their ratio r and
    c(k) = 1 / (1 + (feature_length k)^4):

        d_2 = c(k_2),                       d_1 = 1 - (1 - c(k_1)) r^2     where both bend to the same side
        d_2 = c(k_2) + (1 - c(k_2)) r^2,    d_1 = 1                        where they bend to opposite sides

    Along a crease r is 0, and only the curvature along it moves the values. A corner, where both are large and alike, stays; a
    saddle of curvatures k and -k moves by their sum, which is 0. Each is a limit of the weights of [MDSB02], section 6, without
    their jumps.

    :ivar contrast: length per unit of the values.
    :ivar presmoothing: standard deviation, in samples.
    :ivar feature_length: length.
    """

    contrast: float
    presmoothing: float
    feature_length: float

    def rate(self, samples: Samples, start: Samples) -> Array:
        """du/dt."""
        xx, xy, yy = samples.curvatures()
        (ax, ay), (bx, by), first, second = self._directions(samples)
        one = ax * ax * xx + 2.0 * ax * ay * xy + ay * ay * yy
        two = bx * bx * xx + 2.0 * bx * by * xy + by * by * yy
        return first * one + second * two

    def fastest(self, spacing: tuple[float, float]) -> float:
        """That of the Laplacian: directions are at most one long on the plane, and weights at most one."""
        dx, dy = spacing
        return 4.0 / dx**2 + 4.0 / dy**2

    def reach(self, samples: Samples, start: Samples) -> tuple[Array, Array]:
        """Between its neighbours."""
        return samples.around()

    def _directions(self, samples: Samples) -> tuple[tuple[Array, Array], tuple[Array, Array], Array, Array]:
        """The direction of the smaller curvature, that of the greater, and their weights, each (k, h, w)."""
        smooth = samples.of(self.contrast * samples.blurred(self.presmoothing))
        (x, y), (xx, xy, yy) = smooth.slopes(), smooth.curvatures()
        square = x**2 + y**2
        width = np.sqrt(1.0 + square)
        # Unit vectors of the graph up the slope and across it; on level ground along the axes.
        level = square <= np.finfo(np.float64).tiny
        length = np.sqrt(np.where(level, 1.0, square))
        across = np.where(level, 0.0, -y / length), np.where(level, 1.0, x / length)
        up = np.where(level, 1.0, x / length) / width, np.where(level, 0.0, y / length) / width
        p, q, r = (
            (a[0] * b[0] * xx + (a[0] * b[1] + a[1] * b[0]) * xy + a[1] * b[1] * yy) / width
            for a, b in ((up, up), (up, across), (across, across))
        )
        middle, apart = 0.5 * (p + r), np.hypot(0.5 * (p - r), q)
        turn = 0.5 * np.arctan2(q, 0.5 * (p - r))
        high = np.cos(turn) * up[0] + np.sin(turn) * across[0], np.cos(turn) * up[1] + np.sin(turn) * across[1]
        low = np.cos(turn) * across[0] - np.sin(turn) * up[0], np.cos(turn) * across[1] - np.sin(turn) * up[1]
        above = np.abs(middle + apart) <= np.abs(
            middle - apart
        )  # whether the algebraically greater one is the smaller in size
        smaller, greater = (
            np.where(above, middle + apart, middle - apart),
            np.where(above, middle - apart, middle + apart),
        )
        first, second = self._weights(smaller, greater)
        along = np.where(above, high[0], low[0]), np.where(above, high[1], low[1])
        return along, (np.where(above, low[0], high[0]), np.where(above, low[1], high[1])), first, second

    def _weights(self, smaller: Array, greater: Array) -> tuple[Array, Array]:
        """d_1 and d_2 of curvatures, by their size."""
        c1, c2 = (1.0 / (1.0 + np.square(np.square(self.feature_length * k))) for k in (smaller, greater))
        ratio = np.square(np.divide(smaller, greater, out=np.zeros_like(greater), where=greater != 0))
        alike = smaller * greater > 0
        first = np.where(alike, 1.0 - (1.0 - c1) * ratio, 1.0)
        return first, np.where(alike, c2, c2 + (1.0 - c2) * ratio)


@named_fields
@dataclass(frozen=True, kw_only=True)
class SmallerCurvature(SchemeMethod):
    """Motion by the smaller principal curvature where the greater is large; mean curvature motion elsewhere [MDSB02].

    It is the flow by principal curvatures that Desbrun et al. 2000 leave to the future, on height fields and images; for meshes
    there is ``principal``. Curvatures are those of the graph of the values times the contrast, after a Gaussian, as the noise
    of a sample would else decide its own weight. M. Meyer, M. Desbrun, P. Schröder, A. Barr, Visualization and Mathematics III
    (2003), 35-57, section 6. On a roof of slope 0.8 with noise 1 it leaves errors of 0.10 at time 12
    (contrast 1) and takes 0.16 from the crest, where graph flow leaves 0.72 and takes 2.6.

    Use it for ridges, valleys and creases: they are smoothed along themselves, and corners stay.
    """

    word: ClassVar[str] = "smaller-curvature"
    conserves: ClassVar[str] = "no mean; no value leaves the range of the start"
    aliases: ClassVar[tuple[str, ...]] = ("principal-curvature", "mdsb02")

    presmoothing: float = presmoothing_of(2.0)
    feature: float = option(12.0, "Curvatures above 1 / feature are creases.", "samples")

    def __post_init__(self) -> None:
        super().__post_init__()
        positive(self.feature, "feature")

    def on_grid(self, grid: Grid, threads: int | None) -> Flow:
        """The scheme."""
        step = float(np.sqrt(np.mean(grid.spacing[0]) * grid.spacing[1]))
        scheme = SmallerCurvatureScheme(grid.contrast, self.presmoothing, self.feature * step)
        return SampleFlow(grid, scheme, self.word, threads)
