"""Two surfaces in one view of a window, with a divider between them, or one at a time."""

from typing import TYPE_CHECKING, Any

import numpy as np

from meshflow.view.turning import Turning

if TYPE_CHECKING:
    import pyvista as pv

__all__ = ["Actors", "Overlay"]

Actors = tuple[Any, ...]
"""An actor of VTK, and a coarse one if it has very many triangles."""

_KEY = "space"


class Overlay:
    """Before to the left of a divider and after to its right; the space bar shows one, the other, and both again.

    Each actor is clipped by the plane of the lines of sight through the divider. The divider is therefore a line on the screen
    for any camera, and nothing is drawn twice.

    :param plotter: a window of one view.
    :param before: actors: the geometry, and, if it has very many triangles, a coarse one that is shown during interaction.
    :param after: likewise.
    :param turning: says which of the two is drawn.
    :param at: the position of the divider, a share of the width.
    :param wipes: start with the divider; else with ``before`` only.
    """

    def __init__(
        self, plotter: "pv.Plotter", before: Actors, after: Actors, turning: Turning, at: float, wipes: bool
    ) -> None:
        import vtk

        self.plotter, self.sides, self.turning = plotter, (before, after), turning
        self.at, self.mode = at, 0 if wipes else 1
        self.planes = vtk.vtkPlane(), vtk.vtkPlane()
        for actors, plane in zip(self.sides, self.planes, strict=True):
            for actor in actors:
                actor.mapper.AddClippingPlane(plane)
        self.label: Any = plotter.add_text(
            self.words, position=(0.02, 0.95), viewport=True, font_size=12, color="black"
        )
        window: Any = plotter
        window.renderer.AddObserver("StartEvent", self._follow)
        window.add_key_event(_KEY, self.swap)

    @property
    def words(self) -> str:
        """Which of the two is visible, as a label."""
        return ("before: left,  after: right", "before", "after")[self.mode]

    def slide(self, at: float) -> None:
        """Move the divider to a share of the width."""
        self.at = float(at)

    def swap(self) -> None:
        """Show the next of before, after, and both with the divider."""
        self.mode = (self.mode + 1) % 3
        self.label.input = self.words
        self.plotter.render()

    def _follow(self, *_: Any) -> None:
        """Update the clipping planes and the visibility of the actors before they are drawn."""
        at = (self.at, 1.0, 0.0)[self.mode]
        for actors, seen in zip(self.sides, (at > 0.0, at < 1.0), strict=True):
            drawn = actors[0 if self.turning.fine else -1]
            for actor in actors:
                actor.SetVisibility(seen and actor is drawn)
        camera = self.plotter.camera
        window: Any = self.plotter.render_window
        wide, tall = window.GetSize()
        place, focus = np.array(camera.position), np.array(camera.focal_point)
        forward = (focus - place) / np.linalg.norm(focus - place)
        right = np.cross(forward, np.array(camera.up))
        right /= np.linalg.norm(right)
        across = wide / tall * (2.0 * at - 1.0)
        if camera.parallel_projection:
            origin, normal = place + across * camera.parallel_scale * right, right
        else:
            half = np.tan(np.radians(camera.view_angle) / 2)
            origin, normal = place, right - across * half * forward
        for plane, side in zip(self.planes, (-1.0, 1.0), strict=True):
            plane.SetOrigin(*origin)
            plane.SetNormal(*(side * normal))
