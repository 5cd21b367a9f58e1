"""The page of a picture: panels, labels and the colour scale, laid out in whole pixels by matplotlib (Agg, no pyplot)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from meshflow.geometry.validation import Array
from meshflow.view.look import Look
from meshflow.view.numbers import brief, plain
from meshflow.view.scale import Scale
from meshflow.view.scale_bar import ScaleBar

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["Box", "Foot", "Layout", "compared_page", "layout", "pixels", "single_page"]

_DPI = 100.0
_INK = "#26282b"
_FAINT = "#6b7075"
_PEAK = 0.25  # share of the values in one bin above which the histogram is logarithmic; a normal one has 0.035
_NONE = 0.7  # the start of a logarithmic axis of counts, so that a count of one is visible


@dataclass(frozen=True)
class Box:
    """A rectangle of the page in pixels, from its lower left corner."""

    left: int
    bottom: int
    width: int
    height: int

    @property
    def size(self) -> tuple[int, int]:
        """Width and height."""
        return self.width, self.height


@dataclass(frozen=True)
class Foot:
    """The foot of a page: a line of text, and the scale bar at its right."""

    words: str
    scale_bar: ScaleBar = ScaleBar()


@dataclass(frozen=True)
class Layout:
    """The layout of a page.

    :param panels: before, after, removed; or a single one.
    :param scale: colour bar and histogram.
    :param unit: the size of a pixel of a page of 1600 x 1200, which scales all lengths and letters.
    :param header: pixels above the panels' labels, for the title.
    :param title: at the top.
    """

    page: tuple[int, int]
    panels: tuple[Box, ...]
    scale: Box
    unit: float
    header: int
    title: str = ""


def layout(look: Look, aspect: float, panels: int = 3, labelled: bool = False, scaled: bool = True) -> Layout:
    """The layout for panels of an aspect (width over height).

    Three panels are arranged as before | after over removed | scale, or in one row over the scale if they are larger then. One or
    two panels are placed above the scale.

    :param labelled: a single panel has a label; several always have.
    :param scaled: leave room for a scale below a single panel; below several there always is.
    """
    width, height = look.size
    unit = min(width / 1600, height / 1200)
    gap, label, header, footer = (round(v * unit) for v in (20, 38, 62 if look.title else 14, 44))
    if panels == 1:
        strip = round(120 * unit) * scaled
        above = header + label * labelled
        box = Box(gap, footer + strip, width - 2 * gap, height - above - footer - strip)
        return Layout(look.size, (box,), Box(gap, footer, width - 2 * gap, strip), unit, header, look.title)
    strip = round(300 * unit)
    w, h = (width - 3 * gap) // 2, (height - header - footer - 2 * label - gap) // 2
    narrow, tall = (width - (panels + 1) * gap) // panels, height - header - footer - label - strip - gap
    if panels == 3 and 1.1 * min(h, w / aspect) >= min(tall, narrow / aspect):
        low, high, right = footer, footer + h + label + gap, 2 * gap + w
        return Layout(
            look.size,
            (Box(gap, high, w, h), Box(right, high, w, h), Box(gap, low, w, h)),
            Box(right, low, w, h),
            unit,
            header,
            look.title,
        )
    tall = min(tall, round(narrow / aspect))
    foot = height - header - label - tall
    row = tuple(Box(gap + k * (narrow + gap), foot, narrow, tall) for k in range(panels))
    return Layout(
        look.size, row, Box(width // 5, footer, width * 3 // 5, foot - footer - gap), unit, header, look.title
    )


def compared_page(
    arrangement: Layout,
    panels: Sequence[tuple[str, Array]],
    counted: Sequence[tuple[str, Scale]],
    foot: Foot,
    pixel: float = 1.0,
) -> "Figure":
    """Panels side by side, with the colour scale.

    :param panels: labels, and pictures (h, w, 3) in uint8, of any size.
    :param counted: names and scales whose values the histogram shows; the colours are those of the last.
    :param foot: the line at the bottom.
    :param pixel: height over width of a pixel.
    """
    figure = _blank(arrangement, foot)
    for box, (label, picture) in zip(arrangement.panels, panels, strict=True):
        _panel(figure, arrangement, box, picture, label, pixel)
    _histogram(figure, arrangement, counted)
    return figure


def single_page(
    arrangement: Layout,
    picture: Array,
    scale: Scale | None,
    foot: Foot,
    pixel: float = 1.0,
    labels: tuple[tuple[float, str], ...] = (),
) -> "Figure":
    """One picture, with a colour scale where its colours show values.

    :param picture: (h, w, 3) in uint8, of any size.
    :param foot: the line at the bottom.
    :param pixel: height over width of a pixel of the picture.
    :param labels: above the picture, each with its position, a share of the width.
    """
    figure = _blank(arrangement, foot)
    box, unit = arrangement.panels[0], arrangement.unit
    _panel(figure, arrangement, box, picture, "", pixel)
    for share, label in labels:
        _label(figure, arrangement, box, share, label)
    if scale is not None:
        box = arrangement.scale
        bar = Box(box.left + box.width // 4, box.bottom + round(84 * unit), box.width // 2, round(20 * unit))
        axes = _axes(figure, arrangement, bar)
        _bar(axes, arrangement, scale)
        _ends(axes, arrangement, scale, bar.height)
    return figure


def pixels(figure: "Figure") -> Array:
    """A page as a picture (height, width, 3) in uint8."""
    canvas: Any = figure.canvas
    canvas.draw()
    return np.array(canvas.buffer_rgba())[..., :3]


def _blank(arrangement: Layout, foot: Foot) -> "Figure":
    """An empty page with its title and its foot."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    width, height = arrangement.page
    figure = Figure(figsize=(width / _DPI, height / _DPI), dpi=_DPI, facecolor="white")
    FigureCanvasAgg(figure)
    unit = arrangement.unit
    if arrangement.title:
        figure.text(
            0.5,
            1 - arrangement.header / 2 / height,
            arrangement.title,
            ha="center",
            va="center",
            color=_INK,
            fontsize=_letters(unit, 30),
            parse_math=False,
        )
    figure.text(
        20 * unit / width,
        20 * unit / height,
        foot.words,
        ha="left",
        va="center",
        color=_FAINT,
        fontsize=_letters(unit, 18),
        parse_math=False,
    )
    _draw_scale_bar(figure, arrangement, foot.scale_bar)
    return figure


def _draw_scale_bar(figure: "Figure", arrangement: Layout, scale_bar: ScaleBar) -> None:
    """The scale bar in the lower right corner, with its length and the north arrow to its left."""
    from matplotlib.lines import Line2D

    (width, height), unit = arrangement.page, arrangement.unit
    right, middle, size = width - 20 * unit, 20 * unit / height, _letters(unit, 18)
    words = scale_bar.words if scale_bar.pixels else ""
    if scale_bar.pixels:
        left, tick = right - scale_bar.pixels, 6 * unit
        across = [left, left, left, right, right, right]
        down = [20 * unit + tick, 20 * unit - tick, 20 * unit, 20 * unit, 20 * unit - tick, 20 * unit + tick]
        places = [x / width for x in across], [y / height for y in down]
        figure.add_artist(Line2D(*places, color=_INK, linewidth=_points(unit, 2.5), solid_joinstyle="miter"))
        right = left - 12 * unit
    text = "       ".join(word for word in ("N ↑" if scale_bar.north else "", words) if word)
    if text:
        figure.text(right / width, middle, text, ha="right", va="center", color=_INK, fontsize=size, parse_math=False)


def _letters(unit: float, pixels: float) -> float:
    """A size of letters in points, from pixels of a page of 1600 x 1200; never too small to read."""
    return max(_points(unit, pixels), 5.0)


def _points(unit: float, pixels: float) -> float:
    """A length in points, from pixels of a page of 1600 x 1200."""
    return pixels * unit * 72 / _DPI


def _axes(figure: "Figure", arrangement: Layout, box: Box) -> "Axes":
    """Axes that cover a box."""
    width, height = arrangement.page
    return figure.add_axes((box.left / width, box.bottom / height, box.width / width, box.height / height))


def _panel(figure: "Figure", arrangement: Layout, box: Box, picture: Array, label: str, pixel: float) -> None:
    """A picture in a box, its label above it."""
    axes = _axes(figure, arrangement, box)
    axes.imshow(picture, aspect=pixel, interpolation="antialiased")
    axes.set_axis_off()
    _label(figure, arrangement, box, 0.5, label)


def _label(figure: "Figure", arrangement: Layout, box: Box, share: float, label: str) -> None:
    """A label above a box, at a share of its width."""
    width, height = arrangement.page
    figure.text(
        (box.left + share * box.width) / width,
        (box.bottom + box.height + 18 * arrangement.unit) / height,
        label,
        ha="center",
        va="center",
        color=_INK,
        fontsize=_letters(arrangement.unit, 25),
    )


def _histogram(figure: "Figure", arrangement: Layout, counted: Sequence[tuple[str, Scale]]) -> None:
    """The histogram of the values above the colour bar, which is its axis; of two, the first is a line."""
    scale = counted[-1][1]
    box, unit = arrangement.scale, arrangement.unit
    left, width = box.left + round(0.1 * box.width), round(0.8 * box.width)
    foot, bar = round(108 * unit), round(20 * unit)
    tall = min(box.height - foot - bar - round(66 * unit), round(260 * unit))
    axes = _axes(figure, arrangement, Box(left, box.bottom + foot + bar, width, tall))
    words, top, peaked = [], 1, False
    for k, (name, part) in enumerate(counted):
        values = part.values[np.isfinite(part.values)].astype(np.float64)
        counts, edges = np.histogram(values, bins=61, range=(scale.low, scale.high))
        if k < len(counted) - 1:
            axes.stairs(counts, edges, baseline=None, color="#b2182b", linewidth=_points(unit, 2), zorder=3)
        else:
            axes.bar(edges[:-1], counts, width=np.diff(edges), align="edge", color="#8d949b", linewidth=0)
        peaked = peaked or (not scale.names and counts.max() > _PEAK * counts.sum())
        top = max(top, int(counts.max()))
        words.append(f"{name}: {_statistics(values, part.unit)}" if name else _statistics(values, part.unit))
    axes.set_xlim(scale.low, scale.high)
    axes.set_ylim(0, top * 1.04)
    if peaked:  # with linear counts only one bin would be visible
        axes.set_yscale("log")
        axes.set_ylim(_NONE, top**1.04)
        _beside(axes, arrangement, "counts, logarithmic")
    axes.set_axis_off()
    axes.text(
        0.5,
        1 + 24 * unit / tall,
        "\n".join(words),
        transform=axes.transAxes,
        ha="center",
        va="bottom",
        color=_INK,
        fontsize=_letters(unit, 20),
        parse_math=False,
    )
    bar_axes = _axes(figure, arrangement, Box(left, box.bottom + foot, width, bar))
    _bar(bar_axes, arrangement, scale)
    _ends(bar_axes, arrangement, scale, bar)


def _beside(axes: "Axes", arrangement: Layout, words: str) -> None:
    """A label along the left side of a diagram."""
    axes.text(
        -0.02,
        0.5,
        words,
        ha="center",
        va="center",
        rotation="vertical",
        transform=axes.transAxes,
        fontsize=_letters(arrangement.unit, 18),
        color=_FAINT,
    )


def _ends(axes: "Axes", arrangement: Layout, scale: Scale, bar: int) -> None:
    """The reason for the ends of a colour bar, below its label."""
    axes.text(
        0.5,
        -88 * arrangement.unit / bar,
        scale.ends,
        ha="center",
        va="center",
        transform=axes.transAxes,
        fontsize=_letters(arrangement.unit, 18),
        color=_FAINT,
    )


def _statistics(values: Array, unit: str) -> str:
    """Rms, mean and largest as text; the mean has the decimals of the rms."""
    rms, most = float(np.sqrt(np.mean(values**2))), float(np.abs(values).max())
    mean = plain(float(values.mean()), largest=rms)
    numbers = {"rms": brief(rms), "mean": mean if mean.strip("−0.") else "0", "largest": brief(most)}
    suffix = f" {unit}" if unit else ""
    return ",   ".join(f"{name} {number}{suffix}" for name, number in numbers.items())


def _bar(axes: "Axes", arrangement: Layout, scale: Scale) -> None:
    """A horizontal colour bar with numbers and its label below."""
    from matplotlib.ticker import MaxNLocator

    ramp = np.linspace(0, 1, 256)[None, :]
    axes.imshow(ramp, aspect="auto", cmap=scale.colour_map, extent=(scale.low, scale.high, 0, 1))
    axes.set_yticks([])
    if scale.names:
        axes.set_xticks(range(len(scale.names)), scale.names)
    else:
        axes.xaxis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 2.5, 5, 10]))
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}".replace("-", "−"))
    axes.tick_params(
        axis="x",
        labelsize=_letters(arrangement.unit, 18),
        colors=_INK,
        length=_points(arrangement.unit, 5),
        pad=_points(arrangement.unit, 5),
    )
    axes.set_xlabel(
        scale.label,
        fontsize=_letters(arrangement.unit, 20),
        color=_INK,
        parse_math=False,
        labelpad=_points(arrangement.unit, 4),
    )
    for spine in axes.spines.values():
        spine.set_color(_FAINT)
