"""Correlated noise of the points of a mesh: how strong it is, and over how many rounds of neighbours, from bands of its waves."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import nnls

from meshflow.estimate.crease_outliers import kurtosis_of
from meshflow.estimate.noise_growth import MAD
from meshflow.geometry.validation import Array

__all__ = ["LEFT_IF_SHORT", "LEFT_ON_SMOOTH", "CorrelatedNoise", "Waves"]

# The rounds of neighbour means after the differences, one for each band, and those that noise may have.
BANDS, ROUNDS = (0, 1, 2, 4, 8), (1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 14, 16)
# The least number of vertices of which waves are compared.
FEW = 60
# The share of the vertices, where the surface bends least around them, on which bands are measured.
CALMEST = 0.4
# The logarithms of the bands differ from those of the noise by no more than FITS, root mean square. Of 24 shapes with noise of
# 0.1 and 0.3 edges over 2 to 10 rounds they differ by 0.01 to 0.1, of clean ones by 0.01 to 1.5. If those of noise alone differ
# by less than ALONE, there is no white noise beside it: that would be found where bands of longer waves have some of the shape.
# Of few vertices bands differ by BY_CHANCE over the root of their number.
FITS, ALONE, BY_CHANCE = 0.15, 0.04, 1.5
# The number of bands of short waves. They agree with noise that neighbours show if the logarithms of all but the last differ by
# no more than SHORT_FITS, and none falls by more than FALLS: 0.1 and 0.13 for noise on rough shapes, 0.15 and 0.24 for these
# alone.
SHORT, SHORT_FITS, FALLS = 4, 0.11, 0.15
# Noise is as strong everywhere as its own random differences are: the deviation of its local energy, after LOCAL rounds, is no
# more than EVENLY times that of noise on the same mesh, its kurtosis no more than TAILS, and it is no less than WEAKER times as
# strong where the surface bends most. Two thirds of 60 clean scans and models are not like that: 1.2 to 4.4; 3.5 to 50; 0.3 to
# 0.7.
LOCAL, EVENLY, TAILS, WEAKER = 4, 1.22, 3.9, 0.78
# The band that says so. Shorter waves also have what is left of uneven triangles.
TOLD = 2
# A band of long waves, in which smooth shapes have hardly more than the noise (0.75 to 1.45 times; clean scans 1.5 to 4).
LONG, HARDLY = 32, 1.45
# The share of its variance that may be left: of noise on such a shape; of noise on any whose short waves are those of noise; of
# other even noise; and of what is uneven. Left of noise are -0.3 to 0.6 on smooth shapes, -0.3 to 0.3 where short waves say so,
# 0.4 to 0.9 where the shape has detail of its own; of such detail alone 0.3 to 1.
LEFT_ON_SMOOTH, LEFT_IF_SHORT, LEFT_IF_EVEN, LEFT_IF_UNEVEN = 0.6, 0.75, 0.25, 0.0


@dataclass(frozen=True)
class CorrelatedNoise:
    """Noise that neighbours have in common.

    :ivar sigma: its standard deviation with that of white noise beside it, unit of the points.
    :ivar rounds: the number of rounds of neighbour means that give white noise the same bands.
    :ivar left: the largest share of its variance that the best method may leave; if more is left, it was the shape.
    """

    sigma: float
    rounds: int
    left: float


@dataclass(frozen=True, eq=False)
class _Bands:
    """Fields after rounds of neighbour means, as many as are asked for.

    :ivar umbrella: (n, n), I - A with the means A of the neighbours.
    :ivar fields: (n, d) for each number of rounds so far.
    """

    umbrella: Any
    fields: list[Array]

    def after(self, rounds: int) -> Array:
        """The fields (n, d) after so many rounds."""
        while len(self.fields) <= rounds:
            self.fields.append(self.fields[-1] - 0.5 * (self.umbrella @ self.fields[-1]))
        return self.fields[rounds]

    def size(self, rounds: int, calm: Array) -> float:
        """The standard deviation after so many rounds, of vertices with mask (n,)."""
        return MAD * float(np.median(np.abs(self.after(rounds)[calm]), axis=0).mean())

    def unevenness(self, rounds: int, calm: Array) -> float:
        """The standard deviation of the logarithm of the local energy."""
        energy = _Bands(self.umbrella, [np.square(self.after(rounds))]).after(LOCAL)[calm]
        return float(np.log(np.maximum(energy, np.finfo(float).tiny)).std(axis=0).mean())


@dataclass(frozen=True, eq=False)
class Waves:
    """The waves of the points of a mesh along their normals, in bands, beside those of white noise on it.

    A band is what is left of second differences of the points after rounds of neighbour means. Noise that has been through r
    rounds has in each band the energy that white noise has r rounds further: one curve, shifted by r. White noise beside it, and
    triangles of all sizes, give the energy of white noise in addition. Shapes have more energy in each band of longer waves (5 to
    7 times per octave for scans, 1.5 to 3 times for noise), but a rough shape may look like noise of some rounds.

    :ivar seen: bands of the points; ``made``: of white noise; ``white``: that noise itself after rounds.
    :ivar counted: (n,), mask of the vertices that are used; ``calm``: where the surface bends least; ``bent``: most.
    """

    seen: _Bands
    made: _Bands
    white: _Bands
    counted: Array
    calm: Array
    bent: Array

    @classmethod
    def of(cls, umbrella: Any, bend: Array, around: Array, counted: Array, white: Array) -> "Waves":
        """Those of the distances ``bend`` (n,) of the points from the mean of their neighbours.

        :param umbrella: (n, n), I - A with the means A of the neighbours.
        :param around: (n,), how much the surface bends around each.
        """
        low, high = np.quantile(around[counted], (CALMEST, 1.0 - CALMEST))
        seen, made = (umbrella @ bend)[:, None], umbrella @ (umbrella @ white)
        one, other, noise = (_Bands(umbrella, [fields]) for fields in (seen, made, white))
        return cls(one, other, noise, counted, counted & (around <= low), counted & (around >= high))

    @property
    def are_few(self) -> bool:
        """Whether so few vertices are measured that nothing can be told from their waves."""
        return bool(self.calm.sum() < FEW)

    def white_size(self) -> float:
        """The standard deviation of white noise that has the energy of the shortest waves."""
        return self.seen.size(0, self.calm) / max(self.made.size(0, self.calm), np.finfo(float).tiny)

    def are_noise(self, rounds: int) -> bool:
        """Whether the shortest waves are those of noise of so many rounds, and as strong everywhere."""
        if self.are_few:
            return True
        over = [self.seen.size(band, self.calm) / self.made.size(band + rounds, self.calm) for band in BANDS[:SHORT]]
        off = np.log(np.array(over) / over[0])
        alike = off[:-1].std() <= SHORT_FITS and off.min() >= -FALLS
        return bool(alike) and self._unevenness(0, rounds) <= EVENLY

    def noise(self) -> CorrelatedNoise | None:
        """What the noise is if it is one, and how well it must go; None if these are not the waves of noise."""
        if self.are_few:
            return None
        sizes = np.array([self.seen.size(band, self.calm) for band in BANDS])
        expected = np.array([self.made.size(r, self.calm) for r in range(max(BANDS) + max(ROUNDS) + 1)])
        if not (sizes > 0).all() or not (expected > 0).all():
            return None
        fit, rounds = min((_fit_alone(sizes[:SHORT], expected, rounds), rounds) for rounds in ROUNDS)
        if fit.off > max(ALONE, BY_CHANCE / np.sqrt(self.calm.sum())):
            fit, rounds = min((_fit(sizes, expected, rounds), rounds) for rounds in ROUNDS)
        if fit.off > FITS or fit.smoothed == 0:
            return None
        deviation = self.white.after(rounds).std(axis=0).mean()
        sigma = float(np.hypot(fit.smoothed * deviation, fit.white))
        return CorrelatedNoise(sigma, rounds, self._left(fit, rounds))

    def _left(self, fit: "_Fit", rounds: int) -> float:
        """The largest share of the variance of noise that may be left."""
        field = self.seen.after(TOLD)[self.calm]
        tails = kurtosis_of(field)
        one, other = (
            self.seen.size(TOLD, mask) / self.made.size(TOLD + rounds, mask) for mask in (self.calm, self.bent)
        )
        if self._unevenness(TOLD, rounds) > EVENLY or tails > TAILS or other < WEAKER * one:
            return LEFT_IF_UNEVEN
        smoothed, white = self.made.size(LONG + rounds, self.counted), self.made.size(LONG, self.counted)
        noise = float(np.hypot(fit.smoothed * smoothed, fit.white * white))
        return LEFT_ON_SMOOTH if self.seen.size(LONG, self.counted) <= HARDLY * noise else LEFT_IF_EVEN

    def _unevenness(self, band: int, rounds: int) -> float:
        """The deviation of the logarithm of the local energy of a band, over that of noise of so many rounds."""
        return self.seen.unevenness(band, self.calm) / self.made.unevenness(band + rounds, self.calm)


@dataclass(frozen=True, order=True)
class _Fit:
    """White noise beside noise of some rounds.

    :ivar off: how far their bands are from those that were found, root mean square of the logarithm.
    :ivar smoothed: the standard deviation of the noise before its rounds; ``white``: of the other.
    """

    off: float
    smoothed: float
    white: float = 0.0


def _fit_alone(sizes: Array, expected: Array, rounds: int) -> _Fit:
    """The fit of noise of some rounds without white noise beside it; parameters as for :func:`_fit`."""
    shares = np.log(sizes / expected[np.array(BANDS[: len(sizes)]) + rounds])
    return _Fit(float(shares.std()), float(np.exp(shares.mean())))


def _fit(sizes: Array, expected: Array, rounds: int) -> _Fit:
    """The fit of both.

    :param sizes: (b,), of the bands; ``expected``: (r,), of white noise of deviation 1 after each number of rounds.
    """
    at = np.array(BANDS)
    energies = np.square(np.stack([expected[at], expected[at + rounds]], axis=1) / sizes[:, None])
    shares, _ = nnls(energies, np.ones(len(BANDS)))
    off = np.log(np.maximum(energies @ shares, np.finfo(float).tiny))
    return _Fit(float(np.sqrt(np.mean(off**2))), float(np.sqrt(shares[1])), float(np.sqrt(shares[0])))
