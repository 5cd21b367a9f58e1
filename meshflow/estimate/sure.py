"""Monte Carlo SURE (Ramani, Blu, Unser 2008): the risk of a run, estimated from the noisy data alone, on each of its tiles."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from meshflow.errors import NotConverged
from meshflow.estimate.risk import PROBE, Configuration
from meshflow.flow.constraints import Limit
from meshflow.flow.contract import Flow
from meshflow.flow.steppers import Explicit, SemiImplicit, SuperTime
from meshflow.flow.super_time import stages
from meshflow.flow.workspace import Workspace
from meshflow.geometry.validation import Array

__all__ = ["Copies", "Curve", "Probed", "Seen", "joined", "risks_on", "seen_at"]

# A run ends when its mean square error has exceeded its minimum by BEYOND of it plus SLIGHT of the noise at several times in a
# row; the errors with twicing are then known, too.
BEYOND, SLIGHT = 0.05, 0.01
# A run is slow where two times in a row together lower its minimum by less than SLOW of it plus SLIGHT of the noise. Of 28 cases
# (terrains, photographs, mesas, planes) at octaves, none then ends before a time that matters; with 0.05 one does.
SLOW = 0.03
# The largest number of rates of a run; a flow that is not stiff reaches 96 squared sample distances in 200.
RATES = 240
# The implicit step beyond these rates. The risk does not change with a smaller tolerance (three digits, on a globe and on 4000
# random points).
IMPLICIT = SemiImplicit(tolerance=1e-4)
# The remaining share of the noise is between 0 and 1 up to SURE standard errors. A run outside of these bounds is unstable.
LEAST_LEFT, MOST_LEFT, SURE = -0.05, 1.5, 4.0


@dataclass(frozen=True, eq=False)
class Curve:
    """The expected error of a configuration over time, on tiles.

    :ivar sums: sum of the squared error over each tile (g,), by the weight of twicing and the time.
    :ivar sizes: (g,), the number of values in each tile.
    :ivar sound: whether the run was stable.
    """

    sums: Mapping[float, Mapping[float, Array]]
    sizes: Array
    sound: bool = True

    def mean(self, weight: float, time: float) -> float:
        """The mean square error, squared unit of the values."""
        return float(self.sums[weight][time].sum() / self.sizes.sum())


def joined(curves: Iterable[Curve]) -> Curve:
    """The curves of one configuration on several pieces as one curve, at the times that all of them reached."""
    curves = tuple(curves)
    sums = {
        weight: {
            time: np.concatenate([curve.sums[weight][time] for curve in curves])
            for time in at
            if all(time in curve.sums[weight] for curve in curves)
        }
        for weight, at in curves[0].sums.items()
    }
    return Curve(sums, np.concatenate([curve.sizes for curve in curves]), all(curve.sound for curve in curves))


class Copies(Protocol):
    """Copies of the same data that are run together."""

    @property
    def places(self) -> Array:
        """(c, m), indices of the samples that are counted, in each copy."""
        ...

    def flow(self, configuration: Configuration) -> tuple[Flow, Limit | None]:
        """The flow, and the limit of changes."""
        ...


@dataclass(frozen=True, eq=False)
class Probed:
    """Data, and copies of it that start at u0 + PROBE sigma b, one for each probe b.

    :ivar copies: all of them; the first one is the data itself.
    :ivar begins: (g,), index of the first counted sample of each tile.
    :ivar probes: (p, k, m), b at the counted samples, of deviation 1, correlated like the noise.
    :ivar sigma: (k, m) or (k, 1), the noise.
    :ivar relative: (k, m), unit of the error at each sample, in proportion to its noise; None: all equal.
    :ivar implicit: whether steps beyond RATES are implicit, as those of a run are that slivers make stiff.
    """

    copies: tuple[Copies, ...]
    begins: Array
    probes: Array
    sigma: Array
    relative: Array | None = None
    implicit: bool = False

    @cached_property
    def sizes(self) -> Array:
        """(g,), the number of counted values of each tile."""
        _, k, m = self.probes.shape
        return k * np.diff(self.begins, append=m)

    @cached_property
    def square(self) -> float:
        """The mean square of the noise, squared unit of the values: the risk of unchanged data."""
        return float(np.mean(np.square(self.sigma if self.relative is None else self.sigma / self.relative)))

    @cached_property
    def pull(self) -> Array:
        """(p, k, m), factors whose product with the difference of copy and data is sigma^2 times the remaining share of the
        noise.
        """
        each = self.sigma if self.relative is None else self.sigma / np.square(self.relative)
        norm = len(self.probes) * np.mean(np.square(self.probes, dtype=np.float64), axis=2, keepdims=True)
        return (self.probes * (each / PROBE) / norm).astype(self.probes.dtype)

    def sums(self, values: Array) -> Array:
        """(g,), the sum of values (k, m) over each tile."""
        return np.add.reduceat(values, self.begins, axis=1, dtype=np.float64).sum(axis=0)

    def counted(self, states: Sequence[Array]) -> Array:
        """(1 + p, k, m), the counted samples of the data and of all copies, from the states (n, k)."""
        taken = [np.take(u.T, part.places, axis=1) for u, part in zip(states, self.copies, strict=True)]
        return np.concatenate([np.swapaxes(one, 0, 1) for one in taken])


@dataclass(frozen=True, eq=False)
class Seen:
    """A state of a run.

    :ivar change: (k, m), from the start.
    :ivar square: (g,), sum of its square over each tile.
    :ivar left: (g,), sum over each tile of sigma^2 times the remaining share of the noise.
    """

    change: Array
    square: Array
    left: Array

    @classmethod
    def of(cls, probed: Probed, now: Array, start: Array) -> "Seen":
        """From the counted samples ``now`` (1 + p, k, m), and those of the data at the start (k, m)."""
        change = now[0] - start if probed.relative is None else (now[0] - start) / probed.relative
        left = np.einsum("pkm,pkm->km", now[1:] - now[0], probed.pull)
        return cls(change, probed.sums(change * change), probed.sums(left))

    def twiced(self, probed: Probed, later: "Seen", weight: float) -> "Seen":
        """The state with twicing: adds ``weight`` times the change that the flow makes until twice the time, with opposite
        sign.
        """
        change = self.change + weight * (self.change - later.change)
        return Seen(change, probed.sums(change * change), self.left + weight * (self.left - later.left))


def risks_on(
    probed: Probed,
    configuration: Configuration,
    times: Sequence[float],
    weights: Sequence[float],
    patience: int,
    until_slow: bool = False,
) -> Curve:
    """The expected squared error on each tile.

    It is |u - u0|^2 - sigma^2 + 2 sigma^2 b . (u(u0 + e b) - u(u0)) / e: the change, minus the noise, plus the remaining noise,
    measured by runs that start at u0 + e b. For correlated noise b has its covariance.

    :param times: positive and increasing; the error with twicing is known at times whose double is also among them.
    :param weights: of twicing; they need no further run.
    :param patience: the run ends when the risk has exceeded its minimum by 5 % at more than this many times in a row.
    :param until_slow: whether it also ends when the risk hardly falls any more.
    """
    sums: dict[float, dict[float, Array]] = {weight: {} for weight in weights}
    seen: dict[float, Seen] = {}
    minima, worse = [probed.square], 0
    for time, now in _walk(probed, configuration, times):
        seen[time] = now
        if not _stable(probed, now):
            return Curve(sums, probed.sizes, sound=False)
        latest = _recorded(probed, seen, time, sums)
        least = min(minima[-1], latest)
        minima.append(least)
        worse = worse + 1 if latest > least + BEYOND * (abs(least) + SLIGHT * probed.square) else 0
        if worse > patience or (until_slow and _slow(minima, probed.square)):
            break
        seen = {past: one for past, one in seen.items() if past >= 0.5 * time}
    return Curve(sums, probed.sizes)


def seen_at(probed: Probed, configuration: Configuration, times: Sequence[float], at: float) -> Seen | None:
    """The state of a configuration at time ``at``, with its twicing; None if the run does not reach it."""
    weight, found = configuration.twice, {}
    for time, now in _walk(probed, configuration, times):
        if time in (at, 2.0 * at):
            found[time] = now
        if time >= (2.0 * at if weight > 0 else at):
            break
    now, later = found.get(at), found.get(2.0 * at)
    if weight == 0 or now is None:
        return now
    return None if later is None else now.twiced(probed, later, weight)


def _walk(probed: Probed, configuration: Configuration, times: Sequence[float]) -> Iterator[tuple[float, Seen]]:
    """The state at each time. It ends early if a stiff flow needs more than RATES evaluations and may not be implicit."""
    flows, limits = zip(*(part.flow(configuration) for part in probed.copies), strict=True)
    spaces, explicit = [Workspace(flow) for flow in flows], SuperTime()
    states, since, spent = [flow.start() for flow in flows], 0.0, 0
    start = probed.counted(states)[0]
    for count, time in enumerate(times):
        longest = [Explicit().largest(flow, u) for flow, u in zip(flows, states, strict=True)]
        steps = (time - since) / max(min(longest), np.finfo(float).tiny)
        rates = stages(1, min(steps, float(RATES**2)))
        spent += rates
        if spent > RATES and not probed.implicit:
            return
        before, dt, moved = states, time - since, zip(flows, states, longest, spaces, strict=True)
        try:
            if spent > RATES:
                states = [IMPLICIT.step(flow, u, dt, count, space) for flow, u, _, space in moved]
            else:  # the bound of a state is measured once
                states = [explicit.counted(flow, u, dt, one * flow.pace, count, space) for flow, u, one, space in moved]
        except NotConverged:  # what is known up to here remains
            return
        states = [u if limit is None else limit.hold(u) for u, limit in zip(states, limits, strict=True)]
        for space, u in zip(spaces, before, strict=True):
            if count > 0:
                space.give(u)
        since = time
        yield time, Seen.of(probed, probed.counted(states), start)


def _recorded(
    probed: Probed, seen: Mapping[float, Seen], time: float, sums: Mapping[float, dict[float, Array]]
) -> float:
    """Adds the risks that are known at a time to ``sums``, and returns the least mean square error of them."""
    now, half, found = seen[time], seen.get(0.5 * time), []
    noise = probed.square * probed.sizes
    cross = None if half is None else probed.sums(now.change * half.change)
    for weight, at in sums.items():
        if weight == 0:
            at[time] = now.square + 2.0 * now.left - noise
            found.append(float(at[time].sum()))
        elif half is not None and cross is not None:
            a, b = 1.0 + weight, -weight
            square = a * a * half.square + 2.0 * a * b * cross + b * b * now.square
            at[0.5 * time] = square + 2.0 * (a * half.left + b * now.left) - noise
            found.append(float(at[0.5 * time].sum()))
    return min(found) / float(probed.sizes.sum()) if found else probed.square


def _slow(minima: Sequence[float], square: float) -> bool:
    """Whether a minimum of the risk, once it was below that of unchanged data, has hardly fallen at the last two times.

    :param minima: the least risk up to each time, the first one that of unchanged data, ``square``.
    """
    if len(minima) < 4 or minima[-3] >= square:
        return False
    return minima[-3] - minima[-1] < SLOW * (abs(minima[-3]) + SLIGHT * square)


def _stable(probed: Probed, seen: Seen) -> bool:
    """Whether the remaining share of the noise is within its bounds, up to its standard error."""
    share = seen.left / (probed.square * probed.sizes)
    if not np.isfinite(share).all() or not np.isfinite(seen.square).all():
        return False
    mean = float(seen.left.sum() / (probed.square * probed.sizes.sum()))
    slack = SURE * float(np.std(share)) / float(np.sqrt(len(share)))
    return LEAST_LEFT - slack <= mean <= MOST_LEFT + slack
