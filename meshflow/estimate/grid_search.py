"""The search on grids: all configurations on few tiles, the best on more; differences count by their standard errors."""

from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from meshflow.estimate.blend import blended
from meshflow.estimate.grid_risk import probed
from meshflow.estimate.pieces import SIDE, Piece, along_border, pieces_of, spread, whole
from meshflow.estimate.probes import probes
from meshflow.estimate.risk import FINER, Candidate, Configuration
from meshflow.estimate.sure import Curve, Probed, joined, risks_on, seen_at
from meshflow.geometry.validation import Array
from meshflow.surfaces.grid import Grid

__all__ = ["Found", "GridSearch", "searched_on_grid"]

# Up to so many samples all of a grid is looked at: with all configurations, and with the best ones; else so many tiles.
WHOLE, WHOLE_FINE, FEW, MANY = 24_000, 70_000, 16, 64
# Times looked at first, in squared sample distances; then each half octave from half to four times what was found.
OCTAVES = (*(2.0**power for power in range(-3, 7)), 96.0)
# The best, and the best of another variant within so many standard errors of their difference, are looked at again.
NEAR, MOST = 2.0, 2
# Below this share of the noise's square the risk is small against its own error: twice as many tiles are taken, and the contrast
# is changed only for what is gained beyond the standard error. Elsewhere less than that is sure enough.
SMOOTH, SURE, ALMOST_SURE = 0.03, 1.0, 0.3
# How often the contrast is changed.
ROUNDS = 3
# Tiles along the border, for what holds there.
BORDER = 32
# So many numbers are probed: a small grid several times; with correlated noise, of which fewer are independent, more.
PROBED, PROBED_CORRELATED, PROBES = 16_000, 60_000, 6
# So many runs are blended, and the least weight that is worth a run.
BLENDED, SLIGHT = 3, 0.02
# An error below zero by this share of the noise's square is none: nothing is believed of that curve.
BELOW = -0.5


@dataclass(frozen=True, eq=False)
class GridSearch:
    """What a search on a grid looks at.

    :ivar configurations: variants with their contrasts.
    :ivar free: whether contrasts between those may be tried.
    :ivar sigma: the noise, unit of the values: of each channel (k, 1, 1), of each sample (1, h, w), or of all (1, 1, 1).
    :ivar end: the time that is given, squared length, at which configurations are compared; None: it is searched for, too.
    :ivar weights: of twicing.
    :ivar correlation: (2r+1, 2r+1), of the noise by lag; None: white.
    :ivar between: (k, k), of the noise of channels; None: none.
    :ivar limit: (k, h, w), what no sample leaves; None: none.
    :ivar speed: (1, h, w), the mobility; None: all go freely.
    :ivar blend: whether the best runs are blended, too.
    :ivar border: whether the other boundary, ``neumann``, may be tried.
    :ivar threads: how many.
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
    """What a search came to.

    :ivar candidates: the chosen one first; none where no estimate can be believed.
    :ivar better: whether the chosen one lowers the error by more than the standard error of that.
    :ivar neumann: whether the other boundary errs less.
    :ivar weights: of the first candidates, where blending them errs less than the first alone; else empty.
    """

    candidates: tuple[Candidate, ...]
    better: bool = False
    neumann: bool = False
    weights: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class _Best:
    """The least of a curve.

    :ivar risks: (g,), sums over tiles at that time.
    """

    configuration: Configuration
    time: float
    weight: float
    square: float
    risks: Array
    curve: Curve

    def beyond(self, other: "_Best") -> float:
        """The standard error of the difference of their mean risks, by that of their tiles."""
        return _error(self.risks - other.risks, self.curve.sizes)


def searched_on_grid(grid: Grid, search: GridSearch) -> Found:
    """The candidates of a search on a grid, of which the contrast is left aside."""
    unit = float(np.mean(grid.spacing[0]) * grid.spacing[1])
    with ThreadPoolExecutor(search.threads) as pool:
        parts = _looked_at(grid, search, FEW, WHOLE)
        runs = _Runs(search, parts, pool)
        found = runs.best({one: _octaves(search, unit) for one in search.configurations}, 1)
        if not found:
            return Found(())
        ranked = sorted(found, key=lambda best: best.square)
        near = _near(ranked)
        if grid.missing.size > WHOLE and grid.lines is None:
            smooth = ranked[0].square < SMOOTH * parts[0].square
            runs = replace(runs, parts=_looked_at(grid, search, MANY * (2 if smooth else 1), WHOLE_FINE))
        fine = runs.best({best.configuration: _fine(search, best.time, unit) for best in near}, 2) or near
        if search.free:
            fine = _sharpened(runs, fine, unit)
        known = {best.configuration for best in fine}
        if runs.parts is parts:  # what was left behind was looked at on the same samples
            least = min(best.square for best in fine)
            fine = [*fine, *(one for one in found if one.configuration not in known and one.square >= least)]
        ranked = sorted(fine, key=lambda best: best.square)
        chosen, square = ranked[0], runs.parts[0].square
        gain = _error(chosen.risks - square * chosen.curve.sizes, chosen.curve.sizes)
        neumann = search.border and _less_at_the_border(grid, runs, chosen)
        weights = _weights(runs, ranked[:BLENDED], unit) if search.blend else ()
    boundary = "neumann" if neumann else ""
    candidates = tuple(_candidate(best, chosen, square, search.end, boundary) for best in ranked)
    return Found(candidates, chosen.square + gain < square, neumann, weights)


def _octaves(search: GridSearch, unit: float) -> tuple[float, ...]:
    """The times looked at first, squared length."""
    if search.end is None:
        return tuple(time * unit for time in OCTAVES)
    parts = (0.25, 0.5, 1.0, *((2.0,) if max(search.weights) > 0 else ()))
    return tuple(search.end * part for part in parts)


def _fine(search: GridSearch, time: float, unit: float) -> tuple[float, ...]:
    """The times looked at then, squared length."""
    if search.end is not None:
        return _octaves(search, unit)
    low = 2.0 ** np.floor(np.log2(max(time / unit, OCTAVES[0])) - 1.0)
    times = [t for t in OCTAVES if low / 16.0 <= t <= low] or [low]
    t = low
    while t < OCTAVES[-1] and t < 4.0 * time / unit:
        times += [1.5 * t, 2.0 * t]
        t *= 2.0
    return tuple(t * unit for t in times if t <= OCTAVES[-1])


def _looked_at(grid: Grid, search: GridSearch, tiles: int, most: int) -> tuple[Probed, ...]:
    """The pieces of a grid that are looked at, with their probes: all of it up to ``most`` samples, or along lines."""
    if grid.lines is not None or grid.missing.size <= most:
        parts: tuple[Piece, ...] = (whole(grid, search.sigma, search.limit, search.speed),)
    else:
        parts = pieces_of(grid, spread(grid, tiles), search.sigma, search.limit, search.speed)
    return _with_probes(parts, search)


def _with_probes(parts: Sequence[Piece], search: GridSearch) -> tuple[Probed, ...]:
    """Pieces with as many probes as their size asks for."""
    size, made = sum(len(part.counted) for part in parts), []
    enough = PROBED if search.correlation is None else PROBED_CORRELATED
    count = int(np.clip(-(-enough // max(1, size)), 1, PROBES))
    for seed, part in enumerate(parts):
        shape = (len(part.grid.planes), *part.grid.shape)
        made.append(probed(part, probes(shape, count, search.correlation, search.between, seed)))
    return tuple(made)


@dataclass(frozen=True, eq=False)
class _Runs:
    """Runs of configurations on pieces, each a job of one thread."""

    search: GridSearch
    parts: tuple[Probed, ...]
    pool: ThreadPoolExecutor

    def curves(
        self, times: Mapping[Configuration, Sequence[float]], patience: int
    ) -> Iterable[tuple[Configuration, Curve]]:
        """The curve of each configuration at its times, over all pieces."""
        patience = patience if self.search.end is None else len(OCTAVES)
        longest_first = sorted(times, key=lambda one: one.variant.patch == 0)
        waiting = {
            one: [
                self.pool.submit(risks_on, part, one, times[one], self.search.weights, patience) for part in self.parts
            ]
            for one in longest_first
        }
        return [(one, joined(job.result() for job in waiting[one])) for one in times]

    def best(self, times: Mapping[Configuration, Sequence[float]], patience: int) -> list[_Best]:
        """The least of each configuration's curve, of those that can be believed."""
        least = BELOW * self.parts[0].square
        found = [_least(one, curve, self.search.end) for one, curve in self.curves(times, patience) if curve.sound]
        return [best for best in found if best is not None and best.square >= least]


def _least(configuration: Configuration, curve: Curve, end: float | None) -> _Best | None:
    """The least of a curve, one that was evaluated; None for an empty one."""
    best: _Best | None = None
    for weight, at in curve.sums.items():
        for time in at:
            if end is not None and time != end:
                continue
            square = curve.mean(weight, time)
            if best is None or square < best.square:
                best = _Best(configuration, time, weight, square, at[time], curve)
    return best


def _error(differences: Array, sizes: Array) -> float:
    """The standard error of a mean over all tiles, from sums over each."""
    return float(np.std(differences) * np.sqrt(len(differences)) / sizes.sum())


def _near(ranked: Sequence[_Best]) -> list[_Best]:
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


def _sharpened(runs: _Runs, fine: Sequence[_Best], unit: float) -> list[_Best]:
    """With more or less contrast than the best, as long as that surely lowers the risk."""
    best, found = min(fine, key=lambda one: one.square), list(fine)
    sure = SURE if best.square < SMOOTH * runs.parts[0].square else ALMOST_SURE
    ways = [FINER, 1.0 / FINER]
    for _ in range(ROUNDS):
        contrast = best.configuration.contrast
        steps = {
            replace(best.configuration, contrast=contrast * way): _fine(runs.search, best.time * way**1.5, unit)
            for way in ways
        }
        tried = runs.best(steps, 2)
        found += tried
        top = min(tried, key=lambda one: one.square, default=best)
        if top.square + sure * top.beyond(best) >= best.square:
            break
        ways = [top.configuration.contrast / contrast]
        best = top
    return [one for one in found if one is best or one.square >= best.square]


def _weights(runs: _Runs, best: Sequence[_Best], unit: float) -> tuple[float, ...]:
    """The weights of the best runs in the blend of least risk; none where that is the first one alone."""
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


def _candidate(best: _Best, chosen: _Best, square: float, end: float | None, boundary: str) -> Candidate:
    """What a configuration is expected to leave, over time."""
    configuration = replace(best.configuration, twice=best.weight, boundary=boundary if best is chosen else "")
    times = tuple(sorted(best.curve.sums[best.weight])) if end is None else (best.time,)
    squares = tuple(best.curve.mean(best.weight, time) for time in times)
    if end is None:
        times, squares = (0.0, *times), (square, *squares)
    doubt = best.beyond(chosen) if len(best.risks) == len(chosen.risks) else 0.0
    return Candidate(configuration, times, squares, doubt)


def _less_at_the_border(grid: Grid, runs: _Runs, best: _Best) -> bool:
    """Whether the flow errs less along the border with the other boundary."""
    search = replace(runs.search, end=best.time, weights=(best.weight,))
    windows, sums = along_border(grid, BORDER, SIDE // 2), []
    for boundary in (grid.boundary, "neumann"):
        parts = pieces_of(replace(grid, boundary=boundary), windows, search.sigma, search.limit, search.speed)
        bordered = replace(runs, search=search, parts=_with_probes(parts, search))
        steps = (0.125, 0.25, 0.5, 1.0, *((2.0,) if best.weight > 0 else ()))
        found = bordered.best({best.configuration: tuple(best.time * step for step in steps)}, len(steps))
        sums.append(found[0].square if found else np.inf)
    return sums[1] < sums[0]
