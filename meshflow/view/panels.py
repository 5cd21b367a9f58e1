"""The picture of a comparison of flows: each surface from its camera, and a close-up of a silhouette."""

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, Unpack

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array
from meshflow.io.atomic_write import beside
from meshflow.view.look import Look, Looks, looking
from meshflow.view.pictures import Pictured, writable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["Seen", "flows"]

_STONE, _GROUND, _INK, _FAINT = np.array([0.92, 0.89, 0.84]), "#ccd6e0", "#26282b", "#6b7075"
_TRUE, _MOVED = "#1f78b4", "#b2182b"
_DPI, _WIDE = 100.0, 16.0
# Columns of panels; inches for their labels; share of the image in the close-up.
_COLUMNS, _LABEL, _CLOSE = 3, 0.55, 0.16
_AMBIENT = 0.15
_ALTITUDE = 40.0
# Options of a look that do not apply here.
_NO_LIGHT = tuple(field.name for field in fields(Look) if field.name not in ("title", "azimuth", "altitude"))


class Seen(Protocol):
    """A surface as seen by its camera."""

    @property
    def label(self) -> str:
        """Its name."""
        ...

    @property
    def note(self) -> str:
        """Its numbers."""
        ...

    @property
    def pixels(self) -> Array:
        """(n, 2), column and row at which each vertex is seen."""
        ...

    @property
    def depth(self) -> Array:
        """(n,), of each vertex."""
        ...

    @property
    def points(self) -> Array:
        """(n, 3)."""
        ...

    @property
    def faces(self) -> Array:
        """(m, 3)."""
        ...

    @property
    def rim(self) -> Array:
        """(k, 2), edges with a triangle on one side only."""
        ...


def flows(
    panels: Sequence[Seen],
    path: str | Path,
    *,
    close_up: tuple[float, float] | None = None,
    overwrite: bool = False,
    **look: Unpack[Looks],
) -> Pictured:
    """Draw surfaces side by side, flat shaded in the same light, and below each a close-up of the same place.

    The close-up shows the rim of each surface in red, and the rim before smoothing in blue.

    Example:

        >>> from meshflow import Pinhole
        >>> from meshflow.evaluate import compare_flows
        >>> from meshflow.synthetic import depth_scene
        >>> camera = Pinhole(fx=50.0, fy=50.0, cx=26.5, cy=19.5)
        >>> compared = compare_flows(depth_scene(camera, (40, 54)).noisy, camera, time=1.0)
        >>> flows(compared.panels(), "flows.png").path.name
        'flows.png'

    :param panels: those of :meth:`meshflow.evaluate.FlowComparison.panels`, the first one before smoothing.
    :param path: the picture to write (.png, .jpg, .tif).
    :param close_up: column and row of its centre; by default where the rims moved most.
    :param overwrite: replace an existing file.
    :param look: ``title``, ``azimuth`` and ``altitude`` of :class:`meshflow.view.Look`; by default a light 40 degrees high.
    :raises InputError: for no panel, or one without a triangle.
    :raises FormatError: for a path that cannot be written, an extension that is no picture's, or a file that exists and must not
        be replaced.
    """
    target = writable(path, overwrite=overwrite)
    if len(panels) == 0 or any(len(panel.faces) == 0 for panel in panels):
        raise InputError("flows: panels with at least one triangle each expected; take those of compare_flows(...)")
    light = looking(_NO_LIGHT, **{"altitude": _ALTITUDE, **look})
    figure = _drawn(panels, light, _window(panels, close_up))
    with beside(target) as draft:
        figure.savefig(draft, format=target.suffix[1:].lower(), dpi=_DPI)
    return Pictured(target, "hillshade")


def _window(panels: Sequence[Seen], at: tuple[float, float] | None) -> tuple[float, float, float, float]:
    """Left, right, bottom and top of the close-up, pixels."""
    first = panels[0]
    used = np.unique(first.faces)
    low, high = first.pixels[used].min(axis=0), first.pixels[used].max(axis=0)
    half = np.maximum(high - low, 1.0) * _CLOSE / 2
    if at is None:
        at = tuple(_busiest(panels, low + half, high - half, half))
    left, top = np.asarray(at) - half
    right, bottom = np.asarray(at) + half
    return float(left), float(right), float(bottom), float(top)


def _busiest(panels: Sequence[Seen], low: Array, high: Array, half: Array) -> Array:
    """The centre of the window, between low and high, in which the rims moved most."""
    first = panels[0]
    rim = np.unique(first.rim)
    places = first.pixels[rim]
    alike = [panel for panel in panels if panel.pixels.shape == first.pixels.shape and panel.faces is first.faces]
    moved = sum(np.hypot(*(panel.pixels[rim] - places).T).clip(0, 3) for panel in alike)
    inside = ((places >= low) & (places <= high)).all(axis=1)
    if not inside.any():
        return (low + high) / 2
    # At most a few hundred places, so that the sums over their windows stay small.
    candidates = places[inside][:: max(1, int(inside.sum()) // 400)]
    near = (np.abs(candidates[:, None] - places[None]) <= half).all(axis=2)
    return candidates[(near @ np.asarray(moved, dtype=np.float64)).argmax()]


def _drawn(panels: Sequence[Seen], look: Look, window: tuple[float, float, float, float]) -> "Figure":
    """The page."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    used = panels[0].pixels[np.unique(panels[0].faces)]
    (left, top), (right, bottom) = used.min(axis=0) - 0.5, used.max(axis=0) + 0.5
    gap, head, foot = 0.2, 0.6 if look.title else 0.15, 0.45
    wide = (_WIDE - gap * (_COLUMNS + 1)) / _COLUMNS
    tall = min(wide * (bottom - top) / (right - left), 1.2 * wide)
    rows = -(-len(panels) // _COLUMNS)
    block = 2 * tall + _LABEL + gap
    height = head + rows * (block + 0.1) + foot
    figure = Figure(figsize=(_WIDE, height), dpi=_DPI, facecolor="white")
    FigureCanvasAgg(figure)
    if look.title:
        figure.text(0.5, 1 - head / 2 / height, look.title, ha="center", va="center", fontsize=17, color=_INK)
    for i, panel in enumerate(panels):
        row, column = divmod(i, _COLUMNS)
        x, y = gap + column * (wide + gap), height - head - row * (block + 0.1) - _LABEL - tall
        figure.text(x / _WIDE, (y + tall + 0.33) / height, panel.label, fontsize=14, weight="bold", color=_INK)
        figure.text(x / _WIDE, (y + tall + 0.1) / height, panel.note, fontsize=11, color=_FAINT)
        boxes = [(x, y, wide, tall), (x, y - tall - 0.08, wide, tall)]
        whole, close = (
            figure.add_axes((a / _WIDE, b / height, c / _WIDE, d / height), facecolor=_GROUND) for a, b, c, d in boxes
        )
        _surface(whole, panel, look, (left, right, bottom, top))
        _surface(close, panel, look, window)
        _frame(whole, window)
        _rims(close, panels[0], panel, window)
    figure.text(
        gap / _WIDE,
        foot / 2 / height,
        "close-up: the rim of each surface in red, before smoothing in blue; grey blue: no surface",
        fontsize=11,
        color=_FAINT,
        va="center",
    )
    return figure


def _surface(axes: "Axes", panel: Seen, look: Look, window: tuple[float, float, float, float]) -> None:
    """The triangles in a window, the farthest first, flat shaded."""
    from matplotlib.collections import PolyCollection

    left, right, bottom, top = window
    corners = panel.pixels[panel.faces]
    low, high = corners.min(axis=1), corners.max(axis=1)
    inside = (high[:, 0] >= left) & (low[:, 0] <= right) & (high[:, 1] >= top) & (low[:, 1] <= bottom)
    faces = panel.faces[inside]
    corners, order = corners[inside], np.argsort(-panel.depth[faces].mean(axis=1), kind="stable")
    colours = _shades(panel.points[faces], corners, look)
    axes.add_collection(
        PolyCollection(
            list(corners[order]), facecolors=colours[order], edgecolors=colours[order], linewidths=0.3, antialiased=True
        )
    )
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)
    axes.set_aspect("auto")
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_color(_FAINT)


def _shades(corners: Array, seen: Array, look: Look) -> Array:
    """Colours (m, 3) of triangles (m, 3, 3) in the light of the look, the same for both sides."""
    a, b, c = np.moveaxis(corners, 1, 0)
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)
    one, two = seen[:, 1] - seen[:, 0], seen[:, 2] - seen[:, 0]
    # A triangle that is clockwise in the picture (rows downwards) shows its back.
    normals *= -np.sign(one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0])[:, None]
    east, north, up = look.light
    light = np.clip(normals @ np.array([east, -north, -up]), 0.0, 1.0)
    bright = _AMBIENT + (1 - _AMBIENT) * light
    return bright[:, None] * _STONE


def _frame(axes: "Axes", window: tuple[float, float, float, float]) -> None:
    """The frame of the close-up."""
    left, right, bottom, top = window
    axes.plot([left, right, right, left, left], [top, top, bottom, bottom, top], color=_MOVED, linewidth=1.2)


def _rims(axes: "Axes", before: Seen, panel: Seen, window: tuple[float, float, float, float]) -> None:
    """The rim of a surface over the rim before smoothing."""
    from matplotlib.collections import LineCollection

    wide = abs(window[1] - window[0])
    for shown, colour, width in ((before, _TRUE, 2.6), (panel, _MOVED, 1.2)):
        ends = shown.pixels[shown.rim]
        short = (np.abs(ends[:, 0] - ends[:, 1]) < wide).all(axis=1)
        axes.add_collection(LineCollection(list(ends[short]), colors=colour, linewidths=width, zorder=3))
