"""Variational restoration: the minimum of a potential of the gradient and a fidelity, at rest [ABBFC97], [ROF92]."""

from dataclasses import dataclass, replace
from typing import ClassVar, Literal

from meshflow.errors import InputError
from meshflow.flow.conductances import conductance_of, power_of
from meshflow.flow.contract import Flow
from meshflow.flow.engines.conducting import Conducting
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.family import Variant
from meshflow.flow.methods.beltrami import MEAN, UnsearchedMethod
from meshflow.flow.proximal import Proximal
from meshflow.flow.steppers import Stepper, StepperName
from meshflow.geometry.options import named_fields, option
from meshflow.geometry.validation import positive
from meshflow.surfaces.grid import Grid
from meshflow.surfaces.surface import Surface

__all__ = ["HalfQuadratic", "RudinOsherFatemi"]

POTENTIALS = {"hypersurface": "hypersurface", "lorentz": "rational", "geman-mcclure": "geman-mcclure"}
EXPONENTS = {"hypersurface": 1.0, "lorentz": 2.0, "geman-mcclure": 4.0}


@dataclass(frozen=True, kw_only=True)
class _AtRest(UnsearchedMethod):
    """One fully implicit step of a diffusion: its time is the weight of the potential against the data."""

    once: ClassVar[bool] = True
    balance: Literal["noise", "risk"] = option(
        "noise",
        "How the time is chosen if it is not given: noise makes the residual equal to the noise, risk minimizes the "
        "estimated error.",
    )
    unused: ClassVar[tuple[str, ...]] = ("indicator",)
    conserves: ClassVar[str] = MEAN

    def misfit(self, along_rays: bool, on_grid: bool) -> str:
        """Why the method is not defined along rays; empty elsewhere."""
        return "only for heights and channels, got depths along rays" if along_rays else ""

    @property
    def fits_noise(self) -> bool:
        """The time is that at which the residual equals the noise, or that of least estimated risk."""
        return True

    @property
    def metric(self) -> Conducting:
        """How triangles conduct."""
        return Conducting(conductance_of("hypersurface"))

    def stepper(self, asked: Stepper | StepperName) -> Stepper | StepperName:
        """Half-quadratic iterations.

        :raises InputError: for another stepper by name.
        """
        if isinstance(asked, str) and asked not in ("auto", Proximal.name):
            raise InputError(f"stepper: method {self.word} has its own, got {asked!r}; leave it out")
        return Proximal() if isinstance(asked, str) else asked

    def on_grid(self, grid: Grid, threads: int | None) -> Flow:
        """A conductance per triangle; both triangulations where they would alternate, since there is one step."""
        if grid.diagonals == "alternate":
            grid = replace(grid, diagonals="both")
        return MeshFlow(grid.surface(), Variant(mass=self.mass), self.metric)

    def on_surface(self, surface: Surface, clamped: bool) -> Flow:
        """Likewise."""
        return MeshFlow(surface, Variant(mass=self.mass), self.metric)


@named_fields
@dataclass(frozen=True, kw_only=True)
class HalfQuadratic(_AtRest):
    """Deterministic edge-preserving regularization: a variational restoration, to rest in a few solves [ABBFC97].

    The minimum of sum A phi(s) / contrast^2 + |u - f|^2 / (2 time), s = contrast |grad u|, by half-quadratic minimization
    (:class:`meshflow.flow.proximal.Proximal`). phi by name: ``hypersurface`` sqrt(1 + s^2) - 1, ``lorentz`` log(1 + s^2) / 2,
    ``geman-mcclure`` s^2 / (1 + s^2) / 2, those of P. Charbonnier, L. Blanc-Feraud, G. Aubert, M. Barlaud, IEEE Trans. Image
    Process. 6 (1997), 298-311 (as surveys give them; the paper itself was not at hand). With a ``sharpness`` q
    it is the potential of the flow with conductance 1 / W^q, ((1 + s^2)^(1 - q / 2) - 1) / (2 - q). Without a time the
    residual is made equal to the noise, or the estimated risk least (``balance="risk"``). Use it where a flow's time is hard to
    choose: its result is the end.
    """

    word: ClassVar[str] = "half-quadratic"
    aliases: ClassVar[tuple[str, ...]] = ("artur", "charbonnier", "abbfc97")
    contrasts: ClassVar[tuple[float, ...]] = (1.0,)

    potential: Literal["hypersurface", "lorentz", "geman-mcclure"] = option(
        "hypersurface", "Potential of the gradient: hypersurface is convex; lorentz and geman-mcclure keep edges more."
    )

    sharpness: float | None = option(None, "Above 1, less flux crosses edges. 2 with gamma -1 is Perona and Malik.")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.potential not in POTENTIALS:
            raise InputError(f"potential: {', '.join(POTENTIALS)} expected, got {self.potential!r}")
        if self.sharpness is not None:
            positive(self.sharpness, "sharpness")
            if self.potential != "hypersurface":
                raise InputError(f"potential={self.potential!r}, sharpness={self.sharpness:g}: give one of them")

    @property
    def edge(self) -> float:
        """Lower for potentials that grow more slowly, which would keep the noise."""
        q, plain = self._exponent, super().edge
        return plain if q <= 1.0 else 1.0 / q if q >= 2.0 else plain + (q - 1.0) * (0.5 - plain)

    @property
    def metric(self) -> Conducting:
        """How triangles conduct, phi'(s) / s."""
        known = conductance_of(POTENTIALS[self.potential])
        return Conducting(known if self.sharpness is None else power_of(self.sharpness))

    @property
    def _exponent(self) -> float:
        """q of 1 / W^q."""
        return EXPONENTS[self.potential] if self.sharpness is None else self.sharpness


@named_fields
@dataclass(frozen=True, kw_only=True)
class RudinOsherFatemi(_AtRest):
    """Total variation with a fidelity, at rest: the model of Rudin, Osher and Fatemi [ROF92].

    The minimum of sum A sqrt(1 / contrast^2 + |grad u|^2) + lambda / 2 |u - f|^2 with lambda = contrast / time. Without a time
    lambda is that of their constraint, |u - f|^2 = sigma^2 times the area, or with ``balance="risk"`` that of least estimated
    risk (Stein 1981, by one probe; for white noise), which smooths less. L. Rudin, S. Osher, E. Fatemi, Physica D 60 (1992),
    259-268; they march to rest in time, here it is reached in a few solves. Use it for flat parts between sharp edges; it
    lowers peaks.
    """

    word: ClassVar[str] = "rof"
    aliases: ClassVar[tuple[str, ...]] = ("rof92",)
    contrasts: ClassVar[tuple[float, ...]] = (8.0,)
