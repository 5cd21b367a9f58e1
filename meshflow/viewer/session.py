"""The session of a viewer: data, its flow over time, and the controls of the flow."""

import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Unpack
from weakref import ref

import numpy as np

from meshflow.errors import InputError
from meshflow.estimate.command_line import flags_of
from meshflow.estimate.parameters import Parameter, squared_unit
from meshflow.estimate.plan import Plan
from meshflow.estimate.planning import plan_of_flow
from meshflow.estimate.reported import parameters_of
from meshflow.estimate.request import Request
from meshflow.flow.methods import POINT_METHODS, method_of
from meshflow.flow.methods.beltrami import Beltrami, HeightMethod
from meshflow.flow.progress import Progress
from meshflow.io.files import Document, write
from meshflow.results.result import Result
from meshflow.results.run import run
from meshflow.results.run import states as flowing
from meshflow.surfaces.data import Data
from meshflow.surfaces.mesh import Mesh
from meshflow.view.appearance import flowing_together, taken
from meshflow.view.look import Look, Looks, looking
from meshflow.viewer.browser import Served
from meshflow.viewer.controls import Address, Page, States
from meshflow.viewer.page import exportable, exported
from meshflow.viewer.timeline import MEMORY, Timeline, recorded
from meshflow.viewer.window import Window

__all__ = ["Desk", "Control", "Saving", "Session", "view"]

# Controls: least and largest value, and whether these are factors on the initial value.
CONTROLS = {
    "scale": (0.25, 4.0, True),
    "gamma": (-2.0, 4.0, False),
    "sharpness": (1.0, 8.0, False),
    "patch": (0.0, 3.0, False),
    "contrast": (0.1, 10.0, True),
    "order": (1.0, 20.0, False),
    "crease_contrast": (0.1, 10.0, True),
    "crease_sharpness": (1.0, 16.0, False),
    "normal_weight": (0.1, 10.0, True),
    "feature_length": (0.1, 10.0, True),
}


@dataclass(frozen=True)
class Control:
    """A number that the user can change.

    :ivar name: an option of the method, or ``scale``.
    :ivar value: its current value.
    :ivar unit: its unit; may be empty.
    :ivar grows: whether it changes by factors instead of steps.
    """

    name: str
    value: float
    low: float
    high: float
    unit: str = ""
    grows: bool = False


@dataclass(frozen=True, eq=False)
class Session:
    """Data, its flow, and the controls of the flow.

    :ivar data: before smoothing.
    :ivar request: the flow, with the estimated numbers.
    :ivar controls: numbers that the user can change.
    :ivar sigma: the noise, in the unit of the values; 0 where none was found.
    """

    data: Data
    request: Request
    controls: tuple[Control, ...]
    sigma: float
    count: int = 32
    memory: int = MEMORY

    @classmethod
    def begun(cls, data: Data, request: Request, count: int = 32, memory: int = MEMORY) -> "Session":
        """Begin a session; options that are not given are estimated.

        :param count: the number of states.
        :param memory: bytes of states that are kept.
        :raises InputError: for data that cannot or need not be smoothed, and for stops, which the slider replaces.
        """
        if request.stops or request.steps is not None:
            raise InputError("view: the slider says when to stop; leave out steps, residual, area_loss, displacement")
        plan = plan_of_flow(data, request)
        if plan.idle is not None:
            raise InputError(f"view: nothing to show, {plan.idle}")
        if not plan.time:
            raise InputError("view: a time of 0 shows one state; give a time or a scale")
        settled = _settled(plan, request)
        return cls(data, settled, _controls(settled, parameters_of(plan)), plan.noise.sigma, count, memory)

    def turned(self, **values: float | str) -> "Session":
        """The session with other numbers; controls keep their ranges.

        :raises InputError: for a name that is no control, or an invalid number.
        """
        there = {control.name for control in self.controls} | ({"method"} if _moves(self.data) else set())
        strange = set(values) - there
        if strange:
            raise InputError(f"{', '.join(sorted(strange))}: no such control; there are {', '.join(sorted(there))}")
        changed: dict[str, Any] = dict(values)
        word = changed.pop("method", self.word)
        scale = float(changed.pop("scale", self.request.scale or 0.0))
        if word != self.word:
            fresh = replace(self.request, method=method_of(str(word)), scale=scale)
            return Session.begun(self.data, fresh, self.count, self.memory)
        if "order" in changed:
            changed["order"] = round(float(changed["order"]))
        method = self.request.method
        if method is not None and changed:
            method = replace(method, **changed)
        controls = tuple(
            replace(control, value=float(values.get(control.name, control.value))) for control in self.controls
        )
        return replace(self, request=replace(self.request, method=method, scale=scale), controls=controls)

    @property
    def word(self) -> str:
        """The name of the method."""
        return "" if self.request.method is None else self.request.method.word

    def run(self, progress: Progress = None) -> Timeline:
        """Compute all states.

        :param progress: as in :func:`meshflow.smooth`; an exception that it raises ends the run.
        """
        states = flowing(self.data, self.request, self.count, progress)
        return recorded(states, self.at, self.sigma, squared_unit(self.data), self.memory)

    def at(self, time: float) -> Data:
        """The state at a time, equal to that of the command line."""
        return self.result(time).after

    def result(self, time: float) -> Result:
        """The run to a time, equal to that of the command line."""
        return run(self.data, self.to(time), record=None)

    def to(self, time: float) -> Request:
        """The flow that ends at a time."""
        return replace(self.request, scale=None, time=time)


class Turned(Exception):  # noqa: N818 - not an error: a control was changed, and the run is no longer needed
    """The run was cancelled, because the controls were changed."""


@dataclass(frozen=True)
class Saving:
    """How a chosen state is saved, and the command line that makes it.

    :param source: the input on the command line.
    :param target: where a state is saved.
    :param overwrite: replace an existing file.
    :param read_as: arguments of the command line for reading the source.
    """

    source: str = "IN"
    target: Path | None = None
    overwrite: bool = False
    read_as: tuple[str, ...] = ()


class Desk:
    """The controls for pages and windows: a session, and how its states are saved.

    :param data: the original data; states of a Document can be saved.
    """

    def __init__(self, session: Session, data: Any, saving: Saving) -> None:
        self.session, self._data, self._saving = session, data, saving
        self._made: tuple[ref[Timeline], Session] | None = None

    def controls(self) -> list[dict[str, Any]]:
        """The controls for a page; for points of a mesh also the method."""
        found: list[dict[str, Any]] = []
        if _moves(self.session.data):
            words = [found.word for found in POINT_METHODS]
            found.append({"name": "method", "label": "method", "value": self.session.word, "items": words})
        for control in self.session.controls:
            unit = f" ({control.unit})" if control.unit else ""
            step = (control.high - control.low) / 200 if control.name != "order" else 1.0
            ends = {"low": control.low, "high": control.high, "step": step}
            found.append(
                {
                    "name": control.name,
                    "label": f"{control.name.replace('_', ' ')}{unit}",
                    "value": control.value,
                    **ends,
                }
            )
        return found

    def run(self, values: dict[str, Any], gone: Callable[[float], bool]) -> Timeline | None:
        """The states with these values; None where ``gone`` cancelled the run."""
        there = {
            control.name: float(values[control.name]) for control in self.session.controls if control.name in values
        }
        method = values.get("method")
        session = self.session.turned(**(there if method in (None, self.session.word) else {"method": str(method)}))

        def report(now: float, total: float) -> None:
            """Report the progress, and end a run that is no longer needed."""
            if gone(now / total if total else 1.0):
                raise Turned

        try:
            timeline = session.run(report)
        except Turned:
            return None
        self._made = ref(timeline), session
        return timeline

    def shown(self, timeline: Timeline) -> None:
        """Make the session of this run the current one; runs that are no longer needed must not be saved."""
        if self._made is not None and self._made[0]() is timeline:
            self.session = self._made[1]

    def command(self, time: float) -> str:
        """The command line that makes the state at a time."""
        saving = self._saving
        request = self.session.to(time)
        words = [*saving.read_as, *flags_of(request)]
        return shlex.join(["meshflow", "smooth", saving.source, str(saving.target or "OUT"), *words])

    def save(self, time: float) -> str:
        """Write the state that :meth:`command` makes; returns a sentence that names the file.

        :raises InputError: where the data was not read from a file, or the target exists and must not be replaced.
        """
        target = self._saving.target
        if target is None or not isinstance(self._data, Document):
            raise InputError("save: only states of a file can be saved; read one, or run the command that is shown")
        result = self.session.result(time)
        tags = {f"meshflow:{name}": word for name, word in result.tags.items()}
        write(self._data.holding(result.after), target, overwrite=self._saving.overwrite, tags=tags)
        return f"written: {target}"


def view(
    data: Any,
    *,
    place: Address | Page | None = None,
    request: Request | None = None,
    states: States = States(),  # noqa: B008 - frozen
    saving: Saving | None = None,
    progress: Progress = None,
    **look: Unpack[Looks],
) -> tuple[str, ...]:
    """View the flow of data over time: a slider over its states, and controls for the numbers of the method.

    :param data: a :class:`meshflow.Document`, a data object, or anything that :func:`meshflow.smooth` takes.
    :param place: None: a window; an :class:`Address`: a page that this machine serves until Ctrl-C; a :class:`Page`: one file
        that opens offline.
    :param request: of the flow, as ``Request.of(method=..., time=...)``; options that are not given are estimated.
    :param states: their number, and the memory that they may use.
    :param saving: where a chosen state is saved; for a Document only.
    :param progress: of the first run, as in :func:`meshflow.smooth`.
    :param look: the fields of :class:`meshflow.view.Look`.
    :returns: sentences for the user.
    :raises InputError: for data that cannot be smoothed or drawn, and a port that is in use.
    :raises FormatError: for a page that cannot be written, or exists and must not be replaced.
    :raises MissingPackage: for the browser without ``meshflow[web]``, and where VTK cannot draw.
    """
    seen = looking(**look)
    if not (place is None or isinstance(place, (Address, Page))):
        raise InputError(f"place: an Address, a Page, or None for a window, expected; got {place!r}")
    if isinstance(place, Page):
        exportable(place.path, place.overwrite)
    surface, notes = taken(data, seen.own_colours)
    notes += flowing_together(data)
    begun = Session.begun(surface, request or Request(), states.count, states.memory)
    desk = Desk(begun, data, saving or Saving())
    timeline = desk.session.run(progress)
    if isinstance(place, Page):
        written = exported(timeline, place.path, seen, desk.command, overwrite=place.overwrite)
        return (*notes, *written, f"page: {place.path}")
    shown = _windowed(desk, timeline, seen) if place is None else _served(desk, timeline, seen, place)
    return (*notes, *shown)


def _served(desk: Desk, timeline: Timeline, look: Look, address: Address) -> tuple[str, ...]:
    served = Served(desk, timeline, look, address)
    served.serve(lambda url: address.said(f"{url}  (Ctrl-C ends it)"))
    return served.screen.notes


def _windowed(desk: Desk, timeline: Timeline, look: Look) -> tuple[str, ...]:
    window = Window(desk, timeline, look)
    window.show()
    return window.screen.notes


def _moves(data: Data) -> bool:
    return isinstance(data, Mesh) and data.moves != "channels"


def _settled(plan: Plan, request: Request) -> Request:
    """The request with all estimated options as given ones."""
    method = plan.method
    if isinstance(method, HeightMethod):
        exponents = {"gamma": plan.variant.gamma, "sharpness": plan.variant.sharpness, "patch": plan.variant.patch}
        plain = Beltrami(indicator=method.indicator, mass=method.mass, contrast=method.contrast, twicing=0.0)
        method = replace(plain, **exponents)
    return replace(request, method=method, time=None, scale=float(np.sqrt(2.0 * plan.time)))


def _controls(request: Request, parameters: Mapping[str, Parameter]) -> tuple[Control, ...]:
    """The controls: the scale, and the numbers of the method."""
    found = []
    for name, (low, high, grows) in CONTROLS.items():
        value = request.scale if name == "scale" else getattr(request.method, name, None)
        if value is None:
            continue
        low, high = (low * value, high * value) if grows else (min(low, value), max(high, value))
        unit = "" if name == "scale" or name not in parameters else parameters[name].unit
        found.append(Control(name, float(value), float(low), float(high), unit, grows))
    return tuple(found)
