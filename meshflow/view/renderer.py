"""Chooses how to draw, once for all panels of a picture, and draws the panels."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from meshflow.errors import InputError, MissingPackage
from meshflow.geometry.validation import Array
from meshflow.surfaces.data import Data
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.view import hillshade, vtk_scene
from meshflow.view.geometry import SAMPLES, Geometry, as_shown, drawable, geometry_of
from meshflow.view.look import Look, RendererName, Seen
from meshflow.view.probe import rendering
from meshflow.view.scale import Scale

__all__ = ["Renderer", "must_open", "renderer_for"]


@dataclass(frozen=True, eq=False)
class Renderer:
    """How the data of a picture is drawn.

    :param name: by VTK in space, or as a shaded relief.
    :param step: draw every ``step``-th sample of a grid.
    :param exaggeration: factor on heights.
    :param shown: for images: converts channels to colours.
    :param notes: sentences for the user; those of ``caption`` are below the picture.
    """

    look: Look
    name: RendererName
    step: int
    exaggeration: float
    shown: Callable[[Array], Array] | None
    caption: tuple[str, ...]
    notes: tuple[str, ...]

    def geometries(self, *surfaces: Data) -> tuple[Geometry, ...]:
        """The geometries of data objects of one kind, with the same view and frame."""
        look = self.look
        geometries = [geometry_of(data, look, self.step, self.exaggeration, self.shown) for data in surfaces]
        view = geometries[0].view.framing(*(geometry.points for geometry in geometries))
        return tuple(replace(geometry, view=view) for geometry in geometries)

    def panel(self, data: Data, geometry: Geometry, size: tuple[int, int], scale: Scale | None = None) -> Array:
        """One panel (height, width, 3) in uint8: of the given size from VTK, or one pixel per sample as a relief.

        :param scale: colours, thinned like the geometry.
        """
        if self.name == "pyvista":
            return vtk_scene.drawn(geometry, self.look, size, scale)
        if scale is not None:
            return hillshade.coloured(scale)
        if isinstance(data, Image):
            return hillshade.imaged(data, self.step, self.shown or as_shown(data))
        return hillshade.pictured(geometry, self._grid(data), self.look)

    def aspect(self, geometry: Geometry, data: Data) -> float:
        """Width over height of the contents of a panel."""
        if self.name == "hillshade":
            h, w = self._grid(data)
            return w / h / self.pixel(data)
        wide, tall = geometry.view.extent
        return wide / tall if tall > 0 else 1.0

    def pixel(self, data: Data) -> float:
        """Height over width of a pixel of a panel."""
        if self.name == "hillshade" and isinstance(data, (HeightField, Image)):
            return float(data.spacing[1] / np.mean(data.spacing[0]))
        return 1.0

    def length(self, data: Data, geometry: Geometry, size: tuple[int, int]) -> float | None:
        """The length of a pixel of a panel of a size, across the view; None where it depends on the place or is no length."""
        if isinstance(data, Image) or geometry.view.pinhole:
            return None
        if self.name == "pyvista" or not isinstance(data, HeightField):
            return vtk_scene.length(geometry, size)
        h, w = self._grid(data)
        return float(np.mean(data.spacing[0])) * self.step / min(size[0] / w, size[1] / (h * self.pixel(data)))

    def foot(self) -> str:
        """The line below the picture."""
        return ",  ".join(self.caption)

    def _grid(self, data: Data) -> tuple[int, int]:
        """The drawn rows and columns of a grid; a mesh has none."""
        if isinstance(data, Mesh):
            raise InputError("renderer='hillshade': a mesh has no grid; leave it out")
        h, w = data.missing[:: self.step, :: self.step].shape
        return h, w


def renderer_for(surfaces: tuple[Data, ...], look: Look, window: bool, most: int = SAMPLES) -> Renderer:
    """Choose how to draw data of one kind.

    :param look: its ``renderer`` is the requested one; None: VTK where it can draw, images as images.
    :param window: whether a window or a plotter is needed, which only VTK can make.
    :param most: the largest number of drawn samples per side of a grid.
    :raises InputError: for a renderer that does not suit the data.
    :raises MissingPackage: where VTK is needed and cannot draw; the message says what to do.
    """
    data = surfaces[0]
    chosen, notes = _chosen(data, look.renderer, window, look.seen)
    step, exaggeration, caption = drawable(data, look, most)
    reported = (*notes, *caption) if step > 1 else notes  # light and exaggeration are stated in the picture
    images = [data for data in surfaces if isinstance(data, Image)]
    if not images:
        caption = (*caption, f"light from {look.azimuth:g}°, {look.altitude:g}° high")
    return Renderer(look, chosen, step, exaggeration, as_shown(*images) if images else None, caption, reported)


def must_open() -> None:
    """Refuse a window where VTK cannot draw on a display.

    :raises InputError: in that case.
    """
    answer = rendering()
    if answer.works and answer.window is not None:
        raise InputError(f"a window needs a display that VTK can draw on, and here {answer.why}; give a path")


def _chosen(
    data: Data, asked: RendererName | None, window: bool, seen: Seen | None
) -> tuple[RendererName, tuple[str, ...]]:
    """The renderer, and a note where it is not the expected one."""
    name = type(data).__name__
    if asked == "hillshade" and isinstance(data, Mesh):
        raise InputError("renderer='hillshade': a mesh has no grid to be shown as a relief; leave it out")
    if asked == "hillshade" and seen == "side":
        raise InputError("renderer='hillshade': a relief is seen from the front; leave seen='side' or the renderer out")
    if asked == "hillshade" and window:
        raise InputError("renderer='hillshade': it makes pictures, not windows; give a path")
    if asked == "pyvista" and isinstance(data, Image) and not window:
        raise InputError("renderer='pyvista': an image is written as the image it is; leave it out")
    if asked == "hillshade" or (isinstance(data, Image) and not window):
        return "hillshade", ()
    answer = rendering()
    if answer.works:
        answer.prepare()
        return "pyvista", ()
    if window or asked == "pyvista" or seen == "side" or not isinstance(data, (HeightField, RangeImage)):
        what = "a window" if window else f"a {name} in space"
        raise MissingPackage(f"{what} can be drawn by VTK only: {answer.why}")
    return "hillshade", (f"shown as a relief: {answer.why}",)
