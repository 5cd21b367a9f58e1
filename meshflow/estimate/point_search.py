"""The methods that move the points of a mesh, tried: which of them, and for how long, by the risk along the normals."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from meshflow.errors import NotConverged
from meshflow.estimate.risk import PROBE, Candidate, ranked
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.low_pass import Weights, is_short
from meshflow.flow.methods.fairing import Fairing
from meshflow.flow.methods.normal_filter import NormalFilter
from meshflow.flow.methods.points import PointMethod, PointSetting
from meshflow.flow.mobility import slowed
from meshflow.geometry.normals import beyond, measured, normals_at
from meshflow.geometry.validation import Array
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.surface import Surface

__all__ = ["Tried", "configurations", "searched"]

# Ways of facets that are looked at: contrast and sharpness, the sampling as it is or evened over so many squared edges.
CREASES, REGULARIZED = ((2.0, 8.0), (8.0, 2.0), (1.0, 4.0)), (0.0, 0.3)
# Rounds of facets, and times of fairings, in squared edges, at which the risk is looked at.
LONG = (10.0, 20.0, 30.0, 50.0, 100.0, 200.0, 300.0)
# All ways are looked at up to this, the best so many of them go on.
FIRST, BEST = 50.0, 2
SHORT = (0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 11.0, 16.0, 23.0, 32.0)
FAIRINGS: tuple[tuple[int, Weights], ...] = ((2, "uniform"), (4, "uniform"), (10, "uniform"), (2, "cotangent"))
# Vertices that the search looks at, in so many pieces, and how many rings at their cuts are not counted.
ENOUGH, PIECES, RINGS = 12_000, 4, 3
# A triangle whose normal has turned this far (cosine) from the mean of its own and its neighbours' has folded; a share of them
# weighs as so many sigma squared: a fold is no surface, however near its points may be.
FOLDED, WEIGHT = 0.3, 10.0
# A run is given up when its risk has grown so often since its least.
PATIENCE = 2


def configurations(step: float) -> tuple[PointMethod, ...]:
    """Ways to look at.

    :param step: h, the mean edge.
    """
    made: list[PointMethod] = [
        NormalFilter(crease_contrast=contrast, crease_sharpness=sharpness, regularize=regularized * step**2)
        for regularized, (contrast, sharpness) in product(REGULARIZED, CREASES)
    ]
    made += [Fairing(order=order, weights=weights) for order, weights in FAIRINGS]
    return tuple(made)


def _times(method: PointMethod, step: float) -> tuple[float, ...]:
    """Times at which the risk of a way is looked at, squared length."""
    return tuple(time * step**2 for time in (LONG if isinstance(method, NormalFilter) else SHORT))


@dataclass(frozen=True, eq=False)
class Tried:
    """What a search is told.

    :ivar methods: to look at.
    :ivar setting: triangles and border.
    :ivar sigma: the noise along the normals, unit of the points.
    :ivar end: the time that is given; None: it is searched for, too.
    :ivar mobility: (n, 1), of each vertex; None: all go freely.
    """

    methods: tuple[PointMethod, ...]
    setting: PointSetting
    sigma: float
    end: float | None = None
    mobility: Array | None = None


def searched(data: Mesh, lift: Lift, asked: Tried) -> tuple[Candidate, ...]:
    """The candidates of a search, the best first: mean square error along the normals, by Monte Carlo SURE.

    ((x - x0) . n)^2 - sigma^2 + 2 sigma^2 of what a second run, beside the first by random signs along the normals, has of them
    left: the noise across the surface is what is seen; along it a surface looks the same.
    """
    step, whole = data.step, data
    methods, sigma, end, setting, speed = asked.methods, asked.sigma, asked.end, asked.setting, asked.mobility
    data, counted, kept = _pieces(data)
    slow = None if speed is None else speed[kept]
    normals = normals_at(data.points.astype(np.float64), data.faces) if data.normals is None else data.normals
    signs = np.random.default_rng(0).choice(np.array([-1.0, 1.0]), size=(len(normals), 1))
    start = data.lifted(lift)
    twin = start.moved(start.points + PROBE * sigma * signs * normals)
    across = beyond(data.faces)

    def risk(one: Array, other: Array) -> float:
        """The risk of a run and its twin at one time, squared unit of the points."""
        change = np.einsum("ij,ij->i", one - start.points, normals)[counted]
        left = (signs[:, 0] * np.einsum("ij,ij->i", other - one, normals))[counted] / (PROBE * sigma)
        square = float(np.mean(change * change)) + sigma**2 * (2.0 * float(np.mean(left)) - 1.0)
        return square + WEIGHT * sigma**2 * folded(one, data.faces, across)

    def tried(method: PointMethod, times: tuple[float, ...]) -> list[Candidate]:
        """The candidate of a method at these times; none where it cannot be run."""
        risks = [sigma**2 * (1.0 + WEIGHT * folded(start.points, data.faces, across))]
        for pair in _pairs(method, setting, (start, twin), times, slow):
            risks.append(risk(*pair))
            if len(risks) - 1 - int(np.argmin(risks)) > PATIENCE:
                break
        if len(risks) == 1:
            return []
        first = 0 if end is None else 1  # a time that is given is compared alone
        return [Candidate(method, (0.0, *times)[first : len(risks)], tuple(risks[first:]))]

    def looked_at(method: PointMethod, most: float) -> tuple[float, ...]:
        """The times, up to one, at which the risk of a method is looked at."""
        times = (end,) if end is not None else tuple(t for t in _times(method, step) if method.once or t <= most)
        if len(methods) == 1 or not isinstance(method, Fairing) or method.weights == "uniform":
            return times
        return tuple(t for t in times if all(is_short(generator, t, method.order or 2) for generator in generators))

    flows = [MeshFlow(surface) for surface in (whole.lifted(lift), start, twin)]
    generators = [flow.generator(flow.start(), "cotangent") for flow in flows]
    if end is not None:
        return ranked(candidate for method in methods for candidate in tried(method, looked_at(method, end)))
    first = ranked(candidate for method in methods for candidate in tried(method, looked_at(method, FIRST * step**2)))
    going = [t.configuration for t in first[:BEST] if t.squares[-1] == min(t.squares) and not t.configuration.once]
    longer = [candidate for method in going for candidate in tried(method, looked_at(method, np.inf))]
    return ranked((*longer, *(t for t in first if t.configuration not in going)))


def _pairs(
    method: PointMethod,
    setting: PointSetting,
    pair: tuple[Surface, Surface],
    times: tuple[float, ...],
    speed: Array | None,
) -> Iterator[tuple[Array, Array]]:
    """The points of a run and of its twin at each time; none where slivers do not let it be run."""
    flows = [slowed(method.engine(surface, setting), speed) for surface in pair]
    try:
        yield from zip(*(method.states(flow, flow.start(), times) for flow in flows), strict=True)
    except NotConverged:
        return


def folded(points: Array, faces: Array, across: Array) -> float:
    """The share of triangles whose normal has turned from the mean of its own and its neighbours'."""
    normals, areas = measured(points, faces)
    mean = areas[:, None] * normals
    for side in across.T:
        mean = mean + np.where(side[:, None] >= 0, areas[side, None] * normals[side], 0.0)
    lengths = np.linalg.norm(mean, axis=1)
    cosine = np.divide(
        np.einsum("ij,ij->i", normals, mean), lengths, out=np.ones_like(lengths), where=(lengths > 0) & (areas > 0)
    )
    return float(np.mean(cosine < FOLDED))


def _pieces(data: Mesh) -> tuple[Mesh, Array, Array]:
    """A mesh that is not too large: the whole, or pieces of it, which of its vertices are counted, and which of the whole they
    are.
    """
    assert data.fixed is not None
    if len(data.points) <= ENOUGH:
        return data, ~data.fixed, np.arange(len(data.points))
    across, m = beyond(data.faces), len(data.faces)
    taken, seeds = np.zeros(m, bool), np.linspace(0, m - 1, PIECES + 2).astype(int)[1:-1]
    for seed in seeds:
        front, size = np.array([seed]), 0
        while len(front) and size < 2 * ENOUGH // PIECES:
            front = front[~taken[front]]
            taken[front] = True
            size += len(front)
            front = np.unique(across[front][across[front] >= 0])
    faces = data.faces[taken]
    kept, inverse = np.unique(faces, return_inverse=True)
    cut = np.isin(kept, data.faces[~taken])
    faces = inverse.reshape(-1, 3)
    for _ in range(RINGS):
        cut[faces[cut[faces].any(axis=1)]] = True
    piece = replace(data, points=data.points[kept], faces=faces, channels=None, moves="points", fixed=data.fixed[kept])
    counted = ~(cut | data.fixed[kept])
    return piece, counted if counted.any() else ~data.fixed[kept], kept
