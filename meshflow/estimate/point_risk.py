"""The mean square error along the normals of a mesh, estimated from the noisy points alone."""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from meshflow.estimate.mesh_noise import IMPULSIVE, PointNoise
from meshflow.estimate.risk import Candidate
from meshflow.estimate.vertex_numbers import again, drawn, numbers_of
from meshflow.flow.low_pass import filtered
from meshflow.geometry.connectivity import connect
from meshflow.geometry.laplacians import neighbour_means, umbrella_generator
from meshflow.geometry.normals import beyond, mean_edge, measured, normals_at
from meshflow.geometry.orientation import parts
from meshflow.geometry.validation import Array

__all__ = ["FEWER", "PointCandidate", "PointRisk", "folded"]

# Times of the bi-Laplacian filter with uniform weights, in squared edges: for the normals, and for the smooth copy with new
# noise.
NORMALS, AROUND = 1.0, 2.0
# t of the split. With a smaller one the methods see noise that is nearer to that of the data, and the risk is less certain. For
# impulsive noise t is its kurtosis over HEAVY, up to 1.
SPLIT, HEAVY = 0.5, 7.0
# The number of vertices below which points are split twice, and the one below which they are split four times, which on 96 cases
# of 600 to 1500 vertices lowers the angle by 2 % and the distance by 1 %; eight times gain nothing more.
FEW, FEWER = 6000, 3000
# What looks like impulses may be the shape of a coarse model. The risk of changing nothing is taken for SHAPE sigma^2 then. That
# of the best method is at most half of sigma^2 where there are impulses (72 cases), and 0.7 on a model without noise.
SHAPE = 0.55
# A triangle is folded if the cosine of its normal and the mean with its neighbours is below FOLDED. The share of folded triangles
# times WEIGHT sigma^2 is added to the risk, because a fold is wrong even if its points are close.
FOLDED, WEIGHT = 0.3, 10.0
# The lower bound of a credible risk, in sigma^2, and bounds of the displacement of a vertex, in sigmas and in edges.
BELOW, FAR, FAR_EDGES = -0.3, 10.0, 2.0
# That bound for correlated noise, of which sigma is found less exactly.
BELOW_CORRELATED = -0.6
# The largest mean offset of a part after a method for correlated noise, in sigmas, which runs long. More is no shrinking that can
# be undone: a ring becomes a wire.
OFFSET = 2.5


@dataclass(frozen=True)
class PointCandidate(Candidate):
    """A candidate whose least risk is one of those that were estimated.

    :ivar alike: differences of mean square errors that do not count; of two such times the longer one is taken.
    """

    alike: float = 0.0

    @property
    def least(self) -> tuple[float, float]:
        """The least mean square error, and the longest time from there on at which it is hardly greater."""
        i, least = int(np.argmin(self.squares)), min(self.squares)
        while 0 < i < len(self.times) - 1 and self.squares[i + 1] <= least + self.alike:
            i += 1
        return self.times[i], least


@dataclass(frozen=True, eq=False)
class PointRisk:
    """The expected mean square error along the normals, E mean ((x - y) . n)^2, where y are the points without noise.

    The points x0 are split: for Gaussian noise e and random numbers z of the same covariance, independent of it, x0 + t z and
    x0 - z / t have independent noise (Pang, Zheng, Quan, Ji, *Recorrupted-to-Recorrupted*, 2021). A method runs on the first, and
    its mean square distance from the second is its error at noise (1 + t^2) sigma^2, plus the known variance (1 + 1 / t^2)
    sigma^2. Unlike an estimate by derivatives (Stein 1981) it does not depend on how smoothly a method depends on its points; for
    the normal filter, which decides at each edge whether it is a crease, that was biased. A small mesh is split twice, with z and
    -z, and a smaller one four times. Impulsive noise is split by numbers of its own distribution, that of the residuals where the
    surface bends little. With t = 1 noise and numbers may be exchanged, so that e - z has the mean zero whatever e + z is: the
    estimate has no bias for any distribution. The less impulsive the noise, the smaller is the bias of a smaller t.

    The normals are those of a smoothed copy. With the normals of the noisy points, the error would be underestimated for
    methods that move points along their normals. All candidates are compared with the same points and the same random numbers,
    so an error of sigma shifts all of them equally.

    :ivar starts: points (n, 3) of each run.
    :ivar others: points (n, 3) from which the distance of each run is measured.
    :ivar known: the variance of what the others have of the noise, which is subtracted.
    :ivar normals: (n, 3).
    :ivar counted: (n,), vertices.
    :ivar sigma: unit of the points.
    :ivar at_start: the mean square error of the unchanged data.
    :ivar below: the lower bound of a credible risk, in sigma^2; ``farthest``: the largest mean offset of a part, in sigmas.
    """

    starts: tuple[Array, ...]
    others: tuple[Array, ...]
    known: float
    normals: Array
    counted: Array
    sigma: float
    faces: Array
    across: Array
    step: float
    at_start: float
    label: Array
    below: float = BELOW
    farthest: float = np.inf

    @classmethod
    def of(
        cls, points: Array, faces: Array, counted: Array, noise: PointNoise, fixed: Array | None = None
    ) -> "PointRisk":
        """The risk on points (n, 3).

        :param counted: (n,), vertices for which the error is estimated.
        :param fixed: (n,), vertices that stay, and get no numbers; None: none.
        """
        x, across = points.astype(np.float64), beyond(faces)
        step, sigma = mean_edge(x, faces), noise.sigma
        even = umbrella_generator(connect((faces,), len(x)), step, np.ones(len(x), bool), True)
        numbers, impulsive = numbers_of(x, faces), noise.kurtosis > IMPULSIVE
        start = sigma**2 * ((SHAPE if impulsive else 1.0) + WEIGHT * folded(x, faces, across))
        home = filtered(even, x, (AROUND if impulsive else NORMALS) * step**2, 2)
        normals = _outwards(normals_at(home, faces), x, faces)
        count = int(counted.sum())
        draws = [numbers] if count >= FEWER else [numbers, again(numbers)]
        if impulsive:
            bends = np.abs(np.einsum("ij,ij->i", home - neighbour_means(faces, len(x), "free") @ home, normals))
            calm = counted & (bends <= np.median(bends[counted]))
            off = np.einsum("ij,ij->i", x - home, normals)[calm]
            made = [_of_size(drawn(off, one), sigma, counted) for one in draws]
        else:
            made = [_of_size(_drawn_anew(one, faces, noise.spread), sigma, counted) for one in draws]
        share = min(noise.kurtosis / HEAVY, 1.0) if impulsive else SPLIT
        free = 1.0 if fixed is None else ~fixed[:, None]  # what stays has no noise beside what moves
        splits = [
            sign * one[:, None] * normals * free for one in made for sign in ((1.0, -1.0) if count < FEW else (1.0,))
        ]
        starts = tuple(x + share * split for split in splits)
        others = tuple(x - split / share for split in splits)
        known = sigma**2 * (1.0 + share**-2)
        label = parts(faces, len(x))[1][counted]
        bounds = () if noise.spread == 0 else (BELOW_CORRELATED, OFFSET)
        return cls(starts, others, known, normals, counted, sigma, faces, across, step, start, label, *bounds)

    def of_states(self, states: tuple[Array, ...], least: float = np.inf) -> float:
        """The mean square error of a method at one time, squared unit of the points.

        :param states: the points (n, 3) of each run at that time.
        :param least: folds are not looked for where it is above this without them.
        :returns: infinity if it is not credible: far below zero, or with vertices that moved far away.
        """
        for state, start in zip(states, self.starts, strict=True):
            far = FAR * self.sigma + FAR_EDGES * self.step
            if not np.isfinite(state).all() or np.abs(state - start).max() > far:
                return np.inf
        trios = zip(states, self.starts, self.others, strict=True)
        pairs = [self._off(*trio) for trio in trios]
        if max(offset for _, offset in pairs) > self.farthest * self.sigma:
            return np.inf
        off = [distances for distances, _ in pairs]
        square = float(np.mean(np.square(off))) - self.known
        if square < self.below * self.sigma**2:
            return np.inf
        if square > least:
            return square
        folds = sum(folded(state, self.faces, self.across) for state in states) / len(states)
        return square + WEIGHT * self.sigma**2 * folds

    def _off(self, state: Array, start: Array, other: Array) -> tuple[Array, float]:
        """The distances (k,) of the counted points from others along the normals, without the mean offset of each part from its
        start; and the largest of these offsets."""
        away, since = (np.einsum("ij,ij->i", state - one, self.normals)[self.counted] for one in (other, start))
        mean = np.bincount(self.label, since) / np.maximum(np.bincount(self.label), 1)
        return away - mean[self.label], float(np.abs(mean).max())


def _outwards(normals: Array, x: Array, faces: Array) -> Array:
    """Normals (n, 3) that point away from the middle of each part, for any orientation of its triangles."""
    count, label = parts(faces, len(x))
    size = np.maximum(np.bincount(label, minlength=count), 1)
    middle = np.stack([np.bincount(label, column, count) for column in x.T], axis=1) / size[:, None]
    away = np.bincount(label, np.einsum("ij,ij->i", x - middle[label], normals), count)
    return np.where(away < 0, -1.0, 1.0)[label, None] * normals


def _drawn_anew(numbers: Array, faces: Array, rounds: int) -> Array:
    """Gaussian noise (n,) after rounds of neighbour means.

    :param numbers: (n,) in [0, 1).
    """
    made = ndtri(np.clip(numbers, 1e-6, 1.0 - 1e-6))
    if rounds > 0:
        mean = neighbour_means(faces, len(made), "free")
        for _ in range(rounds):
            made = 0.5 * (made + mean @ made)
    return made


def _of_size(made: Array, sigma: float, counted: Array) -> Array:
    """Numbers (n,) of mean zero and standard deviation sigma over the counted vertices; others may all have the same number."""
    made = made - made[counted].mean()
    return made * (sigma / max(float(made[counted].std()), np.finfo(float).tiny))


def folded(points: Array, faces: Array, across: Array) -> float:
    """The share of folded triangles, whose normal differs from the mean of its own and its neighbours."""
    normals, areas = measured(points, faces)
    own = np.concatenate([areas[:, None] * normals, np.zeros((1, 3))])  # -1, no neighbour, is the last row
    mean = own[:-1] + own[across[:, 0]] + own[across[:, 1]] + own[across[:, 2]]
    low = np.einsum("ij,ij->i", normals, mean) < FOLDED * np.sqrt(np.einsum("ij,ij->i", mean, mean))
    return float(np.mean(low & (areas > 0)))
