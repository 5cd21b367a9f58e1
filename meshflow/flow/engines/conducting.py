"""Nonlinear diffusion with a conductance per triangle, du/dt = div(g(s) grad u), over the base of a surface."""

from dataclasses import dataclass

import numpy as np

from meshflow.errors import InputError
from meshflow.flow.conductances import Conductance
from meshflow.flow.engines.metric import Measured, Metric
from meshflow.flow.engines.triangulation import Triangulation
from meshflow.geometry import operator
from meshflow.geometry.operator import MassKind
from meshflow.geometry.validation import Array
from meshflow.surfaces.surface import Surface

__all__ = ["Conducting"]


@dataclass(frozen=True)
class Conducting:
    """Triangles as their base is, with the cotangents of each multiplied by g(s), s^2 = |grad x|^2 of all channels together.

    The flow is the gradient descent of sum A phi(s), phi' = s g, over the base; its system, with g of the present state, is
    that of the half-quadratic minimization of this energy (Charbonnier et al. 1997, [ABBFC97]). The area that it reports is
    this energy.

    :param conductance: g, at most 1, so that explicit steps are stable up to those of the heat equation.
    """

    conductance: Conductance
    thinnest = 0.0
    keeps_range = False

    def settled(self, surface: Surface, triangulation: Triangulation, mass: MassKind) -> Metric:
        """The same.

        :raises InputError: where the surface has no base: all coordinates are free, or they move along rays.
        """
        if surface.free.per_vertex or surface.is_free:
            raise InputError("a conductance: values above a base expected (heights, channels), got points that move")
        return self

    def measured(self, triangulation: Triangulation, x: Array, sharpness: float) -> Measured:
        """The base, and its cotangents times the conductances."""
        cot, area, slope2 = self._sloped(triangulation, x)
        return Measured(triangulation.connectivity, cot, area, cot * self.conductance.of(slope2)[:, None])

    def area(self, triangulation: Triangulation, x: Array, sharpness: float) -> float:
        """The energy sum A phi(s)."""
        _, area, slope2 = self._sloped(triangulation, x)
        return float((area * self.conductance.potential(slope2)).sum())

    def _sloped(self, triangulation: Triangulation, x: Array) -> tuple[Array, Array, Array]:
        """Cotangents (m, 3) and areas (m,) of the base, and |grad x|^2 (m,)."""
        if triangulation.forms is None:
            raise InputError("a conductance: a surface with a base expected")
        cot, area = operator.form_cotangents(triangulation.forms)
        corners = x[triangulation.connectivity.faces]
        opposite = np.square(np.roll(corners, -1, axis=1) - np.roll(corners, -2, axis=1)).sum(axis=2)
        dirichlet = 0.5 * (cot * opposite).sum(axis=1)
        return cot, area, np.divide(dirichlet, area, out=np.zeros_like(area), where=area > 0)
