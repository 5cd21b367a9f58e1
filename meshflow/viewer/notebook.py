"""The viewer inside a notebook: the page of all states in a frame of the cell, with its sliders; no server, no display."""

from dataclasses import dataclass
from html import escape
from typing import Any, Unpack

from meshflow.estimate.request import Request
from meshflow.flow.progress import Progress
from meshflow.view.appearance import taken
from meshflow.view.look import Looks, looking
from meshflow.viewer.controls import States
from meshflow.viewer.page import page_of
from meshflow.viewer.session import Desk, Saving, Session

__all__ = ["Sliders", "sliders"]


@dataclass(frozen=True, eq=False, repr=False)
class Sliders:
    """A page that a notebook displays as the value of a cell.

    :ivar page: the HTML, complete in itself.
    :ivar notes: sentences for the user.
    :ivar height: of the frame, pixels.
    """

    page: str
    notes: tuple[str, ...]
    height: int

    def __repr__(self) -> str:
        return f"Sliders({len(self.page) / 1e6:.1f} MB of HTML)"

    def _repr_html_(self) -> str:
        """The page in a frame, so that its styles and scripts do not meet those of the notebook."""
        style = f"width: 100%; height: {self.height}px; border: 0"
        return f'<iframe sandbox="allow-scripts" style="{style}" srcdoc="{escape(self.page)}"></iframe>'


def sliders(
    data: Any,
    *,
    request: Request | None = None,
    states: States = States(),  # noqa: B008 - frozen
    height: int = 620,
    progress: Progress = None,
    **look: Unpack[Looks],
) -> Sliders:
    """The flow of data over time in a notebook: a slider over its states, what was removed as colours, and the curves of the run.

    Example:

        >>> from meshflow.estimate.request import Request
        >>> from meshflow.synthetic import mesas, noisy
        >>> sliders(noisy(mesas(24), 2.0), request=Request.of("quick"), states=States(3))._repr_html_()[:7]
        '<iframe'

    :param data: as in :func:`meshflow.smooth`.
    :param request: of the flow, as ``Request.of(method=..., time=...)``; options that are not given are estimated.
    :param states: their number, and the memory that they may use.
    :param height: of the frame, pixels.
    :param progress: of the run, as in :func:`meshflow.smooth`.
    :param look: the fields of :class:`meshflow.view.Look`.
    :returns: an object that the notebook displays.
    :raises InputError: for data that cannot be smoothed or drawn.
    """
    seen = looking(**look)
    surface, notes = taken(data, seen.own_colours)
    desk = Desk(Session.begun(surface, request or Request(), states.count, states.memory), data, Saving())
    page, more = page_of(desk.session.run(progress), seen, desk.command)
    return Sliders(page, (*notes, *more), height)
