"""The rounds of a search: all configurations on few tiles, the best on more.

Differences are compared with their standard errors.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from meshflow.estimate.blend import blended
from meshflow.estimate.risk import FINER, Candidate, Configuration
from meshflow.estimate.sure import Curve, Probed, joined, risks_on, seen_at
from meshflow.flow.pools import Pool
from meshflow.geometry.validation import Array

__all__ = ["Best", "Found", "GridSearch", "Runs", "candidates_of", "surely_better", "two_rounds", "weights_of"]

# Times of the first round, in squared sample distances. The second round has half octaves from half to four times the best time.
OCTAVES = (*(2.0**power for power in range(-3, 7)), 96.0)
# The second round has the best and the best of another variant within NEAR standard errors of their difference, at most MOST.
NEAR, MOST = 2.0, 2
# If the risk is below the share SMOOTH of the square of the noise, it is small against its own error. Then twice as many tiles
# are used, and the contrast changes only for a gain of SURE standard errors; otherwise a gain of ALMOST_SURE is enough.
SMOOTH, SURE, ALMOST_SURE = 0.03, 1.0, 0.3
# The largest number of changes of the contrast.
ROUNDS = 3
# The largest number of blended runs, and the least weight of one.
BLENDED, SLIGHT = 3, 0.02
# A curve with a mean square error below this share of the square of the noise is rejected.
BELOW = -0.5


@dataclass(frozen=True, eq=False)
class GridSearch:
    """The input of a search on a grid of two or of three axes.

    :ivar configurations: variants with their contrasts.
    :ivar free: whether other contrasts may be tried.
    :ivar sigma: the noise, unit of the values: per channel (k, 1, 1), per sample (1, h, w), or one number (1, 1, 1).
    :ivar end: the given time, squared length, at which configurations are compared; None: the time is also searched for.
    :ivar weights: of twicing.
    :ivar correlation: (2r+1, 2r+1), correlation of the noise by lag; None: white.
    :ivar between: (k, k), correlation of the noise between channels; None: independent.
    :ivar limit: (k, h, w), the largest change of each sample; None: none.
    :ivar speed: (1, h, w), the mobility; None: all samples are free.
    :ivar blend: whether the best runs may be blended.
    :ivar border: whether the boundary ``neumann`` may be tried.
    :ivar threads: the number of threads.
    """

    configurations: tuple[Configuration, ...]
    free: bool
    sigma: Array
    end: float | None = None
    weights: tuple[float, ...] = (0.0,)
    correlation: Array | None = None
    between: Array | None = None
    limit: Array | None = None
    speed: Array | None = None
    blend: bool = False
    border: bool = False
    threads: int = 1


@dataclass(frozen=True, eq=False)
class Found:
    """The result of a search.

    :ivar candidates: the chosen one first; empty if no estimate is reliable.
    :ivar better: whether the chosen one lowers the error by more than the standard error of that gain.
    :ivar neumann: whether the boundary ``neumann`` has a lower error.
    :ivar weights: of the first candidates, if blending them has a lower risk than the first alone; else empty.
    """

    candidates: tuple[Candidate, ...]
    better: bool = False
    neumann: bool = False
    weights: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class Best:
    """The minimum of a curve.

    :ivar risks: (g,), sum of the squared error over each tile at that time.
    """

    configuration: Configuration
    time: float
    weight: float
    square: float
    risks: Array
    curve: Curve

    def beyond(self, other: "Best") -> float:
        """The standard error of the difference of the two mean risks, from the spread over the tiles."""
        return _error(self.risks - other.risks, self.curve.sizes)


def _octaves(search: GridSearch, unit: float) -> tuple[float, ...]:
    """The times of the first round, squared length."""
    if search.end is None:
        return tuple(time * unit for time in OCTAVES)
    parts = (0.25, 0.5, 1.0, *((2.0,) if max(search.weights) > 0 else ()))
    return tuple(search.end * part for part in parts)


def _fine(search: GridSearch, time: float, unit: float) -> tuple[float, ...]:
    """The times of the second round around the best time, squared length."""
    if search.end is not None:
        return _octaves(search, unit)
    low = 2.0 ** np.floor(np.log2(max(time / unit, OCTAVES[0])) - 1.0)
    times = [t for t in OCTAVES if low / 16.0 <= t <= low] or [low]
    t = low
    while t < OCTAVES[-1] and t < 4.0 * time / unit:
        times += [1.5 * t, 2.0 * t]
        t *= 2.0
    return tuple(t * unit for t in times if t <= OCTAVES[-1])


@dataclass(frozen=True, eq=False)
class Runs:
    """Runs of configurations on pieces, each a job of one thread."""

    search: GridSearch
    parts: tuple[Probed, ...]
    pool: Pool

    def curves(
        self, times: Mapping[Configuration, Sequence[float]], patience: int, until_slow: bool = False
    ) -> Iterable[tuple[Configuration, Curve]]:
        """The curve of each configuration at its times, over all pieces; to the end if that is given."""
        open_ = self.search.end is None
        patience, until_slow = patience if open_ else len(OCTAVES), until_slow and open_
        longest_first = sorted(times, key=lambda one: one.variant.patch == 0)
        waiting = {
            one: [
                self.pool.submit(risks_on, part, one, times[one], self.search.weights, patience, until_slow)
                for part in self.parts
            ]
            for one in longest_first
        }
        return [(one, joined(job.result() for job in waiting[one])) for one in times]

    def best(
        self, times: Mapping[Configuration, Sequence[float]], patience: int, until_slow: bool = False
    ) -> list[Best]:
        """The minimum of the curve of each configuration; unreliable curves are left out."""
        least = BELOW * self.parts[0].square
        found = [
            _least(one, curve, self.search.end)
            for one, curve in self.curves(times, patience, until_slow)
            if curve.sound
        ]
        return [best for best in found if best is not None and best.square >= least]


def _least(configuration: Configuration, curve: Curve, end: float | None) -> Best | None:
    """The minimum over the evaluated times of a curve; None for an empty one."""
    best: Best | None = None
    for weight, at in curve.sums.items():
        for time in at:
            if end is not None and time != end:
                continue
            square = curve.mean(weight, time)
            if best is None or square < best.square:
                best = Best(configuration, time, weight, square, at[time], curve)
    return best


def _error(differences: Array, sizes: Array) -> float:
    """The standard error of the mean over all tiles, from the sum over each tile."""
    return float(np.std(differences) * np.sqrt(len(differences)) / sizes.sum())


def _near(ranked: Sequence[Best]) -> list[Best]:
    """The best, and the best of other variants that may be better than it."""
    near = [ranked[0]]
    for other in ranked[1:]:
        if len(near) == MOST:
            break
        if other.configuration.variant in {one.configuration.variant for one in near}:
            continue
        if other.square <= near[0].square + NEAR * other.beyond(near[0]):
            near.append(other)
    return near


def _sharpened(runs: Runs, fine: Sequence[Best], unit: float) -> list[Best]:
    """Adds runs with higher and lower contrast than the best, while that significantly lowers the risk."""
    best, found = min(fine, key=lambda one: one.square), list(fine)
    if best.configuration.variant.linear:  # it has no contrast
        return found
    sure = SURE if best.square < SMOOTH * runs.parts[0].square else ALMOST_SURE
    factors = [FINER, 1.0 / FINER]
    for _ in range(ROUNDS):
        contrast = best.configuration.contrast
        steps = {
            replace(best.configuration, contrast=contrast * factor): _fine(runs.search, best.time * factor**1.5, unit)
            for factor in factors
        }
        tried = runs.best(steps, 2)
        found += tried
        top = min(tried, key=lambda one: one.square, default=best)
        if top.square + sure * top.beyond(best) >= best.square:
            break
        factors = [top.configuration.contrast / contrast]
        best = top
    return [one for one in found if one is best or one.square >= best.square]


def weights_of(runs: Runs, ranked: Sequence[Best], unit: float) -> tuple[float, ...]:
    """The weights of the best runs in the blend of least risk; empty if the first alone is best."""
    best = ranked[:BLENDED]
    changes, left = np.zeros((len(best), len(best))), np.zeros(len(best))
    for part in runs.parts:
        jobs = [
            runs.pool.submit(
                seen_at,
                part,
                replace(one.configuration, twice=one.weight),
                _fine(runs.search, one.time, unit),
                one.time,
            )
            for one in best
        ]
        seen = [one for job in jobs if (one := job.result()) is not None]
        if len(seen) < len(best):
            return ()
        changes += [[part.sums(a.change * b.change).sum() for b in seen] for a in seen]
        left += [one.left.sum() for one in seen]
    size = sum(part.sizes.sum() for part in runs.parts)
    weights, _ = blended(changes / size, left / size)
    weights = np.where(weights < SLIGHT, 0.0, weights)
    if weights[0] == 0.0 or np.count_nonzero(weights) < 2:
        return ()
    return tuple(float(weight) for weight in weights / weights.sum())


def two_rounds(runs: Runs, unit: float, more: Callable[[bool], tuple[Probed, ...] | None]) -> tuple[Runs, list[Best]]:
    """The best configurations, the first one first, and the runs of the last round; none where no estimate is reliable.

    :param runs: on the pieces of the first round.
    :param unit: the squared sample distance.
    :param more: the pieces of the second round, given whether the data is smooth; None: those of the first round, which are all.
    """
    search, parts = runs.search, runs.parts
    found = runs.best({one: _octaves(search, unit) for one in search.configurations}, 1, until_slow=True)
    if not found:
        return runs, []
    ranked = sorted(found, key=lambda best: best.square)
    near = _near(ranked)
    others = more(ranked[0].square < SMOOTH * parts[0].square)
    runs = runs if others is None else replace(runs, parts=others)
    fine = runs.best({best.configuration: _fine(search, best.time, unit) for best in near}, 2)
    if (
        not fine
    ):  # no estimate on more samples is reliable; those of the first round are, and are compared with each other
        runs, fine = replace(runs, parts=parts), near
    if search.free:
        fine = _sharpened(runs, fine, unit)
    known = {best.configuration for best in fine}
    if runs.parts is parts:  # both rounds used the same samples
        least = min(best.square for best in fine)
        fine = [*fine, *(one for one in found if one.configuration not in known and one.square >= least)]
    return runs, sorted(fine, key=lambda best: best.square)


def surely_better(runs: Runs, best: Best) -> bool:
    """Whether a run lowers the error by more than the standard error of that gain."""
    square = runs.parts[0].square
    return best.square + _error(best.risks - square * best.curve.sizes, best.curve.sizes) < square


def candidates_of(runs: Runs, ranked: Sequence[Best], boundary: str = "") -> tuple[Candidate, ...]:
    """The candidates, each with its risk over time.

    :param boundary: of the first one, if it is not that of the data.
    """
    square, end = runs.parts[0].square, runs.search.end
    return tuple(_candidate(best, ranked[0], square, end, boundary) for best in ranked)


def _candidate(best: Best, chosen: Best, square: float, end: float | None, boundary: str) -> Candidate:
    """The candidate of a configuration: its risk over time."""
    configuration = replace(best.configuration, twice=best.weight, boundary=boundary if best is chosen else "")
    times = tuple(sorted(best.curve.sums[best.weight])) if end is None else (best.time,)
    squares = tuple(best.curve.mean(best.weight, time) for time in times)
    if end is None:
        times, squares = (0.0, *times), (square, *squares)
    doubt = best.beyond(chosen) if len(best.risks) == len(chosen.risks) else 0.0
    return Candidate(configuration, times, squares, doubt)
