"""Mean curvature flow of a mesh, and its conformalized variant."""

from dataclasses import dataclass, replace
from typing import ClassVar

from meshflow.flow.conservation import AlongNormals
from meshflow.flow.contract import Flow
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.engines.metric import Clamped, Conformal, Given, metric_of
from meshflow.flow.family import Mass, Variant
from meshflow.flow.methods.border_curve import Bordered
from meshflow.flow.methods.points import PointMethod, PointSetting
from meshflow.flow.steppers import Stepper, StepperName, stepper_for
from meshflow.geometry.options import named_fields, option
from meshflow.geometry.validation import Array
from meshflow.surfaces.surface import Surface

__all__ = ["ConformalFlow", "CurvatureFlow", "bordered"]


@named_fields
@dataclass(frozen=True, kw_only=True)
class CurvatureFlow(PointMethod):
    """Mean curvature flow [DMSB99], dx/dt = -M^-1 L x. It shrinks the mesh.

    Use it for short times, and where a geometric motion is meant.
    """

    word: ClassVar[str] = "curvature"
    aliases: ClassVar[tuple[str, ...]] = ("curvature-flow",)

    mass: Mass = option(
        "barycentric", "Area that belongs to a vertex. With ring, as in the paper, time runs three times slower."
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.variant

    @property
    def variant(self) -> Variant:
        """The variant of the flow, for the engines."""
        return Variant(mass=self.mass)

    def engine(self, surface: Surface, setting: PointSetting) -> Flow:
        """The engine that moves the points (n, 3) of a surface."""
        inside = replace(surface, boundary="fixed") if setting.curve else surface
        return bordered(MeshFlow(inside, self.variant, metric_of(setting.triangles)), inside, setting)

    def stepper(
        self, asked: Stepper | StepperName, flow: Flow, time: float | None, faces: Array
    ) -> Stepper | StepperName:
        """The requested stepper."""
        return asked if self.along == "all" else AlongNormals(stepper_for(asked, flow, time), faces)


@named_fields
@dataclass(frozen=True, kw_only=True)
class ConformalFlow(CurvatureFlow):
    """Conformalized mean curvature flow (Kazhdan, Solomon, Ben-Chen 2012), with the stiffness of the start; for large times.

    Use it for large times, towards a sphere.
    """

    word: ClassVar[str] = "conformal"
    aliases: ClassVar[tuple[str, ...]] = ("conformal-flow",)

    def engine(self, surface: Surface, setting: PointSetting) -> Flow:
        """The engine that moves the points (n, 3) of a surface."""
        inside = replace(surface, boundary="fixed") if setting.curve else surface
        metric = Conformal(Clamped() if setting.triangles == "clamped" else Given())
        return bordered(MeshFlow(inside, self.variant, metric), inside, setting)

    def stepper(
        self, asked: Stepper | StepperName, flow: Flow, time: float | None, faces: Array
    ) -> Stepper | StepperName:
        """The requested stepper; semi-implicit by default."""
        return PointMethod.stepper(self, asked, flow, time, faces)


def bordered(flow: Flow, inside: Surface, setting: PointSetting) -> Flow:
    """The flow, with a border that moves as a curve where that is requested."""
    return Bordered(flow, inside) if setting.curve else flow
