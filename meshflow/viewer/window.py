"""The viewer as a window of VTK: a surface, a slider over its states, curves, controls, and the progress of a run."""

from contextlib import closing
from typing import Any

from meshflow.surfaces.data import Data
from meshflow.view.look import Look
from meshflow.viewer.column import Column
from meshflow.viewer.controls import Controls
from meshflow.viewer.curves import across, summary
from meshflow.viewer.player import Player
from meshflow.viewer.screen import Screen
from meshflow.viewer.timeline import Timeline

__all__ = ["Window"]

POLL = 100  # milliseconds after which the window looks what has become of the work in the other thread
HINT = "r: what was removed, s: save this state, c: the command for this state, q: close"
_DOING = {"run": "computing", "state": "computing this state again", "save": "saving"}


class Window(Player):
    """A window that shows a timeline. Long computations run in a second thread.

    :ivar column: what stands beside the geometry.
    :ivar message: what is to be said: an error, where a state was saved, the command.
    :param desk: what can be turned.
    :param off_screen: draw without a window, for tests and pictures.
    :raises InputError: where there is no display.
    :raises MissingPackage: where VTK cannot draw.
    """

    def __init__(self, desk: Controls, timeline: Timeline, look: Look, off_screen: bool = False) -> None:
        screen = Screen(timeline.at(0), timeline.at(len(timeline) - 1), look, off_screen, column=True)
        super().__init__(desk, timeline, screen)
        self.column, self.message = Column(screen.plotter), ""
        self._show_controls()
        self._plotted()
        self._slider = self.column.slide_states(len(timeline) - 1, self.index, self.move)
        self.move(self.index)

    def show(self) -> None:
        """Open the window; return when it is closed, and cancel the current run."""
        plotter: Any = self.screen.plotter
        plotter.add_timer_event(max_steps=10**9, duration=POLL, callback=lambda _: self.poll())
        for key, done in (("r", self.recolour), ("s", self.save), ("c", self.command)):
            plotter.add_key_event(key, done)
        with closing(plotter):
            plotter.show(auto_close=False)
        self._work.leave()

    def recolour(self) -> None:
        """Switch between the surface as it is and the colours of what was removed."""
        self.colouring = "surface" if self.colouring == "removed" else "removed"
        self.move(self.index)

    def turn(self, name: str, value: Any) -> None:
        """A control was changed."""
        if value != self._values[name]:
            self._values = {**self._values, name: value}
            self._run(dict(self._values))

    def poll(self) -> None:
        """Show what the other thread has done, or how far it is."""
        busy = bool(self._work.kind)
        self._work.poll()
        if busy:
            self._say()

    def command(self) -> None:
        """Show the command line that makes this state."""
        self._tell(self.desk.command(self.timeline.history[self.index].time))

    def _asked(self) -> None:
        self._say()

    def _marked(self) -> None:
        self.column.mark_at(float(across(self.timeline)[self.index]))

    def _seen(self, data: Data) -> None:
        self.screen.show(data, self.colouring)
        self._say()

    def _plotted(self) -> None:
        self.message = ""
        self.column.plot(self.timeline)

    def _tell(self, message: str) -> None:
        self.message = message
        self._say()

    _failed = _saved = _tell

    def _show_controls(self) -> None:
        controls = self.desk.controls()
        self._values = {control["name"]: control["value"] for control in controls}
        self.column.show_controls(controls, self.turn)

    def _say(self) -> None:
        kind = self._work.kind
        self.column.busy(self._work.share if kind else None)
        doing = f"{_DOING[kind]}, {100 * self._work.share:.0f} %" if kind == "run" else _DOING.get(kind, "")
        self.column.say(*summary(self.timeline, self.index).split(", "), HINT, doing or self.message)
        self.screen.plotter.render()
