"""What engines on explicit triangles share: coordinates are one array, and memory is not the limit."""

import numpy as np

from meshflow.geometry.validation import Array
from meshflow.surfaces.surface import Surface

__all__ = ["Dense"]


class Dense:
    """The part of the contract that asks for nothing but the coordinates.

    :ivar surface: where the points were.
    """

    surface: Surface

    def start(self) -> Array:
        """Free coordinates (n, k) of the surface as it came."""
        return self.surface.start

    def size(self, *terms: tuple[float, Array], roughly: bool = False) -> tuple[float, float]:
        """The sum of c a over ``terms``, (n, k): root mean square of the vertices, and the greatest length."""
        squares = np.square(sum(c * a for c, a in terms)).sum(axis=1)
        return float(np.sqrt(squares.mean())), float(np.sqrt(squares.max(initial=0.0)))
