"""What a mesh says about its own noise: of its points along the normals, or of values on its vertices."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sparse
from scipy.special import ndtri

from meshflow.estimate.noise import Noise
from meshflow.estimate.noise_growth import MAD
from meshflow.estimate.quantization import quantum_of
from meshflow.estimate.vertex_numbers import numbers_of
from meshflow.estimate.voxels import voxel_edge
from meshflow.flow.low_pass import filtered
from meshflow.geometry.connectivity import connect
from meshflow.geometry.laplacians import neighbour_means, umbrella_generator
from meshflow.geometry.normals import mean_edge, normals_at
from meshflow.geometry.planarity import beside_flat_edges
from meshflow.geometry.validation import Array

__all__ = ["PointNoise", "noise_of_points", "noise_on"]

# Residuals, in their own deviation, beyond which one counts no more than this.
CLIPPED = 2.5
# What is noise alternates from neighbour to neighbour. White noise: the residuals of neighbours correlate by -0.24 to -0.31, so
# that of a share of 0.6 of the edges the signs differ. Shapes that are finely sampled: the curvature has one sign almost
# everywhere, and the residuals correlate by 0 to 0.5; coarse models, and irregular sampling of what is curved, come between.
ALTERNATES, ALMOST, WHITE = 0.26, 0.08, -0.23
CORRELATED = -0.11
# Edges of which both ends lie beside no flat edge: below so many there is nothing to tell noise by, nor where their vertices
# are less than this share.
EDGES, SHARE = 24, 0.04
# Time of the bi-Laplacian filter after which the normals of the vertices are taken, in squared edges: with strong noise those of
# the data are off by 30 degrees, and sigma along them comes out 16 % low.
SETTLED = 1.0
# Sigma of impulses and correlation are looked for where the shape bends least: after this time, on this share of the vertices.
CALM, CALMEST = 4.0, 0.5
# The kurtosis of Gaussian noise, and above which noise is impulsive; rounds of means of neighbours that are looked at.
GAUSSIAN, IMPULSIVE, SPREAD = 3.0, 3.8, 6
# Above it correlation is not looked for: what is far off correlates neighbours too.
SURE = 10.0
# Distance of the vertices from what was divided into voxels, root mean square, in their edges.
IN_STEPS = 0.2
# Noise is white unless the correlation found is this share of the way to that of one round.
SURELY = 0.75


@dataclass(frozen=True)
class PointNoise(Noise):
    """Noise of the points of a mesh along its normals, unit of the points.

    :ivar kurtosis: fourth moment over the squared second; 3 of Gaussian noise, more where some vertices are far off.
    :ivar spread: so many rounds of means of neighbours correlate white noise as much; 0: white.
    :ivar voxel: the edge of the voxels of whose binary volume the mesh is a level set; 0 for any other.
    """

    kurtosis: float = GAUSSIAN
    spread: int = 0
    voxel: float = 0.0

    @property
    def is_plain(self) -> bool:
        """Whether it is white, and few vertices are far off."""
        return self.spread == 0 and self.kurtosis <= IMPULSIVE


def noise_on(channels: Array, faces: Array) -> Noise:
    """Estimate the noise of values on the vertices of a mesh, robustly.

    It is the median absolute deviation of (I - A)^2 applied to the values, where A is the mean of the neighbours, divided at each
    vertex by its response to noise. Linear variation between neighbours, and with it curvature, has no effect.

    :param channels: (n, k).
    :param faces: (m, 3).
    """
    umbrella: Any = sparse.csr_matrix(sparse.identity(len(channels)) - neighbour_means(faces, len(channels), "free"))
    gain = _gain(umbrella)
    inner = gain > 0
    rough = (umbrella @ (umbrella @ channels.astype(np.float64))).T
    sigmas = [MAD * float(np.median(np.abs(r[inner] / gain[inner]))) if inner.any() else 0.0 for r in rough]
    sigmas = [0.0 if sigma <= _rounding(channels) else sigma for sigma in sigmas]
    quanta = [quantum_of(channel) for channel in channels.T]
    whole = float(np.sqrt(np.mean(np.square(sigmas))))
    how = "differences" if inner.any() else "nothing"
    return Noise(whole, max(q for q, _ in quanta), tuple(sigmas), max(s for _, s in quanta), how)


def noise_of_points(points: Array, faces: Array, counted: Array | None = None) -> PointNoise:
    """Estimate the noise of the points of a mesh along its normals.

    As :func:`noise_on`, of the points along the normals of a smoothed copy. None is found where the mesh was drawn: where all
    but a few vertices lie beside an edge across which it is flat to rounding, and where what is rough does not alternate from
    neighbour to neighbour as noise does, on many vertices. Where some vertices are far off, sigma is the root mean square; where
    neighbours are correlated, that of the noise of which as much is left by the differences.

    :param points: (n, 3).
    :param faces: (m, 3).
    :param counted: (n,), the vertices that are looked at; None: all.
    """
    voxel = voxel_edge(points[np.unique(faces)])
    if voxel > 0:
        sigma = IN_STEPS * voxel
        return PointNoise(sigma, 0.0, (sigma,), how="voxels", voxel=voxel)
    x, n = points.astype(np.float64), len(points)
    umbrella: Any = sparse.csr_matrix(sparse.identity(n) - neighbour_means(faces, n, "free"))
    gain = _gain(umbrella)
    inner = gain > 0 if counted is None else (gain > 0) & counted
    if not inner.any():
        return PointNoise(0.0, 0.0, (0.0,))
    bend, rough = _along(umbrella, x, normals_at(x, faces), gain)
    if not _is_noisy(umbrella, bend, rough, inner & ~beside_flat_edges(x, faces)):
        return PointNoise(0.0, 0.0, (0.0,), how="differences")
    step = mean_edge(x, faces)
    even = umbrella_generator(connect((faces,), n), step, gain > 0, True)
    settled = filtered(even, x, SETTLED * step**2, 2)
    bend, rough = _along(umbrella, x, normals_at(settled, faces), gain)
    calm_bend = np.abs(_along(umbrella, filtered(even, x, CALM * step**2, 2), normals_at(settled, faces), gain)[0])
    calm = inner & (calm_bend <= np.quantile(calm_bend[inner], CALMEST))
    sigma = MAD * float(np.median(np.abs(rough[calm])))
    if sigma <= _rounding(points):
        return PointNoise(0.0, 0.0, (0.0,), how="differences")
    found = min(_alternation(umbrella, bend, rough, some)[1] for some in (calm, inner))
    kurtosis = float(np.mean(rough[calm] ** 4) / np.mean(rough[calm] ** 2) ** 2)
    spread, share = (0, 1.0) if kurtosis > SURE else _spread(umbrella, gain, calm, found, numbers_of(x, faces))
    kurtosis = GAUSSIAN if spread else kurtosis
    sigma = sigma / share if kurtosis <= IMPULSIVE else float(np.sqrt(np.mean(rough[calm] ** 2)))
    return PointNoise(sigma, 0.0, (sigma,), how="differences", kurtosis=kurtosis, spread=spread)


def _is_noisy(umbrella: Any, bend: Array, rough: Array, free: Array) -> bool:
    """Whether what is rough alternates as noise does, on many vertices that are free (n,) of edges that are flat to rounding."""
    if free.sum() < SHARE * len(free):
        return False
    alternating, correlation = _alternation(umbrella, bend, rough, free)
    if alternating >= ALTERNATES:
        return True
    return correlation <= (CORRELATED if alternating >= ALMOST else WHITE)


def _spread(umbrella: Any, gain: Array, calm: Array, found: float, numbers: Array) -> tuple[int, float]:
    """How many rounds of means of neighbours make white noise as correlated as was found, and the share of its standard deviation
    that the differences then leave; 0 and 1 for none.
    """
    made = ndtri(np.clip(numbers, 1e-6, 1.0 - 1e-6))
    before, share = (np.nan, 1.0), 1.0
    for rounds in range(SPREAD + 1):
        rough = np.divide(umbrella @ (umbrella @ made), gain, out=np.zeros_like(gain), where=gain > 0)
        here = _alternation(umbrella, rough, rough, calm)[1]
        share = MAD * float(np.median(np.abs(rough[calm]))) / float(made.std())
        nearer = SURELY if rounds == 1 else 0.5
        if rounds > 0 and found < before[0] + nearer * (here - before[0]):
            return rounds - 1, before[1] if rounds > 1 else 1.0
        before = here, share
        made = made - 0.5 * (umbrella @ made)
    return SPREAD, share


def _along(umbrella: Any, x: Array, normals: Array, gain: Array) -> tuple[Array, Array]:
    """How far each point is off the mean of its neighbours, along normals (n, 3), and the residuals (n,) of that."""
    bend = np.einsum("ij,ij->i", umbrella @ x, normals)
    return bend, np.divide(umbrella @ bend, gain, out=np.zeros_like(gain), where=gain > 0)


def _alternation(umbrella: Any, bend: Array, rough: Array, free: Array) -> tuple[float, float]:
    """Of edges between vertices that are free (n,): the share across which the curvature changes sign, and the correlation of the
    residuals; 0 and 0 where there are too few of them.
    """
    edges = umbrella.tocoo()
    both = (edges.row < edges.col) & free[edges.row] & free[edges.col]
    start, end = edges.row[both], edges.col[both]
    if len(start) < EDGES:
        return 0.0, 0.0
    size = MAD * float(np.median(np.abs(rough[free])))
    held = np.clip(rough / max(size, np.finfo(float).tiny), -CLIPPED, CLIPPED)
    return float(np.mean(bend[start] * bend[end] < 0)), float(np.mean(held[start] * held[end]))


def _gain(umbrella: Any) -> Array:
    """What (I - A)^2 makes of white noise at each vertex, (n,)."""
    twice = umbrella @ umbrella
    return np.sqrt(np.asarray(twice.multiply(twice).sum(axis=1)).ravel())


def _rounding(values: Array) -> float:
    """What is rounding alone, in the unit of the values."""
    return 2.0 * float(np.finfo(values.dtype).eps) * float(np.abs(values).max(initial=0.0))
