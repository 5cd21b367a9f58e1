"""The viewer as a window of VTK: a slider over the states, knobs at its side, and another thread that computes what is turned."""

from collections.abc import Callable
from contextlib import closing
from threading import Thread
from typing import Any

from meshflow.errors import InputError
from meshflow.view.curves import told
from meshflow.view.dials import Dials
from meshflow.view.look import Look
from meshflow.view.screen import Colouring, Screen
from meshflow.view.timeline import Timeline

__all__ = ["Window"]

POLL = 100  # milliseconds after which the window looks whether a run has ended
HINT = "r: what was removed    s: save this state    c: print the command    q: close"


class Window:
    """A window that shows a timeline.

    :ivar screen: what is drawn.
    :param dials: what can be turned.
    :param off_screen: draw without a window, for tests and pictures.
    :raises InputError: where there is no display.
    :raises MissingPackage: where VTK cannot draw.
    """

    def __init__(self, dials: Dials, timeline: Timeline, look: Look, off_screen: bool = False) -> None:
        self.dials, self.timeline = dials, timeline
        self.screen = Screen(timeline.at(0), timeline.at(len(timeline) - 1), look, off_screen)
        self.index, self.colouring = len(timeline) - 1, "surface"
        self._values = {control["name"]: control["value"] for control in dials.controls() if "items" not in control}
        self._wanted, self._running = 0, False
        self._share, self._message = 0.0, ""
        self._ready: tuple[int, Timeline | None, str] | None = None
        self._sliders()
        self.move(self.index)

    def show(self) -> None:
        """Open it; back when it is closed, and a run that nobody waits for any more is left."""
        plotter: Any = self.screen.plotter
        plotter.add_timer_event(max_steps=10**9, duration=POLL, callback=lambda _: self.poll())
        for key, done in (("r", self.recolour), ("s", self.save), ("c", self.command)):
            plotter.add_key_event(key, done)
        with closing(plotter):
            plotter.show(auto_close=False)
        self._wanted += 1

    def move(self, index: float) -> None:
        """To another state."""
        self.index = min(max(round(index), 0), len(self.timeline) - 1)
        colouring: Colouring = "removed" if self.colouring == "removed" else "surface"
        self.screen.show(self.timeline.at(self.index), colouring)
        self._say()

    def recolour(self) -> None:
        """The surface as it is, or in the colours of what was removed."""
        self.colouring = "surface" if self.colouring == "removed" else "removed"
        self.move(self.index)

    def turn(self, name: str, value: float) -> None:
        """A knob stands elsewhere: what is computed is left, and another run begins."""
        if value == self._values[name]:
            return
        self._values = {**self._values, name: value}
        self._wanted += 1
        if not self._running:
            self._begin()

    def poll(self) -> None:
        """Show what another thread has computed, or how far it is."""
        if self._ready is None:
            if self._running:
                self._say()
            return
        (wanted, timeline, message), self._ready = self._ready, None
        self._running, self._message = False, message
        if wanted != self._wanted:
            self._begin()
        elif timeline is not None:
            self.timeline = timeline
            self.screen.recoloured(timeline.at(len(timeline) - 1))
            self.move(self.index)
        self._say()

    def save(self) -> None:
        """Write the state that is shown."""
        try:
            self._message = self.dials.save(self.timeline.moments[self.index].time)
        except (InputError, OSError) as cause:
            self._message = str(cause)
        self._say()

    def command(self) -> None:
        """Show the command line that makes this state."""
        self._message = self.dials.command(self.timeline.moments[self.index].time)
        self._say()

    def _begin(self) -> None:
        self._running, self._share = True, 0.0
        Thread(target=self._run, args=(self._wanted, dict(self._values)), daemon=True).start()

    def _run(self, wanted: int, values: dict[str, Any]) -> None:
        def gone(share: float) -> bool:
            self._share = share
            return wanted != self._wanted

        timeline, message = None, ""
        try:
            timeline = self.dials.run(values, gone)
        except (InputError, RuntimeError) as cause:
            message = str(cause)
        self._ready = (wanted, timeline, message)

    def _say(self) -> None:
        busy = f"computing, {100 * self._share:.0f} %" if self._running else self._message
        lines = "\n".join(line for line in (told(self.timeline, self.index), busy, HINT) if line)
        self.screen.plotter.add_text(lines, position="upper_left", font_size=9, color="black", name="told")

    def _sliders(self) -> None:
        self._slider(
            self.move,
            rng=(0, len(self.timeline) - 1),
            value=self.index,
            title="state",
            pointa=(0.3, 0.06),
            pointb=(0.97, 0.06),
            fmt="%.0f",
            interaction_event="always",
        )
        for k, control in enumerate(c for c in self.dials.controls() if "items" not in c):
            height = 0.06 + 0.12 * k
            self._slider(
                lambda value, name=control["name"]: self.turn(name, value),
                rng=(control["low"], control["high"]),
                value=control["value"],
                title=control["label"],
                pointa=(0.02, height),
                pointb=(0.2, height),
                fmt="%.3g",
                interaction_event="end",
            )

    def _slider(self, moved: Callable[[float], None], **options: Any) -> None:
        """A slider that takes little room: title and value stand apart, in small letters."""
        plotter: Any = self.screen.plotter
        widget = plotter.add_slider_widget(
            moved, title_height=0.016, color="#26282b", slider_width=0.016, tube_width=0.002, **options
        )
        shown = widget.GetRepresentation()
        shown.SetLabelHeight(0.016)
        shown.SetSliderLength(0.012)
        shown.SetEndCapLength(0.003)
        shown.SetEndCapWidth(0.012)
