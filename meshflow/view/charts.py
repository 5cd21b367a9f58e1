"""The charts of a report: what was removed, the course of a run, the curves of its search; by matplotlib without pyplot."""

from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np

from meshflow.geometry.validation import Array
from meshflow.view.scale import Scale

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["Chart", "Curve", "bar", "blank", "course", "histogram", "png", "risks"]

DPI = 100
INK, FAINT, STRONG, PALE = "#26282b", "#6b7075", "#b2182b", "#b9bfc5"
LETTERS = 9.0
_BINS = 61


@dataclass(frozen=True)
class Chart:
    """A diagram that is not drawn yet.

    :ivar title: above the diagram.
    :ivar words: a description for screen readers.
    :ivar draw: draws it on empty axes.
    """

    title: str
    words: str
    draw: "Callable[[Axes], None]"


@dataclass(frozen=True)
class Curve:
    """An expected error over time.

    :ivar times: growing from zero.
    :ivar values: one per time.
    """

    times: tuple[float, ...]
    values: tuple[float, ...]


def labelled(what: str, unit: str) -> str:
    """A quantity with its unit."""
    return f"{what} [{unit}]" if unit else what


def histogram(values: Array, sigma: float, unit: str) -> Chart:
    """The histogram of what was removed, with the normal curve of the estimated noise.

    :param values: any shape; only finite values count; not all zero.
    :param sigma: of the noise; 0: no curve.
    """
    values = values[np.isfinite(values)].astype(np.float64)
    largest = float(np.abs(values).max())
    least = max(float(np.percentile(np.abs(values), 99.5)), 3.5 * sigma)
    end = least if 0 < least < largest else largest
    counts, edges = np.histogram(values, _BINS, (-end, end))
    density = counts / (len(values) * (edges[1] - edges[0]))

    def draw(axes: "Axes") -> None:
        """Bars of the values, and the curve of normal noise."""
        axes.bar(edges[:-1], density, np.diff(edges), align="edge", color="#8d949b", linewidth=0)
        if sigma > 0:
            x = np.linspace(-end, end, 301)
            curve = np.exp(-0.5 * (x / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi))
            axes.plot(x, curve, color=STRONG, linewidth=1.5, label=f"normal, σ = {sigma:.4g}")
            axes.set_ylim(0, 1.25 * max(float(density.max()), float(curve.max())))  # room for the legend
            _legend(axes, "upper right")
        axes.set_xlim(-end, end)
        axes.set_yticks([])
        axes.set_ylabel("share of the samples", fontsize=LETTERS, color=INK)
        _labelled_below(axes, labelled("removed: before − after", unit))

    words = f"histogram of what was removed, with the normal curve of sigma {sigma:.4g}"
    return Chart("what was removed, how often", words, draw)


def course(
    title: str, lines: dict[str, Array], times: Array, units: tuple[str, str], sigma: tuple[float, str] | None = None
) -> Chart:
    """Numbers over the time of a run.

    A last state with an earlier time, as twicing gives, is the result and is marked separately.

    :param lines: names, and numbers for each of ``times``.
    :param units: of the time and of the numbers.
    :param sigma: a level to compare with, and its name.
    """
    back = len(times) > 1 and times[-1] < times[-2]
    run = slice(None, -1) if back else slice(None)
    colours = (STRONG, FAINT)

    def draw(axes: "Axes") -> None:
        """Lines with a dot at each state, and the level that they are compared with."""
        for colour, (name, numbers) in zip(colours, lines.items(), strict=False):
            mark = "result, by twicing" if name == next(reversed(lines)) else None
            axes.plot(times[run], numbers[run], ".-", color=colour, linewidth=1.2, markersize=4, label=name)
            if back:
                axes.plot(times[-1:], numbers[-1:], "D", color=colour, markersize=5, label=mark)
        if sigma is not None and sigma[0] > 0:
            axes.axhline(sigma[0], color=INK, linewidth=0.9, linestyle=":", label=sigma[1])
        if len(lines) > 1 or back or sigma is not None:
            _legend(axes, "best")
        axes.set_ylabel(labelled(title, units[1]), fontsize=LETTERS, color=INK)
        axes.margins(y=0.08)
        _labelled_below(axes, labelled("time", units[0]))

    return Chart(f"{title} over time", f"{', '.join(lines)} over time, {len(times)} states", draw)


def risks(curves: tuple[Curve, ...], time: float, units: tuple[str, str]) -> Chart:
    """The curves of a search, the chosen one first and emphasized; the axis of time is linear near zero, then logarithmic.

    :param time: the chosen one.
    """
    first = min((curve.times[1] for curve in curves if len(curve.times) > 1), default=1.0)
    end = max(curve.times[-1] for curve in curves)
    top = max(max(curve.values[0] for curve in curves) * 1.25, max(curves[0].values) * 1.05)

    def draw(axes: "Axes") -> None:
        """The curves, the chosen one on top, and its time."""
        for k, curve in enumerate(curves[1:]):
            axes.plot(curve.times, curve.values, color=PALE, linewidth=0.9, label="others tried" if k == 0 else None)
        axes.plot(curves[0].times, curves[0].values, ".-", color=STRONG, linewidth=1.8, markersize=4, label="chosen")
        axes.axvline(time, color=INK, linewidth=0.9, linestyle=":", label=f"time {time:.6g}")
        axes.set_xscale("function", functions=(lambda t: np.log1p(t / first), lambda s: first * np.expm1(s)))
        axes.set_xlim(0, end)
        axes.set_xticks(_ticks(first, end), minor=False)
        axes.set_ylim(0, top if top > 0 else 1.0)
        axes.set_ylabel(labelled("expected rms error", units[1]), fontsize=LETTERS, color=INK)
        _legend(axes, "best")
        _labelled_below(axes, labelled("time", units[0]))

    return Chart("what the search estimated", f"expected errors of {len(curves)} candidates over time", draw)


def bar(axes: "Axes", scale: Scale) -> None:
    """A horizontal colour bar with its numbers, its label, and the reason for its ends."""
    axes.imshow(
        np.linspace(0, 1, 256)[None, :], aspect="auto", cmap=scale.colour_map, extent=(scale.low, scale.high, 0, 1)
    )
    axes.set_yticks([])
    _labelled_below(axes, "\n".join(word for word in (scale.label, scale.ends) if word))


def blank(width: float, height: float) -> "Figure":
    """An empty figure, inches, with its own canvas."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def png(figure: "Figure", sharp: float = 2.0) -> bytes:
    """A figure as the bytes of a PNG with ``sharp`` times its nominal resolution."""
    file = BytesIO()
    figure.savefig(file, format="png", dpi=DPI * sharp)
    return file.getvalue()


def _ticks(first: float, end: float) -> list[float]:
    """Zero and round times (1 or 3 times a power of ten) with enough distance between them."""
    powers = range(int(np.floor(np.log10(first))), int(np.ceil(np.log10(end))) + 1)
    width, ticks = np.log1p(end / first), [0.0]
    for time in (digit * 10.0**power for power in powers for digit in (1, 3)):
        if time <= end and np.log1p(time / first) - np.log1p(ticks[-1] / first) > 0.1 * width:
            ticks.append(time)
    return ticks


def _legend(axes: "Axes", where: Any) -> None:
    axes.legend(loc=where, fontsize=LETTERS - 1.5, frameon=False, labelcolor=INK, handlelength=1.4)


def _labelled_below(axes: "Axes", below: str) -> None:
    """Style the axes: a label below, few small numbers, a pale frame."""
    from matplotlib.ticker import MaxNLocator

    plain = axes.get_xscale() == "linear"
    if plain:
        axes.xaxis.set_major_locator(MaxNLocator(nbins=5, steps=[1, 2, 2.5, 5, 10]))
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:.6g}".replace("-", "−"))
    axes.tick_params(labelsize=LETTERS - 1, colors=INK, length=3)
    axes.set_xlabel(below, fontsize=LETTERS, color=INK, parse_math=False)
    for spine in axes.spines.values():
        spine.set_color(PALE)
