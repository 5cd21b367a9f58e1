"""Total variation: its flow, and the model of Rudin, Osher and Fatemi at rest [ROF92]."""

from dataclasses import dataclass
from typing import ClassVar

from meshflow.errors import InputError
from meshflow.flow.methods.beltrami import MEAN, HeightMethod
from meshflow.geometry.options import named_fields, option
from meshflow.geometry.validation import positive

__all__ = ["TotalVariation"]


@named_fields
@dataclass(frozen=True, kw_only=True)
class TotalVariation(HeightMethod):
    """The flow of total variation, du/dt = div(grad u / sqrt(e^2 + |grad u|^2)), e its regularization [ROF92].

    It is mean curvature diffusion at the contrast 1 / e, and its limit for small e: slopes far above e lose height at one rate,
    whatever their steepness, and slopes below e diffuse. Times are those of mean curvature diffusion, 1 / e of those of the
    equation. The model of Rudin, Osher and Fatemi at rest, with a fidelity by the noise, is ``rof``.

    Use it for flat parts between sharp edges.
    """

    word: ClassVar[str] = "total-variation"
    conserves: ClassVar[str] = MEAN
    aliases: ClassVar[tuple[str, ...]] = ("tv-flow",)
    contrasts: ClassVar[tuple[float, ...]] = (8.0, 16.0)

    regularization: float | None = option(
        None,
        "Slopes below this diffuse as in the heat equation. Default: 1/8 or 1/16 of the noise over the sample "
        "distance.",
        "value per length",
    )

    def __post_init__(self) -> None:
        if self.regularization is not None:
            positive(self.regularization, "regularization")
            if self.contrast is not None and abs(self.contrast * self.regularization - 1.0) > 1e-9:
                raise InputError(
                    f"regularization {self.regularization} and contrast {self.contrast}: one of them expected"
                )
            object.__setattr__(self, "contrast", 1.0 / float(self.regularization))
        super().__post_init__()

    @property
    def exponents(self) -> dict[str, float]:
        """gamma -1."""
        return {"gamma": -1.0}
