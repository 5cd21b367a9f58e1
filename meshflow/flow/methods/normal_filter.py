"""Features kept: the normals of the triangles flow, and the points follow them."""

from dataclasses import dataclass

import numpy as np

from meshflow.errors import InputError
from meshflow.flow.blend import RATE, Blend
from meshflow.flow.contract import System
from meshflow.flow.engines.dense import Dense
from meshflow.flow.methods.fairing import filtered
from meshflow.geometry import normals as facets
from meshflow.geometry import operator
from meshflow.geometry.connectivity import connect
from meshflow.geometry.laplacians import umbrella_generator
from meshflow.geometry.validation import Array, number, positive
from meshflow.surfaces.surface import Surface

__all__ = ["ROUND", "FacetFlow", "Facets"]

# One round, in squared edges: normals spread in steps of SWEEP, then points follow them in FOLLOWED sweeps. A round is long, so
# that the normals of noisy triangles settle before any point has moved.
ROUND, SWEEP, FOLLOWED = 10.0, 0.5, 10


@dataclass(frozen=True)
class Facets:
    """How normals flow.

    :param contrast: what a difference of unit normals is multiplied by: what then is above 1 is a crease.
    :param sharpness: q of the flux, (1 + |contrast dn|^2)^(-q / 2) dn: 2 Perona and Malik, 8 all but cuts.
    :param evened: squared length; before the first round the sampling is evened by so long a bi-Laplacian filter with uniform
        weights. For points that err in all directions, whose triangles would fold; it moves points along the surface.
    """

    contrast: float = 2.0
    sharpness: float = 8.0
    evened: float = 0.0

    def __post_init__(self) -> None:
        positive(self.contrast, "contrast")
        positive(self.sharpness, "sharpness")
        if number(self.evened, "evened") < 0:
            raise InputError(f"evened: a squared length, zero or more, expected, got {self.evened}")


class FacetFlow(Dense):
    """A flow of the contract: normals of triangles diffuse for a time, edges kept; the points are moved to fit them.

    Planes rest, points move along normals alone (but for ``evened``), volume and creases stay; what is smooth is found where the
    normals agree. Flow of normals as [Tasdizen et al. 2002], on the triangles themselves.

    :param surface: in R^3, all coordinates free.
    :raises InputError: for another surface.
    """

    slivers = False

    def __init__(self, surface: Surface, how: Facets | None = None) -> None:
        if not surface.is_free or surface.points.shape[1] != 3:
            raise InputError("facets: normals of triangles are kept where the points of a mesh in R^3 move")
        self.surface, self.how = surface, how or Facets()
        self.connectivity = connect(surface.triangulations, len(surface.points))
        faces = self.connectivity.faces
        self._across = facets.beyond(faces)
        self.step = facets.mean_edge(surface.points, faces)
        self.held = surface.fixed.copy()
        if surface.boundary == "fixed":
            self.held |= self.connectivity.rim

    def rate(self, u: Array, diagonal: int = 0, blend: Blend = RATE, out: Array | None = None) -> Array:
        """The mean rate of a round; with a blend that keeps u, normals flow for its dt and the points follow once."""
        round = blend.dt if blend.keep != 0.0 else ROUND * self.step**2
        way = self._moved(u, round, diagonal == 0) - u
        if blend.keep == 0.0:
            return blend.of_rate(u, way / round, out)
        return blend.of_change(u, way, out)

    def _moved(self, u: Array, dt: float, first: bool) -> Array:
        x = np.ascontiguousarray(u, dtype=np.float64)
        if first and self.how.evened > 0:
            even = umbrella_generator(self.connectivity, self.step, ~self.held, curve=True)
            x = filtered(even, x, self.how.evened, 2)  # what is held stays: its rows are zero
        faces = self.connectivity.faces
        normals, areas = facets.measured(x, faces)
        weights = facets.conductances(x, faces, self._across)
        sweeps = max(1, round(dt / (SWEEP * self.step**2)))
        by = facets.NormalDiffusion(areas, weights, self._across, self.how.contrast, self.how.sharpness)
        normals = facets.spread(normals, by, dt / sweeps, sweeps)
        return facets.followed(x, self.connectivity, normals, self.held, FOLLOWED)

    def area(self, u: Array) -> float:
        """Area of the surface, squared length."""
        return operator.total_area(u, self.connectivity.faces)

    def bound(self, u: Array) -> float:
        """What makes an explicit step one round."""
        return 2.0 / (ROUND * self.step**2)

    def system(self, u: Array, diagonal: int = 0) -> System:
        """None.

        :raises InputError: always: the motion of normals has no matrix.
        """
        raise InputError("facets: normals flow in explicit rounds; leave the stepper out")
