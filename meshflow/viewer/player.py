"""The base of window and page: the current state of a flow, and the computations of a second thread."""

from collections.abc import Callable
from typing import Any

from meshflow.surfaces.data import Data
from meshflow.viewer.controls import Controls
from meshflow.viewer.screen import Colouring, Screen
from meshflow.viewer.timeline import Timeline
from meshflow.viewer.worker import Background, Gone

__all__ = ["Player"]


class Player:
    """The states of a flow, the controls that change it, and a second thread that computes for both.

    A window and a page are players, and decide where text and controls are placed.

    :ivar screen: the plotter.
    :ivar index: of the state at the slider.
    :ivar colouring: of the surface.
    :param desk: the controls.
    """

    def __init__(self, desk: Controls, timeline: Timeline, screen: Screen) -> None:
        self.desk, self.timeline, self.screen = desk, timeline, screen
        self.index = len(timeline) - 1
        self.colouring: Colouring = "surface"
        self._work = Background()
        self._values: dict[str, Any] = {}

    def move(self, index: float) -> None:
        """Show another state. A state that is not in memory is computed again; until then the old one is shown."""
        self.index = min(max(round(index), 0), len(self.timeline) - 1)
        self._marked()
        timeline, wanted = self.timeline, self.index
        if wanted in timeline.kept:
            self._seen(timeline.at(wanted))
            return

        def again(data: Data) -> None:
            """Show the computed state, if it is still the requested one."""
            if timeline is self.timeline and wanted == self.index:
                self._seen(data)

        self._ask("state", lambda _: timeline.at(wanted), again, self._failed)

    def save(self) -> None:
        """Write the state at the slider."""
        time = self.timeline.history[self.index].time
        self._ask("save", lambda _: self.desk.save(time), self._saved, self._saved)

    def _run(self, values: dict[str, Any]) -> None:
        """Cancel the current run and start a new one with these values of the controls."""
        self._ask("run", lambda gone: self.desk.run(values, gone), self._arrived, self._failed)

    def _arrived(self, timeline: Timeline | None) -> None:
        """Show the states of a new run; another method has other controls."""
        if timeline is None:
            return
        self.timeline = timeline
        self.desk.shown(timeline)
        self.screen.recoloured(timeline.at(len(timeline) - 1))
        self._plotted()
        if {control["name"] for control in self.desk.controls()} != set(self._values):
            self._show_controls()
        self.move(self.index)

    def _ask(
        self, kind: str, work: Callable[[Gone], Any], done: Callable[[Any], None], failed: Callable[[str], None]
    ) -> None:
        self._work.ask(kind, work, done, failed)
        self._asked()

    # --- overridden by window and page ----------------------------------------------------------------------------------

    def _asked(self) -> None:
        """A computation was requested: poll until it is done."""
        raise NotImplementedError

    def _marked(self) -> None:
        """The current state has changed."""
        raise NotImplementedError

    def _seen(self, data: Data) -> None:
        """Show a state."""
        raise NotImplementedError

    def _plotted(self) -> None:
        """Show the curves of another run."""
        raise NotImplementedError

    def _show_controls(self) -> None:
        """Show the controls of another flow."""
        raise NotImplementedError

    def _failed(self, message: str) -> None:
        """Show an error."""
        raise NotImplementedError

    def _saved(self, message: str) -> None:
        """Show where a state was saved, or why not."""
        raise NotImplementedError
