"""Low curvature image simplifiers: diffusion of curvature, which makes ramps between sharp edges [TT99]."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from meshflow.flow.contract import Flow
from meshflow.flow.engines.samples import SampleFlow, Samples
from meshflow.flow.methods.beltrami import SchemeMethod
from meshflow.geometry.options import named_fields
from meshflow.geometry.validation import Array
from meshflow.surfaces.grid import Grid

__all__ = ["LowCurvature", "LowCurvatureScheme"]


@dataclass(frozen=True)
class LowCurvatureScheme:
    """u_t = -h^2 div(C(m) grad(laplace u)), C = 1 / (1 + (contrast h m)^2), m^2 = (u_xx^2 + u_yy^2) / 2 + u_xy^2.

    The factor h^2, h^2 = dx dy, makes time a squared length.
    """

    contrast: float

    def rate(self, samples: Samples, start: Samples) -> Array:
        """du/dt: the fluxes go over the links between samples, with the mean of C of both ends."""
        dx, dy = samples.spacing
        xx, xy, yy = samples.curvatures()
        bent = (0.5 * (xx**2 + yy**2) + xy**2).sum(axis=0)
        conductance = samples.of(1.0 / (1.0 + self.contrast**2 * dx * dy * bent)[None])
        laplacian = samples.of(xx + yy)
        total = np.zeros_like(samples.values)
        for down, right, step in ((0, 1, dx), (0, -1, dx), (1, 0, dy), (-1, 0, dy)):
            link = 0.5 * (conductance.values + conductance.at(down, right))
            total += link * (laplacian.at(down, right) - laplacian.values) / step**2
        return -dx * dy * total

    def fastest(self, spacing: tuple[float, float]) -> float:
        """That of the bi-Laplacian."""
        dx, dy = spacing
        return (4.0 / dx**2 + 4.0 / dy**2) ** 2 * dx * dy

    def reach(self, samples: Samples, start: Samples) -> None:
        """Any value: of fourth order, it has no range that is kept."""


@named_fields
@dataclass(frozen=True, kw_only=True)
class LowCurvature(SchemeMethod):
    """Low curvature image simplifier (LCIS): the result is made of ramps, with sharp ridges and edges between them [TT99].

    u_t = -div(C(m) F), F = (u_xxx + u_xyy, u_xxy + u_yyy), C = 1 / (1 + (m / K)^2), m^2 = (u_xx^2 + u_yy^2) / 2 + u_xy^2, K =
    1 / (contrast h): J. Tumblin, G. Turk, SIGGRAPH 1999, 83-90, as surveys give it; the paper itself was not at
    hand. Time is counted in squared lengths (times h^2). Constants and tilted planes do not move, and the mean is kept. Use
    it to split a picture of high contrast into large shapes and detail (:func:`meshflow.classics.compressed`).
    """

    word: ClassVar[str] = "low-curvature"
    conserves: ClassVar[str] = "the mean of the samples, and on tilted planes every value"
    aliases: ClassVar[tuple[str, ...]] = ("lcis", "tt99")

    def on_grid(self, grid: Grid, threads: int | None) -> Flow:
        """The scheme."""
        return SampleFlow(grid, LowCurvatureScheme(grid.contrast), self.word, threads)
