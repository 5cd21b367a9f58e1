"""Diffusion along and across isophotes with a fidelity and a shock filter [KDA97]."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from meshflow.errors import InputError
from meshflow.flow.contract import Flow
from meshflow.flow.engines.samples import SampleFlow, Samples
from meshflow.flow.methods.beltrami import SchemeMethod, presmoothing_of
from meshflow.flow.methods.selective import along_isophotes
from meshflow.geometry.options import named_fields, option
from meshflow.geometry.validation import Array, number
from meshflow.surfaces.grid import Grid

__all__ = ["ShockFilter", "ShockScheme"]


# A number whose square is still one.
LARGEST = 1e150


@dataclass(frozen=True)
class ShockScheme:
    """The rate of :class:`ShockFilter`, s = contrast |grad u|, phi(s) = sqrt(1 + s^2).

    :ivar fidelity: lambda, per squared length; ``shock``: beta, per length; ``presmoothing``: sigma, in samples.
    :ivar switch: tau, the slope of the smoothed values, all channels together, from which the shock term replaces the diffusion
        across isophotes; 0: both act everywhere.
    """

    contrast: float
    fidelity: float
    shock: float
    presmoothing: float
    switch: float = 0.0

    def rate(self, samples: Samples, start: Samples) -> Array:
        """du/dt."""
        x, y = samples.slopes()
        square = x**2 + y**2
        along = along_isophotes(samples)
        xx, _, yy = samples.curvatures()
        across = xx + yy - along  # u_eta_eta: the two add up to the Laplacian
        w2 = 1.0 + self.contrast**2 * square
        blurred = samples.of(samples.blurred(self.presmoothing)) if self.shock or self.switch else samples
        steep = self._steep(blurred)
        rate = along / np.sqrt(w2) + ~steep * across / w2**1.5 - self.fidelity * (samples.values - start.values)
        if self.shock == 0:
            return rate
        bxx, _, byy = blurred.curvatures()
        sign = np.sign(bxx + byy - along_isophotes(blurred))
        sharper = self.shock * sign * self._upwind(samples, sign)
        return rate - (steep * sharper if self.switch else sharper)

    def _steep(self, blurred: Samples) -> Array:
        """Where (h, w) the smoothed values are steeper than the switch; nowhere without one."""
        if self.switch == 0:
            return np.zeros(blurred.there.shape, bool)
        x, y = blurred.slopes()
        return (x**2 + y**2).sum(axis=0) >= min(self.switch, LARGEST) ** 2

    def fastest(self, spacing: tuple[float, float]) -> float:
        """The sum of those of its terms."""
        dx, dy = spacing
        return 4.0 / dx**2 + 4.0 / dy**2 + self.fidelity + 2.0 * self.shock * (1.0 / dx + 1.0 / dy)

    def reach(self, samples: Samples, start: Samples) -> tuple[Array, Array]:
        """Between its neighbours, and with a fidelity its start."""
        low, high = samples.around()
        return (np.minimum(low, start.values), np.maximum(high, start.values)) if self.fidelity else (low, high)

    @staticmethod
    def _upwind(samples: Samples, sign: Array) -> Array:
        """|grad u| by the scheme of Osher and Rudin: of the differences on both sides, those against the motion (minmod)."""
        v, (dx, dy), total = samples.values, samples.spacing, np.zeros_like(samples.values)
        for before, behind, step in (
            (samples.at(0, -1), samples.at(0, 1), dx),
            (samples.at(-1, 0), samples.at(1, 0), dy),
        ):
            back, forth = (v - before) / step, (behind - v) / step
            total += np.where(back * forth > 0, np.minimum(np.abs(back), np.abs(forth)), 0.0) ** 2
        return np.sqrt(total) * (sign != 0)


@named_fields
@dataclass(frozen=True, kw_only=True)
class ShockFilter(SchemeMethod):
    """Diffusion by phi'(s)/s along isophotes and phi''(s) across, with a fidelity and a shock term that sharpens [KDA97].

    u_t = (phi'(s)/s) u_xi_xi + phi''(s) u_eta_eta - fidelity (u - u0) - shock sign(G_sigma * u_eta_eta) |grad u|, with
    phi(s) = sqrt(1 + s^2), s = contrast |grad u|, xi along and eta across isophotes: after P. Kornprobst, R. Deriche, G. Aubert,
    CVPR 1997, 325-331, as surveys give it; the paper itself was not at hand. With a ``switch`` tau, as in
    the same authors' coupled model (ICIP 1997, from memory), phi'' acts where |G_sigma * grad u| < tau and the shock term where
    it is not, so that noise on flat parts is no longer sharpened. Use it for blurred images with little noise: the shock term
    makes ramps into steps.
    """

    word: ClassVar[str] = "shock"
    conserves: ClassVar[str] = "no mean; no value leaves the range of the start"
    aliases: ClassVar[tuple[str, ...]] = ("kda97",)

    fidelity: float = option(
        0.0, "How strongly the result is pulled back to the input. 0: not at all.", "1 / squared length"
    )
    shock: float = option(0.1, "Strength of the shock term. 0: none.", "1 / length")
    presmoothing: float = presmoothing_of(1.0)
    switch: float = option(
        0.0,
        "Slope of the smoothed values above which the shock term replaces diffusion across edges. 0: both act "
        "everywhere.",
        "value per length",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("fidelity", "shock", "switch"):
            if number(getattr(self, name), name) < 0:
                raise InputError(f"{name}: a number, zero or more, expected, got {getattr(self, name)}")

    def on_grid(self, grid: Grid, threads: int | None) -> Flow:
        """The scheme."""
        scheme = ShockScheme(grid.contrast, self.fidelity, self.shock, self.presmoothing, self.switch)
        return SampleFlow(grid, scheme, self.word, threads)
