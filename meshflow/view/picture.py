"""The two calls of this room: compare a thing before and after, show one thing."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import FormatError, InputError
from meshflow.geometry.gates import real
from meshflow.geometry.lift import Mesh, Noun
from meshflow.io.adopt import adopt
from meshflow.io.replace import beside
from meshflow.view import page, scene
from meshflow.view.look import Look, Up
from meshflow.view.pair import Scale, holes, paired, spread
from meshflow.view.probe import displayed
from meshflow.view.stage import How, staged

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Pictured", "compare", "show"]

_FORMATS = (".png", ".jpg", ".jpeg", ".tif", ".tiff")


@dataclass(frozen=True)
class Pictured:
    """What became of it.

    :param path: the picture; None: it was a window.
    :param how: ``pyvista``: drawn in space by VTK; ``relief``: seen from above, without OpenGL.
    :param notes: what was done on the way, sentences for the user.
    """

    path: Path | None
    how: How
    notes: tuple[str, ...] = ()


def compare(
    before: Any,
    after: Any,
    path: str | Path | None = None,
    *,
    title: str = "",
    unit: str | None = None,
    size: tuple[int, int] = (1600, 1200),
    exaggeration: float | None = None,
    azimuth: float = 315.0,
    altitude: float = 30.0,
    up: Up | None = None,
    how: How | None = None,
) -> Pictured:
    """Show a thing before and after, side by side in the same light, and what was removed below.

    Surfaces are shaded flat, triangle by triangle, so that noise shows. Removed is before minus after: of height,
    of depth, or of the mean of the channels; of a mesh the motion inwards along the normals of ``before``. Its colours
    are symmetric about 0 and end at the 99th percentile of its size.

    :param before: a noun, or anything that :func:`meshflow.io.adopt.adopt` recognises.
    :param after: the same kind of thing on the same samples.
    :param path: the picture to write (.png, .jpg, .tif), in place of one that is there; None: a window.
    :param unit: of what was removed; by default the one that a height field names.
    :param size: of the picture or the window, pixels.
    :param exaggeration: factor on heights; by default one that makes the relief visible.
    :param azimuth: where the light comes from, degrees clockwise from north (from the top of the picture, where there
        is no north).
    :param altitude: how high it stands, degrees.
    :param up: ``y`` or ``z``, what is up of a mesh; by default guessed from its shape.
    :param how: ``pyvista`` or ``relief``; by default VTK where it can draw, and images always as images.
    :raises InputError: for two things that cannot be compared, nothing to draw, options that make no sense, or a window
        where there is no display.
    :raises FormatError: for a path that cannot be written, or an extension that is no picture's.
    :raises MissingPackage: for a mesh, or a window, where VTK cannot draw.
    """
    look = Look(exaggeration, azimuth, altitude, up, size, title)
    target = writable(path)
    pair = paired(before, after, unit)
    stage = staged((pair.before, pair.after), look, how, window=target is None)
    notes = (*pair.notes, *stage.notes)
    one, other = stage.bodies(pair.before, pair.after)
    removed = pair.removed.thinned(stage.step)
    if target is None:
        scene.opened([[("before", one, None), ("after", other, None)], [("removed", other, removed)]], look)
        return Pictured(None, stage.how, notes)
    plan = page.layout(look, stage.aspect(one, pair.before))
    sizes = [panel.size for panel in plan.panels]
    pictures = (
        stage.panel(pair.before, one, sizes[0]),
        stage.panel(pair.after, other, sizes[1]),
        stage.panel(pair.after, other, sizes[2], removed),
    )
    _save(page.compared_page(plan, pictures, pair.removed, look, stage.foot(), stage.pixel(pair.before)), target)
    return Pictured(target, stage.how, notes)


def show(
    thing: Any,
    path: str | Path | None = None,
    *,
    scalars: ArrayLike | None = None,
    title: str = "",
    unit: str | None = None,
    size: tuple[int, int] = (1600, 1200),
    exaggeration: float | None = None,
    azimuth: float = 315.0,
    altitude: float = 30.0,
    up: Up | None = None,
    how: How | None = None,
) -> Pictured:
    """Show one thing in a window, or as a picture.

    :param scalars: a number for each sample (h, w) or vertex (n,), shown as colour.
    :param unit: of the scalars.

    Everything else, and what is raised, as in :func:`compare`.
    """
    look = Look(exaggeration, azimuth, altitude, up, size, title)
    target = writable(path)
    adopted = adopt(thing)
    noun = adopted.noun
    scale = None if scalars is None else _scale(noun, scalars, unit)
    stage = staged((noun,), look, how, window=target is None)
    notes = (*adopted.notes, *stage.notes)
    (body,) = stage.bodies(noun)
    thin = None if scale is None else scale.thinned(stage.step)
    if target is None:
        scene.opened([[("", body, thin)]], look)
        return Pictured(None, stage.how, notes)
    plan = page.layout(look, stage.aspect(body, noun), panels=1)
    picture = stage.panel(noun, body, plan.panels[0].size, thin)
    _save(page.single_page(plan, picture, scale, look, stage.foot(), stage.pixel(noun)), target)
    return Pictured(target, stage.how, notes)


def _scale(noun: Noun, scalars: ArrayLike, unit: str | None) -> Scale:
    """Numbers of the caller's, one per sample or vertex, as colours from the least to the greatest.

    :raises InputError: when they do not fit the noun, or none is finite.
    """
    values = real(scalars, "scalars")
    shape = noun.points.shape[:1] if isinstance(noun, Mesh) else holes(noun).shape
    if values.shape != shape:
        raise InputError(f"scalars: one number per sample or vertex expected, of shape {shape}; got {values.shape}")
    gone = ~np.isfinite(values) if isinstance(noun, Mesh) else ~np.isfinite(values) | holes(noun)
    values = np.where(gone, np.nan, values)
    if np.isnan(values).all():
        raise InputError("scalars: at least one finite number expected where a sample is, got none")
    return Scale(values, *spread(values), "viridis", "", unit or "")


def writable(path: str | Path | None) -> Path | None:
    """A path to write to, or None for a window that can be opened: asked before anything is drawn."""
    if path is None:
        if not displayed():
            raise InputError("a window needs a display, and DISPLAY is not set; give a path to write a picture instead")
        return None
    target = Path(path)
    if target.suffix.lower() not in _FORMATS:
        got = target.suffix or "no extension"
        raise FormatError(f"{target.name}: a picture ends in {', '.join(_FORMATS)}; got {got}")
    if target.is_dir():
        raise FormatError(f"{target}: is a folder; name a file in it")
    if not target.parent.is_dir():
        raise FormatError(f"{target}: the folder {target.parent} is not there; make it first")
    return target


def _save(figure: "Figure", target: Path) -> None:
    """Write a page as a picture: beside the old one first, then in its place."""
    with beside(target) as draft:
        figure.savefig(draft, format=target.suffix[1:].lower(), dpi=figure.dpi)
