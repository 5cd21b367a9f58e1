"""The scale bar and the north arrow at the foot of a page."""

from dataclasses import dataclass

import numpy as np

from meshflow.io.files import Document
from meshflow.surfaces.data import Data
from meshflow.view.numbers import plain, rounded

__all__ = ["Ground", "ScaleBar", "ground_of", "scale_bar_of"]

_LONG = 220  # the longest bar, pixels of a page of 1600 x 1200


@dataclass(frozen=True)
class Ground:
    """The unit of lengths, and whether north is up.

    :ivar unit: of horizontal lengths, not of heights; empty: not known.
    :ivar north: whether it is a georeferenced raster with rows from north to south.
    """

    unit: str = ""
    north: bool = False


@dataclass(frozen=True)
class ScaleBar:
    """A bar of a round length, and a north arrow.

    :ivar pixels: length of the bar on the page; 0: no bar, since lengths depend on the place.
    :ivar words: its length, with its unit if known.
    :ivar north: whether it is a map with north up.
    """

    pixels: float = 0.0
    words: str = ""
    north: bool = False


def scale_bar_of(length: float | None, unit: str, page: float, north: bool) -> ScaleBar:
    """The scale bar of a page.

    :param length: of a pixel of the page, in the unit of the surface; None: it depends on the place.
    :param page: pixels of this page per pixel of a page of 1600 x 1200.
    """
    if length is None or not 0 < length < np.inf:
        return ScaleBar(north=north)
    round_one = rounded(length * _LONG * page)
    return ScaleBar(round_one / length, _words(round_one, unit), north)


def ground_of(data: object, surface: Data) -> Ground:
    """The unit of lengths and the direction of north, of data or of its file."""
    own = getattr(surface, "unit", "")
    if not isinstance(data, Document):
        return Ground(own)
    return Ground(data.source.ground_unit or own, data.source.north_up)


def _words(length: float, unit: str) -> str:
    """A round length: 2 km, 500 m, 20 mm."""
    factor, shown = (1e-3, "km") if length >= 1000 else (1e3, "mm") if length < 0.1 else (1.0, "m")
    factor, shown = (factor, shown) if unit == "m" else (1.0, unit)
    return f"{plain(factor * length, digits=1)} {shown}".rstrip()
