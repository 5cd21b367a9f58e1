"""Stops: criteria that end a run by what it has done to the surface. They are located within a step."""

from collections.abc import Callable, Sequence
from dataclasses import MISSING, dataclass
from functools import partial
from typing import Protocol

import numpy as np

from meshflow.errors import InputError
from meshflow.flow.contract import Flow
from meshflow.geometry.options import named_fields, option
from meshflow.geometry.validation import Array, positive, shown, whole

__all__ = [
    "AreaLoss",
    "Course",
    "Displacement",
    "Met",
    "Residual",
    "Scale",
    "Steps",
    "Stop",
    "When",
    "crossing",
    "place_of",
    "unmet",
]

# The place of a stop within a step is a multiple of this share of the step, so that sums in another order find the same one; of
# an area a coarser one, because windows interpolate it within the step. And the tolerance in which it is looked for before.
FINELY, FINELY_BY_AREA, FINER = 2.0**-20, 2.0**-13, 1e-12


def _same(values: Array) -> Array:
    return values


@dataclass(frozen=True)
class Scale:
    """Converts between the numbers of the caller and those of a run.

    :ivar sigma: the noise of a sample with all its channels, in the unit of u.
    :ivar there: the share of the samples that are not missing and may move; the others are not counted.
    :ivar seen: converts u (n, k) to the values of the caller.
    """

    sigma: float = 0.0
    there: float = 1.0
    seen: Callable[[Array], Array] = _same


@dataclass(frozen=True, eq=False)
class Course:
    """What a stop needs to know of a run: the flow, and the scale of the caller's numbers."""

    flow: Flow
    scale: Scale


class Stop(Protocol):
    """A criterion that ends a run."""

    def excess(self, course: Course, u: Array, time: float) -> float:
        """Zero or positive where u meets the criterion, negative before."""
        ...

    def words(self, course: Course, u: Array, time: float) -> str:
        """The criterion and the value at u, as part of a sentence."""
        ...


@named_fields
@dataclass(frozen=True)
class Steps:
    """Stop after a number of steps; the method is then not searched for.

    :param count: zero or more.
    """

    count: int = option(MISSING, "Stop after this many steps.", flag="steps")

    def __post_init__(self) -> None:
        whole(self.count, "steps", 0)


@named_fields
@dataclass(frozen=True)
class Residual:
    """Stop when the root mean square change reaches a share of the noise; a share of 1 smooths a little too much.

    :param share: of sigma, above 0, up to 1; a larger one is refused, since it removes signal.
    """

    share: float = option(
        0.9,
        "Stop when the rms change is this share of the noise. Values near 0.9 are best.",
        "of the noise",
        "residual",
    )

    def __post_init__(self) -> None:
        if positive(self.share, "residual", "shares of sigma") > 1:
            raise InputError(
                f"residual: a share of the noise up to 1 expected, got {self.share}; a larger one removes signal"
            )

    def excess(self, course: Course, u: Array, time: float) -> float:
        """The share of sigma that was removed, over the requested one, minus 1."""
        return self.over(self._gone(course, u))

    def over(self, gone: float) -> float:
        """The excess where a share of sigma was removed."""
        return gone / self.share - 1.0

    def words(self, course: Course, u: Array, time: float) -> str:
        """As part of a sentence."""
        return self.said(self._gone(course, u))

    def said(self, gone: float) -> str:
        """As part of a sentence, where a share of sigma was removed."""
        return f"a residual of {gone:.3g} sigma ({self.share:g} asked for)"

    def _gone(self, course: Course, u: Array) -> float:
        scale = course.scale
        change = course.flow.size((1.0, u), (-1.0, course.flow.start()))[0]
        return change / np.sqrt(scale.there) / scale.sigma if scale.sigma > 0 else np.inf


@named_fields
@dataclass(frozen=True)
class AreaLoss:
    """Stop when the area has decreased by a share of its initial value (El-Fallah and Ford; section 5.6).

    :param share: in (0, 1).
    """

    share: float = option(0.01, "Stop when this share of the area has been lost.", "of the area", "area-loss")

    def __post_init__(self) -> None:
        if positive(self.share, "area_loss", "shares of the area") >= 1:
            raise InputError(f"area_loss: a share of the area between 0 and 1 expected, got {self.share}")

    def excess(self, course: Course, u: Array, time: float) -> float:
        """The lost share, over the requested one, minus 1."""
        return self.over(self._lost(course.flow, u))

    def over(self, lost: float) -> float:
        """The excess where a share of the area is lost."""
        return lost / self.share - 1.0

    def words(self, course: Course, u: Array, time: float) -> str:
        """As part of a sentence."""
        return self.said(self._lost(course.flow, u))

    def said(self, lost: float) -> str:
        """As part of a sentence, where a share of the area is lost."""
        return f"an area loss of {lost:.3g} ({self.share:g} asked for)"

    def _lost(self, flow: Flow, u: Array) -> float:
        before = flow.area(flow.start())
        return 1.0 - flow.area(u) / before if before > 0 else 0.0


@named_fields
@dataclass(frozen=True)
class Displacement:
    """Stop when a sample has moved this far since the start.

    :param most: unit of the values (of a mesh: of its points), above 0.
    """

    most: float = option(1.0, "Stop when a sample has moved this far.", "unit of the values", "displacement")

    def __post_init__(self) -> None:
        positive(self.most, "displacement")

    def excess(self, course: Course, u: Array, time: float) -> float:
        """The largest displacement over the requested one, minus 1."""
        return self._moved(course.flow, u) / self.most - 1.0

    def words(self, course: Course, u: Array, time: float) -> str:
        """As part of a sentence."""
        return f"a displacement of {self._moved(course.flow, u):.4g} ({self.most:g} asked for)"

    def _moved(self, flow: Flow, u: Array) -> float:
        return flow.size((1.0, u), (-1.0, flow.start()))[1]


@named_fields
@dataclass(frozen=True)
class When:
    """Stop when a function of your own says so.

    :param asked: takes (values, time); returns a truth value, or a number that is zero where the run shall end and negative
        before. The values (h, w), (h, w, k) or (n, k) are read-only.
    """

    asked: Callable[[Array, float], object]

    def __post_init__(self) -> None:
        if not callable(self.asked):
            raise InputError(f"stop: a callable (values, time) expected, got {shown(self.asked)}")

    def excess(self, course: Course, u: Array, time: float) -> float:
        """The number, or 1 and -1 for true and false."""
        said = self.asked(course.scale.seen(u), time)
        if isinstance(said, (bool, np.bool_)):
            return 1.0 if said else -1.0
        number = np.asarray(said, dtype=np.float64)
        if number.ndim != 0 or not np.isfinite(number):
            raise InputError(f"stop: true, false or a finite number expected from the callable, got {said!r}")
        return float(number)

    def words(self, course: Course, u: Array, time: float) -> str:
        """As part of a sentence."""
        return f"what {getattr(self.asked, '__name__', 'the callable')} asked for"


@dataclass(frozen=True)
class Met:
    """Where a run has met its stop: within its last step.

    :ivar share: of the step.
    :ivar time: of the end; ``said``: the stop, as part of a sentence.
    """

    share: float
    time: float
    said: str


def place_of(stop: Stop, excess: Callable[[float], float]) -> float:
    """The share of a step at which a stop is met, a multiple of :data:`FINELY`.

    :param excess: of the stop at a share of the step, below zero at its beginning and not at its end.
    """
    from scipy.optimize import root_scalar

    finely = FINELY_BY_AREA if isinstance(stop, AreaLoss) else FINELY
    root = float(root_scalar(excess, bracket=(0.0, 1.0), method="brentq", xtol=FINER).root)
    return round(root / finely) * finely


def crossing(
    stops: Sequence[Stop], course: Course, before: tuple[Array, float], after: tuple[Array, float]
) -> tuple[Array, float, str, float] | None:
    """Where within a step the first stop is met: u, interpolated linearly between the ends of the step, the time, and the stop.

    :param before: u and time at the beginning of the step; ``after``: at its end.
    :returns: None where no stop is met; else u, the time, the sentence, and the share of the step.
    """
    found: tuple[float, Stop] | None = None
    (old, since), (new, until) = before, after

    def blend(share: float) -> Array:
        """u on the straight line between the ends of the step."""
        return old + np.asarray(share, old.dtype) * (new - old)

    def over(share: float, stop: Stop) -> float:
        """By how much a stop is exceeded at a share of the step."""
        u = old if share == 0 else new if share == 1 else blend(share)
        return stop.excess(course, u, since + share * (until - since))

    for stop in stops:
        if over(1.0, stop) < 0:
            continue
        share = 0.0
        if over(0.0, stop) < 0:
            share = place_of(stop, partial(over, stop=stop))
        if found is None or share < found[0]:
            found = share, stop
    if found is None:
        return None
    share, stop = found
    u, time = new if share == 1 else blend(share), since + share * (until - since)
    return u, time, stop.words(course, u, time), share


def unmet(stops: Sequence[Stop], course: Course, u: Array, time: float) -> str:
    """The stops that a run did not reach in its time, as the end of a sentence; empty without stops."""
    return ", before " + " and ".join(stop.words(course, u, time) for stop in stops) if stops else ""
