"""Values and their colours."""

from dataclasses import dataclass, replace
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array
from meshflow.view.numbers import brief

if TYPE_CHECKING:
    from matplotlib.colors import Colormap

__all__ = ["Scale", "known_colours", "ranging", "showing", "showing_both", "spread", "symmetric", "together"]

_ENDS = 99.0  # percentile of the absolute value at which colours end, so that outliers do not make the rest pale
# Values of both signs are red above and blue below 0; others have a perceptually uniform map.
_TWO_SIDED, _ONE_SIDED = "RdBu_r", "viridis"
_BENT = 1023  # colours of a bent map, which changes fast near 0; an odd number, so that one is that of 0
_PALE = 0.12  # share of the way to the last colour below which a colour looks like that of 0
_SEEN = 0.25  # the share of the way that typical values then get
_KINDS = ("#eae3d6", "#2b6cb0", "#c2410c", "#7a8088")  # of categories, in order


@dataclass(frozen=True, eq=False)
class Scale:
    """Values and their colours.

    :param values: (h, w) of a grid or (n,) of a mesh, NaN where there is none; or (m,) of triangles.
    :param low: the value of the first colour.
    :param high: the value of the last colour.
    :param colours: the name of a colour map of matplotlib.
    :param what: a description of the values.
    :param unit: its unit; may be empty.
    :param ends: why the colours end where they do, a sentence; may be empty.
    :param names: of categories; the values are then their indices.
    :param of_triangles: whether the values belong to the triangles of a mesh.
    :param bend: colours follow the inverse hyperbolic sine of the values, which is linear up to about this share of the largest,
        so that more colours are near 0. None: they are linear.
    """

    values: Array
    low: float
    high: float
    colours: str
    what: str
    unit: str = ""
    ends: str = ""
    names: tuple[str, ...] = ()
    of_triangles: bool = False
    bend: float | None = None

    @property
    def label(self) -> str:
        """The description with the unit."""
        return f"{self.what} [{self.unit}]" if self.unit else self.what

    @property
    def colour_map(self) -> "Colormap":
        """The colour map for matplotlib and VTK."""
        from matplotlib import colormaps
        from matplotlib.colors import ListedColormap

        if self.names:
            return ListedColormap(_KINDS[: len(self.names)])
        if self.bend is None:
            return colormaps[self.colours]
        # The map is bent, not the values, so that bars, histograms and VTK keep linear axes.
        values = np.linspace(self.low, self.high, _BENT)
        far = max(abs(self.low), abs(self.high))
        bent = np.arcsinh(values / far / self.bend)
        return ListedColormap(colormaps[self.colours]((bent - bent[0]) / (bent[-1] - bent[0])))

    def thinned(self, step: int) -> "Scale":
        """Every ``step``-th value of a grid."""
        return self if step == 1 else replace(self, values=self.values[::step, ::step])

    def wearing(self, colours: str | None) -> "Scale":
        """The scale with other colours; categories keep theirs.

        :raises InputError: for a name that is no colour map's.
        """
        return self if colours is None or self.names else replace(self, colours=known_colours(colours))


def known_colours(name: str) -> str:
    """The name of a colour map, checked.

    :raises InputError: for one that matplotlib does not know; the message names those that are like it.
    """
    from matplotlib import colormaps

    if name not in colormaps:
        like = get_close_matches(name, list(colormaps), 3) or ["viridis", "cividis", "RdBu_r"]
        raise InputError(f"colours: the name of a colour map of matplotlib expected, got {name!r}; {', '.join(like)}?")
    return name


def spread(values: Array) -> tuple[float, float]:
    """The least and the largest finite value, never equal."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    return (low, high) if high > low else (low - 0.5, high + 0.5)


def symmetric(values: Array, what: str, unit: str, idle: str) -> Scale:
    """Values about 0, with colours that end at the 99th percentile of their absolute value.

    :param values: at least one is finite.
    :param idle: the text where all are 0, such as "nothing was removed".
    """
    size = np.abs(values[np.isfinite(values)])
    most, limit = float(size.max()), float(np.percentile(size, _ENDS))
    ends = f"colours end at ±{brief(limit)}, the {_ENDS:.0f}th percentile of the size; largest {brief(most)}"
    if most == 0:
        limit, ends = 1.0, idle
    elif limit == 0:
        limit, ends = most, f"colours end at ±{brief(most)}, the largest: almost {idle}"
    return Scale(values, -limit, limit, _TWO_SIDED, what, unit, ends)


def ranging(values: Array, what: str, unit: str, ends: tuple[float, float] | None = None) -> Scale:
    """Values from the least to the largest, or between given ends."""
    low, high = ends or spread(values)
    return Scale(values, low, high, _ONE_SIDED, what, unit)


def together(one: Scale, other: Scale) -> tuple[Scale, Scale]:
    """Two scales with common colours: neither saturates more than alone; symmetric about 0 if one of them is."""
    low, high = min(one.low, other.low), max(one.high, other.high)
    ends = one.ends if one.high >= other.high else other.ends
    colours = one.colours
    if one.colours != other.colours:  # only one of them has values of both signs
        colours, high = one.colours if one.low < other.low else other.colours, max(-low, high)
        low = -high
    common: dict[str, Any] = {"low": low, "high": high, "ends": ends, "colours": colours}
    return replace(one, **common), replace(other, **common)


def showing_both(one: Scale, other: Scale) -> tuple[Scale, Scale]:
    """Two scales as :func:`together`, bent where typical values of one would look like 0 beside the other.

    For example, the curvature of noise is ten times that of the smoothed surface.
    """
    one, other = together(one, other)
    bend = _bend(one, other)
    if bend is None:
        return one, other
    ends = "; ".join(filter(None, (one.ends, "more colours near 0, so that both are visible")))
    return replace(one, bend=bend, ends=ends), replace(other, bend=bend, ends=ends)


def showing(scale: Scale) -> Scale:
    """A scale symmetric about 0, bent where typical values would look like 0, for example beside a crease."""
    bend = _bend(scale) if scale.low < 0 < scale.high else None
    if bend is None:
        return scale
    return replace(scale, bend=bend, ends="; ".join(filter(None, (scale.ends, "more colours near 0"))))


def _bend(*scales: Scale) -> float | None:
    """The bend with which typical values of each scale are visible; None: none is needed."""
    far = max(abs(scales[0].low), abs(scales[0].high))
    typical = min(float(np.nanmedian(np.abs(scale.values))) for scale in scales) / far
    if not 0 < typical < _PALE:
        return None
    bends = np.geomspace(1e-3, 1.0, 200)
    return float(bends[np.abs(np.arcsinh(typical / bends) / np.arcsinh(1 / bends) - _SEEN).argmin()])
