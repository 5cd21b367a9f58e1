"""Draws geometries by VTK: panels for a page, and windows."""

from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from meshflow.geometry.validation import Array
from meshflow.view.geometry import Geometry
from meshflow.view.look import Look
from meshflow.view.overlay import Overlay
from meshflow.view.scale import Scale
from meshflow.view.turning import HEAVY, Turning, coarse

if TYPE_CHECKING:
    import pyvista as pv

__all__ = ["COLUMN", "FOOT", "Rows", "added", "coarsened", "drawn", "length", "overlaid", "single", "windowed"]

# Shares of a window: the width of the column beside the geometry, the height of bar and slider below.
COLUMN, FOOT = 0.27, 0.17
Rows = list[list[tuple[str, Geometry, Scale | None]]]
"""Rows of panels of a window: label, geometry, colours instead of its own."""

_STONE = "#eae3d6"  # pale and matt, so that shading shows the shape
# Colours must stay readable and the shape visible: surfaces facing the viewer keep six sevenths of their brightness, surfaces
# facing the light all of it.
_COLOURED: dict[str, Any] = {"ambient": 0.52, "diffuse": 0.48, "specular": 0.0}
_MARGIN = 1.04
_BARS = {
    "title_font_size": 15,
    "label_font_size": 14,
    "color": "black",
    "fmt": "%.3g",
    "n_labels": 5,
    "vertical": True,
    "width": 0.05,
    "height": 0.6,
    "position_x": 0.8,
    "position_y": 0.2,
    "fill": True,  # so that its digits are readable in front of the geometry
    "background_color": "white",
}
_BELOW = {"vertical": False, "width": 0.5, "height": 0.05, "position_x": 0.25, "position_y": 0.09, "fill": False}


def drawn(geometry: Geometry, look: Look, size: tuple[int, int], scale: Scale | None = None) -> Array:
    """One geometry as a picture (height, width, 3) in uint8, on white.

    :param size: width and height, pixels.
    :param scale: colours of its samples, instead of stone.
    """
    import pyvista as pv

    plotter = pv.Plotter(off_screen=True, window_size=list(size), lighting="none", theme=pv.themes.DocumentTheme())
    with closing(plotter):
        _light(plotter, geometry, look)
        _add(plotter, geometry, scale)
        _aim(plotter, geometry, size[0] / size[1])
        plotter.enable_anti_aliasing("ssaa")
        picture = plotter.screenshot(None, return_img=True)
    return np.asarray(picture)[..., :3]


def length(geometry: Geometry, size: tuple[int, int]) -> float:
    """The length of a pixel of :func:`drawn`, for views without perspective."""
    return 2 * _half(geometry, size[0] / size[1]) / size[1]


def windowed(rows: Rows, look: Look, off_screen: bool | None = None) -> "pv.Plotter":
    """A window with rows of labelled geometries that rotate together; it is not shown yet, and the caller closes it.

    :param rows: one or two, the second of one geometry.
    :param off_screen: draw without a window; None: as pyvista decides.
    """
    import pyvista as pv

    shape: Any = (len(rows), len(rows[0]))
    groups: Any = [(1, slice(None))] if len(rows) == 2 else None
    plotter = pv.Plotter(shape=shape, groups=groups, off_screen=off_screen, **_frame(look))
    with _closed_on_failure(plotter):
        _light(plotter, rows[0][0][1], look)  # for all panels, since pyvista adds a light to each
        heavy: list[tuple[Any, Any]] = []
        for r, row in enumerate(rows):
            for c, (label, geometry, scale) in enumerate(row):
                plotter.subplot(r, c)
                actor = _add(plotter, geometry, scale, bar=True)
                heavy += _stood_in(plotter, actor, geometry, scale)
                plotter.add_text(label, position="upper_left", font_size=12, color="black")
                _aim(plotter, geometry, look.size[0] / look.size[1])
        plotter.link_views()
        Turning(plotter, heavy)
    return plotter


def overlaid(
    panels: tuple[tuple[Geometry, Scale | None], ...], look: Look, off_screen: bool | None = None
) -> "pv.Plotter":
    """A window with a divider between two surfaces, or one at a time; it is not shown yet, and the caller closes it.

    :param panels: two surfaces with their colours.
    :param look: gives the first position of the divider, and whether the window starts with it (``wipe``) or with the first
        surface only. The space bar switches.
    :param off_screen: draw without a window; None: as pyvista decides.
    """
    import pyvista as pv

    plotter = pv.Plotter(off_screen=off_screen, **_frame(look))
    with _closed_on_failure(plotter):
        (one, first), (other, second) = panels
        _light(plotter, one, look)
        actors = _add(plotter, one, first, bar=True), _add(plotter, other, second)
        heavy = [
            _stood_in(plotter, actor, *panel)
            for actor, panel in zip(actors, ((one, first), (other, second)), strict=True)
        ]
        turning = Turning(plotter, [])  # the overlay decides which of them are shown
        sides = [pairs[0] if pairs else (actor,) for actor, pairs in zip(actors, heavy, strict=True)]
        overlay = Overlay(plotter, sides[0], sides[1], turning, look.at, look.arrange == "wipe")
        widgets: Any = plotter
        slider = widgets.add_slider_widget(
            overlay.slide,
            rng=(0.0, 1.0),
            value=look.at,
            title="",
            pointa=(0.0, 0.04),
            pointb=(1.0, 0.04),
            interaction_event="always",
            color="#26282b",
            fmt="",
            slider_width=0.05,
            tube_width=0.002,
        )
        handle = slider.GetRepresentation()  # short and without caps, so that it is where the divider is
        handle.SetEndCapLength(0.0)
        handle.SetSliderLength(0.012)
        if any(heavy):  # the divider must also be responsive
            slider.AddObserver("StartInteractionEvent", turning.turn)
            slider.AddObserver("EndInteractionEvent", turning.rest)
        _aim(plotter, one, look.size[0] / look.size[1])
    return plotter


@contextmanager
def _closed_on_failure(plotter: "pv.Plotter") -> Iterator[None]:
    """Close the window where something fails."""
    try:
        yield
    except BaseException:
        plotter.close()
        raise


def single(geometry: Geometry, look: Look, off_screen: bool, *, column: bool = False) -> "pv.Plotter":
    """A plotter with light and camera for one geometry, which is :func:`added` later; the caller closes it.

    :param column: leave room for :class:`meshflow.viewer.column.Column` to the left of the surface, and for a bar and a slider
        below it.
    """
    import pyvista as pv

    aspect, parts = look.size[0] / look.size[1], dict[str, Any]()
    if column:
        parts = {"shape": (1, 2), "col_weights": (COLUMN, 1 - COLUMN), "border": False}
        aspect *= 1 - COLUMN
        (left, low), (right, high) = geometry.view.frame
        below = (left, low - max(high - low, (right - left) / aspect) * FOOT / (1 - FOOT))
        geometry = replace(geometry, view=replace(geometry.view, frame=(below, (right, high))))
    plotter = pv.Plotter(off_screen=off_screen, **parts, **_frame(look))
    if column:
        plotter.subplot(0, 1)
    _light(plotter, geometry, look)
    _aim(plotter, geometry, aspect)
    return plotter


def added(plotter: "pv.Plotter", geometry: Geometry, scale: Scale | None, name: str, *, below: bool = False) -> Any:
    """Add the actor of a geometry, which replaces the one of that name and its bar.

    :param below: place the bar below the geometry, where :func:`single` left room; else at its right.
    """
    shown: Any = plotter
    for bar in list(shown.scalar_bars.keys()):
        shown.remove_scalar_bar(bar, render=False)
    shown.remove_actor(name, render=False)
    actor = _add(plotter, geometry, scale, bar=scale is not None, place=_BELOW if below else {})
    plotter.add_actor(actor, name=name, reset_camera=False, render=False)
    plotter.reset_camera_clipping_range()  # the camera was set before the geometry was added
    return actor


def coarsened(
    plotter: "pv.Plotter", actor: Any, geometry: Geometry, scale: Scale | None, name: str
) -> list[tuple[Any, Any]]:
    """For a geometry of very many triangles: its actor and a coarse one, which replace that of the name; else no pair."""
    shown: Any = plotter
    shown.remove_actor(name, render=False)
    pairs = _stood_in(plotter, actor, geometry, scale)
    for _, other in pairs:
        other.SetVisibility(False)
        plotter.add_actor(other, name=name, reset_camera=False, render=False)
    return pairs


def _frame(look: Look) -> dict[str, Any]:
    """The common options of all windows."""
    import pyvista as pv

    theme = pv.themes.DocumentTheme()
    return {"window_size": list(look.size), "lighting": "none", "theme": theme, "title": look.title or "meshflow"}


def _stood_in(plotter: "pv.Plotter", actor: Any, geometry: Geometry, scale: Scale | None) -> list[tuple[Any, Any]]:
    """The pair of the actor and a coarse one, for a geometry of very many triangles."""
    if len(geometry.faces) <= HEAVY:
        return []
    return [(actor, _add(plotter, coarse(geometry), scale))]


def _add(
    plotter: "pv.Plotter",
    geometry: Geometry,
    scale: Scale | None,
    bar: bool = False,
    place: dict[str, Any] | None = None,
) -> Any:
    """Add the flat shaded actor of a geometry: in stone, in its own colours, or in those of a scale."""
    shape = geometry.polydata()
    if scale is not None:  # soft light, so that the shape is visible and the colour readable
        bars: Any = {"title": f"{scale.label}\n", **_BARS, **(place or {})} if bar else None
        which = (
            geometry.samples
            if not scale.of_triangles
            else slice(None)
            if geometry.triangles is None
            else geometry.triangles
        )
        return plotter.add_mesh(
            shape,
            scalars=scale.values.ravel()[which],
            preference="cell" if scale.of_triangles else "point",
            clim=(scale.low, scale.high),
            cmap=scale.colour_map,
            n_colors=max(scale.colour_map.N, 256),
            nan_color="lightgrey",
            show_scalar_bar=bar,
            scalar_bar_args=bars,
            smooth_shading=False,
            **_COLOURED,
        )
    if geometry.colours is not None:
        flat = not geometry.view.pinhole and not np.ptp(geometry.points[:, 2])
        light: dict[str, Any] = {"lighting": False, "ambient": 0.0, "diffuse": 1.0} if flat else _COLOURED
        worn: dict[str, Any] = {"scalars": geometry.colours, "rgb": True}
        if geometry.texture is not None:
            import pyvista as pv

            shape, worn = (
                geometry.textured(geometry.texture),
                {"texture": pv.Texture(geometry.texture.picture), "color": "white"},
            )
        return plotter.add_mesh(shape, smooth_shading=False, **light, **worn)
    return plotter.add_mesh(shape, color=_STONE, smooth_shading=False, ambient=0.15, diffuse=0.9, specular=0.0)


def _light(plotter: "pv.Plotter", geometry: Geometry, look: Look) -> None:
    """Three lights: the raking one of the look, a weak one opposite, and one at the viewer, so that shadows show the shape.

    Together they are hardly brighter than one light.
    """
    import pyvista as pv

    east, north, high = look.light
    for toward, intensity in (((east, north, high), 0.97), ((-east, -north, high), 0.15)):
        place = tuple(np.array(toward) @ geometry.view.ground)
        plotter.add_light(
            pv.Light(position=place, focal_point=(0, 0, 0), light_type="scene light", intensity=intensity)
        )
    plotter.add_light(pv.Light(light_type="headlight", intensity=0.15))


def _half(geometry: Geometry, aspect: float) -> float:
    """Half of the visible height of a picture."""
    wide, tall = geometry.view.extent
    return max(tall, wide / aspect) / 2 * _MARGIN or 1.0  # the geometry may be a point


def _aim(plotter: "pv.Plotter", geometry: Geometry, aspect: float) -> None:
    """Place the camera according to the view, so that the frame is filled.

    :param aspect: width over height of the drawing area.
    """
    view, half = geometry.view, _half(geometry, aspect)
    middle = np.mean(view.frame, axis=0) @ np.stack([view.right, view.up])
    depth = geometry.points @ view.toward
    if view.pinhole:
        focus = float(np.median(-depth)) * (middle - view.toward)
        plotter.camera_position = [(0.0, 0.0, 0.0), tuple(focus), tuple(view.up)]
        plotter.camera.view_angle = float(np.degrees(2 * np.arctan(half)))
    else:
        focus = middle + view.toward * float(depth.min() + depth.max()) / 2
        away = 2 * float(np.linalg.norm(np.ptp(geometry.points, axis=0))) or 1.0
        plotter.camera_position = [tuple(focus + away * view.toward), tuple(focus), tuple(view.up)]
        plotter.camera.parallel_projection = True
        plotter.camera.parallel_scale = half
    plotter.reset_camera_clipping_range()
