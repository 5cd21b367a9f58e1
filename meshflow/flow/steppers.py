"""Time steppers: explicit Euler, semi-implicit Euler, super-time-stepping."""

from dataclasses import dataclass
from typing import Literal, Protocol, TypeGuard

import numpy as np

from meshflow.errors import InputError, NotConverged
from meshflow.flow.blend import Blend, euler
from meshflow.flow.contract import Flow, MatrixFree, Ordered, System
from meshflow.flow.linear_solve import Method, solve
from meshflow.flow.super_time import reach, schedule, stages
from meshflow.flow.workspace import Workspace
from meshflow.geometry.options import expected, must_be_object, named_fields, spelled
from meshflow.geometry.validation import Array, positive

__all__ = [
    "FEW",
    "Embedding",
    "Explicit",
    "SemiImplicit",
    "Stepper",
    "StepperName",
    "SuperTime",
    "counted_in",
    "embeds",
    "stepper_for",
    "stepper_word",
]

StepperName = Literal["auto", "explicit", "semi-implicit", "super-time"]
STEPPERS: tuple[StepperName, ...] = ("auto", "explicit", "semi-implicit", "super-time")

# Up to this number of explicit steps, super-time steps of equal accuracy take as many rates.
FEW = 48
# The factor by which the bound may grow during a step; the bound exceeds the fastest decay by as much.
SLACK = 1.25


class Stepper(Protocol):
    """Takes one step in time."""

    name: str

    @property
    def rates(self) -> int:
        """The number of rates of the largest step."""
        ...

    def step(self, flow: Flow, u: Array, dt: float, diagonal: int = 0, workspace: Workspace | None = None) -> Array:
        """The free coordinates (n, k) after time dt.

        :param diagonal: the number of steps before this one, which selects the diagonal of its first rate.
        :param workspace: arrays of the run to write to; by default arrays for this step only.
        """
        ...

    def largest(self, flow: Flow, u: Array) -> float:
        """The largest stable step at u; infinite where every step is stable."""
        ...


class Embedding(Stepper, Protocol):
    """A stepper that estimates its error."""

    def tried(
        self, flow: Flow, u: Array, dt: float, explicit: float, diagonal: int = 0, workspace: Workspace | None = None
    ) -> tuple[Array, float]:
        """A step, and its root mean square error.

        :param explicit: the longest explicit step at u.
        """
        ...

    def endured(self, dt: float, explicit: float, then: float) -> bool:
        """Whether a step of dt was stable to its end.

        :param explicit: the longest explicit step at its start; ``then``: at its end.
        """
        ...

    @property
    def stretch(self) -> float:
        """The length of its largest step, in explicit steps."""
        ...


def embeds(stepper: Stepper) -> TypeGuard[Embedding]:
    """Whether a stepper estimates its error. (To ask isinstance of a protocol takes as long as a step of a small grid.)"""
    return all(hasattr(stepper, word) for word in ("tried", "endured", "stretch"))


@named_fields
@dataclass(frozen=True)
class Explicit:
    """u + dt rate(u): first order, stable for dt <= 2 / bound (h^2 / 6 on a grid of spacing h, for any data)."""

    name = "explicit"
    rates = 1

    def step(self, flow: Flow, u: Array, dt: float, diagonal: int = 0, workspace: Workspace | None = None) -> Array:
        """The free coordinates (n, k) after time dt."""
        return flow.rate(u, diagonal, euler(dt), (workspace or Workspace(flow)).take())

    def largest(self, flow: Flow, u: Array) -> float:
        """2 / bound of the triangles as they are at u."""
        bound = flow.bound(u)
        return 2.0 / bound if bound > 0 else np.inf


def counted_in(flow: Flow, u: Array) -> float:
    """The explicit step in which the stages of a super-time step are counted."""
    return Explicit().largest(flow, u) * flow.pace


@named_fields
@dataclass(frozen=True)
class SuperTime:
    """Super-time-stepping, Runge-Kutta-Legendre (Meyer, Balsara, Aslam 2014): s rates reach s^2 / 2 explicit steps.

    A step has as many stages as it needs, each with its own metric. It uses three arrays besides u, four for second order.

    :param order: 1, or 2, whose stages reach half as far.
    :param stages: the largest number of stages of a step.
    """

    order: Literal[1, 2] = 1
    stages: int = 50
    name = "super-time"

    def __post_init__(self) -> None:
        if self.order not in (1, 2):
            raise InputError(f"order: 1 or 2 expected, got {self.order!r}")
        if int(self.stages) != self.stages or self.stages < 3:
            raise InputError(f"stages: a whole number, 3 or more, expected, got {self.stages}")

    @property
    def rates(self) -> int:
        """The largest number of stages."""
        return self.stages

    def step(self, flow: Flow, u: Array, dt: float, diagonal: int = 0, workspace: Workspace | None = None) -> Array:
        """The free coordinates (n, k) after time dt."""
        return self.counted(flow, u, dt, counted_in(flow, u), diagonal, workspace)

    def counted(
        self, flow: Flow, u: Array, dt: float, explicit: float, diagonal: int = 0, workspace: Workspace | None = None
    ) -> Array:
        """:meth:`step`, where the length of :func:`counted_in` is known.

        :param explicit: that length.
        """
        workspace, count = workspace or Workspace(flow), self.count(dt, explicit)
        last, *spent = self._stages(flow, u, dt, diagonal, count, workspace)
        workspace.give(*spent)
        return last

    def tried(
        self, flow: Flow, u: Array, dt: float, explicit: float, diagonal: int = 0, workspace: Workspace | None = None
    ) -> tuple[Array, float]:
        """A step, and its root mean square error, to the order of the step."""
        workspace, count = workspace or Workspace(flow), self.count(dt, explicit)
        last, before, *drift = self._stages(flow, u, dt, diagonal, count, workspace)
        of_last, of_before, of_start, of_rate = schedule(self.order, count).error
        terms = [(of_last, last), (of_before, before), (of_start, u), *((of_rate * dt, rate) for rate in drift)]
        error = flow.size(*terms, roughly=True)[0]
        workspace.give(before, *drift)
        return last, error

    def endured(self, dt: float, explicit: float, then: float) -> bool:
        """False where triangles have become so thin during the step that its stages were unstable."""
        return SLACK * then * reach(self.order, self.count(dt, explicit)) >= dt

    @property
    def stretch(self) -> float:
        """The reach of the largest number of stages."""
        return reach(self.order, self.stages)

    def largest(self, flow: Flow, u: Array) -> float:
        """The reach of the largest number of stages, with explicit steps that are stable at u."""
        return counted_in(flow, u) * self.stretch

    def count(self, dt: float, explicit: float) -> int:
        """The number of stages of a step, enough to compare the last two.

        :param dt: the length of the step; ``explicit``: that of :func:`counted_in`.
        """
        return max(self.order + 1, stages(self.order, dt / explicit))

    def _stages(
        self, flow: Flow, u: Array, dt: float, diagonal: int, count: int, workspace: Workspace
    ) -> tuple[Array, ...]:
        """The last stage, the one before it, and for second order the rate at u."""
        plan, take = schedule(self.order, count), workspace.take
        if self.order == 1:
            drift, first = (), euler(plan.first * dt)
        else:
            drift = (flow.rate(u, diagonal, out=take()),)
            first = Blend(1.0, 0.0, drift=(plan.first * dt, drift[0]))
        before, last = u, flow.rate(u, diagonal, first, take())
        for j, (back, home, rate, begin) in enumerate(zip(plan.back, plan.home, plan.rate, plan.begin, strict=True), 1):
            stage = Blend(1.0, rate * dt, ((back, before),))
            if drift:
                stage = Blend(1.0, rate * dt, ((back, before), (home, u)), (begin * dt, drift[0]))
            out = take() if before is u else before
            before, last = last, flow.rate(last, diagonal + j, stage, out)
        return (last, before, *drift)


@named_fields
@dataclass(frozen=True)
class SemiImplicit:
    """(M / s + dt L) (u+ - u) = dt (M / s) rate(u): current metric, positions at the end [DMSB99]; stable for every dt.

    It solves for the change, so that a surface at rest keeps every bit. Corrections at the boundary are lagged in the rate.

    :param solver: ``auto | direct | cg | multigrid``; on grids ``auto`` and ``cg`` need no matrix.
    :param tolerance: relative residual of the change.
    """

    solver: Method = "auto"
    tolerance: float = 1e-9
    name = "semi-implicit"
    rates = 1

    def __post_init__(self) -> None:
        positive(self.tolerance, "tolerance")

    def step(self, flow: Flow, u: Array, dt: float, diagonal: int = 0, workspace: Workspace | None = None) -> Array:
        """The free coordinates (n, k) after time dt."""
        workspace, rate = workspace or Workspace(flow), flow.rate(u, diagonal)
        if not rate.any():
            out = workspace.take()
            out[:] = u
            return out
        change = self._solved(flow.system(u, diagonal), dt, rate)
        return np.add(u, change, out=workspace.take(), casting="same_kind")

    def largest(self, flow: Flow, u: Array) -> float:
        """Infinite: every step lowers the Dirichlet energy of the current metric."""
        return np.inf

    def _solved(self, system: System, dt: float, rate: Array) -> Array:
        right = np.multiply(rate, dt * system.mass[:, None], out=rate if rate.dtype == np.float64 else None)
        if self.solver in ("auto", "cg") and isinstance(system, MatrixFree):
            try:
                return system.conjugate_gradients(dt, right, self.tolerance)
            except NotConverged:
                if self.solver == "cg":
                    raise
        order, matrix = system.order if isinstance(system, Ordered) else None, system.matrix(dt)
        del system  # the triangles are no longer needed
        return solve(matrix, right, None, self.solver, self.tolerance, order)


def stepper_word(word: Stepper | StepperName) -> Stepper | StepperName:
    """A stepper, or the name of one.

    :raises InputError: for an unknown name, a class, or an object that is neither.
    """
    must_be_object(word, "stepper: a stepper")
    if isinstance(word, str):
        for name in STEPPERS:
            if spelled(word, (name,)):
                return name
        raise InputError(f"stepper: {expected(word, STEPPERS)}")
    if not isinstance(word, (Explicit, SuperTime, SemiImplicit)) and not hasattr(word, "step"):
        raise InputError(f"stepper: {expected(word, STEPPERS)}")
    return word


def stepper_for(word: Stepper | StepperName, flow: Flow, time: float | None) -> Stepper:
    """The stepper of a name; ``auto`` chooses one.

    It chooses explicit steps where they are few, super-time-stepping where that saves rates, and the semi-implicit stepper where
    slivers of a mesh would make even those too many.

    :raises InputError: for an unknown word, and super-time steps of a flow of which no stage is stable.
    """
    word = stepper_word(word)
    if flow.pace == 0:
        if word == "super-time" or isinstance(word, SuperTime):
            raise InputError(
                "stepper='super-time': only explicit steps keep the range of the values here; leave it out"
            )
        word = "explicit" if word == "auto" else word
    if not isinstance(word, str):
        return word
    if word == "auto":
        steps, longest = 0.0 if time is None else time * flow.bound(flow.start()) / 2.0, SuperTime()
        few = steps * longest.rates <= flow.patience * longest.stretch
        word = "explicit" if steps <= FEW else "super-time" if few else "semi-implicit"
    return {"explicit": Explicit(), "semi-implicit": SemiImplicit(), "super-time": SuperTime()}[word]
