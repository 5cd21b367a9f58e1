"""A film of a surface on its way: one look, one frame, one scale of colours, the time written into it."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from meshflow.errors import InputError
from meshflow.surfaces.lift import Noun
from meshflow.view import page
from meshflow.view.frames import FILMS, Frames
from meshflow.view.geometry import Body, embodied, raised, thinned
from meshflow.view.look import Look
from meshflow.view.numbers import plain
from meshflow.view.pair import paired
from meshflow.view.pictures import Pictured, writable
from meshflow.view.quantity import Quantity, measured
from meshflow.view.renderer import How, Stage, staged
from meshflow.view.scale import Scale
from meshflow.view.scene import Removed

__all__ = ["filmable", "filmed"]

_SAMPLES = 600  # of a grid, a side: as many as a frame has pixels
_PAUSE = 1.5  # seconds for which the last frame stays


@dataclass(frozen=True, eq=False)
class _Moment:
    """A state, thinned for the screen; its numbers are those of all of the data."""

    time: float
    noun: Noun
    scale: Scale | None


def filmable(path: str | Path, overwrite: bool) -> Path:
    """A path that a film can be written to: asked before anything is computed.

    :param overwrite: replace a file that is there.
    :raises FormatError: for another extension, a folder that is not there, or a file that is there and is not to be replaced.
    """
    target = writable(path, FILMS, overwrite)
    assert target is not None
    return target


def filmed(
    states: Iterable[tuple[float, Noun]],
    path: str | Path,
    look: Look,
    *,
    time_unit: str = "",
    rate: float = 12.0,
    turn: float = 0.0,
    quantity: Quantity | Removed | None = None,
    contrast: float = 1.0,
    how: How | None = None,
    overwrite: bool = False,
) -> Pictured:
    """Draw states of a noun one after the other. Colours, light and frame are the same in all of them.

    :param states: times and nouns of one kind and size, the start first.
    :param path: ``.mp4`` (needs ``meshflow[film]``) or ``.gif``.
    :param time_unit: written behind the time.
    :param rate: frames per second.
    :param turn: degrees by which the viewer walks around the surface meanwhile; 0: the camera stands still.
    :param quantity: what colour stands for: ``removed`` so far, or a quantity; None: the surface as it is.
    :param how: as in :func:`meshflow.view.compare`.
    :param overwrite: replace a file that is there.
    :raises InputError: for no state, nothing to draw, or options that make no sense.
    :raises FormatError: for a path that cannot be written, or must not.
    :raises MissingPackage: for ``.mp4`` where ffmpeg is not installed, and where only VTK would do and it cannot draw.
    """
    target = filmable(path, overwrite)
    with Frames(target, rate) as frames:
        moments, stage = _moments(states, look, how, quantity, contrast, turn)
        scale = _common([moment.scale for moment in moments])
        bodies = _framed([_body(moment.noun, stage) for moment in moments], turn)
        plan = page.layout(look, stage.aspect(bodies[0], moments[0].noun), 1, labelled=True, scaled=scale is not None)
        stay = round(_PAUSE * rate)
        for k, (moment, body) in enumerate(zip(moments, bodies, strict=True)):
            hue = None if scale is None or moment.scale is None else replace(scale, values=moment.scale.values)
            picture = stage.panel(moment.noun, body, plan.panels[0].size, hue)
            label = f"time {plain(moment.time, moments[-1].time)} {time_unit}".rstrip()
            sheet = page.single_page(
                plan, picture, scale, look, page.Foot(stage.foot()), stage.pixel(moment.noun), (label,)
            )
            drawn = page.pixels(sheet)
            for _ in range(1 + stay * (k == len(moments) - 1)):
                frames.add(drawn)
    return Pictured(target, stage.how, stage.notes)


def _moments(
    states: Iterable[tuple[float, Noun]],
    look: Look,
    how: How | None,
    quantity: Quantity | Removed | None,
    contrast: float,
    turn: float,
) -> tuple[list[_Moment], Stage]:
    """All states, measured and thinned as they come, and how they are drawn."""
    moments: list[_Moment] = []
    stage: Stage | None = None
    first: Noun | None = None
    for time, noun in states:
        first = noun if first is None else first
        if stage is None:
            seen = raised(noun, look.seen)
            if turn and (how == "relief" or not np.isfinite(turn)):
                raise InputError(f"turn: degrees, of what VTK draws in space, expected; got {turn} with how={how!r}")
            stage = staged((seen,), look, "pyvista" if turn else how, window=False, most=_SAMPLES)
        if quantity == "removed":
            scale = paired(first, noun, None).removed
        else:
            scale = None if quantity is None else measured(noun, quantity, contrast)
        scale = None if scale is None else scale.wearing(look.colours).thinned(stage.step)
        moments.append(_Moment(time, thinned(raised(noun, look.seen), stage.step), scale))
    if stage is None:
        raise InputError("film: states of a noun expected, got none")
    return moments, replace(stage, step=1)


def _common(scales: list[Scale | None]) -> Scale | None:
    """One scale for all: that of the widest ends."""
    there = [scale for scale in scales if scale is not None and "nothing" not in scale.ends]
    if not there:
        return scales[-1]
    return max(there, key=lambda scale: scale.high - scale.low)


def _body(noun: Noun, stage: Stage) -> Body:
    look = stage.look
    return embodied(noun, 1, stage.exaggeration, stage.shown, look.up, look.seen, look.own_colours)


def _framed(bodies: list[Body], turn: float) -> list[Body]:
    """The bodies seen in one frame, turned from the first to the last."""
    view, many = bodies[0].view, max(len(bodies) - 1, 1)
    if not turn:
        view = view.framing(*(body.points for body in bodies))
        return [replace(body, view=view) for body in bodies]
    views = [view.turned(turn * k / many).framing(body.points) for k, body in enumerate(bodies)]
    half = np.max([seen.extent for seen in views], axis=0) / 2
    middles = [np.mean(seen.frame, axis=0) for seen in views]
    frames = [(tuple(middle - half), tuple(middle + half)) for middle in middles]
    return [
        replace(body, view=replace(seen, frame=frame)) for body, seen, frame in zip(bodies, views, frames, strict=True)
    ]
