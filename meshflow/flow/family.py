"""The W^q family of flows: exponents, edge indicator, mass."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.options import named_fields
from meshflow.geometry.validation import Array, number, positive

__all__ = ["Indicator", "Mass", "Variant"]

Indicator = Literal["metric", "projection"]
Mass = Literal["barycentric", "voronoi", "ring"]
# The widest patch; the filter taps must fit beside the rows of a grid.
# The largest exponents: beyond, no slope of any data keeps within double precision.
STEEPEST = 100.0
# The least gamma: below it steep places move so fast that the steps that they allow are too short to compute.
LEAST_GAMMA = -12.0
WIDEST = 6.0


@named_fields
@dataclass(frozen=True)
class Variant:
    """One flow of the family dX/dt = -(edge indicator)^gamma P B.

    :param gamma: exponent of the edge indicator, in the convention of section 4.2, defined in every dimension: -2 graph flow
        (the motion of the graph under mean curvature flow), -1 mean curvature diffusion (El-Fallah and Ford), 0 Beltrami
        flow (14), above 0 stronger preservation of edges (10). The gamma of section 3 is this gamma plus 1. Where
        all coordinates are free (a mesh), the indicator is 1 and gamma has no effect.
    :param sharpness: q, above 0: in each triangle the free part of lengths is stretched so that a triangle of slope s has area
        W^q instead of W = sqrt(1 + s^2), all channels together. 1 is the paper. With gamma = -1 the flux across an edge is then
        grad / W^q: q = 1 [FEF98], q = 2 Perona and Malik (1), q = 4 Geman and McClure. No effect where all coordinates are
        free; not defined along rays.
    :param indicator: ``metric``: area of the triangles around a vertex projected across its free directions over their true
        area, 1/W of a height field (3); ``projection``: \\|PB\\| / \\|B\\| as (10) writes it. Both lie in [0, 1].
    :param mass: ``barycentric``: time as in the heat equation on flat data; ``voronoi`` (mixed): the same; ``ring``: the
        whole ring, as (14): time runs three times slower.
    :param patch: rho, in samples: lengths are measured in the space of patches, the Gaussian neighbourhoods of this width of
        the samples (on grids, not along rays). 0: between single samples. With gamma = -1 it leaks along edges; with gamma = 0,
        widths of 0.5 to 1 lower the error of the flow on noisy data.
    :param floor: least value of the ``projection`` indicator, which is 0/0 on flat surfaces; without it the rate is unbounded for
        gamma < 0.
    :param linear: triangles are measured by their base alone, so that dX/dt is the Laplacian of X: the heat equation, for any
        data. It has no contrast.
    :raises InputError: for an unknown word, a gamma that is not finite, a sharpness that is not positive, a floor outside
        (0, 1], or a patch that is negative or wider than 6 samples.
    """

    gamma: float = 0.0
    sharpness: float = 1.0
    indicator: Indicator = "metric"
    mass: Mass = "barycentric"
    floor: float = 0.05
    patch: float = 0.0
    linear: bool = False

    def __post_init__(self) -> None:
        if not LEAST_GAMMA <= number(self.gamma, "gamma") <= STEEPEST:
            why = "; below it steep places move too fast to compute, and -2 (graph flow) already smooths edges"
            raise InputError(
                f"gamma: an exponent from {LEAST_GAMMA:g} to {STEEPEST:g} expected, got {self.gamma:g}"
                f"{why if self.gamma < 0 else ''}"
            )
        if positive(self.sharpness, "sharpness") > STEEPEST:
            raise InputError(f"sharpness: an exponent up to {STEEPEST:g} expected, got {self.sharpness:g}")
        if positive(self.floor, "floor") > 1:
            raise InputError(f"floor: a number in (0, 1] expected, got {self.floor}")

        if not 0 <= number(self.patch, "patch") <= WIDEST:
            raise InputError(f"patch: a width between 0 and {WIDEST:g} samples expected, got {self.patch}")

    @property
    def taps(self) -> Array:
        """The Gaussian of the patches from its centre outwards; both sides together sum to 1. One tap without patches."""
        far = int(np.ceil(2.5 * self.patch))
        taps = np.exp(-0.5 * np.square(np.arange(far + 1) / self.patch)) if far else np.ones(1)
        return taps / (2.0 * taps.sum() - taps[0])

    @property
    def conserves(self) -> bool:
        """Whether s / M is one over the area of the base: with ``neumann`` borders the mean over that area is conserved."""
        alike = self.linear or self.gamma == -1.0
        return alike and self.mass != "voronoi" and (self.gamma == 0.0 or self.indicator == "metric")

    @property
    def reach(self) -> int:
        """How many samples away a sample of a grid decides the rate of another one."""
        return len(self.taps) if self.patch > 0 else 1

    def check(self, along_rays: bool, on_grid: bool) -> None:
        """Refuse options that are not defined on a surface.

        :raises InputError: as :meth:`misfit` says.
        """
        if why := self.misfit(along_rays, on_grid):
            raise InputError(why)

    def check_on_tetrahedra(self) -> None:
        """Refuse options that are not defined for volumes.

        :raises InputError: with the option.
        """
        for word, given in (
            ("patch", self.patch > 0),
            ("mass='voronoi'", self.mass == "voronoi"),
            ("indicator='projection'", self.indicator == "projection" and self.gamma != 0),
        ):
            if given:
                raise InputError(f"{word}: not defined for volumes, whose cells are tetrahedra; leave it out")

    def misfit(self, along_rays: bool, on_grid: bool) -> str:
        """Why the options are not defined on a surface; empty where they are.

        A sharpness other than 1 is not defined along rays, where the triangles have no common base and tilted planes would
        move; nor are patches along rays or on a mesh; nor is a linear flow along rays, where there is no base.
        """
        if along_rays and self.linear:
            return (
                "along rays there is no plane over which depths could diffuse linearly; take domain='disparity', "
                "or kind='terrain' for the depths as heights over the pixels"
            )
        if along_rays and self.sharpness != 1.0:
            return f"sharpness: along rays only 1 is defined, got {self.sharpness:g}; use gamma to keep edges of a range image"
        if self.patch > 0 and (along_rays or not on_grid):
            where = "along rays" if along_rays else "on a mesh"
            return f"patch: {where} samples have no patches, got {self.patch:g}; height fields and images have"
        return ""
