"""Which variant of the family, and for how long: the risk estimated from the noisy data alone."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from meshflow.flow.constraints import Limit
from meshflow.flow.contract import Flow
from meshflow.flow.family import Variant
from meshflow.flow.steppers import Explicit, SuperTime
from meshflow.flow.super_time import stages
from meshflow.flow.workspace import Workspace
from meshflow.geometry.validation import Array

__all__ = ["PROBE", "TWICE", "Candidate", "Configuration", "first_of", "ranked", "refined", "risk_curves", "searched"]

# The twin starts beside the flow by this share of the noise: a derivative, to the rounding of single precision.
PROBE = 0.1
# Weights of twicing that are looked at: they cost no further run.
TWICE = (0.0, 0.5, 1.0)
# A run is given up when its mean square error has stayed above its least, by this share and this share of the noise, until the
# time has doubled: what is given back by twicing is known by then.
BEYOND, SLIGHT = 0.05, 0.01
# Rates after which a run is given up: a flow without stiffness reaches 96 squared sample distances in 200.
RATES = 240
# Contrasts tried beside the best one.
FINER = 1.35


@dataclass(frozen=True)
class Configuration:
    """A variant and the contrast it is taken with.

    :ivar contrast: alpha, length per unit of the value.
    :ivar twice: w of u(t) + w (u(t) - u(2 t)), twicing in time (Tukey 1977): what the flow would still take away is given
        back. Of the heat equation with w = 1 the response is 1 - (1 - exp(-k^2 t))^2, flat where the data is.
    :ivar boundary: of the grid it was tried on, where that is another than the data's own.
    """

    variant: Variant
    contrast: float
    twice: float = 0.0
    boundary: str = ""

    @property
    def words(self) -> dict[str, Any]:
        """Names to numbers and words, in reading order."""
        m = self.variant
        named = {"gamma": m.gamma, "sharpness": m.sharpness, "patch": m.patch, "contrast": self.contrast}
        return {**named, "twicing": self.twice, **({"boundary": self.boundary} if self.boundary else {})}


@dataclass(frozen=True)
class Candidate:
    """What a configuration is expected to leave.

    :ivar configuration: a :class:`Configuration`, or another thing with ``words``.
    :ivar times: at which the risk was estimated, squared length; the first is zero.
    :ivar squares: mean square error, squared unit of the values; at time zero sigma^2. What sigma is wrong by shifts all of
        them alike: they may be negative, and are compared all the same.
    """

    configuration: Any
    times: tuple[float, ...]
    squares: tuple[float, ...]

    @property
    def risks(self) -> tuple[float, ...]:
        """Root mean square errors, unit of the values."""
        return tuple(float(np.sqrt(max(square, 0.0))) for square in self.squares)

    @property
    def least(self) -> tuple[float, float]:
        """Time and mean square error where that is least: between the times looked at, by its parabola over the root of time."""
        i = int(np.argmin(self.squares))
        if i == 0 or i == len(self.squares) - 1:
            return self.times[i], self.squares[i]
        x = np.sqrt(self.times[i - 1 : i + 2])
        a, b, c = np.polyfit(x, self.squares[i - 1 : i + 2], 2)
        at = float(np.clip(-b / (2 * a), x[0], x[2])) if a > 0 else float(x[1])
        return at**2, float(a * at * at + b * at + c)

    @property
    def risk(self) -> float:
        """The least root mean square error."""
        return float(np.sqrt(max(self.least[1], 0.0)))


def risk_curves(
    pair: tuple[Flow, Flow],
    probe: Array,
    sigma: float | Array,
    times: Sequence[float],
    counted: Array,
    twices: Sequence[float] = TWICE,
    limits: tuple[Limit, Limit] | None = None,
    patient: bool = False,
) -> dict[float, tuple[float, ...]]:
    """The mean square error to be expected at each of ``times``, by Monte Carlo SURE (Ramani, Blu, Unser 2008).

    mean (u - u0)^2 - sigma^2 + 2 sigma^2 b . (u(u0 + e b) - u(u0)) / (n e): what was changed, less the noise, plus what of
    the noise is left, measured by a second run that starts beside the first by e b, b random signs.

    :param pair: the run, and its twin, which starts at u0 + PROBE sigma probe.
    :param probe: b (n, k), +1 or -1.
    :param sigma: of each coordinate, unit of u; or one for each vertex (n, 1): errors are then counted in it, and told in its
        root mean square.
    :param times: growing, above zero, each twice the one before it, or two before it; the curves end early where the risk
        grows again.
    :param counted: (n,), the vertices that are counted.
    :param twices: weights of twicing; they cost no further run.
    :param limits: what the coordinates of both do not leave.
    :param patient: go on to the last time although the risk grows.
    :returns: for each of ``twices`` one for time zero and for each time up to where it ended, squared unit of u.
    """
    (flow, twin), stepper, spaces = pair, SuperTime(), [Workspace(flow) for flow in pair]
    each = np.broadcast_to(np.asarray(sigma, np.float64), (len(counted), 1))[counted]
    sigma = float(np.sqrt(np.mean(each * each)))
    relative, step, of = each / sigma, PROBE * each, probe[counted].astype(np.float64)
    start, spent, past = flow.start(), 0, []
    u, v, since, worse = start, twin.start(), 0.0, 0
    curves: dict[float, list[float]] = {weight: [sigma**2] for weight in twices}
    back = 1 if len(times) < 2 or times[1] > 1.8 * times[0] else 2
    for count, time in enumerate(times):
        spent += stages(1, (time - since) / max(Explicit().largest(flow, u), np.finfo(float).tiny))
        if spent > RATES:
            break  # so stiff a flow is not worth its run
        old = u, v
        run = zip(pair, (u, v), spaces, strict=True)
        u, v = (stepper.step(move, state, time - since, count, space) for move, state, space in run)
        if limits is not None:
            u, v = limits[0].hold(u), limits[1].hold(v)
        if count > 0:
            for space, state in zip(spaces, old, strict=True):
                space.give(state)
        now = (u - start)[counted].astype(np.float64) / relative, of * (v - u)[counted] / step
        for weight, risks in curves.items():
            if weight > 0 and count < back:
                continue
            one = past[-back] if weight > 0 else now
            change, kept = (a + weight * (a - b) for a, b in zip(one, now, strict=True))
            risks.append(float(np.mean(change * change)) + sigma**2 * (2.0 * float(np.mean(kept)) - 1.0))
        past, since = [*past[-1:], now], time
        least, latest = min(map(min, curves.values())), min(risks[-1] for risks in curves.values())
        worse = worse + 1 if latest > least + BEYOND * (abs(least) + SLIGHT * sigma**2) else 0
        if (worse > back and not patient) or not np.isfinite(latest):
            break
    return {weight: tuple(risks) for weight, risks in curves.items()}


def ranked(candidates: Iterable[Candidate]) -> tuple[Candidate, ...]:
    """Candidates by their least risk, the least first."""
    return tuple(sorted(candidates, key=lambda candidate: candidate.least[1]))


def searched(
    configurations: Iterable[Configuration], tried: Callable[[Configuration], Sequence[Candidate]]
) -> tuple[Candidate, ...]:
    """All candidates of configurations, the best first.

    :param tried: makes the candidates of a configuration, one for each weight of twicing.
    """
    return ranked(candidate for configuration in configurations for candidate in tried(configuration))


def first_of(candidates: Iterable[Candidate], count: int) -> tuple[Configuration, ...]:
    """The best configuration of each of the best variants, whatever its twicing."""
    best: dict[Variant, Configuration] = {}
    for candidate in ranked(candidates):
        best.setdefault(candidate.configuration.variant, replace(candidate.configuration, twice=0.0))
    return tuple(best.values())[:count]


def refined(configuration: Configuration) -> tuple[Configuration, Configuration]:
    """A configuration with more and with less contrast."""
    return (
        replace(configuration, contrast=configuration.contrast * FINER),
        replace(configuration, contrast=configuration.contrast / FINER),
    )
