"""Taubin's lambda | mu smoothing: a low-pass filter of the umbrella that does not shrink [Tau95]."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from meshflow.errors import InputError
from meshflow.flow.contract import Flow
from meshflow.flow.low_pass import generator_of
from meshflow.flow.methods.curvature import CurvatureFlow
from meshflow.flow.methods.points import PointSetting
from meshflow.flow.steppers import Stepper, StepperName
from meshflow.flow.workspace import Workspace
from meshflow.geometry.normals import mean_edge
from meshflow.geometry.options import named_fields, option
from meshflow.geometry.validation import Array, number
from meshflow.surfaces.surface import Surface

__all__ = ["LambdaMu", "mu"]


def mu(weight: float, passband: float) -> float:
    """The weight mu of the second step, from 1 / lambda + 1 / mu = passband.

    Example:

        >>> round(mu(0.5, 0.1), 3)
        -0.526

    :param weight: lambda of the first step.
    :param passband: the frequency that is kept.
    """
    return weight / (passband * weight - 1.0)


@dataclass(frozen=True)
class _Pairs:
    """x += lambda K x, x += mu K x, K x = mean of the neighbours - x; a pair lasts lambda h^2 / 4.

    :ivar weight: lambda; ``back``: mu; ``pair``: the time of a pair, squared length.
    """

    weight: float
    back: float
    pair: float
    name = "lambda-mu"
    rates = 2

    def step(self, flow: Flow, u: Array, dt: float, diagonal: int = 0, workspace: Workspace | None = None) -> Array:
        """The points (n, 3) after a pair, or the share dt / pair of one."""
        umbrella = generator_of(flow, u, "uniform")  # -4 K / h^2
        step2 = 4.0 * self.pair / self.weight
        ahead = u - 0.25 * step2 * (dt / self.pair) * self.weight * np.asarray(umbrella @ u)
        return ahead - 0.25 * step2 * (dt / self.pair) * self.back * np.asarray(umbrella @ ahead)

    def largest(self, flow: Flow, u: Array) -> float:
        """One pair."""
        return self.pair


@named_fields
@dataclass(frozen=True, kw_only=True)
class LambdaMu(CurvatureFlow):
    """Smoothing without shrinking: alternating steps of lambda and mu, 1 / lambda + 1 / mu = passband [Tau95].

    x += lambda K x, x += mu K x, with K x the mean of the neighbours minus x, so that a frequency k of the umbrella (0 to 2) is
    multiplied by (1 - lambda k)(1 - mu k) per pair, and k = passband is kept. G. Taubin, SIGGRAPH 1995, 351-358. A pair lasts
    lambda h^2 / 4, h the mean edge; ``stop=Steps(n)`` makes n pairs. Borders move as curves, at half the speed. Points drift
    along the surface where the sampling is uneven. Use it to compare, or for even meshes.
    """

    word: ClassVar[str] = "taubin"
    conserves: ClassVar[str] = "nothing exactly; shapes of frequencies below the pass band, nearly"
    aliases: ClassVar[tuple[str, ...]] = ("tau95",)

    weight: float = option(0.5, "lambda of the first step, above 0 and at most 1.")
    passband: float = option(
        0.1, "Frequency of the umbrella operator below which shapes are kept, from 0 to below 1 / weight."
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        weight, passband = number(self.weight, "weight"), number(self.passband, "passband")
        if not (0 < weight <= 1 and 0 <= passband < 1 / weight):
            raise InputError(
                f"taubin: 0 < weight <= 1 and 0 <= passband < 1 / weight expected, got {weight} and {passband}"
            )

    def engine(self, surface: Surface, setting: PointSetting) -> Flow:
        """The engine that moves the points (n, 3) of a surface."""
        self.must_hold_border(setting)
        return super().engine(surface, setting)

    def stepper(
        self, asked: Stepper | StepperName, flow: Flow, time: float | None, faces: Array
    ) -> Stepper | StepperName:
        """Pairs of steps.

        :raises InputError: for another stepper by name.
        """
        return self.along_which(self.own_stepper(asked, self._pairs(flow.start(), faces)), faces)

    def _pairs(self, x: Array, faces: Array) -> _Pairs:
        pair = 0.25 * self.weight * mean_edge(x, faces) ** 2
        return _Pairs(self.weight, mu(self.weight, self.passband), pair)
