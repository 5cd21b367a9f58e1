"""Curvature flow with lengths measured in (x, weight n): it smooths faces and keeps creases."""

from dataclasses import dataclass
from typing import ClassVar

from meshflow.flow.contract import Flow
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.engines.metric import NormalChannels as Lengths
from meshflow.flow.engines.metric import metric_of
from meshflow.flow.family import Mass, Variant
from meshflow.flow.methods.points import PointMethod, PointSetting
from meshflow.geometry.options import named_fields, option
from meshflow.geometry.validation import positive
from meshflow.surfaces.surface import Surface

__all__ = ["NormalChannels"]


@named_fields
@dataclass(frozen=True, kw_only=True)
class NormalChannels(PointMethod):
    """Mean curvature flow of the surface (x, normal_weight n), in which only the points x move. It keeps creases.

    Use it for faces and creases, with more smoothing than curvature.
    """

    word: ClassVar[str] = "normal-channels"

    normal_weight: float | None = option(None, "Factor on the unit normals. Default: 8 mean edges.", "length")
    mass: Mass = option(
        "barycentric", "Area that belongs to a vertex. With ring, as in the paper, time runs three times slower."
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.normal_weight is not None:
            positive(self.normal_weight, "normal_weight")

    def engine(self, surface: Surface, setting: PointSetting) -> Flow:
        """The engine that moves the points (n, 3) of a surface."""
        self.must_hold_border(setting)
        return MeshFlow(
            surface, Variant(mass=self.mass), Lengths(self.normal_weight or 1.0, metric_of(setting.triangles))
        )
