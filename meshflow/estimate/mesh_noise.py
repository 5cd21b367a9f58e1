"""Estimates of the noise of a mesh: of its points along the normals, or of values on its vertices."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import scipy.sparse as sparse
from scipy.special import ndtri

from meshflow.estimate.correlated_noise import LEFT_IF_SHORT, LEFT_ON_SMOOTH, Waves
from meshflow.estimate.crease_outliers import kurtosis_of, without_creases
from meshflow.estimate.edge_noise import bent_like_noise, noise_at_edges
from meshflow.estimate.noise import Noise
from meshflow.estimate.noise_growth import MAD
from meshflow.estimate.quantization import quantum_of
from meshflow.estimate.rounded_points import quanta_of
from meshflow.estimate.vertex_numbers import again, numbers_of
from meshflow.flow.low_pass import filtered
from meshflow.flow.within_voxels import VoxelEdges
from meshflow.geometry.connectivity import connect
from meshflow.geometry.laplacians import cotangent_means, means_over_diagonals, neighbour_means, umbrella_generator
from meshflow.geometry.normals import mean_edge, normals_at
from meshflow.geometry.planarity import beside_flat_edges
from meshflow.geometry.validation import Array

__all__ = ["PointNoise", "noise_beside", "noise_of_points", "noise_on"]

# Residuals are clipped at this many of their deviations.
CLIPPED = 2.5
# Noise alternates between neighbours. For white noise the residuals of neighbours have a correlation of -0.24 to -0.31, and their
# signs differ at a share of 0.6 of the edges. For finely sampled shapes the curvature has the same sign almost everywhere, and
# the correlation is 0 to 0.5. Coarse models, and irregular samplings of curved shapes, are between these.
ALTERNATES, ALMOST, WHITE = 0.26, 0.08, -0.23
CORRELATED, SIGNIFICANT = -0.11, 3.0
# Surfaces that were simplified to few triangles (quadric error metrics) alternate as correlated noise does, at 0.21 to 0.34 of
# their edges, and the correlation of their residuals is between the first two numbers of a line; but the edges of their triangles
# are hardly bent against each other, by less than the third number times what those of white noise are (-0.9 to 0.08; white noise
# of 0.1 edges 0.4 to 1, noise of one to three rounds 0.2 to 0.7, but -0.25 on balls, whose correlation is -0.21).
SIMPLIFIED = ((-0.23, -0.205, -0.28), (-0.205, -0.08, 0.12))
# The least number of edges without a flat edge at either end, and the least share of their vertices; otherwise no noise is
# reported.
EDGES, SHARE = 24, 0.04
# Where residuals do not alternate, correlated noise is looked for if this share of the vertices has no flat edge: noise leaves
# none.
EVERYWHERE = 0.95
# On coarse models the shape is in all bands of waves: correlated noise that seems to be stronger than this, in mean edges, is
# none.
STRONGEST = 0.4
# Noise that is not everywhere, and weaker than this, is the sampling: a level set on a grid is 0.02 mean edges off its smooth
# shape.
WEAKEST = 0.05
# Correlated noise that alternates and is weaker than this, in mean edges, is removed whether or not its longer waves are those of
# noise: it is that of laser scans (0.04), whose lines are uneven. Clean models that look like noise seem to have 0.2 and more.
FAINT = 0.08
# Noise that seems to be white is correlated if its waves say so, and that it is this many times as strong.
STRONGER = 1.25
# The bounds of the shortest waves, in standard deviations of the rounding of coordinates, if that is the noise.
ROUNDED = (0.6, 1.6)
# Time of the bi-Laplacian filter for the normals of the vertices, in squared edges. With strong noise the normals of the data
# have errors of 30 degrees, and sigma along them would be 16 % too low.
SETTLED = 1.0
# Sigma and kurtosis are measured on the share CALMEST of vertices where the curvature after the time CALM is least, in the root
# mean square over NEAR rounds of neighbours, and correlation over AROUND rounds, because single vertices are chosen by their
# noise: it then seems correlated, and skewed noise smaller (0.75 sigma on balls, with 2 rounds 0.85).
CALM, CALMEST, NEAR, AROUND = 4.0, 0.5, 2, 10
# Of coarse models most vertices are beside a crease, which seems to be noise (a box of 386 vertices, noise of 0.01 edges: 0.12).
# If sigma is LEAKED times that at the edges, which are flat across most of them, and residuals do not alternate (white noise
# and impulses -0.34 to -0.22, creases -0.16 to 0.13), it is replaced by that, unless that is above LARGE mean edges: it is
# never above 0.23 of them, however strong the noise. Correlated noise is at most SMOOTH times that at the edges.
LEAKED, ALTERNATING, SMOOTH, LARGE = 1.3, -0.19, 1.1, 0.2
# The kurtosis of Gaussian noise, the one above which noise is impulsive, and the largest number of rounds of neighbour means.
GAUSSIAN, IMPULSIVE, SPREAD = 3.0, 3.5, 6
# The kurtosis above which correlation is not estimated, because impulses also correlate neighbours.
SURE = 10.0
# Noise is white unless its correlation is beyond this share of the interval from that of white noise to that of one round (16
# shapes, 4 seeds: white noise -0.7 to 0.6, one round 0.5 to 1.3). Both are means over DRAWS samples of noise.
SURELY, DRAWS = 0.65, 4
# The correlation of few edges must also differ from that of white noise by this many standard errors.
BY_CHANCE = 2.0


@dataclass(frozen=True)
class PointNoise(Noise):
    """Noise of the points of a mesh along its normals, unit of the points.

    :ivar kurtosis: fourth moment over the squared second one; 3 for Gaussian noise, more if some vertices are far off.
    :ivar spread: number of rounds of neighbour means that give white noise the same correlation; 0: white.
    :ivar voxels: the edges of the voxels if the mesh is a level set of a binary volume; None for any other.
    :ivar left: the largest share of its variance that the best method may leave; if more is left, it may be the shape.
    :ivar quanta: of the coordinates, if rounding is the noise; empty for any other.
    """

    kurtosis: float = GAUSSIAN
    spread: int = 0
    voxels: VoxelEdges | None = field(default=None, repr=False, compare=False)
    left: float = 1.0
    quanta: tuple[float, ...] = ()

    @property
    def is_plain(self) -> bool:
        """Whether it is white and not impulsive."""
        return self.spread == 0 and self.kurtosis <= IMPULSIVE


def noise_on(channels: Array, faces: Array, points: Array | None = None) -> Noise:
    """Estimate the noise of values on the vertices of a mesh, robustly.

    It is the median absolute deviation of (I - A)^2 applied to the values, where A is the mean of the neighbours, divided at each
    vertex by its response to noise. Of the neighbours of a vertex among irregular ones, the plain mean is not at the vertex,
    and a slope would count as noise (0.54 instead of 0.20 for a plane of slope 1 on random points 2 apart); with the weights of
    the cotangents it is, and vertices at the border and beside it, where it is not, are left out as far as others remain.

    :param channels: (n, k).
    :param faces: (m, 3).
    :param points: (n, d), the places of the vertices; None: the mean is a plain one.
    """
    mean = neighbour_means(faces, len(channels), "free") if points is None else cotangent_means(points, faces)
    near = np.zeros(len(channels), bool)
    if points is not None:
        rim = connect((faces,), len(channels)).rim
        near = rim | (mean @ rim > 0)
    return noise_beside(channels, mean, ~near)


def noise_beside(channels: Array, mean: Any, asked: Array) -> Noise:
    """:func:`noise_on` by the means of neighbours.

    :param channels: (n, k).
    :param mean: (n, n), the matrix of these means.
    :param asked: (n,), the vertices that are used, if any of them has neighbours.
    """
    umbrella: Any = sparse.csr_matrix(sparse.identity(len(channels)) - mean)
    gain = _gain(umbrella)
    inner = gain > 0
    inner = inner & asked if (inner & asked).any() else inner
    rough = (umbrella @ (umbrella @ channels.astype(np.float64))).T
    sigmas = [MAD * float(np.median(np.abs(r[inner] / gain[inner]))) if inner.any() else 0.0 for r in rough]
    sigmas = [0.0 if sigma <= _rounding(channels) else sigma for sigma in sigmas]
    quanta = [quantum_of(channel) for channel in channels.T]
    whole = float(np.sqrt(np.mean(np.square(sigmas))))
    how = "differences" if inner.any() else "nothing"
    return Noise(whole, max(q for q, _ in quanta), tuple(sigmas), max(s for _, s in quanta), how)


def noise_of_points(points: Array, faces: Array, counted: Array | None = None) -> PointNoise:
    """Estimate the noise of the points of a mesh along its normals.

    It is that of :func:`noise_on` for the points along the normals of a smoothed copy. Designed meshes have no noise: almost
    all of their vertices are at an edge across which the mesh is flat up to rounding, or their residuals do not alternate
    between neighbours as those of noise do. For impulsive noise sigma is the root mean square. For correlated noise, which is
    reduced by differences, sigma is corrected for that.

    :param points: (n, 3).
    :param faces: (m, 3).
    :param counted: (n,), mask of the vertices that are used; None: all.
    """
    x, n = points.astype(np.float64), len(points)
    umbrella: Any = sparse.csr_matrix(sparse.identity(n) - neighbour_means(faces, n, "free"))
    gain = _gain(umbrella)
    inner = gain > 0 if counted is None else (gain > 0) & counted
    if not inner.any():
        return PointNoise(0.0, 0.0, (0.0,))
    upright = normals_at(x, faces)
    bend, rough = _along(umbrella, x, upright, gain)
    free = inner & ~beside_flat_edges(x, faces)
    noisy, least = _is_noisy(umbrella, bend, rough, free)
    none = PointNoise(0.0, 0.0, (0.0,), how="differences")
    simplified = least is not None and bent_like_noise(x, faces, upright, _white(numbers_of(x, faces))) < least
    noisy, quanta = noisy and not simplified, quanta_of(points[np.unique(faces)])
    if not noisy and quanta is None and free.sum() < EVERYWHERE * inner.sum():
        return none
    step = mean_edge(x, faces)
    even = umbrella_generator(connect((faces,), n), step, gain > 0, True)
    normals = normals_at(filtered(even, x, SETTLED * step**2, 2), faces)
    bend, rough = _along(umbrella, x, normals, gain)
    bends = _along(umbrella, filtered(even, x, CALM * step**2, 2), normals, gain)[0] ** 2
    seen = _Seen(_Graph(umbrella, gain), bend, rough, inner, _spread_out(umbrella, bends, NEAR), step)
    waves = seen.waves(numbers_of(x, faces))
    rounded = _rounded(waves, quanta)
    if rounded is not None:
        return rounded
    if noisy:
        found = _alternating(seen, x, faces, normals)
    else:
        found = seen.correlated(waves) if free.sum() >= EVERYWHERE * inner.sum() else None
    return none if found is None or found.sigma <= _rounding(points) else found


@dataclass(frozen=True, eq=False)
class _Graph:
    """The umbrella I - A (n, n) of a graph, and its response (n,) of :func:`_gain`."""

    umbrella: Any
    gain: Array

    def residuals(self, values: Array) -> Array:
        """(I - A)^2 applied to values (n, k), divided by its response."""
        gain = self.gain[:, None]
        return np.divide(self.umbrella @ (self.umbrella @ values), gain, out=np.zeros_like(values), where=gain > 0)


@dataclass(frozen=True, eq=False)
class _Seen:
    """What is measured along the normals of a smoothed copy.

    :ivar bend: (n,), distance of each point from the mean of its neighbours; ``rough``: (n,), residuals.
    :ivar inner: (n,), mask of the vertices that are used.
    :ivar around: (n,), the squared curvature of a smoother copy, mean over NEAR rounds of neighbours.
    :ivar step: the mean edge.
    """

    graph: _Graph
    bend: Array
    rough: Array
    inner: Array
    around: Array
    step: float

    def calmest(self, around: Array) -> Array:
        """The mask (n,) of the share of vertices with the least curvature around them."""
        return self.inner & (around <= np.quantile(around[self.inner], CALMEST))

    def farther_around(self) -> Array:
        """The squared curvature (n,), mean over AROUND rounds."""
        return _spread_out(self.graph.umbrella, self.around, AROUND - NEAR)

    def waves(self, numbers: Array) -> Waves:
        """Bands of waves, beside those of noise that is made of uniform numbers (n,)."""
        return Waves.of(self.graph.umbrella, self.bend, self.farther_around(), self.inner, _white(numbers))

    def correlated(self, waves: Waves) -> PointNoise | None:
        """The noise from waves; None if they are not those of noise."""
        found = waves.noise()
        faint = WEAKEST * self.step if found is not None and found.left == 0 else 0.0
        if found is None or not faint < found.sigma <= STRONGEST * self.step:
            return None
        sigma = found.sigma
        return PointNoise(sigma, 0.0, (sigma,), how="differences", spread=found.rounds, left=found.left)


def _rounded(waves: Waves, quanta: Array | None) -> PointNoise | None:
    """The noise of points whose coordinates have quanta (3,); None if rounding is not the noise of the shortest waves."""
    if quanta is None:
        return None
    sigma = float(np.sqrt(np.mean(np.square(quanta)) / 12.0))
    if not ROUNDED[0] * sigma <= waves.white_size() <= ROUNDED[1] * sigma:
        return None
    return PointNoise(sigma, float(quanta.max()), (sigma,), how="rounding", quanta=tuple(quanta.tolist()))


def _alternating(seen: _Seen, x: Array, faces: Array, normals: Array) -> PointNoise:
    """The noise of points (n, 3) of which neighbours differ as those of noise do."""
    graph, inner = seen.graph, seen.inner
    both: Any = sparse.csr_matrix(sparse.identity(len(x)) - means_over_diagonals(x, faces, normals))
    whole = _Graph(both, _gain(both))
    clear, calm = _along(both, x, normals, whole.gain)[1], seen.calmest(seen.around)
    if (kurtosis := kurtosis_of(clear[calm])) > IMPULSIVE:
        level = without_creases(graph.umbrella, normals, clear, inner, calm)
        if level is not None:
            calm, kurtosis = level, kurtosis_of(clear[level])
            _, correlation, edges = _alternation(graph.umbrella, seen.bend, seen.rough, level)
            if correlation <= WHITE + 1.0 / np.sqrt(max(edges, 1)):
                sigma = MAD * float(np.median(np.abs(clear[level])))
                return PointNoise(sigma, 0.0, (sigma,), how="differences")
    sigma, at_edges = MAD * float(np.median(np.abs(clear[calm]))), noise_at_edges(x, faces, inner)
    leaked = kurtosis <= SURE and at_edges < min(sigma / LEAKED, LARGE * seen.step)
    if leaked and _correlation(graph.umbrella, seen.rough, calm) > ALTERNATING:
        return PointNoise(at_edges, 0.0, (at_edges,), how="differences")
    waves = seen.waves(numbers_of(x, faces))
    if sigma <= SMOOTH * at_edges and kurtosis <= SURE:
        region, numbers = seen.calmest(seen.farther_around()), numbers_of(x, faces)
        found = _alternation(graph.umbrella, seen.bend, seen.rough, region)
        spread, share = _spread(graph, whole, region, found, numbers)
        if spread > 0:
            sigma = sigma / share
            left = 1.0 if waves.are_few else LEFT_IF_SHORT
            known = PointNoise(sigma, 0.0, (sigma,), how="differences", spread=spread, left=left)
            other = seen.correlated(waves)
            if other is not None and other.left >= LEFT_ON_SMOOTH:
                return other
            if sigma <= FAINT * seen.step:
                return replace(known, left=1.0)
            return known if waves.are_noise(spread) else other or replace(known, left=0.0)
    if kurtosis > IMPULSIVE:
        sigma = float(np.sqrt(np.mean(clear[calm] ** 2)))
        return PointNoise(sigma, 0.0, (sigma,), how="differences", kurtosis=kurtosis)
    known = PointNoise(sigma, 0.0, (sigma,), how="differences", kurtosis=kurtosis)
    other = None if waves.are_noise(0) else seen.correlated(waves)
    if other is None or other.sigma < STRONGER * sigma:
        return known
    if other.left >= LEFT_ON_SMOOTH:
        return other
    return replace(other, left=LEFT_IF_SHORT) if waves.are_noise(other.spread) else known


def _is_noisy(umbrella: Any, bend: Array, rough: Array, free: Array) -> tuple[bool, float | None]:
    """Whether residuals alternate as noise does, on enough vertices without flat edges, mask ``free`` (n,); and the least number
    of :func:`.edge_noise.bent_like_noise` with which they are noise, where they may also be the shape of few triangles.
    """
    if free.sum() < SHARE * len(free):
        return False, None
    alternating, correlation, edges = _alternation(umbrella, bend, rough, free)
    least = next((bent for low, high, bent in SIMPLIFIED if low < correlation <= high), None)
    if alternating >= ALTERNATES:
        return True, least
    chance = SIGNIFICANT / np.sqrt(max(edges, 1))  # of few edges a correlation says less
    return correlation <= (max(CORRELATED - chance, WHITE) if alternating >= ALMOST else WHITE), least


def _spread(
    graph: _Graph, whole: _Graph, calm: Array, found: tuple[float, float, int], numbers: Array
) -> tuple[int, float]:
    """The number of rounds of neighbour means after which white noise has the correlation that was found, and the share of its
    standard deviation in the residuals; 0 and 1 for white noise.

    :param graph: in which neighbours are correlated; ``whole``: of the residuals.
    :param found: the answer of :func:`_alternation`.
    """
    made = _white(numbers)
    _, correlation, edges = found
    chance = BY_CHANCE / np.sqrt(max(edges, 1))
    before, share, white = (np.nan, 1.0), 1.0, np.nan
    for rounds in range(SPREAD + 1):
        rough, clear = graph.residuals(made), whole.residuals(made)
        here = float(np.mean([_alternation(graph.umbrella, one, one, calm)[1] for one in rough.T]))
        share = MAD * float(np.median(np.abs(clear[calm]), axis=0).mean()) / float(made.std())
        white = here if rounds == 0 else white
        nearer = SURELY if rounds == 1 else 0.5
        if rounds > 0 and correlation < max(before[0] + nearer * (here - before[0]), white + chance):
            return rounds - 1, before[1] if rounds > 1 else 1.0
        before = here, share
        made = made - 0.5 * (graph.umbrella @ made)
    return SPREAD, share


def _white(numbers: Array) -> Array:
    """DRAWS samples (n, DRAWS) of white noise, from uniform numbers (n,)."""
    draws = np.column_stack([again(numbers, times) for times in range(DRAWS)])
    return ndtri(np.clip(draws, 1e-6, 1.0 - 1e-6))


def _spread_out(umbrella: Any, values: Array, rounds: int) -> Array:
    """Values (n,) after rounds in which each becomes the mean of itself and that of its neighbours."""
    for _ in range(rounds):
        values = values - 0.5 * (umbrella @ values)
    return values


def _along(umbrella: Any, x: Array, normals: Array, gain: Array) -> tuple[Array, Array]:
    """The distance (n,) of each point from the mean of its neighbours along normals (n, 3), and its residuals (n,)."""
    bend = np.einsum("ij,ij->i", umbrella @ x, normals)
    return bend, np.divide(umbrella @ bend, gain, out=np.zeros_like(gain), where=gain > 0)


def _alternation(umbrella: Any, bend: Array, rough: Array, free: Array) -> tuple[float, float, int]:
    """For edges between vertices with mask ``free`` (n,): the share with a change of the sign of the curvature, the
    correlation of residuals, and how many there are; 0 and 0 for too few edges.
    """
    start, end = _edges_of(umbrella, free)
    if len(start) < EDGES:
        return 0.0, 0.0, len(start)
    size = MAD * float(np.median(np.abs(rough[free])))
    held = np.clip(rough / max(size, np.finfo(float).tiny), -CLIPPED, CLIPPED)
    return float(np.mean(bend[start] * bend[end] < 0)), float(np.mean(held[start] * held[end])), len(start)


def _correlation(umbrella: Any, rough: Array, free: Array) -> float:
    """The correlation of residuals (n,) that are not clipped, along edges between vertices with mask ``free`` (n,)."""
    start, end = _edges_of(umbrella, free)
    return float(np.mean(rough[start] * rough[end]) / np.mean(rough[free] ** 2)) if len(start) else 0.0


def _edges_of(umbrella: Any, free: Array) -> tuple[Array, Array]:
    """Both ends (e,) of the edges between vertices with mask (n,)."""
    edges = umbrella.tocoo()
    both = (edges.row < edges.col) & free[edges.row] & free[edges.col]
    return edges.row[both], edges.col[both]


def _gain(umbrella: Any) -> Array:
    """The standard deviation (n,) of (I - A)^2 applied to white noise of deviation 1."""
    twice = umbrella @ umbrella
    return np.sqrt(np.asarray(twice.multiply(twice).sum(axis=1)).ravel())


def _rounding(values: Array) -> float:
    """The rounding error of the values, in their unit."""
    return 2.0 * float(np.finfo(values.dtype).eps) * float(np.abs(values).max(initial=0.0))
