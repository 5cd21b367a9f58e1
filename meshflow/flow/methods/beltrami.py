"""The methods of the W^q family: by exponents, and its named members."""

from dataclasses import dataclass
from typing import Any, ClassVar

from meshflow.errors import InputError
from meshflow.flow.contract import Flow
from meshflow.flow.controls import AreaChange, Control
from meshflow.flow.engines.grid import GridFlow
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.engines.metric import Clamped
from meshflow.flow.family import WIDEST, Indicator, Mass, Variant
from meshflow.flow.steppers import Explicit, Stepper, StepperName
from meshflow.geometry.options import named_fields, option
from meshflow.geometry.validation import positive
from meshflow.surfaces.grid import Grid
from meshflow.surfaces.surface import Surface

__all__ = [
    "MEAN",
    "Beltrami",
    "GemanMcClure",
    "Heat",
    "HeightMethod",
    "MeanCurvatureDiffusion",
    "Patches",
    "SchemeMethod",
    "UnsearchedMethod",
    "presmoothing_of",
]

MEAN = "the mean of the values, each weighted by the area of its sample, with neumann borders"


@dataclass(frozen=True, kw_only=True)
class HeightMethod:
    """A method for values above a base: heights, channels, depths. Options that are None are estimated from the data.

    :ivar word: its name on the command line.
    :ivar gamma: exponent of the edge indicator, see :class:`Variant`; ``sharpness`` and ``patch`` likewise.
    :ivar contrasts: those that a search tries, in sample distances divided by the noise.
    :ivar once: whether it reaches its time in one step.
    :ivar slower: by how much its time runs slower than that of the heat equation.
    :ivar conserves: what does not change, and with which borders; in words.
    :ivar aliases: other names of it.
    :ivar unused: its options that change nothing.
    """

    word: ClassVar[str] = ""
    contrasts: ClassVar[tuple[float, ...]] = (1.0, 2.0, 4.0)
    once: ClassVar[bool] = False
    slower: ClassVar[float] = 1.0
    conserves: ClassVar[str] = "nothing"
    aliases: ClassVar[tuple[str, ...]] = ()
    unused: ClassVar[tuple[str, ...]] = ()

    contrast: float | None = option(
        None,
        "Factor on the values: slopes above 1 / contrast count as edges, so a larger contrast keeps weaker edges. "
        "Default: from the noise.",
        "length per unit",
    )
    twicing: float | None = option(
        None,
        "Weight w of twicing, which restores signal. The flow runs on to twice the time, and the result is u(t) + w "
        "(u(t) - u(2 t)). 0: none.",
        within=(0.0, 1.0),
    )
    second_stage: bool | None = option(
        None,
        "After the flow, filter groups of similar patches (height fields, images and volumes only). Default: yes if no "
        "method is named, if it lowers the expected error, and if the data has at most 2^20 values (2^23 for a volume).",
    )
    indicator: Indicator = option(
        "metric",
        "How edges are measured: metric compares areas, projection is equation (10). Without effect if gamma is 0.",
    )
    mass: Mass = option(
        "barycentric", "Area that belongs to a vertex. With ring, as in the paper, time runs three times slower."
    )

    def __post_init__(self) -> None:
        if self.contrast is not None:
            positive(self.contrast, "contrast")
        _ = self.variant

    @property
    def exponents(self) -> dict[str, float]:
        """Those of gamma, sharpness and patch that differ from the paper's (0, 1, 0)."""
        return {}

    @property
    def ruled(self) -> bool:
        """Whether a given time makes the contrast follow a rule instead of a search."""
        return self.contrast is not None

    @property
    def searches(self) -> bool:
        """Whether contrast and time may be searched by the estimated risk of the family; else they are by rule."""
        return True

    def searches_for(self, channels: int) -> bool:
        """Likewise, for so many channels."""
        return self.searches

    @property
    def variant(self) -> Variant:
        """The exponents, the edge indicator and the mass, for the engines."""
        gamma, sharpness, patch = ({"gamma": 0.0, "sharpness": 1.0, "patch": 0.0} | self.exponents).values()
        return Variant(gamma, sharpness, self.indicator, self.mass, patch=patch)

    @property
    def edge(self) -> float:
        """The contrast without a search, in sample distances over the noise."""
        return self.contrasts[(len(self.contrasts) - 1) // 2]

    @property
    def fits_noise(self) -> bool:
        """Whether the time without a search is that at which the residual equals the noise."""
        return False

    def stepper(self, asked: Stepper | StepperName) -> Stepper | StepperName:
        """The requested stepper."""
        return asked

    def control(self, asked: Control | None) -> Control | None:
        """The requested control of the steps."""
        return asked

    def on_grid(self, grid: Grid, threads: int | None) -> Flow:
        """The engine for samples of a grid."""
        return GridFlow(grid, self.variant, threads)

    def on_surface(self, surface: Surface, clamped: bool) -> Flow:
        """The engine for channels of a mesh.

        :param clamped: whether negative weights are set to zero.
        """
        return MeshFlow(surface, self.variant, Clamped() if clamped else None)

    def misfit(self, along_rays: bool, on_grid: bool) -> str:
        """Why the method is not defined along rays, or off a grid; empty where it is."""
        return self.variant.misfit(along_rays, on_grid)


@dataclass(frozen=True, kw_only=True)
class UnsearchedMethod(HeightMethod):
    """A method that the engines of the family do not have: contrast and time are given, or by rule."""

    @property
    def searches(self) -> bool:
        """Nothing is searched for."""
        return False

    @property
    def ruled(self) -> bool:
        """Likewise."""
        return True


def presmoothing_of(sigma: float) -> Any:
    """Declare the Gaussian of a scheme, with its default; a wider one costs more than a run and leaves no edge."""
    return option(
        sigma,
        "Standard deviation of the Gaussian filter that precedes the measurement of edges.",
        "samples",
        within=(0.0, 1000.0),
    )


@dataclass(frozen=True, kw_only=True)
class SchemeMethod(UnsearchedMethod):
    """A method by finite differences between samples of a grid, with explicit steps."""

    unused: ClassVar[tuple[str, ...]] = ("indicator", "mass")

    def misfit(self, along_rays: bool, on_grid: bool) -> str:
        """Why the method is not defined along rays, or off a grid; empty where it is."""
        got = "a range image" if along_rays else "" if on_grid else "a mesh"
        return f"only for height fields and images, whose samples lie on a plane grid; got {got}" if got else ""

    def on_surface(self, surface: Surface, clamped: bool) -> Flow:
        """None.

        :raises InputError: always; meshes have no differences between samples.
        """
        raise InputError(
            f"method={self.word!r}: only for height fields and images, whose samples lie on a grid; got a mesh"
        )


def patch_of(width: float) -> Any:
    """Declare the width of the patches, with its default."""
    meaning = (
        "Width of the patches whose difference is the distance between two samples. 0: single samples. Grids only."
    )
    return option(width, meaning, "samples", within=(0.0, WIDEST))


@named_fields
@dataclass(frozen=True, kw_only=True)
class Beltrami(HeightMethod):
    """Beltrami flow (14) [KMS97] [SKM98]; the exponents gamma, sharpness and patch give the other flows of its family.

    Use it as the flow of the paper, or with exponents of your own.
    """

    word: ClassVar[str] = "beltrami"
    conserves: ClassVar[str] = "nothing; for gamma -1 what mean-curvature does"
    aliases: ClassVar[tuple[str, ...]] = ("beltrami-flow", "kms97", "skm98")
    contrasts: ClassVar[tuple[float, ...]] = (0.7, 1.0, 1.5, 2.0, 3.0, 4.0)

    gamma: float = option(
        0.0,
        "Exponent of the edge indicator. 0 is Beltrami flow, -1 mean curvature diffusion, -2 graph flow; above 0, edges "
        "are kept more.",
    )
    sharpness: float = option(1.0, "Above 1, less flux crosses edges. 2 with gamma -1 is Perona and Malik.")
    patch: float = patch_of(0.0)

    @property
    def exponents(self) -> dict[str, float]:
        """gamma, sharpness and patch."""
        return {"gamma": self.gamma, "sharpness": self.sharpness, "patch": self.patch}

    @property
    def ruled(self) -> bool:
        """As in the base class, and also where the caller gives exponents."""
        return self.contrast is not None or (self.gamma, self.sharpness, self.patch) != (0.0, 1.0, 0.0)


@named_fields
@dataclass(frozen=True, kw_only=True)
class MeanCurvatureDiffusion(HeightMethod):
    """Mean curvature diffusion, du/dt = div(grad u / sqrt(1 + |grad u|^2)) [FEF98]: gamma = -1. It keeps edges somewhat.

    With ``neumann`` borders the mean of the values is conserved to rounding, each sample weighted by its area on the plane. With
    ``alternate`` this is its mean area in the two triangulations, as with ``both``; where one of them has less than half of the
    other, amid holes, it is 3/4 of the larger. G. Ford, A. El-Fallah, Pattern Recognition Letters 19 (1998), 433-437. Their
    explicit steps that follow the loss of area (section 5.6) are ``area_steps``. Use it as a gentle flow that needs no exponent.
    """

    word: ClassVar[str] = "mean-curvature"
    conserves: ClassVar[str] = MEAN
    aliases: ClassVar[tuple[str, ...]] = ("mcd", "fef98")

    area_steps: bool = option(
        False, "Explicit steps whose length follows the loss of area, as El-Fallah and Ford have it."
    )

    @property
    def exponents(self) -> dict[str, float]:
        """gamma -1."""
        return {"gamma": -1.0}

    def stepper(self, asked: Stepper | StepperName) -> Stepper | StepperName:
        """The requested stepper; explicit where steps follow the area."""
        if self.area_steps and asked == "auto":
            return Explicit()
        return asked

    def control(self, asked: Control | None) -> Control | None:
        """The requested control, or that by area."""
        return AreaChange() if self.area_steps and asked is None else asked


@named_fields
@dataclass(frozen=True, kw_only=True)
class GemanMcClure(HeightMethod):
    """Diffusion with the flux grad / W^4, after Geman and McClure: gamma = -1, sharpness 4.

    Use it for plateaus with sharp edges.
    """

    word: ClassVar[str] = "geman-mcclure"
    conserves: ClassVar[str] = MEAN
    contrasts: ClassVar[tuple[float, ...]] = (0.4, 0.7, 1.0)

    @property
    def exponents(self) -> dict[str, float]:
        """gamma -1, sharpness 4."""
        return {"gamma": -1.0, "sharpness": 4.0}


@named_fields
@dataclass(frozen=True, kw_only=True)
class Heat(HeightMethod):
    """The heat equation du/dt = div grad u, linear for any data: time t is a Gaussian of variance 2 t. It blurs edges.

    On a mesh it is the equation of the surface, with the Laplace-Beltrami operator of its points. It has no contrast.

    Use it where a Gaussian is meant.
    """

    word: ClassVar[str] = "heat"
    conserves: ClassVar[str] = MEAN
    aliases: ClassVar[tuple[str, ...]] = ("heat-equation", "linear-diffusion")
    unused: ClassVar[tuple[str, ...]] = ("contrast", "indicator")
    contrasts: ClassVar[tuple[float, ...]] = (1.0,)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.contrast is not None:
            raise InputError(f"method='heat': the heat equation has no contrast, got {self.contrast}; leave it out")

    @property
    def ruled(self) -> bool:
        """There is no contrast to search for."""
        return True

    @property
    def variant(self) -> Variant:
        """The linear flow."""
        return Variant(mass=self.mass, linear=True)


@named_fields
@dataclass(frozen=True, kw_only=True)
class Patches(HeightMethod):
    """Beltrami flow with lengths measured between patches, the neighbourhoods of the samples. Grids only.

    Use it for textures and slopes.
    """

    word: ClassVar[str] = "patches"

    patch: float = patch_of(0.7)

    @property
    def exponents(self) -> dict[str, float]:
        """The width of the patches."""
        return {"patch": self.patch}
