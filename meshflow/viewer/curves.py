"""Curves of a flow over time, as a small drawing for pages and windows."""

import base64
from dataclasses import dataclass
from html import escape

import numpy as np

from meshflow.geometry.validation import Array
from meshflow.view.numbers import plain
from meshflow.viewer.timeline import Timeline

__all__ = ["Curve", "across", "curves", "curves_as_picture", "measures", "summary"]

_WIDE, _HIGH, _EDGE = 320, 150, 8
_AREA, _REMOVED = "#2b6cb0", "#c2410c"


@dataclass(frozen=True, eq=False)
class Curve:
    """A quantity of each state.

    :ivar shares: of its largest value, 0 to 1, one per state.
    :ivar colour: ``#rrggbb``.
    :ivar words: its name and range.
    """

    shares: Array
    colour: str
    words: str


def summary(timeline: Timeline, index: int) -> str:
    """A state as text: its time, area, and what was removed."""
    measurement = timeline.history[index]
    unit = f" {timeline.unit}" if timeline.unit else ""
    words = [
        f"time {plain(measurement.time, timeline.history[-1].time, 4)}{unit}",
        f"area {100 * measurement.area:.4g} %",
        f"removed rms {measurement.change:.3g} {getattr(timeline.at(0), 'unit', '')}".rstrip(),
    ]
    return ", ".join(
        words + ([f"{measurement.residual:.3g} of the noise"] if np.isfinite(measurement.residual) else [])
    )


def across(timeline: Timeline) -> Array:
    """The position of each state on the axis of time, 0 to 1: the square root of time, so that states are evenly spaced."""
    times = np.sqrt([measurement.time for measurement in timeline.history])
    return times / (times[-1] or 1.0)


def measures(timeline: Timeline) -> tuple[Curve, Curve]:
    """The curves of the area, and of the rms of what was removed."""
    history, last = timeline.history, timeline.history[-1]
    removed = f"{last.residual:.3g} of the noise" if np.isfinite(last.residual) else f"rms {last.change:.3g}"
    drawn = (
        ([measurement.area for measurement in history], _AREA, f"area, 100 to {100 * last.area:.3g} %"),
        ([measurement.change for measurement in history], _REMOVED, f"removed, 0 to {removed}"),
    )
    one, other = (Curve(np.asarray(values) / (max(values) or 1.0), hue, words) for values, hue, words in drawn)
    return one, other


def curves_as_picture(timeline: Timeline, index: int) -> str:
    """The drawing of :func:`curves` as a ``data:`` URL of a picture, in which no script can run.

    :param index: of the marked state.
    """
    packed = base64.b64encode(curves(timeline, index).encode()).decode("ascii")
    return f"data:image/svg+xml;base64,{packed}"


def curves(timeline: Timeline, index: int) -> str:
    """SVG of the area and of what was removed over the square root of time, each scaled to its largest, with a state marked."""
    wide, high = _WIDE - 2 * _EDGE, _HIGH - 2 * _EDGE - 14
    places = _EDGE + wide * across(timeline)
    lines, names = [], []
    for curve in measures(timeline):
        down = _EDGE + high * (1.0 - curve.shares)
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in zip(places, down, strict=True))
        lines.append(f'<polyline points="{points}" fill="none" stroke="{curve.colour}" stroke-width="1.5"/>')
        names.append(f'<tspan fill="{curve.colour}">{curve.words}  </tspan>')
    x = places[index]
    marker = f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{_EDGE}" y2="{_EDGE + high}" stroke="#444" stroke-dasharray="3 2"/>'
    frame = f'<rect x="{_EDGE}" y="{_EDGE}" width="{wide}" height="{high}" fill="none" stroke="#ccc"/>'
    text = f'<text x="{_EDGE}" y="{_HIGH - 6}" font-size="11" font-family="sans-serif">{"".join(names)}</text>'
    label = escape(summary(timeline, index))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDE} {_HIGH}" width="{_WIDE}" height="{_HIGH}" '
        f'role="img" aria-label="{label}">'
        f"{frame}{''.join(lines)}{marker}{text}</svg>"
    )
