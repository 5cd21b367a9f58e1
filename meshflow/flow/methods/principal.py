"""Mean curvature flow that leaves edges and corners: along the directions in which the surface is bent little."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from meshflow.errors import InputError
from meshflow.flow.blend import RATE, Blend
from meshflow.flow.contract import Flow
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.engines.metric import Given, Measured, Metric
from meshflow.flow.engines.triangulation import Triangulation
from meshflow.flow.family import Mass, Variant
from meshflow.flow.methods.points import PointMethod, PointSetting
from meshflow.flow.wrapper import Around
from meshflow.geometry.curvature import directed
from meshflow.geometry.normals import normals_at
from meshflow.geometry.operator import MassKind, total_area
from meshflow.geometry.options import option
from meshflow.geometry.validation import Array, positive
from meshflow.surfaces.surface import Surface

__all__ = ["AlongCurvature", "Principal", "PrincipalFlow"]


@dataclass(frozen=True)
class AlongCurvature:
    """Neighbours draw each other as div(D grad), D of the principal curvatures and directions (:func:`directed`).

    :param feature_length: 1 / T: what is curved more than its inverse is a feature.
    """

    feature_length: float
    thinnest = 0.0
    keeps_range = False

    def __post_init__(self) -> None:
        positive(self.feature_length, "feature_length")

    def settled(self, surface: Surface, triangulation: Triangulation, mass: MassKind) -> Metric:
        """The same.

        :raises InputError: for a surface that is not in R^3, or whose points do not move.
        """
        if not surface.is_free or surface.alternate or surface.points.shape[1] != 3:
            raise InputError("principal: directions of curvature are measured where the points of a mesh in R^3 move")
        return self

    def measured(self, triangulation: Triangulation, x: Array, sharpness: float) -> Measured:
        """The triangles as they are, and the weights of D."""
        given = Given().measured(triangulation, x, sharpness)
        weights = directed(x, given.connectivity.faces, 1.0 / self.feature_length)
        return Measured(given.connectivity, given.cot, given.area, weights)

    def area(self, triangulation: Triangulation, x: Array, sharpness: float) -> float:
        """That of the triangles."""
        return total_area(x, triangulation.connectivity.faces)


class Principal(Around):
    """dx/dt = n n . div(D grad x), D of the principal curvatures and directions (:func:`directed`): the future work of Desbrun et
    al. 2000, after Meyer et al. 2002, section 6, and Clarenz, Diewald, Rumpf 2000.

    Flat parts lose their noise, an edge and a cylinder lose it along themselves, a corner stays. Meyer et al. multiply the whole
    speed of a vertex by a ratio of the curvatures of its ring, w = k_min / k_H. There the noise of a vertex decides its own
    weight: with noise of 0.03 edges on a cylinder of curvature 2 the ring says k_2 = -3.7 to 1.5 where 0 is true, so that the
    least curvature is that of either direction, or of neither (a corner), and what alternates along the axis is not drawn back:
    the error of the normals grew from 3.9 to 4.6 degrees. The sign of w was right (what is bent to the other side along an edge
    moves outwards): with w held above 0 it stayed at 3.6. So curvatures are measured over two rings here, and choose directions
    instead of speeds: along these the positions diffuse as they are.

    :param surface: in R^3, all coordinates free.
    :param feature_length: 1 / T, a length: what is curved more than its inverse is a feature.
    :raises InputError: for another surface.
    """

    def __init__(self, surface: Surface, variant: Variant | None, feature_length: float) -> None:
        super().__init__(MeshFlow(surface, variant, AlongCurvature(feature_length)))
        self._faces = surface.triangulations[0]

    def rate(self, u: Array, diagonal: int = 0, blend: Blend = RATE, out: Array | None = None) -> Array:
        """du/dt (n, 3), along the normals: what D, as it varies, pushes across the surface is no motion of the shape."""
        rate, normals = self.flow.rate(u, diagonal), normals_at(u, self._faces)
        return blend.of_rate(u, np.einsum("ij,ij->i", rate, normals)[:, None] * normals, out)


@dataclass(frozen=True, kw_only=True)
class PrincipalFlow(PointMethod):
    """Mean curvature flow along the directions in which the surface is bent little (:class:`Principal`)."""

    word: ClassVar[str] = "principal"

    feature_length: float | None = option(
        None, "What is curved more than one over this is a feature and is kept. Default: from the noise.", "length"
    )
    mass: Mass = option("barycentric", "Area of a vertex; with ring, as in the paper, time runs three times slower.")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.feature_length is not None:
            positive(self.feature_length, "feature_length")

    def engine(self, surface: Surface, setting: PointSetting) -> Flow:
        """What moves the points (n, 3) of a surface.

        :raises InputError: for other triangles than the given ones.
        """
        self.must_hold_border(setting)
        if setting.triangles not in ("auto", "given"):
            raise InputError(
                f"triangles={setting.triangles!r}: principal measures directions on the triangles as they are; leave it out"
            )
        return Principal(surface, Variant(mass=self.mass), self.feature_length or 1.0)
