"""Windows stay quick while they are turned: no anti-aliasing, and a coarse body in the place of one of very many triangles."""

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from meshflow.view.geometry import Body

if TYPE_CHECKING:
    import pyvista as pv

__all__ = ["HEAVY", "Turning", "coarse"]

HEAVY = 400_000  # triangles that software draws in about a tenth of a second
_CELLS = 160  # along the longest side: a cell is a few pixels of a window


def coarse(body: Body, cells: int = _CELLS) -> Body:
    """The same body of fewer triangles: points within a cell of a grid become one of them (Rossignac and Borrel 1993).

    :param cells: along its longest side.
    """
    low, size = body.points.min(axis=0), float(np.ptp(body.points, axis=0).max()) or 1.0
    place = np.minimum((body.points - low) * (cells / size), cells - 1).astype(np.int64)
    key = (place[:, 0] * cells + place[:, 1]) * cells + place[:, 2]
    _, first, home = np.unique(key, return_index=True, return_inverse=True)
    faces = home.ravel()[body.faces]
    a, b, c = faces.T
    kept = np.flatnonzero((a != b) & (b != c) & (c != a))
    # Of triangles that fell onto each other one is enough, whichever way it turns.
    _, once = np.unique(np.sort(faces[kept], axis=1), axis=0, return_index=True)
    kept = kept[np.sort(once)]
    return replace(
        body,
        points=body.points[first],
        faces=faces[kept],
        samples=body.samples[first],
        triangles=kept if body.triangles is None else body.triangles[kept],
        colours=None if body.colours is None else body.colours[first],
        texture=None if body.texture is None else body.texture.of(kept),
    )


class Turning:
    """What is drawn at rest, and what while the window is turned.

    :ivar fine: at rest.
    :param plotter: whose interaction is watched.
    :param pairs: actors, of which the fine ones are seen at rest, and the coarse ones while it turns.
    :param smoothed: anti-aliased at rest.
    :param prepared: called before the coarse ones are seen.
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
        """The coarse ones."""
        self._prepared()
        self._show(fine=False)

    def rest(self, *_: Any) -> None:
        """The fine ones."""
        self._show(fine=True)

    def _show(self, *, fine: bool) -> None:
        self.fine = fine
        window: Any = self.plotter
        if not self._smoothed:
            pass
        elif fine:
            window.enable_anti_aliasing("ssaa", all_renderers=True)
        else:  # in software it takes longer than all the rest
            window.disable_anti_aliasing(all_renderers=True)
        for one, other in self.pairs:
            one.SetVisibility(fine)
            other.SetVisibility(not fine)
