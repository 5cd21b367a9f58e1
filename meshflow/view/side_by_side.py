"""Results of several methods side by side, with what each removed, and a table of their numbers."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import numpy as np

from meshflow.geometry.validation import Array
from meshflow.io.atomic_write import beside
from meshflow.view.look import OF_PAIRS, Look, Looks, RendererName, looking
from meshflow.view.pictures import Pictured, writable
from meshflow.view.scene import of_one, of_two

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Column", "side_by_side"]

_INK, _FAINT = "#26282b", "#6b7075"
_DPI, _WIDE, _GAP, _LABEL, _LINE = 100.0, 16.0, 0.15, 0.5, 0.26
# Columns of panels at most, and pixels of a panel.
_COLUMNS, _PIXELS = 5, 640


@dataclass(frozen=True, eq=False)
class Column:
    """A result.

    :ivar name: above it; ``note``: below the name.
    :ivar after: the data, of the kind of that before.
    :ivar numbers: by name, for the table.
    """

    name: str
    note: str
    after: object
    numbers: dict[str, str]


def side_by_side(
    before: object,
    columns: Sequence[Column],
    path: str | Path,
    *,
    overwrite: bool = False,
    **look: Unpack[Looks],
) -> Pictured:
    """Draw data before and after each of several methods in the same light, what each removed, and a table.

    What was removed is in the colours of :func:`meshflow.view.compare`: symmetric about 0, to the 99th percentile of its absolute
    value, for each method its own.

    :param before: as in :func:`meshflow.view.compare`.
    :param path: the picture to write (.png, .jpg, .tif).
    :param overwrite: replace an existing file.
    :param look: the options of :class:`meshflow.view.Look` by name, except those for two surfaces.
    :raises InputError: for no column, or data that cannot be drawn.
    :raises FormatError: for a path that cannot be written.
    """
    target, seen = writable(path, overwrite=overwrite), looking(OF_PAIRS, **look)
    figure, renderer, notes = _drawn(before, columns, seen)
    with beside(target) as draft:
        figure.savefig(draft, format=target.suffix[1:].lower(), dpi=_DPI)
    return Pictured(target, renderer, notes)


def _drawn(before: object, columns: Sequence[Column], look: Look) -> "tuple[Figure, RendererName, tuple[str, ...]]":
    """The page, by which renderer, and its notes."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    first = of_one(before, look, None)
    size = _PIXELS, max(1, round(_PIXELS / first.aspect))
    panels: list[tuple[str, str, Array, Array | None]] = [("before", "", first.picture(0, size), None)]
    for one in columns:
        scene = of_two(before, one.after, look, "removed", False)
        panels.append((one.name, one.note, scene.picture(1, size), scene.picture(2, size)))
    rows = -(-len(panels) // _COLUMNS)
    across = -(-len(panels) // rows)
    wide = (_WIDE - _GAP * (across + 1)) / across
    tall = min(wide / first.aspect, 1.4 * wide)
    block, head = _LABEL + 2 * (tall + _GAP), 0.55 if look.title else 0.1
    height = head + rows * block + _LINE * (len(columns) + 2.5)
    figure = Figure(figsize=(_WIDE, height), dpi=_DPI, facecolor="white")
    FigureCanvasAgg(figure)
    if look.title:
        figure.text(0.5, 1 - head / 2 / height, look.title, ha="center", va="center", fontsize=16, color=_INK)
    for i, (name, note, picture, removed) in enumerate(panels):
        row, column = divmod(i, across)
        x, y = _GAP + column * (wide + _GAP), height - head - row * block - _LABEL
        figure.text(x / _WIDE, (y + 0.27) / height, name, fontsize=12.5, weight="bold", color=_INK)
        figure.text(x / _WIDE, (y + 0.08) / height, note, fontsize=9.5, color=_FAINT)
        for k, pixels in enumerate((picture, removed)):
            if pixels is not None:
                place = x / _WIDE, (y - (k + 1) * tall - k * _GAP) / height, wide / _WIDE, tall / height
                axes = figure.add_axes(place)
                axes.imshow(pixels, aspect="auto", interpolation="antialiased")
                axes.set_axis_off()
    _table(figure, columns, height)
    return figure, first.renderer.name, first.notes


def _table(figure: "Figure", columns: Sequence[Column], height: float) -> None:
    """The numbers of all columns, one line each, at the foot."""
    heads = list(dict.fromkeys(name for one in columns for name in one.numbers))
    x = np.linspace(0.22, 0.95, len(heads)) if len(heads) > 1 else np.array([0.3])
    y = (_LINE * (len(columns) + 1.3)) / height
    for place, head in zip(x, heads, strict=True):
        figure.text(place, y, head, fontsize=10.5, color=_FAINT, ha="right")
    for row, one in enumerate(columns):
        y = (_LINE * (len(columns) - row + 0.2)) / height
        figure.text(_GAP / _WIDE, y, one.name, fontsize=10.5, color=_INK)
        for place, head in zip(x, heads, strict=True):
            figure.text(place, y, one.numbers.get(head, ""), fontsize=10.5, color=_INK, ha="right")
