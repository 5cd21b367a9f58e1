"""The base of engines on explicit triangles, whose coordinates are one array."""

import numpy as np

from meshflow.geometry.validation import Array
from meshflow.surfaces.surface import Surface

__all__ = ["Dense"]


class Dense:
    """The parts of the contract that need the coordinates only.

    :ivar surface: the surface at the start.
    """

    surface: Surface

    def start(self) -> Array:
        """Free coordinates (n, k) of the surface at the start."""
        return self.surface.start

    def size(self, *terms: tuple[float, Array], roughly: bool = False) -> tuple[float, float]:
        """The sum of c a over ``terms``, (n, k): root mean square over the vertices, and largest length."""
        (c, a), *more = terms
        total = c * a
        for c, a in more:
            total += c * a
        squares = np.einsum("ij,ij->i", total, total)
        return float(np.sqrt(squares.mean())), float(np.sqrt(squares.max(initial=0.0)))
