"""What engines on explicit triangles share: coordinates are one array, and memory is not the limit."""

from collections.abc import Sequence

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

    def spare(self) -> Array:
        """An array (n, k) to write to."""
        return np.empty(self.surface.start.shape)

    def done(self, array: Array) -> None:
        """Nothing: the memory of a mesh is not the limit."""

    def _changed(
        self,
        u: Array,
        change: Array,
        toward: Sequence[tuple[float, Array]],
        drift: tuple[float, Array] | None,
        out: Array | None,
    ) -> Array:
        """u + change (n, k), which is written over, + the sum of c (a - u) over ``toward`` + c a of ``drift``, into ``out``."""
        for c, a in toward:
            change += c * (a - u)
        if drift is not None:
            change += drift[0] * drift[1]
        return np.add(u, change, out=change if out is None else out)
