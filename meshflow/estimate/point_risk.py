"""The mean square error along the normals of a mesh, estimated from the noisy points alone."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from meshflow.estimate.mesh_noise import PointNoise
from meshflow.estimate.risk import PROBE, Candidate
from meshflow.estimate.vertex_numbers import drawn, numbers_of
from meshflow.flow.low_pass import filtered
from meshflow.geometry.connectivity import connect
from meshflow.geometry.laplacians import neighbour_means, umbrella_generator
from meshflow.geometry.normals import beyond, mean_edge, measured, normals_at
from meshflow.geometry.orientation import parts
from meshflow.geometry.validation import Array
from meshflow.surfaces.surface import Surface

__all__ = ["PointCandidate", "PointRisk", "folded", "shifted"]

# Times of the bi-Laplacian filter with uniform weights, in squared edges: for the normals, and for the smooth copy with new
# noise.
NORMALS, AROUND = 1.0, 2.0
# A triangle is folded if the cosine of its normal and the mean with its neighbours is below FOLDED. The share of folded triangles
# times WEIGHT sigma^2 is added to the risk, because a fold is wrong even if its points are close.
FOLDED, WEIGHT = 0.3, 10.0
# The lower bound of a credible risk, in sigma^2, and bounds of the displacement of a vertex, in sigmas and in edges.
BELOW, FAR, FAR_EDGES = -0.3, 10.0, 2.0


class PointCandidate(Candidate):
    """A candidate whose least risk is one of those that were estimated."""

    @property
    def least(self) -> tuple[float, float]:
        """The time and the mean square error at the minimum over ``times``."""
        i = int(np.argmin(self.squares))
        return self.times[i], self.squares[i]


@dataclass(frozen=True, eq=False)
class PointRisk:
    """The expected mean square error along the normals, E mean ((x - y) . n)^2, where y are the points without noise.

    For any method it is mean ((x - x0) . n)^2 - sigma^2 + 2 cov, where cov is the mean covariance of the noise with the result
    (Efron 2004). For white Gaussian noise cov is sigma^2 times the mean derivative of the result by its own point (Stein 1981),
    which is measured by a second run with a start perturbed by numbers of mean square 1 (Ramani, Blu, Unser 2008). For
    impulsive or correlated noise this identity does not hold. Then cov is measured by a second run on a smooth copy of the mesh
    with new noise of the same distribution and correlation.

    The normals are those of a smoothed copy. With the normals of the noisy points, the error would be underestimated for
    methods that move points along their normals. All candidates are compared with the same points and the same random numbers,
    so an error of sigma shifts all of them equally.

    :ivar start: points (n, 3) of the data.
    :ivar beside: (n, 3), start of the second run.
    :ivar home: (n, 3), reference of the change of the second run; None: the first run.
    :ivar probe: (n,), the numbers with which that change is correlated.
    :ivar normals: (n, 3).
    :ivar counted: (n,), vertices.
    :ivar sigma: unit of the points.
    """

    start: Array
    beside: Array
    home: Array | None
    probe: Array
    normals: Array
    counted: Array
    sigma: float
    faces: Array
    across: Array
    step: float

    @classmethod
    def of(cls, surface: Surface, faces: Array, counted: Array, noise: PointNoise) -> "PointRisk":
        """The risk on the points of a surface."""
        x = surface.points.astype(np.float64)
        step, sigma = mean_edge(x, faces), noise.sigma
        even = umbrella_generator(connect((faces,), len(x)), step, np.ones(len(x), bool), True)
        normals = _outwards(normals_at(filtered(even, x, NORMALS * step**2, 2), faces), x, faces)
        numbers = numbers_of(x, faces)
        if noise.is_plain:
            probe = np.sqrt(2.0) * np.cos(2.0 * np.pi * numbers)
            beside, home = x + PROBE * sigma * probe[:, None] * normals, None
        else:
            home = filtered(even, x, AROUND * step**2, 2)
            normals = _outwards(normals_at(home, faces), x, faces)
            probe = _drawn_anew(np.einsum("ij,ij->i", x - home, normals), numbers, faces, noise)
            beside = home + probe[:, None] * normals
        return cls(x, beside, home, probe, normals, counted, sigma, faces, beyond(faces), step)

    @property
    def at_start(self) -> float:
        """The mean square error of the unchanged data."""
        return self.sigma**2 * (1.0 + WEIGHT * folded(self.start, self.faces, self.across))

    def of_pair(self, one: Array, other: Array) -> float:
        """The mean square error of a run at one time, squared unit of the points.

        :param other: the points of the second run at that time.
        :returns: infinity if it is not credible: far below zero, or with vertices that moved far away.
        """
        moved = one - self.start
        if not np.isfinite(one).all() or np.abs(moved).max() > FAR * self.sigma + FAR_EDGES * self.step:
            return np.inf
        change = np.einsum("ij,ij->i", moved, self.normals)[self.counted]
        against, scale = (one, self.sigma / PROBE) if self.home is None else (self.home, 1.0)
        kept = (self.probe * np.einsum("ij,ij->i", other - against, self.normals))[self.counted]
        square = float(np.mean(change * change)) - self.sigma**2 + 2.0 * scale * float(np.mean(kept))
        if square < BELOW * self.sigma**2:
            return np.inf
        return square + WEIGHT * self.sigma**2 * folded(one, self.faces, self.across)


def _outwards(normals: Array, x: Array, faces: Array) -> Array:
    """Normals (n, 3) that point away from the middle of each part, for any orientation of its triangles."""
    count, label = parts(faces, len(x))
    size = np.maximum(np.bincount(label, minlength=count), 1)
    middle = np.stack([np.bincount(label, column, count) for column in x.T], axis=1) / size[:, None]
    away = np.bincount(label, np.einsum("ij,ij->i", x - middle[label], normals), count)
    return np.where(away < 0, -1.0, 1.0)[label, None] * normals


def _drawn_anew(residual: Array, numbers: Array, faces: Array, noise: PointNoise) -> Array:
    """New noise (n,) of standard deviation sigma, with the distribution of residuals, or with the correlation of correlated
    noise.

    :param numbers: (n,) in [0, 1).
    """
    if noise.spread == 0:
        made = drawn(residual, numbers)
    else:
        made = ndtri(np.clip(numbers, 1e-6, 1.0 - 1e-6))
        mean = neighbour_means(faces, len(made), "free")
        for _ in range(noise.spread):
            made = 0.5 * (made + mean @ made)
    made = made - made.mean()
    return made * (noise.sigma / max(float(made.std()), np.finfo(float).tiny))


def shifted(surface: Surface, points: Array) -> Surface:
    """The surface with other points (n, 3)."""
    return replace(surface, points=points)


def folded(points: Array, faces: Array, across: Array) -> float:
    """The share of folded triangles, whose normal differs from the mean of its own and its neighbours."""
    normals, areas = measured(points, faces)
    mean = areas[:, None] * normals
    for side in across.T:
        mean = mean + np.where(side[:, None] >= 0, areas[side, None] * normals[side], 0.0)
    lengths = np.linalg.norm(mean, axis=1)
    cosine = np.divide(
        np.einsum("ij,ij->i", normals, mean), lengths, out=np.ones_like(lengths), where=(lengths > 0) & (areas > 0)
    )
    return float(np.mean(cosine < FOLDED))
