"""A plotter that shows the states of a surface, for a window with sliders and for a browser."""

from dataclasses import replace
from typing import Any, Literal, get_args

import numpy as np

from meshflow.errors import InputError, MissingPackage
from meshflow.geometry.validation import Array
from meshflow.surfaces.data import Data
from meshflow.surfaces.image import Image
from meshflow.view import vtk_scene
from meshflow.view.geometry import Geometry, as_shown, drawable, geometry_of, raised, thinned
from meshflow.view.look import Look
from meshflow.view.pair import paired
from meshflow.view.probe import displayed, rendering
from meshflow.view.scale import Scale
from meshflow.view.turning import Turning

__all__ = ["COLOURINGS", "Colouring", "Screen"]

Colouring = Literal["surface", "removed"]
SAMPLES = 600  # per side of a grid, so that the slider is responsive
COLOURINGS: tuple[Colouring, ...] = get_args(Colouring)


class Screen:
    """A plotter that shows states of the same samples in one frame and one colour scale.

    :ivar plotter: of pyvista; the caller closes it.
    :ivar notes: sentences for the user.
    :param first: the start of a flow.
    :param last: its end; frame and colours fit both.
    :param off_screen: draw without a window.
    :param column: leave room for a column beside the geometry, as in :func:`meshflow.view.vtk_scene.single`.
    :raises InputError: where there is nothing to draw.
    :raises MissingPackage: where VTK cannot draw.
    """

    def __init__(self, first: Data, last: Data, look: Look, off_screen: bool, *, column: bool = False) -> None:
        answer = rendering()
        if not answer.works:
            raise MissingPackage(f"states can be drawn by VTK only: {answer.why}")
        if off_screen:
            answer.prepare()
        elif not displayed() or answer.window is not None:
            raise InputError(
                "a window needs a display, and there is none that VTK can draw on: view it in a browser (--web, place=Address()) "
                "or write a page (--export, place=Page(path))"
            )
        self._first, self._look, self._column = first, look, column
        self._colouring: Colouring = "surface"
        seen = raised(first, look.seen)
        self._step, self._exaggeration, self.notes = drawable(seen, look, SAMPLES)
        images = [data for data in (seen, raised(last, look.seen)) if isinstance(data, Image)]
        self._shown = as_shown(*images) if images else None
        geometry, end = self._geometry(first), self._geometry(last)
        geometry = replace(geometry, view=geometry.view.framing(geometry.points, end.points))
        self._scale = self._removed(last)
        self.plotter = vtk_scene.single(geometry, look, off_screen, column=column)
        self._seen: tuple[Geometry, Scale | None] = geometry, None
        self._stands_in = False
        self._turning = Turning(self.plotter, [], smoothed=False, prepared=self._coarse)
        self._surface: Any = self._drawn(geometry, None)

    def recoloured(self, last: Data) -> None:
        """Set the colours for states with another end."""
        self._scale = self._removed(last)

    def show(self, data: Data, colouring: Colouring = "surface") -> None:
        """Show a state, plain or coloured by what was removed since the start."""
        geometry, scale = self._geometry(data), None
        if colouring == "removed":
            values = self._removed(data).values
            scale = replace(self._scale, values=values)
        self._seen, self._stands_in = (geometry, scale), False
        held, worn = self._surface, self._surface.active_scalars_name
        textured = scale is None and geometry.texture is not None
        same = colouring == self._colouring and (scale is not None or textured or geometry.colours is None)
        places = geometry.corners if textured else geometry.points
        if same and len(held.points) == len(places) and held.n_cells == len(geometry.faces):
            held.points = places  # the triangles are already on the graphics card
            if scale is not None and worn is not None:
                held.point_data[worn] = scale.values.ravel()[geometry.samples]
        else:
            self._surface = self._drawn(geometry, scale)
        self._colouring = colouring
        self.plotter.render()

    def picture(self) -> Array:
        """The current picture (h, w, 3) in uint8."""
        return np.asarray(self.plotter.screenshot(None, return_img=True))[..., :3]

    def _drawn(self, geometry: Geometry, scale: Scale | None) -> Any:
        self._actor = vtk_scene.added(self.plotter, geometry, scale, "state", below=self._column)
        return self._actor.mapper.dataset

    def _coarse(self) -> None:
        """Make the coarse geometry when an interaction starts, so that the slider over states does not wait for it."""
        if not self._stands_in:
            self._turning.pairs = vtk_scene.coarsened(self.plotter, self._actor, *self._seen, "while it turns")
            self._stands_in = True

    def _geometry(self, data: Data) -> Geometry:
        seen = thinned(raised(data, self._look.seen), self._step)
        return geometry_of(seen, self._look, 1, self._exaggeration, self._shown)

    def _removed(self, data: Data) -> Scale:
        return paired(self._first, data, None).removed.wearing(self._look.colours).thinned(self._step)
