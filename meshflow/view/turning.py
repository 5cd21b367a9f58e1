"""Keeps windows responsive during interaction: no anti-aliasing, and coarse geometry instead of very many triangles."""

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from meshflow.view.geometry import Geometry

if TYPE_CHECKING:
    import pyvista as pv

__all__ = ["HEAVY", "Turning", "coarse"]

HEAVY = 400_000  # triangles that software rendering draws in about a tenth of a second
_CELLS = 160  # along the longest side: a cell is a few pixels of a window


def coarse(geometry: Geometry, cells: int = _CELLS) -> Geometry:
    """The geometry with fewer triangles: points in a cell of a grid become one of them (Rossignac and Borrel 1993).

    :param cells: along its longest side.
    """
    low, size = geometry.points.min(axis=0), float(np.ptp(geometry.points, axis=0).max()) or 1.0
    place = np.minimum((geometry.points - low) * (cells / size), cells - 1).astype(np.int64)
    key = (place[:, 0] * cells + place[:, 1]) * cells + place[:, 2]
    _, first, home = np.unique(key, return_index=True, return_inverse=True)
    faces = home.ravel()[geometry.faces]
    a, b, c = faces.T
    kept = np.flatnonzero((a != b) & (b != c) & (c != a))
    # Of coinciding triangles one is kept, whatever its orientation.
    _, once = np.unique(np.sort(faces[kept], axis=1), axis=0, return_index=True)
    kept = kept[np.sort(once)]
    return replace(
        geometry,
        points=geometry.points[first],
        faces=faces[kept],
        samples=geometry.samples[first],
        triangles=kept if geometry.triangles is None else geometry.triangles[kept],
        colours=None if geometry.colours is None else geometry.colours[first],
        texture=None if geometry.texture is None else geometry.texture.of(kept),
        normals=None if geometry.normals is None else geometry.normals[kept],
    )


class Turning:
    """Switches between fine geometry at rest and coarse geometry during interaction.

    :ivar fine: whether the fine geometry is shown.
    :param plotter: whose interaction is observed.
    :param pairs: fine actors, shown at rest, and coarse ones, shown during interaction.
    :param smoothed: whether the window is anti-aliased at rest.
    :param prepared: called before the coarse actors are shown.
    """

    def __init__(
        self,
        plotter: "pv.Plotter",
        pairs: list[tuple[Any, Any]],
        *,
        smoothed: bool = True,
        prepared: Callable[[], None] = lambda: None,
    ) -> None:
        self.pairs, self.plotter, self.fine = pairs, plotter, True
        self._smoothed, self._prepared = smoothed, prepared
        self.rest()
        style = plotter.iren
        if style is not None:
            style.add_observer("StartInteractionEvent", self.turn)
            style.add_observer("EndInteractionEvent", self.rest)

    def turn(self, *_: Any) -> None:
        """Show the coarse geometry."""
        self._prepared()
        self._show(fine=False)

    def rest(self, *_: Any) -> None:
        """Show the fine geometry."""
        self._show(fine=True)

    def _show(self, *, fine: bool) -> None:
        self.fine = fine
        window: Any = self.plotter
        if not self._smoothed:
            pass
        elif fine:
            window.enable_anti_aliasing("ssaa", all_renderers=True)
        else:  # in software rendering it takes longer than all the rest
            window.disable_anti_aliasing(all_renderers=True)
        for one, other in self.pairs:
            one.SetVisibility(fine)
            other.SetVisibility(not fine)
