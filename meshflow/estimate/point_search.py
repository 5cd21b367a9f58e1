"""The search for a method and a time for the points of a mesh, by the estimated risk along the normals."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from meshflow.errors import NotConverged
from meshflow.estimate.mesh_noise import PointNoise
from meshflow.estimate.mesh_pieces import pieces
from meshflow.estimate.point_risk import PointCandidate, PointRisk, shifted
from meshflow.estimate.risk import Candidate, ranked
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.low_pass import Weights, is_short
from meshflow.flow.methods.fairing import Fairing
from meshflow.flow.methods.normal_filter import NormalFilter
from meshflow.flow.methods.points import PointMethod, PointSetting
from meshflow.flow.mobility import slowed
from meshflow.geometry.validation import Array
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.mesh import Mesh

__all__ = ["Tried", "configurations", "searched"]

# Contrast and sharpness of the normal filter in the search: for faces with creases, for round shapes, and for weak creases.
CREASES = ((2.0, 8.0), (1.0, 4.0), (8.0, 4.0))
# Times of the initial regularization of the sampling, in squared edges, for noise below STRONG edges and above it.
REGULARIZED, STRONG = ((0.0, 0.3), (0.3, 1.0)), 0.35
# Times of the normal filter and of fairings, in squared edges, at which the risk is estimated. All configurations of the normal
# filter run to the end of the first stage; the best BEST of them continue in the next.
STAGES, BEST = ((10.0, 20.0), (50.0, 100.0), (200.0, 300.0)), (3, 2)
COARSE = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
# Further times, as multiples of the best of those.
BESIDE = (0.7, 1.4)
FAIRINGS: tuple[tuple[int, Weights], ...] = ((2, "uniform"), (4, "uniform"), (10, "uniform"), (2, "cotangent"))
# A run is stopped after its risk has grown this many times since its minimum.
PATIENCE = 2


def configurations(step: float, sigma: float) -> tuple[PointMethod, ...]:
    """The methods of the search with their options.

    :param step: h, the mean edge.
    :param sigma: of the noise, unit of the points.
    """
    made: list[PointMethod] = [
        NormalFilter(crease_contrast=contrast, crease_sharpness=sharpness, regularize=much * step**2)
        for much in REGULARIZED[int(sigma >= STRONG * step)]
        for contrast, sharpness in CREASES
    ]
    made += [Fairing(order=order, weights=weights) for order, weights in FAIRINGS]
    return tuple(made)


@dataclass(frozen=True, eq=False)
class Tried:
    """The input of a search.

    :ivar methods: to try.
    :ivar setting: triangles and border.
    :ivar noise: of the points along the normals, with the sigma to be removed.
    :ivar end: the given time; None: it is also searched for.
    :ivar mobility: (n, 1), of each vertex; None: all are free.
    """

    methods: tuple[PointMethod, ...]
    setting: PointSetting
    noise: PointNoise
    end: float | None = None
    mobility: Array | None = None


@dataclass(eq=False)
class _Run:
    """A method on the data and on the perturbed points, with their current states and the risk at each time."""

    method: PointMethod
    risk: PointRisk
    pairs: Iterator[tuple[Array, Array]]
    times: list[float] = field(default_factory=lambda: [0.0])
    squares: list[float] = field(default_factory=list)
    going: bool = True

    def to(self, time: float) -> None:
        """Continue to a time, which is the next one of the pairs."""
        if not self.going:
            return
        try:
            pair = next(self.pairs)
        except NotConverged:  # slivers prevent further steps
            self.going = False
            return
        square = self.risk.of_pair(*pair)
        if not np.isfinite(square):
            self.going = False
            return
        self.times.append(time)
        self.squares.append(square)
        self.going = len(self.squares) - 1 - int(np.argmin(self.squares)) <= PATIENCE

    def candidate(self, first: int) -> PointCandidate:
        """The candidate, from a time on."""
        return PointCandidate(self.method, tuple(self.times[first:]), tuple(self.squares[first:]))


def searched(data: Mesh, lift: Lift, asked: Tried) -> tuple[Candidate, ...]:
    """The candidates of a search, the best first: mean square error along the normals (:class:`PointRisk`).

    All configurations of the normal filter run for a short time, the best of them for longer times; fairings run to a few
    times, and to times near the best of them. The minimum is over estimated risks, without interpolation.
    """
    whole, step = data, data.step
    data, counted, kept = pieces(data)
    start = data.lifted(lift)
    risk = PointRisk.of(start, data.faces, counted, asked.noise)
    beside = shifted(start, risk.beside)
    speed = None if asked.mobility is None else asked.mobility[kept]
    surfaces = (start, beside)

    def begun(method: PointMethod, times: tuple[float, ...]) -> _Run:
        """A run at its start."""
        flows = [slowed(method.engine(surface, asked.setting), speed) for surface in surfaces]
        states = (method.states(flow, flow.start(), times) for flow in flows)
        return _Run(method, risk, zip(*states, strict=True), squares=[risk.at_start])

    def fair(method: PointMethod, times: tuple[float, ...]) -> tuple[float, ...]:
        """The times for which a fairing needs no factorization."""
        if len(asked.methods) == 1 or not isinstance(method, Fairing) or method.weights == "uniform":
            return times
        return tuple(t for t in times if all(is_short(generator, t, method.order or 2) for generator in generators))

    def through(method: PointMethod, times: tuple[float, ...]) -> _Run:
        """A run to the last of its times."""
        run = begun(method, times)
        for time in times:
            run.to(time)
        return run

    flows = [MeshFlow(surface) for surface in (whole.lifted(lift), *surfaces)]
    generators = [flow.generator(flow.start(), "cotangent") for flow in flows]
    if asked.end is not None:
        runs = [through(method, fair(method, (asked.end,))) for method in asked.methods]
        return ranked(run.candidate(1) for run in runs if len(run.times) > 1)
    square = step**2
    filters = [m for m in asked.methods if isinstance(m, NormalFilter)]
    marks = tuple(time * square for stage in STAGES for time in stage)
    runs = [begun(method, marks) for method in filters]
    going = runs
    for stage, best in zip(STAGES, (*BEST, 0), strict=True):
        for run in going:
            for time in stage:
                run.to(time * square)
        going = sorted((run for run in going if run.going), key=lambda run: min(run.squares))[:best]
    for method in asked.methods:
        if isinstance(method, NormalFilter):
            continue
        run = through(method, fair(method, tuple(time * square for time in COARSE)))
        runs.append(run)
        at = run.times[int(np.argmin(run.squares))]
        if at > 0:
            runs.append(through(method, fair(method, tuple(at * share for share in BESIDE))))
    return ranked(run.candidate(0) for run in runs if len(run.times) > 1)
