"""Triangles of a flow, with the quantities that do not change."""

from dataclasses import dataclass

import numpy as np

from meshflow.geometry import operator
from meshflow.geometry.connectivity import Connectivity, connect
from meshflow.geometry.validation import Array
from meshflow.surfaces.surface import Surface

__all__ = ["Triangulation", "triangulations_of"]


@dataclass(frozen=True, eq=False)
class Triangulation:
    """A set of triangles and the quantities that do not change.

    :ivar connectivity: which vertices and triangles touch.
    :ivar charts: (m, 3, c), corners in the coordinates that are not free; c is 0 where all are free.
    :ivar forms: (m, 4), the quadratic forms of the charts; None where all are free.
    :ivar flat: (n,), a third of the area of the charts around each vertex.
    """

    connectivity: Connectivity
    charts: Array
    forms: Array | None
    flat: Array

    @classmethod
    def of(cls, faces: tuple[Array, ...], charts: Array, n: int) -> "Triangulation":
        """Join triangulations, (m, 3) each, of n vertices; charts (m, 3, c): corners in the coordinates that are not free."""
        connectivity = connect(faces, n)
        if charts.shape[2] == 0:
            return cls(connectivity, charts, None, np.zeros(n))
        forms = operator.forms(charts)
        third = np.repeat(0.5 * np.sqrt(forms[:, 3]) / 3.0, 3)
        flat = np.bincount(connectivity.faces.ravel(), weights=third, minlength=n)
        return cls(connectivity, charts, forms, flat)

    def chart_gradient(self, cot: Array, linear: bool) -> Array:
        """The length (n,) of the area gradient in the coordinates that are not free.

        :param linear: without the pull of the border.
        """
        if self.forms is None:
            return np.zeros(self.connectivity.size)
        gradient = operator.gather_chart_gradient(self.connectivity, cot, self.charts, linear)
        return np.linalg.norm(gradient, axis=1)


def triangulations_of(surface: Surface) -> tuple[Triangulation, ...]:
    """The triangulations of a surface that alternate; where they do not, one of all its triangles."""
    n = len(surface.points)
    if surface.alternate:
        pairs = zip(surface.triangulations, surface.corners, strict=True)
        return tuple(Triangulation.of((faces,), corners, n) for faces, corners in pairs)
    return (Triangulation.of(surface.triangulations, np.concatenate(surface.corners), n),)
