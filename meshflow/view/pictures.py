"""The calls of this room: compare a thing before and after, show one thing; as a picture, a window, or in a notebook."""

from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import FormatError, InputError
from meshflow.geometry.validation import Array
from meshflow.io.atomic_write import beside, must_be_free
from meshflow.view import page
from meshflow.view import vtk_scene as scene
from meshflow.view.frames import ANIMATED, Frames
from meshflow.view.look import Looks, looking
from meshflow.view.overlay import divided
from meshflow.view.probe import displayed
from meshflow.view.quantity import Quantity
from meshflow.view.renderer import How, must_open
from meshflow.view.scene import Arrange, Removed, Sight, of_one, of_two

if TYPE_CHECKING:
    import pyvista as pv
    from matplotlib.figure import Figure

__all__ = ["Pictured", "compare", "plotter", "show", "writable"]

_FORMATS = (".png", ".jpg", ".jpeg", ".tif", ".tiff")
_BLINKS = 1.25  # pictures per second
_DIVIDER = np.array([38, 40, 43], np.uint8)


@dataclass(frozen=True)
class Pictured:
    """What became of it. In a notebook it shows the picture.

    :param path: the picture; None: it was a window.
    :param how: ``pyvista``: drawn in space by VTK; ``relief``: seen from above, without OpenGL.
    :param notes: what was done on the way, sentences for the user.
    """

    path: Path | None
    how: How
    notes: tuple[str, ...] = ()

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> dict[str, Any]:
        """The picture, as notebooks ask for it."""
        kinds = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg", ".gif": "image/gif"}
        kind = None if self.path is None else kinds.get(self.path.suffix.lower())
        if kind is None or self.path is None:
            return {"text/plain": repr(self)}
        return {"text/plain": repr(self), kind: self.path.read_bytes()}


def compare(
    before: Any,
    after: Any,
    path: str | Path | None = None,
    *,
    quantity: Quantity | Removed = "removed",
    arrange: Arrange = "beside",
    at: float = 0.5,
    unit: str | None = None,
    contrast: float = 1.0,
    labels: tuple[str, str] = ("before", "after"),
    how: How | None = None,
    overwrite: bool = False,
    **look: Unpack[Looks],
) -> Pictured:
    """Show a thing before and after in the same light, and what was removed.

    Surfaces are shaded flat, triangle by triangle, so that noise shows. Removed is before minus after: of height,
    of depth, or of the mean of the channels; of a mesh the motion inwards along the normals of ``before``. Its colours
    are symmetric about 0 and end at the 99th percentile of its size. Numbers are those of all of the data; what is drawn of
    grids is thinned to 1000 samples a side, and that is said.

    :param before: a noun, a :class:`meshflow.Document`, or anything that :func:`meshflow.io.objects.from_object` recognises.
    :param after: the same kind of thing on the same samples.
    :param path: the picture to write (.png, .jpg, .tif; to blink .gif or .png); None: a window.
    :param quantity: ``removed``; or before and after in the colours of their ``curvature``, ``edges``, ``triangles`` or
        ``samples`` (:func:`meshflow.view.measured`), one scale for both.
    :param arrange: ``beside`` each other; ``wipe``: one view, before to the left of a divider (that a window lets you drag)
        and after to its right; ``blink``: one after the other (in a window at the space bar).
    :param at: where the divider stands, a share of the width from the left.
    :param unit: of what was removed; by default the one that the noun names.
    :param contrast: length per unit of the values, for ``edges``.
    :param labels: what the two are, where they are not before and after.
    :param how: ``pyvista`` or ``relief``; by default VTK where it can draw, and images always as images.
    :param overwrite: replace a file that is there.
    :param look: the fields of :class:`meshflow.view.Look`: light, exaggeration, side, size, title, colours.
    :raises InputError: for two things that cannot be compared, nothing to draw, options that make no sense, or a window
        where there is no display.
    :raises FormatError: for a path that cannot be written, an extension that is no picture's, or a file that is there and is not
        to be replaced.
    :raises MissingPackage: for a mesh, or a window, where VTK cannot draw.
    """
    at, seen = divided(at), looking(**look)
    target = writable(path, ANIMATED if arrange == "blink" else _FORMATS, overwrite)
    sight = of_two(before, after, seen, how, target is None, arrange, unit, quantity, contrast, labels)
    if target is None:
        return _opened(sight, arrange, at)
    if arrange == "blink":
        _blinked(sight, target)
    else:
        _save(_wiped(sight, at) if arrange == "wipe" else _beside(sight), target)
    return Pictured(target, sight.stage.how, sight.notes)


def show(
    thing: Any,
    path: str | Path | None = None,
    *,
    scalars: ArrayLike | None = None,
    quantity: Quantity | None = None,
    unit: str | None = None,
    contrast: float = 1.0,
    how: How | None = None,
    overwrite: bool = False,
    **look: Unpack[Looks],
) -> Pictured:
    """Show one thing in a window, or as a picture.

    :param scalars: a number for each sample (h, w) or vertex (n,), shown as colour.
    :param quantity: instead: ``curvature``, ``edges``, ``triangles`` or ``samples``, with its unit and its scale
        (:func:`meshflow.view.measured`).
    :param unit: of the scalars.

    Everything else, and what is raised, as in :func:`compare`.
    """
    seen, target = looking(**look), writable(path, _FORMATS, overwrite)
    sight = of_one(thing, seen, how, target is None, unit, scalars, quantity, contrast)
    if target is None:
        return _opened(sight, "beside", 0.5)
    plan = page.layout(seen, sight.aspect, panels=1)
    scale = sight.counted[0][1] if sight.counted else None
    picture = sight.picture(0, plan.panels[0].size)
    _save(page.single_page(plan, picture, scale, seen, sight.foot(plan.panels[0].size, plan.unit), sight.pixel), target)
    return Pictured(target, sight.stage.how, sight.notes)


def plotter(
    before: Any,
    after: Any = None,
    *,
    quantity: Quantity | Removed | None = None,
    arrange: Arrange = "beside",
    at: float = 0.5,
    unit: str | None = None,
    contrast: float = 1.0,
    off_screen: bool | None = None,
    **look: Unpack[Looks],
) -> "pv.Plotter":
    """What :func:`compare`, or :func:`show` of one thing, would open as a window: a ``pyvista.Plotter``, not yet shown.

    For notebooks, where its ``show()`` draws a picture, or a view that turns where ``trame`` is installed
    (``show(jupyter_backend="trame")``), and for whoever wants to add to it. No display is needed to make it; close it in the end.

    :param after: None: one thing is shown.
    :param off_screen: draw without a window; None: as pyvista decides.
    :raises MissingPackage: where VTK cannot draw.
    """
    at, seen = divided(at), looking(**look)
    if after is None:
        if quantity == "removed":
            raise InputError("quantity='removed': of two things, got one; give after, or another quantity")
        sight = of_one(before, seen, "pyvista", True, unit, None, quantity, contrast)
    else:
        sight = of_two(before, after, seen, "pyvista", True, arrange, unit, quantity or "removed", contrast)
    return _plotted(sight, arrange, at, off_screen)


def writable(path: str | Path | None, formats: tuple[str, ...] = _FORMATS, overwrite: bool = False) -> Path | None:
    """A path to write to, or None for a window that can be opened: asked before anything is drawn.

    :raises InputError: for a window where there is no display.
    :raises FormatError: for a path that cannot be written, or must not.
    """
    if path is None:
        if not displayed():
            raise InputError(
                "a window needs a display, and DISPLAY is not set; give a path to write a picture instead, or take "
                "meshflow.view.plotter in a notebook"
            )
        return None
    target = Path(path)
    if target.suffix.lower() not in formats:
        got = target.suffix or "no extension"
        raise FormatError(f"{target.name}: a picture ends in {', '.join(formats)}; got {got}")
    if target.is_dir():
        raise FormatError(f"{target}: is a folder; name a file in it")
    if not target.parent.is_dir():
        raise FormatError(f"{target}: the folder {target.parent} is not there; make it first")
    must_be_free(target, overwrite)
    return target


def _opened(sight: Sight, arrange: Arrange, at: float) -> Pictured:
    """A window; returns when it is closed."""
    must_open()
    with closing(_plotted(sight, arrange, at, None)) as window:
        window.show()
    return Pictured(None, sight.stage.how, sight.notes)


def _plotted(sight: Sight, arrange: Arrange, at: float, off_screen: bool | None) -> "pv.Plotter":
    """A window, not yet shown."""
    panels = [(one.label, one.body, one.scale) for one in sight.shown]
    if arrange == "beside" or len(panels) == 1:
        return scene.windowed([row for row in (panels[:2], panels[2:]) if row], sight.look, off_screen)
    pair = (panels[0][1:], panels[1][1:])
    return scene.overlaid(pair, sight.look, at, arrange == "wipe", off_screen)


def _beside(sight: Sight) -> "Figure":
    """All panels, with a histogram of what is counted."""
    plan = page.layout(sight.look, sight.aspect, len(sight.shown))
    drawn = [(one.label, sight.picture(k, plan.panels[k].size)) for k, one in enumerate(sight.shown)]
    return page.compared_page(
        plan, drawn, sight.counted, sight.look, sight.foot(plan.panels[0].size, plan.unit), sight.pixel
    )


def _wiped(sight: Sight, at: float) -> "Figure":
    """One view, before to the left of a divider and after to its right."""
    plan = page.layout(sight.look, sight.aspect, 1, labelled=True, scaled=bool(sight.counted))
    one, other = (sight.picture(k, plan.panels[0].size) for k in (0, 1))
    both, place, width = other.copy(), round(at * other.shape[1]), max(1, other.shape[1] // 600)
    both[:, :place] = one[:, :place]
    both[:, max(place - width // 2, 0) : place - width // 2 + width] = _DIVIDER
    return _single(sight, plan, both, (sight.shown[0].label, sight.shown[1].label), at)


def _blinked(sight: Sight, target: Path) -> None:
    """Two frames of an animated picture, before and after."""
    plan = page.layout(sight.look, sight.aspect, 1, labelled=True, scaled=bool(sight.counted))
    with Frames(target, _BLINKS) as frames:
        for k, one in enumerate(sight.shown[:2]):
            picture = sight.picture(k, plan.panels[0].size)
            frames.add(page.pixels(_single(sight, plan, picture, (one.label,))))


def _single(sight: Sight, plan: page.Layout, picture: Array, labels: tuple[str, ...], at: float = 0.5) -> "Figure":
    scale = sight.counted[-1][1] if sight.counted else None
    return page.single_page(
        plan, picture, scale, sight.look, sight.foot(plan.panels[0].size, plan.unit), sight.pixel, labels, at
    )


def _save(figure: "Figure", target: Path) -> None:
    """Write a page as a picture: beside the old one first, then in its place."""
    with beside(target) as draft:
        figure.savefig(draft, format=target.suffix[1:].lower(), dpi=figure.dpi)
