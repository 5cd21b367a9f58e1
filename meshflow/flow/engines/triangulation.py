"""Triangles of a flow, with the quantities that do not change."""

from dataclasses import dataclass, replace

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
    :ivar share: (n,), flat over the area by which the vertex counts in a mean; None: 1, they are the same.
    """

    connectivity: Connectivity
    charts: Array
    forms: Array | None
    flat: Array
    share: Array | None = None

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


def triangulations_of(surface: Surface, conserves: bool = False) -> tuple[Triangulation, ...]:
    """The triangulations of a surface that alternate; where they do not, one of all its triangles.

    :param conserves: count each vertex by its mean area in all of them, but by at least 3/4 of its largest one, so that all
        conserve the same mean; no rate is then more than 4/3 as fast, and explicit steps stay stable.
    """
    n = len(surface.points)
    if surface.alternate:
        pairs = zip(surface.triangulations, surface.corners, strict=True)
        found = [Triangulation.of((faces,), corners, n) for faces, corners in pairs]
        if not conserves:
            return tuple(found)
        flats = [t.flat for t in found]
        area = np.maximum(np.mean(flats, axis=0), 0.75 * np.max(flats, axis=0))
        return tuple(replace(t, share=np.divide(t.flat, area, out=np.ones_like(area), where=area > 0)) for t in found)
    return (Triangulation.of(surface.triangulations, np.concatenate(surface.corners), n),)
