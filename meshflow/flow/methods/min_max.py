"""Flow under min/max curvature: isophotes move by the one sign of their curvature that removes noise [MS96]."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.ndimage import convolve

from meshflow.flow.contract import Flow
from meshflow.flow.engines.samples import SampleFlow, Samples
from meshflow.flow.methods.beltrami import SchemeMethod
from meshflow.flow.methods.selective import along_isophotes
from meshflow.geometry.options import named_fields, option
from meshflow.geometry.validation import Array
from meshflow.surfaces.grid import Grid

__all__ = ["MinMax", "MinMaxScheme"]


# The largest radius: the window is (2 radius + 1)² samples.
WIDEST = 1000.0


@dataclass(frozen=True)
class MinMaxScheme:
    """The rate of :class:`MinMax`.

    :ivar radius: of the window, in samples.
    """

    radius: float

    def rate(self, samples: Samples, start: Samples) -> Array:
        """du/dt."""
        motion = along_isophotes(samples)  # kappa |grad u|, kappa = div(grad u / |grad u|)
        mean = self._mean(samples)
        return np.where(mean < self._threshold(samples), np.maximum(motion, 0.0), np.minimum(motion, 0.0))

    def fastest(self, spacing: tuple[float, float]) -> float:
        """That of curvature motion."""
        dx, dy = spacing
        return 4.0 / dx**2 + 4.0 / dy**2

    def reach(self, samples: Samples, start: Samples) -> tuple[Array, Array]:
        """Between its neighbours."""
        return samples.around()

    def _mean(self, samples: Samples) -> Array:
        """The mean over a disc, of the samples that are present."""
        far = int(np.ceil(self.radius))
        y, x = np.mgrid[-far : far + 1, -far : far + 1]
        disc = (x**2 + y**2 <= self.radius**2).astype(np.float64)
        weight = convolve(samples.there.astype(np.float64), disc, mode="nearest")
        sums = [convolve(v * samples.there, disc, mode="nearest") for v in samples.values]
        return np.stack(sums) / np.where(weight > 0, weight, 1.0)

    def _threshold(self, samples: Samples) -> Array:
        """The mean of the values at both ends of the diameter along the isophote, at the nearest samples.

        At peaks, where isophotes have no direction, it is the mean of both diameters along the axes.
        """
        x, y = samples.slopes()
        length = np.hypot(x, y)
        over = np.divide(self.radius, length, out=np.zeros_like(length), where=length > 0)
        right, down = np.rint(-y * over).astype(int), np.rint(x * over).astype(int)
        far = int(np.rint(self.radius))
        axes = 0.5 * (self._ends(samples, 0, far) + self._ends(samples, far, 0))
        return np.where(length > 0, self._ends(samples, down, right), axes)

    @staticmethod
    def _ends(samples: Samples, down: Array | int, right: Array | int) -> Array:
        """The mean of the values at two opposite offsets; of the sample itself where one is missing."""
        v, (h, w) = samples.values, samples.there.shape
        row, column = np.mgrid[0:h, 0:w]
        channel = np.arange(len(v))[:, None, None]
        total = np.zeros_like(v)
        for side in (1, -1):
            r, c = np.clip(row + side * down, 0, h - 1), np.clip(column + side * right, 0, w - 1)
            total += np.where(samples.there[r, c], v[channel, r, c], v)
        return 0.5 * total


@named_fields
@dataclass(frozen=True, kw_only=True)
class MinMax(SchemeMethod):
    """Flow under min/max curvature: isophotes move by one sign of their curvature, which a window decides [MS96].

    u_t = F |grad u|, F = max(kappa, 0) where the mean of u over a disc of this radius is below the threshold T, else
    min(kappa, 0), kappa = div(grad u / |grad u|); T is the mean of u at both ends of the diameter along the isophote. No extremum
    grows. R. Malladi, J. A. Sethian, Graphical Models and Image Processing 58 (1996), 127-141, as
    surveys give it; the paper itself was not at hand. Use it for speckles: those smaller than the window vanish.
    """

    word: ClassVar[str] = "min-max"
    conserves: ClassVar[str] = "no mean; no value leaves the range of the start"
    unused: ClassVar[tuple[str, ...]] = ("contrast", "indicator", "mass")
    aliases: ClassVar[tuple[str, ...]] = ("min-max-flow",)

    radius: float = option(
        2.0, "Radius of the window. Details smaller than it vanish.", "samples", within=(1.0, WIDEST)
    )

    def on_grid(self, grid: Grid, threads: int | None) -> Flow:
        """The scheme."""
        return SampleFlow(grid, MinMaxScheme(self.radius), self.word, threads)
