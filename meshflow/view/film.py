"""Films of a surface while it is smoothed, with one look, one frame and one colour scale, and the time in each picture."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from meshflow.errors import InputError
from meshflow.surfaces.data import Data
from meshflow.view import page
from meshflow.view.frames import FILMS, Frames
from meshflow.view.geometry import Geometry, geometry_of, raised, thinned
from meshflow.view.look import Look
from meshflow.view.numbers import plain
from meshflow.view.pair import paired
from meshflow.view.pictures import Pictured, writable
from meshflow.view.quantity import Quantity, measured
from meshflow.view.renderer import Renderer, renderer_for
from meshflow.view.scale import Scale
from meshflow.view.scale_bar import Ground
from meshflow.view.scene import Removed, foot_of

__all__ = ["Reel", "filmable", "filmed"]

_SAMPLES = 600  # per side of a grid, about the pixels of a frame
_PAUSE = 1.5  # seconds for which the last frame stays


@dataclass(frozen=True, eq=False)
class _Keyframe:
    """A state, thinned for the screen; its numbers are computed from all data."""

    time: float
    data: Data
    scale: Scale | None


def filmable(path: str | Path, overwrite: bool) -> Path:
    """Check that a film can be written to a path, before anything is computed.

    :param overwrite: replace an existing file.
    :raises FormatError: for another extension, a folder that does not exist, or a file that exists and must not be replaced.
    """
    return writable(path, FILMS, overwrite)


@dataclass(frozen=True)
class Reel:
    """How a film runs.

    :param rate: frames per second.
    :param turn: degrees by which the camera moves around the surface during the film; 0: it does not move.
    :param time_unit: written after the time.
    :param ground: the unit of lengths, and whether it is a map, for the scale bar.
    """

    rate: float = 12.0
    turn: float = 0.0
    time_unit: str = ""
    ground: Ground = Ground()


def filmed(
    states: Iterable[tuple[float, Data]],
    path: str | Path,
    look: Look,
    reel: Reel = Reel(),
    quantity: Quantity | Removed | None = None,
    overwrite: bool = False,
) -> Pictured:
    """Draw states of data as the frames of a film. Colours, light and view are the same in all frames.

    :param states: times and data of one kind and size, the start first.
    :param path: ``.mp4`` (needs ``meshflow[film]``) or ``.gif``.
    :param look: as in :func:`meshflow.view.show`.
    :param reel: frames per second, and how the camera moves.
    :param quantity: what colour shows: ``removed`` so far, or a quantity; None: the plain surface.
    :param overwrite: replace an existing file.
    :raises InputError: for no state, nothing to draw, or invalid options.
    :raises FormatError: for a path that cannot or must not be written.
    :raises MissingPackage: for ``.mp4`` without ffmpeg, and where VTK is needed and cannot draw.
    """
    target = filmable(path, overwrite)
    with Frames(target, reel.rate) as frames:
        keyframes, renderer = _keyframes(states, look, quantity, reel.turn)
        scale = _common([keyframe.scale for keyframe in keyframes])
        geometries = _framed([_geometry(keyframe.data, renderer) for keyframe in keyframes], reel.turn)
        plan = page.layout(
            look, renderer.aspect(geometries[0], keyframes[0].data), 1, labelled=True, scaled=scale is not None
        )
        length = renderer.length(keyframes[0].data, geometries[0], plan.panels[0].size)
        foot, stay = foot_of(renderer, reel.ground, length, plan.unit), round(_PAUSE * reel.rate)
        for k, (keyframe, geometry) in enumerate(zip(keyframes, geometries, strict=True)):
            hue = None if scale is None or keyframe.scale is None else replace(scale, values=keyframe.scale.values)
            picture = renderer.panel(keyframe.data, geometry, plan.panels[0].size, hue)
            label = f"time {plain(keyframe.time, keyframes[-1].time)} {reel.time_unit}".rstrip()
            drawing = page.single_page(plan, picture, scale, foot, renderer.pixel(keyframe.data), ((0.5, label),))
            drawn = page.pixels(drawing)
            for _ in range(1 + stay * (k == len(keyframes) - 1)):
                frames.add(drawn)
    return Pictured(target, renderer.name, renderer.notes)


def _keyframes(
    states: Iterable[tuple[float, Data]],
    look: Look,
    quantity: Quantity | Removed | None,
    turn: float,
) -> tuple[list[_Keyframe], Renderer]:
    """All states, measured and thinned one by one, and the renderer."""
    keyframes: list[_Keyframe] = []
    renderer: Renderer | None = None
    first: Data | None = None
    for time, data in states:
        first = data if first is None else first
        if renderer is None:
            seen = raised(data, look.seen)
            if turn and (look.renderer == "hillshade" or not np.isfinite(turn)):
                raise InputError(
                    f"turn: degrees expected, and a renderer in space (VTK); got {turn} with renderer={look.renderer!r}"
                )
            chosen = replace(look, renderer="pyvista") if turn else look
            renderer = renderer_for((seen,), chosen, window=False, most=_SAMPLES)
        if quantity == "removed":
            scale = paired(first, data, None).removed
        else:
            scale = None if quantity is None else measured(data, quantity, look.contrast)
        scale = None if scale is None else scale.wearing(look.colours).thinned(renderer.step)
        keyframes.append(_Keyframe(time, thinned(raised(data, look.seen), renderer.step), scale))
    if renderer is None:
        raise InputError("film: states of a data object expected, got none")
    return keyframes, replace(renderer, step=1)


def _common(scales: list[Scale | None]) -> Scale | None:
    """One scale for all states: the widest."""
    there = [scale for scale in scales if scale is not None and "nothing" not in scale.ends]
    if not there:
        return scales[-1]
    return max(there, key=lambda scale: scale.high - scale.low)


def _geometry(data: Data, renderer: Renderer) -> Geometry:
    return geometry_of(data, renderer.look, 1, renderer.exaggeration, renderer.shown)


def _framed(geometries: list[Geometry], turn: float) -> list[Geometry]:
    """The geometries in one frame, rotated from the first to the last."""
    view, many = geometries[0].view, max(len(geometries) - 1, 1)
    if not turn:
        view = view.framing(*(geometry.points for geometry in geometries))
        return [replace(geometry, view=view) for geometry in geometries]
    views = [view.turned(turn * k / many).framing(geometry.points) for k, geometry in enumerate(geometries)]
    half = np.max([seen.extent for seen in views], axis=0) / 2
    middles = [np.mean(seen.frame, axis=0) for seen in views]
    frames = [(tuple(middle - half), tuple(middle + half)) for middle in middles]
    return [
        replace(geometry, view=replace(seen, frame=frame))
        for geometry, seen, frame in zip(geometries, views, frames, strict=True)
    ]
