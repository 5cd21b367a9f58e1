"""The family of W^q: exponents, edge indicator and mass as engines take them, and the methods of it that have names."""

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.options import option
from meshflow.geometry.validation import Array, number, positive

__all__ = [
    "Beltrami",
    "GemanMcClure",
    "GraphFlow",
    "Heat",
    "HeightMethod",
    "Indicator",
    "Mass",
    "MeanCurvatureDiffusion",
    "Member",
    "Patches",
    "PeronaMalik",
    "TotalVariation",
]

Indicator = Literal["metric", "projection"]
Mass = Literal["barycentric", "voronoi", "ring"]
# The widest patch: the taps must fit beside the rows of a grid.
WIDEST = 6.0


@dataclass(frozen=True)
class Member:
    """One flow of the family dX/dt = -(edge indicator)^gamma P B.

    :param gamma: exponent of the edge indicator, the convention of section 4.2, defined in every dimension: -2 graph flow
        (the motion of the shape under mean curvature flow), -1 mean curvature diffusion (El-Fallah and Ford), 0 Beltrami
        flow (14), above 0 stronger preservation of edges (10). The gamma of section 3 is this one plus 1. Where all
        coordinates are free (a mesh), the indicator is 1 and gamma has no effect.
    :param sharpness: q, above 0: in each triangle the free part of lengths is stretched so that a triangle of slope s has area
        W^q instead of W = sqrt(1 + s^2), all channels together. 1 is the paper. With gamma = -1 the flux across an edge is then
        grad / W^q: q = 1 [FEF98], q = 2 Perona and Malik (1), q = 4 Geman and McClure. No effect where all coordinates are
        free; not defined along rays.
    :param indicator: ``metric``: area of the triangles around a vertex projected across its free directions over their true
        area, 1/W of a height field (3); ``projection``: \\|PB\\| / \\|B\\| as (10) writes it. Both lie in [0, 1].
    :param mass: ``barycentric``: time as in the heat equation on flat data; ``voronoi`` (mixed): the same; ``ring``: the
        whole ring, as (14): time runs three times slower.
    :param patch: rho, in samples: lengths are measured in the space of patches, the Gaussian neighbourhoods of this width that
        each sample carries (DESIGN.md, section 2; on grids, not along rays). 0: of single samples. With gamma = -1 it leaks along
        edges; with gamma = 0, 0.5 to 1 lowers the error of the flow on noisy data.
    :param floor: least value of the ``projection`` indicator, which is 0/0 on flat surfaces and, for gamma < 0, would let the
        motion grow without bound.
    :raises InputError: for an unknown word, a gamma that is not finite, a sharpness that is not positive, a floor outside
        (0, 1], or a patch that is negative or wider than 6 samples.
    """

    gamma: float = 0.0
    sharpness: float = 1.0
    indicator: Indicator = "metric"
    mass: Mass = "barycentric"
    floor: float = 0.05
    patch: float = 0.0

    def __post_init__(self) -> None:
        number(self.gamma, "gamma")
        positive(self.sharpness, "sharpness")
        if self.indicator not in ("metric", "projection"):
            raise InputError(f"indicator: metric or projection expected, got {self.indicator!r}")
        if self.mass not in ("barycentric", "voronoi", "ring"):
            raise InputError(f"mass: barycentric, voronoi or ring expected, got {self.mass!r}")
        if positive(self.floor, "floor") > 1:
            raise InputError(f"floor: a number in (0, 1] expected, got {self.floor}")

        if not 0 <= number(self.patch, "patch") <= WIDEST:
            raise InputError(f"patch: a width between 0 and {WIDEST:g} samples expected, got {self.patch}")

    @property
    def taps(self) -> Array:
        """The Gaussian of the patches, from its middle outwards, of sum 1 with both its sides; one tap where there is none."""
        far = int(np.ceil(2.5 * self.patch))
        taps = np.exp(-0.5 * np.square(np.arange(far + 1) / self.patch)) if far else np.ones(1)
        return taps / (2.0 * taps.sum() - taps[0])

    def check(self, along_rays: bool, on_grid: bool) -> None:
        """Refuse a member that has no meaning on a surface.

        :raises InputError: for a sharpness other than 1 along rays: no common base holds the triangles there, and tilted planes
            would no longer rest; for patches along rays or on a mesh.
        """
        if along_rays and self.sharpness != 1.0:
            raise InputError(
                f"sharpness: along rays only 1 is defined, got {self.sharpness}; use gamma to keep edges of a range image"
            )
        if self.patch > 0 and (along_rays or not on_grid):
            where = "along rays" if along_rays else "on a mesh"
            raise InputError(f"patch: {where} samples have no patches, got {self.patch}; height fields and images have")


@dataclass(frozen=True, kw_only=True)
class HeightMethod:
    """A method for values above a base: heights, channels, depths. What is None is found from the data.

    :ivar word: what the command calls it.
    :ivar gamma: exponent of the edge indicator, see :class:`Member`; ``sharpness`` and ``patch`` likewise.
    :ivar contrasts: what a search tries, in sample distances over the noise.
    """

    word: ClassVar[str] = ""
    contrasts: ClassVar[tuple[float, ...]] = (1.0, 2.0, 4.0)

    contrast: float | None = option(
        None,
        "Length per unit of the value: a larger one keeps smaller edges. Default: from the noise.",
        "length per unit",
    )
    twicing: float | None = option(
        None, "Weight w of twicing, 0 to 1: u(t) + w (u(t) - u(2 t)) gives back what the method took from the data."
    )
    indicator: Indicator = option("metric", "How edges are recognized where gamma is not 0.")
    mass: Mass = option("barycentric", "Area of a vertex; with ring, as in the paper, time runs three times slower.")

    def __post_init__(self) -> None:
        if self.contrast is not None:
            positive(self.contrast, "contrast")
        if self.twicing is not None and not 0 <= number(self.twicing, "twicing") <= 1:
            raise InputError(f"twicing: a weight between 0 and 1 expected, got {self.twicing}")
        _ = self.member

    @property
    def exponents(self) -> dict[str, float]:
        """gamma, sharpness and patch, those that differ from the paper's (0, 1, 0)."""
        return {}

    @property
    def ruled(self) -> bool:
        """Whether the contrast is taken by rule, and not searched for, where the time is given."""
        return self.contrast is not None

    @property
    def member(self) -> Member:
        """The exponents, the edge indicator and the mass, as engines take them."""
        return Member(indicator=self.indicator, mass=self.mass, **self.exponents)


@dataclass(frozen=True, kw_only=True)
class Beltrami(HeightMethod):
    """The family dX/dt = -(edge indicator)^gamma P B, by its exponents; with its defaults Beltrami flow (14)."""

    word: ClassVar[str] = "beltrami"
    contrasts: ClassVar[tuple[float, ...]] = (0.7, 1.0, 1.5, 2.0, 3.0, 4.0)

    gamma: float = option(
        0.0,
        "Exponent of the edge indicator. 0: Beltrami flow; above 0: edges are kept more; -1: mean curvature diffusion; "
        "-2: graph flow.",
    )
    sharpness: float = option(1.0, "Above 1: less flux across edges; 2 with gamma -1 is Perona and Malik.")
    patch: float = option(0.0, "Width of the patches in whose space lengths are measured; grids only.", "samples")

    @property
    def exponents(self) -> dict[str, float]:
        """gamma, sharpness and patch."""
        return {"gamma": self.gamma, "sharpness": self.sharpness, "patch": self.patch}

    @property
    def ruled(self) -> bool:
        """Also where the caller chooses exponents of their own."""
        return self.contrast is not None or (self.gamma, self.sharpness, self.patch) != (0.0, 1.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class GraphFlow(HeightMethod):
    """The motion of the shape under mean curvature flow, values moving alone (8), (9): gamma = -2."""

    word: ClassVar[str] = "graph"
    contrasts: ClassVar[tuple[float, ...]] = (1.0, 2.0)

    @property
    def exponents(self) -> dict[str, float]:
        """gamma -2."""
        return {"gamma": -2.0}


@dataclass(frozen=True, kw_only=True)
class MeanCurvatureDiffusion(HeightMethod):
    """Mean curvature diffusion [FEF98]: gamma = -1, so that the mean of the values is conserved."""

    word: ClassVar[str] = "mean-curvature"

    @property
    def exponents(self) -> dict[str, float]:
        """gamma -1."""
        return {"gamma": -1.0}


@dataclass(frozen=True, kw_only=True)
class TotalVariation(HeightMethod):
    """Mean curvature diffusion at a high contrast, near the flow of total variation [ROF92]."""

    word: ClassVar[str] = "total-variation"
    contrasts: ClassVar[tuple[float, ...]] = (8.0, 16.0)

    @property
    def exponents(self) -> dict[str, float]:
        """gamma -1."""
        return {"gamma": -1.0}


@dataclass(frozen=True, kw_only=True)
class PeronaMalik(HeightMethod):
    """Perona and Malik's diffusion on triangles (1): flux grad / W^q, gamma = -1."""

    word: ClassVar[str] = "perona-malik"
    contrasts: ClassVar[tuple[float, ...]] = (0.7, 1.0, 1.5, 2.0, 3.0)

    sharpness: float = option(2.0, "Above 1: less flux across edges; 2 with gamma -1 is Perona and Malik.")

    @property
    def exponents(self) -> dict[str, float]:
        """gamma -1, and the sharpness."""
        return {"gamma": -1.0, "sharpness": self.sharpness}


@dataclass(frozen=True, kw_only=True)
class GemanMcClure(HeightMethod):
    """Diffusion with the flux grad / W^4, after Geman and McClure: gamma = -1, sharpness 4."""

    word: ClassVar[str] = "geman-mcclure"
    contrasts: ClassVar[tuple[float, ...]] = (0.4, 0.7, 1.0)

    @property
    def exponents(self) -> dict[str, float]:
        """gamma -1, sharpness 4."""
        return {"gamma": -1.0, "sharpness": 4.0}


@dataclass(frozen=True, kw_only=True)
class Heat(HeightMethod):
    """Beltrami flow at a contrast so low that it is all but the heat equation."""

    word: ClassVar[str] = "heat"
    contrasts: ClassVar[tuple[float, ...]] = (0.05,)


@dataclass(frozen=True, kw_only=True)
class Patches(HeightMethod):
    """Beltrami flow with lengths measured in the space of patches: every sample carries its neighbourhood. Grids only."""

    word: ClassVar[str] = "patches"

    patch: float = option(0.7, "Width of the patches in whose space lengths are measured; grids only.", "samples")

    @property
    def exponents(self) -> dict[str, float]:
        """The width of the patches."""
        return {"patch": self.patch}
