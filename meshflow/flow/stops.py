"""When a run has come far enough: by what it has done to the surface, each by name, found to within a step."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from meshflow.errors import InputError
from meshflow.flow.contract import Flow
from meshflow.geometry.validation import Array, positive

__all__ = ["AreaLoss", "Displacement", "Residual", "Stop", "When", "crossing", "unmet"]

# How finely the place of a stop within a step is sought, as a share of the step.
FINELY = 1e-4


class Stop(Protocol):
    """Something that a run comes to."""

    def excess(self, flow: Flow, u: Array, time: float) -> float:
        """Above or at zero where u is there, below where it is not yet."""
        ...

    def words(self, flow: Flow, u: Array, time: float) -> str:
        """What was asked for and how far u has come, as part of a sentence."""
        ...


@dataclass(frozen=True)
class Residual:
    """The root mean square change has reached a share of the noise; at all of it the flow has smoothed too long.

    :param share: of sigma, above 0.
    :param sigma: the noise as the flow measures it, unit of u, of a sample with all its channels.
    :param there: the share of the samples that are there; those that are not do not move and are not counted.
    """

    share: float
    sigma: float
    there: float = 1.0

    def __post_init__(self) -> None:
        if positive(self.share, "residual", "shares of sigma") > 1:
            raise InputError(f"residual: a share of the noise up to 1 expected, got {self.share}; beyond it data goes")

    def excess(self, flow: Flow, u: Array, time: float) -> float:
        """Share of sigma that has gone, over what was asked for, minus 1."""
        return self._gone(flow, u) / self.share - 1.0

    def words(self, flow: Flow, u: Array, time: float) -> str:
        """As part of a sentence."""
        return f"a residual of {self._gone(flow, u):.3g} sigma ({self.share:g} asked for)"

    def _gone(self, flow: Flow, u: Array) -> float:
        change = flow.size((1.0, u), (-1.0, flow.start()))[0]
        return change / np.sqrt(self.there) / self.sigma if self.sigma > 0 else np.inf


@dataclass(frozen=True)
class AreaLoss:
    """The area has fallen by a share of what it was (El-Fallah and Ford; section 5.6).

    :param share: in (0, 1).
    """

    share: float

    def __post_init__(self) -> None:
        if positive(self.share, "area_loss", "shares of the area") >= 1:
            raise InputError(f"area_loss: a share of the area between 0 and 1 expected, got {self.share}")

    def excess(self, flow: Flow, u: Array, time: float) -> float:
        """Share that is lost, over what was asked for, minus 1."""
        return self._lost(flow, u) / self.share - 1.0

    def words(self, flow: Flow, u: Array, time: float) -> str:
        """As part of a sentence."""
        return f"an area loss of {self._lost(flow, u):.3g} ({self.share:g} asked for)"

    def _lost(self, flow: Flow, u: Array) -> float:
        before = flow.area(flow.start())
        return 1.0 - flow.area(u) / before if before > 0 else 0.0


@dataclass(frozen=True)
class Displacement:
    """A vertex has moved as far as this since the start.

    :param most: unit of u, above 0.
    :param unit: units of u for one of the caller's, for the words.
    """

    most: float
    unit: float = 1.0

    def __post_init__(self) -> None:
        positive(self.most, "displacement")

    def excess(self, flow: Flow, u: Array, time: float) -> float:
        """Greatest displacement over what was asked for, minus 1."""
        return self._moved(flow, u) / self.most - 1.0

    def words(self, flow: Flow, u: Array, time: float) -> str:
        """As part of a sentence."""
        return f"a displacement of {self._moved(flow, u) / self.unit:.4g} ({self.most / self.unit:g} asked for)"

    def _moved(self, flow: Flow, u: Array) -> float:
        return flow.size((1.0, u), (-1.0, flow.start()))[1]


@dataclass(frozen=True)
class When:
    """A callable of the caller's says so.

    :param asked: (values, time) to a truth value, or to a number that is zero where the run shall end and negative before.
    :param seen: makes what the caller sees of u.
    """

    asked: Callable[[Any, float], Any]
    seen: Callable[[Array], Any] = np.asarray

    def __post_init__(self) -> None:
        if not callable(self.asked):
            raise InputError(f"stop: a callable (values, time) expected, got {self.asked!r}")

    def excess(self, flow: Flow, u: Array, time: float) -> float:
        """The number, or 1 and -1 for true and false."""
        said = self.asked(self.seen(u), time)
        if isinstance(said, (bool, np.bool_)):
            return 1.0 if said else -1.0
        number = np.asarray(said, dtype=np.float64)
        if number.ndim != 0 or not np.isfinite(number):
            raise InputError(f"stop: the callable shall return true, false or a finite number, got {said!r}")
        return float(number)

    def words(self, flow: Flow, u: Array, time: float) -> str:
        """As part of a sentence."""
        return f"what {getattr(self.asked, '__name__', 'the callable')} asked for"


def crossing(
    stops: Sequence[Stop], flow: Flow, before: tuple[Array, float], after: tuple[Array, float]
) -> tuple[Array, float, str] | None:
    """Where within a step the first stop is met: u on the straight line between its ends, the time, and which it was.

    :param before: u and time at the beginning of the step; ``after``: at its end.
    :returns: None where none is met.
    """
    from scipy.optimize import root_scalar

    found: tuple[float, Stop] | None = None
    (old, since), (new, until) = before, after

    def blend(share: float) -> Array:
        return old + np.asarray(share, old.dtype) * (new - old)

    def over(share: float, stop: Stop) -> float:
        u = old if share == 0 else new if share == 1 else blend(share)
        return stop.excess(flow, u, since + share * (until - since))

    for stop in stops:
        if over(1.0, stop) < 0:
            continue
        share = 0.0
        if over(0.0, stop) < 0:
            share = float(root_scalar(over, args=(stop,), bracket=(0.0, 1.0), method="brentq", xtol=FINELY).root)
        if found is None or share < found[0]:
            found = share, stop
    if found is None:
        return None
    share, stop = found
    u, time = new if share == 1 else blend(share), since + share * (until - since)
    return u, time, stop.words(flow, u, time)


def unmet(stops: Sequence[Stop], flow: Flow, u: Array, time: float) -> str:
    """What a run that ends at its time did not come to, as the end of a sentence; empty where nothing was asked for."""
    return ", before " + " and ".join(stop.words(flow, u, time) for stop in stops) if stops else ""
