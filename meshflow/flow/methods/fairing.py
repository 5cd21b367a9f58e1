"""Fairing: a low-pass filter of any order on a mesh, in one step."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

from meshflow.errors import InputError
from meshflow.flow.contract import Flow
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.engines.metric import metric_of
from meshflow.flow.family import Variant
from meshflow.flow.low_pass import LowPass, Weights
from meshflow.flow.methods.curvature import bordered
from meshflow.flow.methods.points import PointMethod, PointSetting
from meshflow.flow.steppers import Stepper, StepperName
from meshflow.geometry.options import named_fields, option
from meshflow.geometry.validation import Array, number
from meshflow.surfaces.surface import Surface

__all__ = ["Fairing"]


@named_fields
@dataclass(frozen=True, kw_only=True)
class Fairing(PointMethod):
    """A low-pass filter, 1 / (1 + (t A)^order) of the Laplacian A (:class:`LowPass`); order 1 is implicit fairing [DMSB99].

    Use it for smooth shapes with noise, where there are no creases.
    """

    word: ClassVar[str] = "fairing"
    conserves: ClassVar[str] = (
        "of a closed mesh the centre of its vertices, weighted by their areas at the start, with weights cotangent; the volume "
        "with PreserveVolume"
    )
    aliases: ClassVar[tuple[str, ...]] = ("low-pass",)
    once: ClassVar[bool] = True

    order: int | None = option(
        None,
        "Order of the filter: 1 is implicit fairing, 2 the bi-Laplacian, 20 close to an ideal low-pass. Without a "
        "search: 2.",
        within=(1, 20),
    )
    weights: Weights | None = option(
        None, "cotangent keeps the sampling, uniform makes it more even. Without a search: cotangent."
    )
    presmooth: float | None = option(
        None,
        "Time of a bi-Laplacian filter with uniform weights. The cotangents are measured on a copy that it has "
        "smoothed, since those of noisy triangles are wrong. Without a search, or with weights: 0.",
        "squared length",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        self.low_pass()
        if self.presmooth is not None and number(self.presmooth, "presmooth") < 0:
            raise InputError(f"presmooth: a squared length, zero or more, expected, got {self.presmooth}")

    def filled(self) -> "Fairing":
        """The method with the fixed choice for options that are None."""
        return replace(
            self, order=self.order or 2, weights=self.weights or "cotangent", presmooth=float(self.presmooth or 0.0)
        )

    def low_pass(self) -> LowPass:
        """The filter, with the fixed choice for options that are None."""
        order, weights = 2 if self.order is None else self.order, self.weights or "cotangent"
        return LowPass(order, weights, 0.0 if self.presmooth is None else self.presmooth)

    def engine(self, surface: Surface, setting: PointSetting) -> Flow:
        """The engine that moves the points (n, 3) of a surface."""
        inside = replace(surface, boundary="fixed") if setting.curve else surface
        return bordered(MeshFlow(inside, Variant(), metric_of(setting.triangles)), inside, setting)

    def stepper(
        self, asked: Stepper | StepperName, flow: Flow, time: float | None, faces: Array
    ) -> Stepper | StepperName:
        """The filter itself.

        :raises InputError: for another stepper by name.
        """
        return self.along_which(self.own_stepper(asked, self.low_pass()), faces)

    def states(self, flow: Flow, start: Array, times: tuple[float, ...]) -> Iterator[Array]:
        """The coordinates (n, 3) at each time, each filtered from the start."""
        for count, time in enumerate(times):
            yield self.low_pass().step(flow, start, time, count)
