"""The diffusion of Perona and Malik, with the conductances of the paper and Tukey's [PM90]."""

from dataclasses import dataclass
from typing import ClassVar, Literal

from meshflow.errors import InputError
from meshflow.flow.conductances import conductance_of
from meshflow.flow.contract import Flow
from meshflow.flow.engines.conducting import Conducting
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.family import Variant
from meshflow.flow.methods.beltrami import MEAN, HeightMethod
from meshflow.geometry.options import named_fields, option
from meshflow.surfaces.grid import Grid
from meshflow.surfaces.surface import Surface

__all__ = ["PeronaMalik"]


@named_fields
@dataclass(frozen=True, kw_only=True)
class PeronaMalik(HeightMethod):
    """The diffusion of Perona and Malik on triangles, du/dt = div(g grad u) (1) [PM90]. It keeps and sharpens edges.

    With s = contrast |grad u|, all channels together, g is 1 / (1 + s^2) (``rational``, the paper's second; alpha of (1) is 1 /
    contrast^2), exp(-s^2) (``exponential``, the paper's first), or (1 - s^2)^2 up to s = 1 and 0 beyond (``tukey``, of Black et
    al. 1998, scaled to g(0) = 1). With another ``sharpness`` q the rational one is 1 / (1 + s^2)^(q/2). The four-neighbour
    scheme of the paper is :func:`meshflow.classics.perona_malik`.

    Use it for plateaus and cliffs.
    """

    word: ClassVar[str] = "perona-malik"
    conserves: ClassVar[str] = MEAN
    aliases: ClassVar[tuple[str, ...]] = ("pm", "pm90")
    contrasts: ClassVar[tuple[float, ...]] = (0.7, 1.0, 1.5, 2.0, 3.0)

    sharpness: float = option(2.0, "Above 1, less flux crosses edges. 2 with gamma -1 is Perona and Malik.")
    conductance: Literal["rational", "exponential", "tukey"] = option(
        "rational",
        "How the flux decreases with the slope: rational and exponential are those of the paper; tukey stops it.",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        conductance_of(self.conductance)
        if self.conductance not in ("rational", "exponential", "tukey"):
            raise InputError(f"conductance: rational, exponential or tukey expected, got {self.conductance!r}")
        if self.conductance != "rational" and self.sharpness != 2.0:
            raise InputError(f"sharpness {self.sharpness}: only for conductance='rational'; leave one of them out")

    @property
    def exponents(self) -> dict[str, float]:
        """gamma -1, and the sharpness."""
        return {"gamma": -1.0, "sharpness": self.sharpness}

    @property
    def ruled(self) -> bool:
        """As in the base class, and also for conductances that are not of the family."""
        return self.contrast is not None or self.conductance != "rational"

    @property
    def edge(self) -> float:
        """As in the base class; lower for conductances that fall faster."""
        return {"exponential": 0.4, "tukey": 0.2}.get(self.conductance, super().edge)

    @property
    def searches(self) -> bool:
        """Whether the family has this conductance."""
        return self.conductance == "rational"

    def on_grid(self, grid: Grid, threads: int | None) -> Flow:
        """The family for the rational conductance, else a conductance per triangle."""
        if self.conductance == "rational":
            return super().on_grid(grid, threads)
        return MeshFlow(grid.surface(), Variant(mass=self.mass), Conducting(conductance_of(self.conductance)))

    def on_surface(self, surface: Surface, clamped: bool) -> Flow:
        """Likewise."""
        if self.conductance == "rational":
            return super().on_surface(surface, clamped)
        return MeshFlow(surface, Variant(mass=self.mass), Conducting(conductance_of(self.conductance)))
