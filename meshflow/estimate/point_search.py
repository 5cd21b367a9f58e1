"""The search for a method and a time for the points of a mesh, by the estimated risk along the normals."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TypeGuard

import numpy as np

from meshflow.errors import NotConverged
from meshflow.estimate.mesh_noise import PointNoise
from meshflow.estimate.mesh_pieces import pieces
from meshflow.estimate.point_risk import FEWER, PointCandidate, PointRisk
from meshflow.estimate.risk import Candidate, ranked
from meshflow.flow.compute import Compute
from meshflow.flow.contract import Flow
from meshflow.flow.low_pass import Weights, filtered_by_all, generator_of
from meshflow.flow.methods.fairing import Fairing
from meshflow.flow.methods.normal_filter import NormalFilter
from meshflow.flow.methods.points import PointMethod, PointSetting
from meshflow.flow.mobility import slowed
from meshflow.flow.pools import Pool
from meshflow.geometry.validation import Array
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.surface import Surface

__all__ = ["Tried", "configurations", "regularizing", "searched"]

# Contrast and sharpness of the normal filter in the search: for creases, and for round shapes with creases. (4, 8) and (4, 4) in
# addition gain 0.5 % of the angle (13 cases, the best time known). (1, 4), for round shapes, never wins beside fairings.
CREASES = ((8.0, 4.0), (2.0, 8.0))
# Time of the initial regularization of the sampling, in h^2 (sigma / a)^2 with the mean edge h and the mean altitude a of the
# noisy triangles on their longest sides, and the longest time, in h^2. For boxes and uneven cubes with noise of 0.1, 0.2,
# 0.3, 0.4, 0.5 true edges the best of seven times is 0.1, 0.2, 0.3 to 0.5, 0.5, 0.5 h^2, and this is 0.06, 0.14, 0.3, 0.5,
# 0.65. Half of the best time leaves folds, twice of it rounds creases. If it is shorter than BRIEF, UNEVEN is tried as well:
# slivers need more.
REGULARIZED, LONGEST, BRIEF, UNEVEN = 1.5, 1.0, 0.2, 0.3
# Times of the normal filter, in squared edges, at which the risk is estimated. All configurations run to the end of the first
# stage, the best BEST of them to that of the next, if they are worse than the best fairing by no more than WORSE sigma^2: those
# that win in the end are better than all fairings after the first stage (18 of 54 cases).
WORSE = 0.05
STAGES, BEST = ((10.0, 20.0), (50.0,), (100.0,), (200.0, 300.0)), (4, 3, 2, 0)
# Order, weights, and the time of smoothing before cotangents are measured, in squared edges, of the fairings; and their times.
# Cotangents of a smoothed copy are those of the surface, whatever the noise; the longer time is for irregular triangles. On
# regular grids uniform weights are better. Orders of 4, and cotangents of the data itself, never win by more than 2 % (60 cases).
# One of order 1, which also damps long waves, needs a quarter of the times.
# Long times take several times as long. They are for fairings whose risk falls to the end of the short times, and is above the
# least by no more than FARTHER sigma^2. Uniform weights, which let vertices slide until all edges are alike, are tried for
# the longest of them on many vertices only, where even grids need them: a ball of 642 vertices lost its normals (0.6 -> 1.7
# degrees) for a risk that chance had lowered.
FAIRED, FIRST = (0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0), 0.25
FAIRED_LONG, FAIRED_EVEN, FARTHER = (5.6, 8.0, 11.0, 16.0, 22.0, 32.0), 4, 0.3
FAIRINGS: tuple[tuple[int, Weights, float], ...] = (
    (2, "cotangent", 1.0), (10, "cotangent", 1.0), (2, "cotangent", 3.0), (10, "uniform", 0.0),
)  # fmt: skip
# Errors of the normal filter that differ by less, in sigma^2, are alike, and the longer time is taken: the error of the normals
# falls on for a while when that of positions no longer does (on a CAD part to half or twice the time).
ALIKE = 0.02
# Of fairings whose errors differ from the least by no more than this, in sigma^2, the one of the highest order is chosen: it
# damps long waves less.
EQUAL = 0.004
# The error of the difference of two runs of the normal filter is about UNSURE sigma^2 over the root of the number of vertices. Of
# those that differ by less, the one with the shorter regularization is chosen: it does not round creases.
UNSURE = 0.6
# A run is stopped after its risk has grown this many times since its minimum.
PATIENCE = 2


def configurations(step: float, altitude: float, sigma: float) -> tuple[PointMethod, ...]:
    """The methods of the search with their options.

    :param step: h, the mean edge.
    :param altitude: mean over the triangles, above zero; see :func:`mean_altitude`.
    :param sigma: of the noise, unit of the points.
    """
    regularized = regularizing(altitude, sigma)
    made: list[PointMethod] = [
        NormalFilter(crease_contrast=contrast, crease_sharpness=sharpness, regularize=time * step**2)
        for time in ((regularized, UNEVEN) if regularized < BRIEF else (regularized,))
        for contrast, sharpness in CREASES
    ]
    made += [
        Fairing(order=order, weights=weights, presmooth=presmooth * step**2) for order, weights, presmooth in FAIRINGS
    ]
    return tuple(made)


def regularizing(altitude: float, sigma: float) -> float:
    """The time of the initial regularization, in squared edges, for noise in all directions.

    :param altitude: mean over the triangles; ``sigma``: of the noise, both in the unit of the points.
    """
    return min(REGULARIZED * (sigma / altitude) ** 2, LONGEST)


@dataclass(frozen=True, eq=False)
class Tried:
    """The input of a search.

    :ivar methods: to try.
    :ivar setting: triangles and border.
    :ivar noise: of the points along the normals, with the sigma to be removed.
    :ivar end: the given time; None: it is also searched for.
    :ivar mobility: (n, 1), of each vertex; None: all are free.
    :ivar threads: number of methods that run side by side.
    """

    methods: tuple[PointMethod, ...]
    setting: PointSetting
    noise: PointNoise
    end: float | None = None
    mobility: Array | None = None
    threads: int = 1


@dataclass(eq=False)
class _Run:
    """A method with its risk at each time, and the states that follow.

    :ivar going: whether it is worth while to continue.
    """

    method: PointMethod
    risk: PointRisk
    states: Iterator[tuple[Array, ...]]
    times: list[float] = field(default_factory=lambda: [0.0])
    squares: list[float] = field(default_factory=list)
    going: bool = True

    def to(self, times: tuple[float, ...], least: float) -> None:
        """Continue to the next times of its states."""
        for time in times:
            if not self.going:
                return
            try:
                states = next(self.states)
            except NotConverged:  # slivers prevent further steps
                self.going = False
                return
            square = self.risk.of_states(states, least)
            if not np.isfinite(square):
                self.going = False
                return
            self.times.append(time)
            self.squares.append(square)
            self.going = len(self.squares) - 1 - int(np.argmin(self.squares)) <= PATIENCE

    @property
    def least(self) -> float:
        """The least risk so far."""
        return min(self.squares)

    @property
    def falls(self) -> bool:
        """Whether the risk falls to the last time, or the one before it."""
        return self.going and len(self.squares) - 1 - int(np.argmin(self.squares)) <= 1

    def candidate(self, first: int) -> PointCandidate:
        """The candidate, from a time on."""
        alike = ALIKE * self.risk.sigma**2 if isinstance(self.method, NormalFilter) else 0.0
        return PointCandidate(self.method, tuple(self.times[first:]), tuple(self.squares[first:]), alike=alike)


@dataclass(frozen=True, eq=False)
class _Search:
    """The data of a search, or pieces of it, and the methods.

    :ivar surface: of the data.
    :ivar speed: (n, 1), mobility; None: all vertices move freely.
    """

    surface: Surface
    risk: PointRisk
    asked: Tried
    speed: Array | None

    def begun(self, method: PointMethod, times: tuple[float, ...]) -> _Run:
        """A run at its start, to be continued to the times."""
        flow = self._flow(method)
        states = (method.states(flow, start, times) for start in self.risk.starts)
        return _Run(method, self.risk, zip(*states, strict=True), squares=[self.risk.at_start])

    def fairings(self, methods: Sequence[Fairing], times: tuple[float, ...]) -> list[_Run]:
        """The runs of fairings with the same weights to each of the times."""
        runs = [_Run(method, self.risk, iter(()), squares=[self.risk.at_start]) for method in methods]
        self.to(runs, times, self.risk.at_start)
        return runs

    def to(self, runs: Sequence[_Run], times: tuple[float, ...], least: float) -> None:
        """Continue fairings with the same weights to each of the times for which a polynomial suffices.

        The polynomials of the operator are common to all of them.
        """
        methods = [run.method.filled() for run in runs if isinstance(run.method, Fairing)]
        pairs = [(time, method.order or 1) for method in methods for time in times]
        flow, first = self._flow(methods[0]), methods[0].low_pass()
        generators = (generator_of(flow, u, first.weights, first.presmooth) for u in self.risk.starts)
        all_states = [filtered_by_all(a, u, pairs) for a, u in zip(generators, self.risk.starts, strict=True)]
        for count, run in enumerate(runs):
            part = slice(count * len(times), (count + 1) * len(times))
            states = zip(*(of_run[part] for of_run in all_states), strict=True)
            there = [(time, found) for time, found in zip(times, states, strict=True) if _all_there(found)]
            run.states = iter([found for _, found in there])
            run.to(tuple(time for time, _ in there), least)

    def _flow(self, method: PointMethod) -> Flow:
        """The engine of a method."""
        return slowed(method.engine(self.surface, self.asked.setting), self.speed)


def _all_there(states: tuple[Array | None, ...]) -> TypeGuard[tuple[Array, ...]]:
    """Whether no state is missing."""
    return all(state is not None for state in states)


def searched(data: Mesh, lift: Lift, asked: Tried) -> tuple[Candidate, ...]:
    """The candidates of a search, the best first: mean square error along the normals (:class:`PointRisk`).

    All configurations of the normal filter run for a short time, the best of them for longer times; fairings run to some times.
    The minimum is over estimated risks, without interpolation.
    """
    square = data.step**2
    data, counted, kept = pieces(data)
    surface = data.lifted(lift)
    risk = PointRisk.of(surface.points, data.faces, counted, asked.noise, data.fixed)
    search = _Search(surface, risk, asked, None if asked.mobility is None else asked.mobility[kept])
    end, groups = () if asked.end is None else (asked.end / square,), _groups(asked.methods)
    jobs = [partial(search.fairings, group, _scaled(end or FAIRED, square)) for group in groups]
    alone = [m for m in asked.methods if not jobs or not isinstance(m, Fairing)]
    stages = tuple(_scaled(stage, square) for stage in _stages(alone, end))
    going = [search.begun(method, tuple(time for stage in stages for time in stage)) for method in alone]
    runs, least = list(going), risk.at_start
    for turn, (stage, best) in enumerate(zip(stages, BEST, strict=False)):
        jobs += [partial(run.to, stage, least) for run in going]
        made = [found for found in _side_by_side(jobs, asked.threads) if found]
        runs += [run for group in made for run in group]
        least, faired = (min((run.least for run in some), default=np.inf) for some in (runs, runs[len(alone) :]))
        jobs = []
        if turn == 0 and not end:
            longer = [
                [run for run in group if run.falls and run.least <= least + FARTHER * risk.sigma**2] for group in made
            ]
            jobs += [
                partial(search.to, group, _scaled(_long(group, int(counted.sum())), square), least)
                for group in longer
                if group
            ]
        going = [run for run in going if run.going and run.least <= faired + WORSE * risk.sigma**2]
        going = sorted(going, key=lambda run: run.least)[:best]
    first = 0 if asked.end is None else 1
    return _chosen_first(
        ranked(run.candidate(first) for run in runs if len(run.times) > 1), risk.sigma, int(counted.sum())
    )


def _chosen_first(candidates: tuple[Candidate, ...], sigma: float, count: int) -> tuple[Candidate, ...]:
    """Ranked candidates, the one that is chosen first: of those with about the least error, of the same kind as the best, the
    fairing of the highest order, or the normal filter with the shortest regularization, if it has one.

    :param sigma: of the noise; ``count``: vertices for which the error was estimated.
    """
    best = candidates[0].configuration if candidates else None
    if best is None or candidates[0].least[0] == 0:
        return candidates
    equal = (EQUAL if isinstance(best, Fairing) else UNSURE / np.sqrt(count)) * sigma**2
    alike = [
        (_preference(one.configuration, best), -i)
        for i, one in enumerate(candidates)
        if one.least[0] > 0 and one.least[1] <= candidates[0].least[1] + equal
    ]
    first = -max(alike)[1]
    return (candidates[first], *candidates[:first], *candidates[first + 1 :])


def _preference(method: object, best: object) -> float:
    """The greater, the sooner a method is chosen of those that are as good as the best; -infinity for one of another kind."""
    if isinstance(method, Fairing) and isinstance(best, Fairing) and method.weights == best.weights:
        return float(method.order or 0)
    if isinstance(method, NormalFilter) and isinstance(best, NormalFilter) and method.regularize:
        return -method.regularize
    return -np.inf


def _stages(methods: Sequence[PointMethod], end: tuple[float, ...]) -> tuple[tuple[float, ...], ...]:
    """The times of methods without a group, in squared edges."""
    if end:
        return (end,)
    orders = [method.order or 2 for method in methods if isinstance(method, Fairing)]
    return (_scaled(FAIRED + FAIRED_LONG, FIRST if max(orders) == 1 else 1.0),) if orders else STAGES


def _long(group: Sequence[_Run], count: int) -> tuple[float, ...]:
    """The long times of fairings with the same weights, in squared edges.

    :param count: vertices for which the error is estimated.
    """
    uniform = any(isinstance(run.method, Fairing) and run.method.filled().weights == "uniform" for run in group)
    return FAIRED_LONG[:FAIRED_EVEN] if uniform and count < FEWER else FAIRED_LONG


def _scaled(times: tuple[float, ...], factor: float) -> tuple[float, ...]:
    return tuple(time * factor for time in times)


def _groups(methods: Sequence[PointMethod]) -> list[list[Fairing]]:
    """The fairings of each kind of weights, if there are several methods."""
    fairings = [method for method in methods if isinstance(method, Fairing)] if len(methods) > 1 else []
    kinds = [(method.filled().weights, method.filled().presmooth) for method in fairings]
    return [[m for m, own in zip(fairings, kinds, strict=True) if own == kind] for kind in dict.fromkeys(kinds)]


def _side_by_side(jobs: Sequence[Callable[[], list[_Run] | None]], threads: int) -> list[list[_Run] | None]:
    """The results of jobs, each in one thread, several at a time."""
    if threads == 1 or len(jobs) < 2:
        return [job() for job in jobs]
    with Pool(min(threads, len(jobs))) as pool:
        return list(pool.map(_in_one_thread, jobs))


def _in_one_thread(job: Callable[[], list[_Run] | None]) -> list[_Run] | None:
    """The result of a job, whose loops use one thread."""
    with Compute(threads=1).running():
        return job()
