"""One page that holds all states of a flow and opens without a server, a network or an installation."""

import base64
import json
import zlib
from collections.abc import Callable
from dataclasses import replace
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from meshflow.errors import FormatError, InputError
from meshflow.geometry.validation import Array
from meshflow.io.atomic_write import beside, must_be_free
from meshflow.surfaces.data import Data
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.view.geometry import Geometry, as_shown, drawable, geometry_of, raised, thinned
from meshflow.view.look import Look
from meshflow.view.pair import paired
from meshflow.view.scale import Scale
from meshflow.viewer.curves import curves_as_picture, summary
from meshflow.viewer.timeline import Timeline

__all__ = ["exportable", "exported", "page_of"]

SAMPLES = 400  # per side of a grid; more would make a page of tens of megabytes
HEAVY = 400_000  # vertices of a mesh above which a note states the size of the page
MANY = 24  # states of a page


def exportable(path: str | Path, overwrite: bool) -> Path:
    """Check that a page can be written to a path, before anything is computed.

    :param overwrite: replace an existing file.
    :raises FormatError: for another extension, a missing folder, or a file that exists and must not be replaced.
    """
    target = Path(path)
    if target.suffix.lower() not in (".html", ".htm"):
        raise FormatError(f"{target}: .html expected")
    if not target.parent.is_dir():
        raise FormatError(f"{target}: there is no folder {target.parent}")
    must_be_free(target, overwrite)
    return target


def exported(
    timeline: Timeline, path: str | Path, look: Look, command: Callable[[float], str], *, overwrite: bool = False
) -> tuple[str, ...]:
    """Write the page; returns notes.

    :param path: ``.html``.
    :param overwrite: replace an existing file.
    :raises FormatError: as :func:`exportable`.
    :raises InputError: as :func:`page_of`.
    """
    target = exportable(path, overwrite)
    text, notes = page_of(timeline, look, command)
    with beside(target) as draft:
        draft.write_text(text, encoding="utf-8")
    return notes


def page_of(timeline: Timeline, look: Look, command: Callable[[float], str]) -> tuple[str, tuple[str, ...]]:
    """The page as HTML, and notes.

    Positions are stored with 16 bits of the bounding box, what was removed with 8 bits of its scale; the page is for viewing.

    :param command: the command line that makes the state at a time.
    :raises InputError: where there is nothing to draw.
    """
    every = max(1, -(-(len(timeline) - 1) // (MANY - 1)))
    shown = [*range(0, len(timeline) - 1, every), len(timeline) - 1]
    first, last = timeline.at(0), timeline.at(len(timeline) - 1)
    seen = raised(first, look.seen)
    step, exaggeration, notes = drawable(seen, look, SAMPLES)
    images = [surface for surface in (seen, raised(last, look.seen)) if isinstance(surface, Image)]
    hues = as_shown(*images) if images else None

    def geometry(surface: Data) -> Geometry:
        """The geometry of a state."""
        thin = thinned(raised(surface, look.seen), step)
        return geometry_of(thin, look, 1, exaggeration, hues)

    start = geometry(first)
    view = start.view.framing(start.points, geometry(last).points)
    scale = paired(first, last, None).removed.wearing(look.colours)
    states = []
    for index in shown:
        surface = timeline.at(index)
        removed = paired(first, surface, None).removed.thinned(step).values
        facts = {"summary": summary(timeline, index), "curves": curves_as_picture(timeline, index)}
        facts["command"] = command(timeline.history[index].time)
        states.append((geometry(surface), removed, facts))
    data = _page(replace(start, view=view), states, scale, look)
    if isinstance(first, Mesh) and len(start.points) > HEAVY:
        notes = (*notes, f"{len(start.points)} vertices in {len(states)} states: the page has {len(data) >> 20} MB")
    words = {
        "title": escape(look.title or "meshflow"),
        "notes": escape("; ".join(notes)),
        "data": data.replace("<", "\\u003c"),
        "flat": "true" if images else "false",
    }
    template = Template(files("meshflow.viewer").joinpath("page.html").read_text(encoding="utf-8"))
    return template.substitute(words), notes


def _page(start: Geometry, states: list[tuple[Geometry, Array, dict[str, str]]], scale: Scale, look: Look) -> str:
    """The numbers of a page."""
    if any(len(geometry.points) != len(start.points) for geometry, _, _ in states):
        raise InputError("states: the same samples in all of them expected")
    low = np.min([geometry.points.min(axis=0) for geometry, _, _ in states], axis=0)
    size = np.maximum(np.max([geometry.points.max(axis=0) for geometry, _, _ in states], axis=0) - low, 1e-300)
    view = start.view
    sides = np.stack([view.right, view.up], axis=1)
    flat = start.points @ sides
    wide, tall = np.ptp(flat, axis=0)
    middle = (start.points.min(axis=0) + start.points.max(axis=0)) / 2
    # the centre of the box differs from that of the visible geometry
    middle = middle + sides @ ((flat.min(axis=0) + flat.max(axis=0)) / 2 - middle @ sides)
    found: dict[str, Any] = {
        "many": len(start.points),
        "faces": _packed(start.faces.astype("<u4")),
        "table": _packed(np.round(255 * scale.colour_map(np.linspace(0, 1, 256))[:, :3]).astype(np.uint8)),
        "low": low.tolist(),
        "size": size.tolist(),
        "middle": middle.tolist(),
        "radius": float(np.linalg.norm(size)),
        "extent": [float(wide) or 1.0, float(tall) or 1.0],
        "up": view.up.tolist(),
        "toward": view.toward.tolist(),
        "axis": (view.up if view.axis is None else view.axis).tolist(),
        "light": (look.light @ view.ground).tolist(),
        "what": scale.label,
        "ends": [f"{value:.3g}" for value in (scale.low, (scale.low + scale.high) / 2, scale.high)],
        "states": [],
    }
    before: list[Array] = []
    for geometry, removed, words in states:
        columns = list(np.round((geometry.points - low) / size * 65535).astype("<u2").T)
        share = np.nan_to_num((removed.ravel()[geometry.samples] - scale.low) / (scale.high - scale.low), nan=0.5)
        state: dict[str, Any] = dict(words)
        # What does not move is stored once.
        state["columns"] = [
            None if before and np.array_equal(column, before[q]) else _packed(column)
            for q, column in enumerate(columns)
        ]
        before = before or columns
        state["removed"] = _packed(np.round(255 * np.clip(share, 0, 1)).astype(np.uint8))
        state["colours"] = None if geometry.colours is None else _packed(geometry.colours)
        found["states"].append(state)
    return json.dumps(found)


def _packed(values: Array) -> str:
    return base64.b64encode(zlib.compress(np.ascontiguousarray(values).tobytes(), 6)).decode("ascii")
