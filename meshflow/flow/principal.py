"""Mean curvature flow that leaves edges and corners: weighted by the principal curvatures."""

import numpy as np

from meshflow.flow.contract import Flow
from meshflow.flow.slowed import Scaled
from meshflow.geometry.curvature import anisotropy, curvatures
from meshflow.geometry.gates import Array, positive

__all__ = ["Principal"]


class Principal(Scaled):
    """du/dt = w rate(u), w of :func:`anisotropy` at u: the future work of Desbrun et al. 2000 as Meyer et al. 2002 did it.

    Flat parts lose their noise, an edge moves by the curvature along it alone, a corner stays; a cylinder all but keeps its
    radius. One threshold says what is noise and what a feature: spikes beyond it stay, noise on what is bent more than that
    does not fall, and below it everything shrinks as by curvature. Facets do better on most data.

    :param flow: mean curvature flow in R^3.
    :param faces: (m, 3).
    :param contrast: 1 / T, a length: what is curved more than its inverse is a feature.
    """

    def __init__(self, flow: Flow, faces: Array, contrast: float) -> None:
        super().__init__(flow)
        self.faces, self.threshold = faces, 1.0 / positive(contrast, "contrast")

    def factor(self, u: Array) -> Array:
        """w (n, 1)."""
        return anisotropy(curvatures(np.ascontiguousarray(u), self.faces), self.threshold)[:, None]
