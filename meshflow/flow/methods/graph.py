"""The graph flow: the motion of the graph under mean curvature flow, in which only the values move."""

from dataclasses import dataclass
from typing import ClassVar, Literal

from meshflow.errors import InputError
from meshflow.flow.contract import Flow
from meshflow.flow.engines.graph_motion import GraphMotion
from meshflow.flow.family import Indicator, Variant
from meshflow.flow.methods.beltrami import HeightMethod
from meshflow.geometry.options import named_fields, option
from meshflow.surfaces.grid import Grid
from meshflow.surfaces.surface import Surface

__all__ = ["GraphFlow"]


@named_fields
@dataclass(frozen=True, kw_only=True)
class GraphFlow(HeightMethod):
    """The motion of the graph under mean curvature flow, in which only the values move (6); graph mean curvature of [MS96].

    For one channel it is gamma = -2. For several, ``motion`` is dI^a/dt = g^ij d_i d_j I^a, the true motion of the shape, and
    ``paper`` is (8), (9) as the paper writes it, -(B.B / PB.PB) PB, which for several channels is another one. It smooths edges,
    too. Use it as a scale space of shapes.
    """

    word: ClassVar[str] = "graph"
    aliases: ClassVar[tuple[str, ...]] = ("graph-flow", "graph-mean-curvature")
    contrasts: ClassVar[tuple[float, ...]] = (1.0, 2.0)

    formula: Literal["motion", "paper"] = option(
        "motion", "For several channels: the true motion of the graph, or equation (8) of the paper."
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.formula not in ("motion", "paper"):
            raise InputError(f"formula: motion or paper expected, got {self.formula!r}")

    @property
    def exponents(self) -> dict[str, float]:
        """gamma -2."""
        return {"gamma": -2.0}

    @property
    def variant(self) -> Variant:
        """The family, for one channel or as the paper has it."""
        indicator: Indicator = "projection" if self.formula == "paper" else self.indicator
        return Variant(-2.0, 1.0, indicator, self.mass)

    def searches_for(self, channels: int) -> bool:
        """The family has it but for the motion of several channels."""
        return channels == 1 or self.formula == "paper"

    def on_grid(self, grid: Grid, threads: int | None) -> Flow:
        """The family, or the motion of several channels."""
        if self.searches_for(len(grid.planes)) or grid.lines is not None:
            return super().on_grid(grid, threads)
        return GraphMotion(grid.surface())

    def on_surface(self, surface: Surface, clamped: bool) -> Flow:
        """Likewise."""
        if clamped or surface.is_free or self.searches_for(surface.start.shape[1]):
            return super().on_surface(surface, clamped)
        return GraphMotion(surface)
