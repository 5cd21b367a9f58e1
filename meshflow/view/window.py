"""The viewer as a window of VTK: a body, a slider over its states; curves, knobs, and what another thread does beside it."""

from contextlib import closing
from typing import Any

from meshflow.geometry.lift import Noun
from meshflow.view.background import Background, Gone
from meshflow.view.column import Column
from meshflow.view.curves import across, told
from meshflow.view.dials import Dials
from meshflow.view.look import Look
from meshflow.view.screen import Colouring, Screen
from meshflow.view.timeline import Timeline

__all__ = ["Window"]

POLL = 100  # milliseconds after which the window looks what has become of the work in the other thread
HINT = "r: what was removed, s: save this state, c: the command that makes it, q: close"
_DOING = {"run": "computing", "state": "computing this state again", "save": "saving"}


class Window:
    """A window that shows a timeline. Nothing that takes long is done in its own thread.

    :ivar screen: what is drawn.
    :ivar column: what stands beside it.
    :ivar index: of the state that the slider is at.
    :ivar message: what is to be said: an error, where a state was saved, the command.
    :param dials: what can be turned.
    :param off_screen: draw without a window, for tests and pictures.
    :raises InputError: where there is no display.
    :raises MissingPackage: where VTK cannot draw.
    """

    def __init__(self, dials: Dials, timeline: Timeline, look: Look, off_screen: bool = False) -> None:
        self.dials, self.timeline = dials, timeline
        self.screen = Screen(timeline.at(0), timeline.at(len(timeline) - 1), look, off_screen, column=True)
        self.column = Column(self.screen.plotter)
        self.index, self.message = len(timeline) - 1, ""
        self._colouring: Colouring = "surface"
        self._work = Background()
        self._values: dict[str, Any] = {}
        self._knobs()
        self.column.plot(timeline)
        self._slider = self.column.slide_states(len(timeline) - 1, self.index, self.move)
        self.move(self.index)

    def show(self) -> None:
        """Open it; back when it is closed, and a run that nobody waits for any more is left."""
        plotter: Any = self.screen.plotter
        plotter.add_timer_event(max_steps=10**9, duration=POLL, callback=lambda _: self.poll())
        for key, done in (("r", self.recolour), ("s", self.save), ("c", self.command)):
            plotter.add_key_event(key, done)
        with closing(plotter):
            plotter.show(auto_close=False)
        self._work.leave()

    def move(self, index: float) -> None:
        """To another state; one that is not in memory is computed again, and what was seen stays until then."""
        self.index = min(max(round(index), 0), len(self.timeline) - 1)
        self.column.mark_at(float(across(self.timeline)[self.index]))
        if self.index in self.timeline.kept:
            self._seen(self.index, self.timeline.at(self.index))
            return
        timeline, wanted = self.timeline, self.index
        self._work.ask(
            "state", lambda _: timeline.at(wanted), lambda noun: self._again(timeline, wanted, noun), self._failed
        )
        self._say()

    def recolour(self) -> None:
        """The surface as it is, or in the colours of what was removed."""
        self._colouring = "surface" if self._colouring == "removed" else "removed"
        self.move(self.index)

    def turn(self, name: str, value: Any) -> None:
        """A knob stands elsewhere: what is computed is left, and another run begins."""
        if value == self._values[name]:
            return
        self._values = {**self._values, name: value}
        values = dict(self._values)
        self._work.ask("run", lambda gone: self._ran(values, gone), self._arrived, self._failed)
        self._say()

    def poll(self) -> None:
        """Show what the other thread has done, or how far it is."""
        busy = bool(self._work.kind)
        self._work.poll()
        if busy:
            self._say()

    def save(self) -> None:
        """Write the state that the slider is at."""
        time = self.timeline.moments[self.index].time
        self._work.ask("save", lambda _: self.dials.save(time), self._failed, self._failed)
        self._say()

    def command(self) -> None:
        """Show the command line that makes this state."""
        self.message = self.dials.command(self.timeline.moments[self.index].time)
        self._say()

    def _ran(self, values: dict[str, Any], gone: Gone) -> Timeline | None:
        return self.dials.run(values, gone)

    def _arrived(self, timeline: Timeline | None) -> None:
        """The states of another run; another method has other knobs."""
        if timeline is None:
            return
        self.timeline, self.message = timeline, ""
        self.dials.shown(timeline)
        self.screen.recoloured(timeline.at(len(timeline) - 1))
        self.column.plot(timeline)
        if {control["name"] for control in self.dials.controls()} != set(self._values):
            self._knobs()
        self.move(self.index)

    def _again(self, timeline: Timeline, index: int, noun: Noun) -> None:
        """A state that was computed again; shown, if it is still wanted."""
        if timeline is self.timeline and index == self.index:
            self._seen(index, noun)

    def _seen(self, index: int, noun: Noun) -> None:
        self.screen.show(noun, self._colouring)
        self._say()

    def _failed(self, message: str) -> None:
        self.message = message
        self._say()

    def _knobs(self) -> None:
        controls = self.dials.controls()
        self._values = {control["name"]: control["value"] for control in controls}
        self.column.turn_knobs(controls, self.turn)

    def _say(self) -> None:
        kind = self._work.kind
        self.column.busy(self._work.share if kind else None)
        doing = f"{_DOING[kind]}, {100 * self._work.share:.0f} %" if kind == "run" else _DOING.get(kind, "")
        self.column.say(*told(self.timeline, self.index).split(", "), HINT, doing or self.message)
        self.screen.plotter.render()
