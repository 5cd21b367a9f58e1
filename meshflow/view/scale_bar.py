"""What tells how large things are, and where north is: a scale bar and an arrow in the foot of a page."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from meshflow.io.files import Document
from meshflow.surfaces.lift import Noun
from meshflow.view.numbers import plain, rounded

__all__ = ["Ground", "Ruler", "grounded", "ruled"]

_LONG = 220  # pixels of a page of 1600 x 1200 that a bar takes at most


@dataclass(frozen=True)
class Ground:
    """What is known of where a thing lies.

    :ivar unit: of lengths on it, not of its heights; empty: not known.
    :ivar north: it is a raster whose file says where on a map it lies, its rows from north to south.
    """

    unit: str = ""
    north: bool = False


@dataclass(frozen=True)
class Ruler:
    """A bar of a round length, and an arrow to the north.

    :ivar pixels: how long the bar is on the page; 0: none, since lengths differ from place to place.
    :ivar words: its length, with its unit where it is known.
    :ivar north: it is a map, north up.
    """

    pixels: float = 0.0
    words: str = ""
    north: bool = False


def ruled(length: float | None, unit: str, page: float, north: bool) -> Ruler:
    """The ruler of a page.

    :param length: of a pixel of the page, in the unit of the surface; None: it has none that holds everywhere.
    :param page: pixels of this page for one of a page of 1600 x 1200.
    """
    if length is None or not 0 < length < np.inf:
        return Ruler(north=north)
    round_one = rounded(length * _LONG * page)
    return Ruler(round_one / length, _words(round_one, unit), north)


def grounded(thing: Any, noun: Noun) -> Ground:
    """The ground of a noun, and of the file that it came from."""
    own = getattr(noun, "unit", "")
    return (
        Ground(thing.source.ground_unit or own, thing.source.north_up) if isinstance(thing, Document) else Ground(own)
    )


def _words(length: float, unit: str) -> str:
    """A round length: 2 km, 500 m, 20 mm."""
    factor, shown = (1e-3, "km") if length >= 1000 else (1e3, "mm") if length < 0.1 else (1.0, "m")
    factor, shown = (factor, shown) if unit == "m" else (1.0, unit)
    return f"{plain(factor * length, digits=1)} {shown}".rstrip()
