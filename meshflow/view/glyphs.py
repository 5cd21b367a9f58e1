"""Vector fields before and after as arrows or streamlines."""

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array
from meshflow.io.atomic_write import beside
from meshflow.surfaces.vectors import Vectors
from meshflow.surfaces.volume import steps_of
from meshflow.view.pictures import writable

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["vectors"]

# Arrows along the longer side, inches of a panel, and dots per inch.
_ARROWS, _PANEL, _DPI = 28, 4.2, 90.0
_DENSITY = 1.4


def vectors(
    before: Vectors,
    after: Vectors,
    path: str | Path,
    *,
    drawn: Literal["arrows", "streamlines"] = "arrows",
    overwrite: bool = False,
) -> Path:
    """Draw a vector field before and after smoothing, over its magnitude, in the same colours.

    Rows run downwards, as in a picture, and the second component points downwards with them; of three components the third, out
    of the plane, is part of the magnitude only.

    Example:

        >>> import numpy as np
        >>> from meshflow import Vectors, smooth
        >>> wind = Vectors(np.ones((16, 16, 2)) + 0.2 * np.random.default_rng(0).normal(size=(16, 16, 2)), unit="m/s")
        >>> vectors(wind, smooth(wind), "wind.png").name
        'wind.png'

    :param before: the field, in space its slice in the middle; ``after``: the field after smoothing, of equal size.
    :param path: the picture to write (.png, .jpg, .tif).
    :param drawn: ``arrows``, about 28 along the longer side; or ``streamlines``.
    :param overwrite: replace an existing file.
    :returns: the path.
    :raises InputError: for anything but vector fields of one size, and another word.
    :raises FormatError: for a path that cannot be written, or a file that exists.
    """
    if not isinstance(before, Vectors) or not isinstance(after, Vectors) or before.values.shape != after.values.shape:
        raise InputError("vectors: two fields of one size expected; give Vectors(values) and what smooth made of it")
    if drawn not in ("arrows", "streamlines"):
        raise InputError(f"drawn: arrows or streamlines expected, got {drawn!r}")
    target = writable(path, overwrite=overwrite)
    before, after = _slice(before), _slice(after)
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    h, w = before.missing.shape
    dx, dy = float(np.mean(before.image.spacing[0])), float(before.image.spacing[1])
    tall = _PANEL * min(max(h * dy / (w * dx), 0.25), 4.0)
    figure = Figure(figsize=(2 * _PANEL + 1.2, tall + 0.5), dpi=_DPI, layout="constrained")
    FigureCanvasAgg(figure)
    most = float(np.nanmax(before.magnitude))
    axes = figure.subplots(1, 2)
    for axis, field, title in zip(axes, (before, after), ("before", "after"), strict=True):
        axis.imshow(field.magnitude, cmap="viridis", vmin=0.0, vmax=most, aspect=dy / dx)
        (_arrows if drawn == "arrows" else _streamlines)(axis, field.values, field.missing)
        axis.set(title=title, xticks=[], yticks=[], xlim=(-0.5, w - 0.5), ylim=(h - 0.5, -0.5))
    figure.colorbar(
        axes[0].images[0], ax=axes, shrink=0.8, label=f"magnitude{f', {before.unit}' if before.unit else ''}"
    )
    with beside(target) as draft:
        figure.savefig(draft, format=target.suffix[1:].lower())
    return target


def _slice(field: Vectors) -> Vectors:
    """The slice in the middle of a field in space; a plane one unchanged."""
    if field.missing.ndim == 2:
        return field
    middle = len(field.missing) // 2
    _, dy, dx = steps_of(field.spacing)
    return Vectors(field.values[middle], (dx, dy), field.missing[middle], field.unit)


def _arrows(axis: "Axes", values: Array, missing: Array) -> None:
    """Arrows at every so manieth sample, the longest as long as their distance."""
    h, w = missing.shape
    step = max(1, round(max(h, w) / _ARROWS))
    y, x = np.mgrid[step // 2 : h : step, step // 2 : w : step]
    there = ~missing[y, x]
    u, v = values[y, x, 0][there], values[y, x, 1][there]
    longest = float(np.quantile(np.hypot(u, v), 0.98)) or 1.0
    scale = longest / (1.2 * step)
    axis.quiver(x[there], y[there], u, v, angles="xy", scale_units="xy", scale=scale, color="white", width=0.003)


def _streamlines(axis: "Axes", values: Array, missing: Array) -> None:
    """Streamlines of the first two components."""
    h, w = missing.shape
    u, v = (np.where(missing, np.nan, values[..., i]) for i in (0, 1))
    axis.streamplot(np.arange(w), np.arange(h), u, v, density=_DENSITY, color="white", linewidth=0.7, arrowsize=0.8)
