"""The search on grids: all configurations on few tiles, the best on more. Differences are compared with their standard errors."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from meshflow.estimate.blend import blended
from meshflow.estimate.grid_risk import probed
from meshflow.estimate.pieces import SIDE, Piece, along_border, pieces_of, spread, whole
from meshflow.estimate.probes import probes
from meshflow.estimate.risk import FINER, Candidate, Configuration
from meshflow.estimate.sure import Curve, Probed, joined, risks_on, seen_at
from meshflow.flow.pools import Pool
from meshflow.geometry.validation import Array
from meshflow.surfaces.grid import Grid

__all__ = ["Found", "GridSearch", "searched_on_grid"]

# The largest grids that are searched whole, with all configurations and with the best ones; and the numbers of tiles of larger
# ones.
WHOLE, WHOLE_FINE, FEW, MANY = 24_000, 70_000, 16, 64
# Times of the first round, in squared sample distances. The second round has half octaves from half to four times the best time.
OCTAVES = (*(2.0**power for power in range(-3, 7)), 96.0)
# The second round has the best and the best of another variant within NEAR standard errors of their difference, at most MOST.
NEAR, MOST = 2.0, 2
# If the risk is below the share SMOOTH of the square of the noise, it is small against its own error. Then twice as many tiles
# are used, and the contrast changes only for a gain of SURE standard errors; otherwise a gain of ALMOST_SURE is enough.
SMOOTH, SURE, ALMOST_SURE = 0.03, 1.0, 0.3
# The largest number of changes of the contrast.
ROUNDS = 3
# The largest number of tiles along the border, for the choice of the boundary.
BORDER = 32
# The least number of probed samples: a small grid has several probes, at most PROBES. Correlated noise needs more.
PROBED, PROBED_CORRELATED, PROBES = 16_000, 60_000, 6
# The largest number of blended runs, and the least weight of one.
BLENDED, SLIGHT = 3, 0.02
# A curve with a mean square error below this share of the square of the noise is rejected.
BELOW = -0.5


@dataclass(frozen=True, eq=False)
class GridSearch:
    """The input of a search on a grid.

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
class _Best:
    """The minimum of a curve.

    :ivar risks: (g,), sum of the squared error over each tile at that time.
    """

    configuration: Configuration
    time: float
    weight: float
    square: float
    risks: Array
    curve: Curve

    def beyond(self, other: "_Best") -> float:
        """The standard error of the difference of the two mean risks, from the spread over the tiles."""
        return _error(self.risks - other.risks, self.curve.sizes)


def searched_on_grid(grid: Grid, search: GridSearch) -> Found:
    """The result of a search on a grid. The contrast of the grid is ignored."""
    unit = float(np.mean(grid.spacing[0]) * grid.spacing[1])
    with Pool(search.threads) as pool:
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
        ranked = sorted(fine, key=lambda best: best.square)
        chosen, square = ranked[0], runs.parts[0].square
        gain = _error(chosen.risks - square * chosen.curve.sizes, chosen.curve.sizes)
        neumann = search.border and _less_at_the_border(grid, runs, chosen)
        weights = _weights(runs, ranked[:BLENDED], unit) if search.blend else ()
    boundary = "neumann" if neumann else ""
    candidates = tuple(_candidate(best, chosen, square, search.end, boundary) for best in ranked)
    return Found(candidates, chosen.square + gain < square, neumann, weights)


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


def _looked_at(grid: Grid, search: GridSearch, tiles: int, most: int) -> tuple[Probed, ...]:
    """The pieces of a grid that are used, with their probes; all of it for up to ``most`` samples, and for lines of sight."""
    if grid.lines is not None or grid.missing.size <= most:
        parts: tuple[Piece, ...] = (whole(grid, search.sigma, search.limit, search.speed),)
    else:
        parts = pieces_of(grid, spread(grid, tiles), search.sigma, search.limit, search.speed)
    return _with_probes(parts, search)


def _with_probes(parts: Sequence[Piece], search: GridSearch) -> tuple[Probed, ...]:
    """Pieces with their probes; the smaller they are, the more probes."""
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
    pool: Pool

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
        """The minimum of the curve of each configuration; unreliable curves are left out."""
        least = BELOW * self.parts[0].square
        found = [_least(one, curve, self.search.end) for one, curve in self.curves(times, patience) if curve.sound]
        return [best for best in found if best is not None and best.square >= least]


def _least(configuration: Configuration, curve: Curve, end: float | None) -> _Best | None:
    """The minimum over the evaluated times of a curve; None for an empty one."""
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
    """The standard error of the mean over all tiles, from the sum over each tile."""
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


def _weights(runs: _Runs, best: Sequence[_Best], unit: float) -> tuple[float, ...]:
    """The weights of the best runs in the blend of least risk; empty if the first alone is best."""
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
    """The candidate of a configuration: its risk over time."""
    configuration = replace(best.configuration, twice=best.weight, boundary=boundary if best is chosen else "")
    times = tuple(sorted(best.curve.sums[best.weight])) if end is None else (best.time,)
    squares = tuple(best.curve.mean(best.weight, time) for time in times)
    if end is None:
        times, squares = (0.0, *times), (square, *squares)
    doubt = best.beyond(chosen) if len(best.risks) == len(chosen.risks) else 0.0
    return Candidate(configuration, times, squares, doubt)


def _less_at_the_border(grid: Grid, runs: _Runs, best: _Best) -> bool:
    """Whether the boundary ``neumann`` has a lower risk along the border."""
    search = replace(runs.search, end=best.time, weights=(best.weight,))
    windows, sums = along_border(grid, BORDER, SIDE // 2), []
    for boundary in (grid.boundary, "neumann"):
        parts = pieces_of(replace(grid, boundary=boundary), windows, search.sigma, search.limit, search.speed)
        bordered = replace(runs, search=search, parts=_with_probes(parts, search))
        steps = (0.125, 0.25, 0.5, 1.0, *((2.0,) if best.weight > 0 else ()))
        found = bordered.best({best.configuration: tuple(best.time * step for step in steps)}, len(steps))
        sums.append(found[0].square if found else np.inf)
    return sums[1] < sums[0]
