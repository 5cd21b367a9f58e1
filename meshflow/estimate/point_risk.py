"""The mean square error along the normals of a mesh, estimated from the noisy points alone."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from meshflow.estimate.mesh_noise import PointNoise
from meshflow.estimate.risk import Candidate
from meshflow.estimate.vertex_numbers import drawn, numbers_of
from meshflow.flow.low_pass import filtered
from meshflow.geometry.connectivity import connect
from meshflow.geometry.laplacians import neighbour_means, umbrella_generator
from meshflow.geometry.normals import beyond, mean_edge, measured, normals_at
from meshflow.geometry.orientation import parts
from meshflow.geometry.validation import Array
from meshflow.surfaces.surface import Surface

__all__ = ["PointCandidate", "PointRisk", "folded", "shifted"]

# The second run starts beside the first by this share of the noise: a derivative.
PROBE = 0.1
# Time of the bi-Laplacian filter with uniform weights after which normals are taken, and of that around which noise is drawn
# anew, in squared edges.
NORMALS, AROUND = 1.0, 2.0
# A triangle whose normal differs this much (cosine) from the mean of its own and its neighbours is folded. A share of folded
# triangles counts as this many sigma squared, since a fold is wrong however close its points are.
FOLDED, WEIGHT = 0.3, 10.0
# What a credible risk is not below, in sigma squared, and what no vertex moves beyond, in sigmas and edges.
BELOW, FAR, FAR_EDGES = -0.3, 10.0, 2.0


class PointCandidate(Candidate):
    """A candidate of which nothing is chosen that was not looked at."""

    @property
    def least(self) -> tuple[float, float]:
        """Time and mean square error where that is least, of the times looked at."""
        i = int(np.argmin(self.squares))
        return self.times[i], self.squares[i]


@dataclass(frozen=True, eq=False)
class PointRisk:
    """The mean square error along the normals, E mean ((x - y) . n)^2, y the points without noise: what is chosen by.

    Of any method it is mean ((x - x0) . n)^2 - sigma^2 + 2 cov, cov the mean covariance of the noise with what the method makes
    of it (Efron 2004). Of white Gaussian noise cov is sigma^2 times the mean derivative of the result by its own point (Stein
    1981), which a second run shows that starts beside the first by numbers of mean square 1 (Ramani, Blu, Unser 2008). Of any
    other, impulsive or correlated, that identity does not hold: cov is found by running the method once more, on a smooth copy
    of the mesh with noise drawn anew, of the same distribution and correlation.

    The normals are those of a smoothed copy: along the normals of the noisy points themselves a method that moves points along
    normals alone seems to leave the sine of their error. Candidates are compared on the same points and the same numbers:
    what sigma is wrong by shifts all of them alike.

    :ivar start: points (n, 3) of the data.
    :ivar beside: (n, 3), where the second run starts.
    :ivar home: (n, 3), what the change of the second run is measured from; None: from the first run.
    :ivar probe: (n,), what that change is correlated with.
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
        """The mean square error of the data as it is."""
        return self.sigma**2 * (1.0 + WEIGHT * folded(self.start, self.faces, self.across))

    def of_pair(self, one: Array, other: Array) -> float:
        """The mean square error of a run at one time, squared unit of the points.

        :param other: the points of the second run at that time.
        :returns: infinity where that is not credible: far below zero, or vertices thrown away.
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
    """Normals (n, 3) that point away from the middle of each part, whichever way its triangles are turned."""
    count, label = parts(faces, len(x))
    size = np.maximum(np.bincount(label, minlength=count), 1)
    middle = np.stack([np.bincount(label, column, count) for column in x.T], axis=1) / size[:, None]
    away = np.bincount(label, np.einsum("ij,ij->i", x - middle[label], normals), count)
    return np.where(away < 0, -1.0, 1.0)[label, None] * normals


def _drawn_anew(residual: Array, numbers: Array, faces: Array, noise: PointNoise) -> Array:
    """Noise (n,) of standard deviation sigma: of the distribution of residuals, or where it is correlated, of its correlation.

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
