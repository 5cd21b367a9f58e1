"""Monte Carlo SURE (Ramani, Blu, Unser 2008): the risk of a run, estimated from the noisy data alone, on each of its tiles."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from meshflow.estimate.risk import PROBE, Configuration
from meshflow.flow.constraints import Limit
from meshflow.flow.contract import Flow
from meshflow.flow.steppers import Explicit, SuperTime
from meshflow.flow.super_time import stages
from meshflow.flow.workspace import Workspace
from meshflow.geometry.validation import Array

__all__ = ["Copies", "Curve", "Probed", "Seen", "joined", "risks_on", "seen_at"]

# A run is given up when its mean square error has stayed above its least, by this share and this share of the noise, for some
# times: what is given back by twicing is known by then.
BEYOND, SLIGHT = 0.05, 0.01
# The largest number of rates of a run; a flow that is not stiff reaches 96 squared sample distances in 200.
RATES = 240
# What of the noise is left lies between nothing and all, but for its own standard error; a run that says otherwise is unstable.
LEAST_LEFT, MOST_LEFT, SURE = -0.05, 1.5, 4.0


@dataclass(frozen=True, eq=False)
class Curve:
    """What a configuration is expected to leave on tiles.

    :ivar sums: of the squared error over each tile (g,), by the weight of twicing and the time.
    :ivar sizes: (g,), how many numbers those are of.
    :ivar sound: whether the run was stable as far as it went.
    """

    sums: Mapping[float, Mapping[float, Array]]
    sizes: Array
    sound: bool = True

    def mean(self, weight: float, time: float) -> float:
        """The mean square error, squared unit of the values."""
        return float(self.sums[weight][time].sum() / self.sizes.sum())


def joined(curves: Iterable[Curve]) -> Curve:
    """The curves of one configuration on several pieces as one, at the times that all of them have come to."""
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
    """Copies of one data that are moved together."""

    @property
    def places(self) -> Array:
        """(c, m), of the samples that are counted, in each copy."""
        ...

    def flow(self, configuration: Configuration) -> tuple[Flow, Limit | None]:
        """What moves them, and what they are held to."""
        ...


@dataclass(frozen=True, eq=False)
class Probed:
    """Data, and beside it copies that start at u0 + PROBE sigma b, one for each probe b.

    :ivar copies: all of them; the first one is the data itself.
    :ivar begins: (g,), where among the samples that are counted each tile begins.
    :ivar probes: (p, k, m), b at those samples, of deviation 1, correlated as the noise.
    :ivar sigma: (k, m) or (k, 1), the noise.
    :ivar relative: (k, m), what errors are counted in, of mean square 1; None: all alike.
    """

    copies: tuple[Copies, ...]
    begins: Array
    probes: Array
    sigma: Array
    relative: Array | None = None

    @cached_property
    def sizes(self) -> Array:
        """(g,), how many numbers of each tile are counted."""
        _, k, m = self.probes.shape
        return k * np.diff(self.begins, append=m)

    @cached_property
    def square(self) -> float:
        """The mean square of the noise, squared unit of the values: the risk of leaving all as it is."""
        return float(np.mean(self.sigma**2))

    @cached_property
    def pull(self) -> Array:
        """(p, k, m), what makes of the way between copy and data sigma^2 times the share of the noise that is left."""
        each = self.sigma if self.relative is None else self.sigma / np.square(self.relative)
        norm = len(self.probes) * np.mean(np.square(self.probes, dtype=np.float64), axis=2, keepdims=True)
        return (self.probes * (each / PROBE) / norm).astype(self.probes.dtype)

    def sums(self, values: Array) -> Array:
        """(g,), the sum of values (k, m) over each tile."""
        return np.add.reduceat(values, self.begins, axis=1, dtype=np.float64).sum(axis=0)

    def counted(self, states: Sequence[Array]) -> Array:
        """(1 + p, k, m), the samples that are counted, of the data and of all copies, from the states (n, k)."""
        taken = [np.take(u.T, part.places, axis=1) for u, part in zip(states, self.copies, strict=True)]
        return np.concatenate([np.swapaxes(one, 0, 1) for one in taken])


@dataclass(frozen=True, eq=False)
class Seen:
    """A state: what has changed (k, m), the sums over tiles (g,) of its square, and sigma^2 times what is left of the noise."""

    change: Array
    square: Array
    left: Array

    @classmethod
    def of(cls, probed: Probed, now: Array, start: Array) -> "Seen":
        """From the samples that are counted (1 + p, k, m), and where those of the data began (k, m)."""
        change = now[0] - start if probed.relative is None else (now[0] - start) / probed.relative
        left = np.einsum("pkm,pkm->km", now[1:] - now[0], probed.pull)
        return cls(change, probed.sums(change * change), probed.sums(left))

    def twiced(self, probed: Probed, later: "Seen", weight: float) -> "Seen":
        """With what the flow still takes by twice the time given back, times a weight."""
        change = self.change + weight * (self.change - later.change)
        return Seen(change, probed.sums(change * change), self.left + weight * (self.left - later.left))


def risks_on(
    probed: Probed, configuration: Configuration, times: Sequence[float], weights: Sequence[float], patience: int
) -> Curve:
    """The squared error to be expected on each tile.

    |u - u0|^2 - sigma^2 + 2 sigma^2 b . (u(u0 + e b) - u(u0)) / e: what was changed, less the noise, plus what of the noise is
    left, measured by runs that start beside the first by e b. For correlated noise b has its covariance.

    :param times: growing, above zero; twicing with a weight above zero is known at a time of which the double is among them.
    :param weights: of twicing; they cost no further run.
    :param patience: the run ends when the risk has been above its least, by 5 %, at more than so many times in a row.
    """
    sums: dict[float, dict[float, Array]] = {weight: {} for weight in weights}
    seen: dict[float, Seen] = {}
    least, worse = probed.square, 0
    for time, now in _walk(probed, configuration, times):
        seen[time] = now
        if not _stable(probed, now):
            return Curve(sums, probed.sizes, sound=False)
        latest = _told(probed, seen, time, sums)
        least = min(least, latest)
        worse = worse + 1 if latest > least + BEYOND * (abs(least) + SLIGHT * probed.square) else 0
        if worse > patience:
            break
        seen = {past: one for past, one in seen.items() if past >= 0.5 * time}
    return Curve(sums, probed.sizes)


def seen_at(probed: Probed, configuration: Configuration, times: Sequence[float], at: float) -> Seen | None:
    """What a configuration does to the data by a time, with its twicing; None where it does not come so far."""
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
    """What is seen at each time, until so many rates are spent that a flow is too stiff to be worth its run."""
    flows, limits = zip(*(part.flow(configuration) for part in probed.copies), strict=True)
    spaces, stepper = [Workspace(flow) for flow in flows], SuperTime()
    states, since, spent = [flow.start() for flow in flows], 0.0, 0
    start = probed.counted(states)[0]
    for count, time in enumerate(times):
        longest = min(Explicit().largest(flow, u) for flow, u in zip(flows, states, strict=True))
        spent += stages(1, (time - since) / max(longest, np.finfo(float).tiny))
        if spent > RATES:
            return
        before, moved = states, zip(flows, states, spaces, strict=True)
        states = [stepper.step(flow, u, time - since, count, space) for flow, u, space in moved]
        states = [u if limit is None else limit.hold(u) for u, limit in zip(states, limits, strict=True)]
        for space, u in zip(spaces, before, strict=True):
            if count > 0:
                space.give(u)
        since = time
        yield time, Seen.of(probed, probed.counted(states), start)


def _told(probed: Probed, seen: Mapping[float, Seen], time: float, sums: Mapping[float, dict[float, Array]]) -> float:
    """Write down the risks that are known at a time; the least mean square error of them."""
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


def _stable(probed: Probed, seen: Seen) -> bool:
    """Whether what is left of the noise is a share of it, as far as that is known."""
    share = seen.left / (probed.square * probed.sizes)
    if not np.isfinite(share).all() or not np.isfinite(seen.square).all():
        return False
    mean = float(seen.left.sum() / (probed.square * probed.sizes.sum()))
    slack = SURE * float(np.std(share)) / float(np.sqrt(len(share)))
    return LEAST_LEFT - slack <= mean <= MOST_LEFT + slack
