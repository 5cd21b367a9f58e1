"""The scale bar and the arrow to the north, in the foot of a page."""

from dataclasses import dataclass

import numpy as np

from meshflow.io.files import Document
from meshflow.surfaces.data import Data
from meshflow.view.numbers import plain, rounded

__all__ = ["Ground", "ScaleBar", "ground_of", "scale_bar_of"]

_LONG = 220  # pixels of a page of 1600 x 1200 that a bar takes at most


@dataclass(frozen=True)
class Ground:
    """The unit of lengths, and whether north is up.

    :ivar unit: of lengths on it, not of its heights; empty: not known.
    :ivar north: it is a raster whose file says where on a map it lies, its rows from north to south.
    """

    unit: str = ""
    north: bool = False


@dataclass(frozen=True)
class ScaleBar:
    """A bar of a round length, and an arrow to the north.

    :ivar pixels: how long the bar is on the page; 0: none, since lengths differ from place to place.
    :ivar words: its length, with its unit where it is known.
    :ivar north: it is a map, north up.
    """

    pixels: float = 0.0
    words: str = ""
    north: bool = False


def scale_bar_of(length: float | None, unit: str, page: float, north: bool) -> ScaleBar:
    """The scale bar of a page.

    :param length: of a pixel of the page, in the unit of the surface; None: it has none that holds everywhere.
    :param page: pixels of this page for one of a page of 1600 x 1200.
    """
    if length is None or not 0 < length < np.inf:
        return ScaleBar(north=north)
    round_one = rounded(length * _LONG * page)
    return ScaleBar(round_one / length, _words(round_one, unit), north)


def ground_of(data: object, surface: Data) -> Ground:
    """The unit of lengths and the direction of north of data, and of the file that it came from."""
    own = getattr(surface, "unit", "")
    if not isinstance(data, Document):
        return Ground(own)
    return Ground(data.source.ground_unit or own, data.source.north_up)


def _words(length: float, unit: str) -> str:
    """A round length: 2 km, 500 m, 20 mm."""
    factor, shown = (1e-3, "km") if length >= 1000 else (1e3, "mm") if length < 0.1 else (1.0, "m")
    factor, shown = (factor, shown) if unit == "m" else (1.0, unit)
    return f"{plain(factor * length, digits=1)} {shown}".rstrip()
