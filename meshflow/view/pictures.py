"""The public drawing functions: compare data before and after, show data; as a picture, in a window, or in a notebook."""

from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import FormatError, InputError
from meshflow.geometry.validation import Array
from meshflow.io.atomic_write import beside, must_be_free
from meshflow.view import page, vtk_scene
from meshflow.view.frames import ANIMATED, Frames
from meshflow.view.look import OF_PAIRS, Looks, RendererName, looking
from meshflow.view.probe import displayed
from meshflow.view.quantity import Quantity
from meshflow.view.renderer import must_open
from meshflow.view.scene import Removed, Scene, of_one, of_two

if TYPE_CHECKING:
    import pyvista as pv
    from matplotlib.figure import Figure

__all__ = ["Pictured", "compare", "plotter", "show", "writable"]

_FORMATS = (".png", ".jpg", ".jpeg", ".tif", ".tiff")
_BLINKS = 1.25  # pictures per second
_DIVIDER = np.array([38, 40, 43], np.uint8)


@dataclass(frozen=True)
class Pictured:
    """A picture that was made; notebooks display it.

    :param path: of the picture; None: it was a window.
    :param renderer: ``pyvista``: drawn in space by VTK; ``hillshade``: seen from above, without OpenGL.
    :param notes: sentences for the user.
    """

    path: Path | None
    renderer: RendererName
    notes: tuple[str, ...] = ()

    def _repr_mimebundle_(self, include: object = None, exclude: object = None) -> dict[str, str | bytes]:
        """The picture for notebooks."""
        kinds = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg", ".gif": "image/gif"}
        kind = None if self.path is None else kinds.get(self.path.suffix.lower())
        if kind is None or self.path is None:
            return {"text/plain": repr(self)}
        return {"text/plain": repr(self), kind: self.path.read_bytes()}


def compare(
    before: object,
    after: object,
    path: str | Path | None = None,
    *,
    quantity: Quantity | Removed = "removed",
    overwrite: bool = False,
    **look: Unpack[Looks],
) -> Pictured:
    """Show data before and after in the same light, and what was removed.

    Surfaces are flat shaded, so that noise is visible. Removed is before minus after: of the height, the depth, or the mean of
    the channels; for a mesh the motion inwards along the normals of ``before``. Its colours are symmetric about 0 and end at the
    99th percentile of its absolute value. Numbers are computed from all data. Grids are thinned to 1000 samples per side for
    drawing, which the picture states.

    Example:

        >>> from meshflow.synthetic import mesas, noisy
        >>> picture = compare(noisy(mesas(48), 2.0), mesas(48), "both.png", size=(400, 300), renderer="hillshade")
        >>> picture.path.name
        'both.png'

    :param before: a height field, image, range image or mesh, a :class:`meshflow.Document`, or any object that
        :func:`meshflow.smooth` takes.
    :param after: the same kind of data on the same samples.
    :param path: the picture to write (.png, .jpg, .tif; for ``blink`` .gif or .png); None: a window.
    :param quantity: ``removed``; or before and after coloured by ``curvature``, ``edges``, ``triangles`` or
        ``samples`` (:func:`meshflow.view.measured`), with one scale for both.
    :param overwrite: replace an existing file.
    :param look: the options of :class:`meshflow.view.Look` by name: arrangement, light, exaggeration, side, size, title, colours,
        renderer.
    :raises InputError: for data that cannot be compared, nothing to draw, invalid options, or a window without a display.
    :raises FormatError: for a path that cannot be written, an extension that is no picture's, or a file that exists and must not
        be replaced.
    :raises MissingPackage: for a mesh or a window, where VTK cannot draw.
    """
    seen = looking(**look)
    target = _target(path, ANIMATED if seen.arrange == "blink" else _FORMATS, overwrite)
    scene = of_two(before, after, seen, quantity, target is None)
    if target is None:
        return _opened(scene)
    if seen.arrange == "blink":
        _blinked(scene, target)
    else:
        _save(_wiped(scene) if seen.arrange == "wipe" else _beside(scene), target)
    return Pictured(target, scene.renderer.name, scene.notes)


def show(
    data: object,
    path: str | Path | None = None,
    *,
    scalars: ArrayLike | None = None,
    quantity: Quantity | None = None,
    overwrite: bool = False,
    **look: Unpack[Looks],
) -> Pictured:
    """Show data in a window, or as a picture.

    Example:

        >>> from meshflow.synthetic import mesas
        >>> show(mesas(48), "one.png", size=(400, 300), renderer="hillshade").path.name
        'one.png'

    :param data: as ``before`` of :func:`compare`.
    :param path: the picture to write (.png, .jpg, .tif); None: a window.
    :param scalars: one number per sample (h, w) or vertex (n,), shown as colour.
    :param quantity: or a quantity: ``curvature``, ``edges``, ``triangles`` or ``samples``, with unit and scale
        (:func:`meshflow.view.measured`).
    :param overwrite: replace an existing file.
    :param look: the options of :class:`meshflow.view.Look` by name, except those for two surfaces.

    It raises the same errors as :func:`compare`.
    """
    seen, target = looking(OF_PAIRS, **look), _target(path, _FORMATS, overwrite)
    scene = of_one(data, seen, quantity, scalars, target is None)
    if target is None:
        return _opened(scene)
    plan = page.layout(seen, scene.aspect, panels=1)
    scale = scene.counted[0][1] if scene.counted else None
    size = plan.panels[0].size
    _save(page.single_page(plan, scene.picture(0, size), scale, scene.foot(size, plan.unit), scene.pixel), target)
    return Pictured(target, scene.renderer.name, scene.notes)


def plotter(
    before: object,
    after: object = None,
    *,
    quantity: Quantity | Removed | None = None,
    off_screen: bool | None = None,
    **look: Unpack[Looks],
) -> "pv.Plotter":
    """The window of :func:`compare`, or of :func:`show` for one surface, as a ``pyvista.Plotter`` that is not shown yet.

    It is for notebooks, where ``show()`` draws a picture, or an interactive view with ``trame``
    (``show(jupyter_backend="trame")``), and for adding further actors. It needs no display. Close it at the end.

    Example:

        >>> from meshflow.synthetic import mesas, noisy
        >>> window = plotter(noisy(mesas(32), 2.0), mesas(32), off_screen=True)  # window.show() opens it
        >>> window.close()

    :param before: as in :func:`compare`.
    :param after: None: one surface is shown.
    :param quantity: as in :func:`compare`, or :func:`show`.
    :param off_screen: draw without a window; None: as pyvista decides.
    :param look: the options of :class:`meshflow.view.Look` by name; VTK draws it.
    :raises InputError: as :func:`compare`.
    :raises MissingPackage: where VTK cannot draw.
    """
    without = ("renderer",) if after is not None else ("renderer", *OF_PAIRS)
    seen = replace(looking(without, **look), renderer="pyvista")
    if after is None:
        if quantity == "removed":
            raise InputError("quantity='removed': two surfaces expected, got one; give after, or another quantity")
        scene = of_one(before, seen, quantity, window=True)
    else:
        scene = of_two(before, after, seen, quantity or "removed", window=True)
    return _plotted(scene, off_screen)


def writable(path: str | Path, formats: tuple[str, ...] = _FORMATS, overwrite: bool = False) -> Path:
    """Check that a picture can be written to a path, before anything is drawn.

    :param path: a file in an existing folder.
    :param formats: accepted extensions.
    :param overwrite: replace an existing file.
    :raises FormatError: for a path that cannot or must not be written.
    """
    target = Path(path)
    if target.suffix.lower() not in formats:
        got = target.suffix or "no extension"
        what = "film" if ".mp4" in formats else "picture"
        raise FormatError(f"{target.name}: a {what} ends in {', '.join(formats)}; got {got}")
    if target.is_dir():
        raise FormatError(f"{target} is a folder; name a file in it")
    if not target.parent.is_dir():
        raise FormatError(f"{target}: the folder {target.parent} does not exist; create it first")
    must_be_free(target, overwrite)
    return target


def _target(path: str | Path | None, formats: tuple[str, ...], overwrite: bool) -> Path | None:
    """A path to write to, or None for a window that can be opened.

    :raises InputError: for a window without a display.
    """
    if path is not None:
        return writable(path, formats, overwrite)
    if not displayed():
        raise InputError(
            "a window needs a display, and DISPLAY is not set; give a path to write a picture instead, or take "
            "meshflow.view.plotter in a notebook"
        )
    return None


def _opened(scene: Scene) -> Pictured:
    """A window; returns when it is closed."""
    must_open()
    with closing(_plotted(scene, None)) as window:
        window.show()
    return Pictured(None, scene.renderer.name, scene.notes)


def _plotted(scene: Scene, off_screen: bool | None) -> "pv.Plotter":
    """A window, not yet shown."""
    panels = [(one.label, one.geometry, one.scale) for one in scene.shown]
    if scene.look.arrange == "beside" or len(panels) == 1:
        return vtk_scene.windowed([row for row in (panels[:2], panels[2:]) if row], scene.look, off_screen)
    pair = (panels[0][1:], panels[1][1:])
    return vtk_scene.overlaid(pair, scene.look, off_screen)


def _beside(scene: Scene) -> "Figure":
    """All panels, with a histogram."""
    plan = page.layout(scene.look, scene.aspect, len(scene.shown))
    drawn = [(one.label, scene.picture(k, plan.panels[k].size)) for k, one in enumerate(scene.shown)]
    return page.compared_page(plan, drawn, scene.counted, scene.foot(plan.panels[0].size, plan.unit), scene.pixel)


def _wiped(scene: Scene) -> "Figure":
    """One view, before to the left of a divider and after to its right."""
    plan = page.layout(scene.look, scene.aspect, 1, labelled=True, scaled=bool(scene.counted))
    one, other = (scene.picture(k, plan.panels[0].size) for k in (0, 1))
    both, place, width = other.copy(), round(scene.look.at * other.shape[1]), max(1, other.shape[1] // 600)
    both[:, :place] = one[:, :place]
    both[:, max(place - width // 2, 0) : place - width // 2 + width] = _DIVIDER
    at = scene.look.at
    return _single(scene, plan, both, ((at / 2, scene.shown[0].label), ((1 + at) / 2, scene.shown[1].label)))


def _blinked(scene: Scene, target: Path) -> None:
    """Two frames of an animated picture, before and after."""
    plan = page.layout(scene.look, scene.aspect, 1, labelled=True, scaled=bool(scene.counted))
    with Frames(target, _BLINKS) as frames:
        for k, one in enumerate(scene.shown[:2]):
            picture = scene.picture(k, plan.panels[0].size)
            frames.add(page.pixels(_single(scene, plan, picture, ((0.5, one.label),))))


def _single(scene: Scene, plan: page.Layout, picture: Array, labels: tuple[tuple[float, str], ...]) -> "Figure":
    scale = scene.counted[-1][1] if scene.counted else None
    return page.single_page(plan, picture, scale, scene.foot(plan.panels[0].size, plan.unit), scene.pixel, labels)


def _save(figure: "Figure", target: Path) -> None:
    """Write a page as a picture; an existing file is replaced only when it is complete."""
    with beside(target) as draft:
        figure.savefig(draft, format=target.suffix[1:].lower(), dpi=figure.dpi)
