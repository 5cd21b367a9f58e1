"""How the noise of a picture depends on its intensity, from the flattest blocks of each intensity.

Photon noise has a variance in proportion to the light; with the read noise of the sensor it is a + b x (Foi, Trimeche,
Katkovnik, Egiazarian 2008). Gains that differ from pixel to pixel, and speckle, add c x^2. After the tone curve of a camera the
noise may also fall with the intensity.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy.special

from meshflow.estimate.noise_growth import MAD, residuals
from meshflow.geometry.validation import Array

__all__ = ["ByIntensity", "noise_by_intensity"]

# The side of a block, and the share of the blocks of a class that are taken for flat.
SIDE, FLAT = 8, 0.2
# The number of classes of intensity, the least number of blocks in each, and the least number of classes.
CLASSES, CLASS_SIZE, FEW = 16, 16, 5
# A block with more than this share of samples at an end of the range is left out: noise is clipped there.
CLIPPED = 0.05
# The least ratio of the noise at both ends of the intensities; the greatest misfit (log) of the classes, and the share of their
# scatter that the dependence must explain: for a clear dependence, or for classes that scatter as those of noise alone do.
RATIO, CREDIBLE = 1.25, ((0.2, 0.8), (0.06, 0.6))
# Values are counted if the variance over the intensity, in quanta, is between these in the median class, and scatters by less
# (log of the deviation) than this, and than this multiple of the scatter of the variance alone, that of white noise being less;
# classes of fewer photons are left out.
OF_PHOTONS, SCATTER, EXPLAINS, SOME_PHOTONS = (0.8, 1.8), 0.12, 1.4, 0.3
# Of a negative, whose photons are counted down from its greatest value, the scatter is at most this multiple of that of the
# variance alone: the greatest value of white noise is always about as far above its mean as its variance is large. The greatest
# value is that of no photons where a class has so few; where none has, its noise is found as any other is.
EXPLAINS_NEGATIVE, FEW_PHOTONS = 0.8, 5.0
# Values between these have squares and squares of these.
SQUARED = (1e-60, 1e60)
# The noise is at least this share of the greatest; and its square at least this part of that of one photon (Anscombe 1948).
LEAST, ONE_PHOTON = 0.03, 0.375


@dataclass(frozen=True, eq=False)
class ByIntensity:
    """The deviation of noise by intensity: its square is a + b x + c x^2, x the distance from ``origin``; a, b, c >= 0.

    :ivar origin: the least intensity where the noise grows with it, the greatest where it falls.
    :ivar span: the least and the greatest intensity that were seen; beyond the origin the square falls on in a straight line.
    :ivar typical: the median intensity.
    :ivar photons: whether the values are numbers of photons, of ``b`` each, from ``origin`` on, or, in a negative, down from it.
    """

    a: float
    b: float
    c: float
    origin: float
    span: tuple[float, float]
    typical: float
    photons: bool = False

    def __str__(self) -> str:
        low, high = (
            f"{sigma:.3g} at {at:.3g}" for sigma, at in zip(self.at(np.array(self.span)), self.span, strict=True)
        )
        if self.photons:
            return f"that of photons of {self.b:.3g} each, {high if self.rising else low}"
        return f"{low}, {high}"

    def to_dict(self) -> dict[str, object]:
        """The numbers as values for JSON."""
        numbers = {"a": self.a, "b": self.b, "c": self.c, "origin": self.origin, "typical": self.typical}
        return {**numbers, "span": list(self.span), "photons": self.photons}

    @property
    def rising(self) -> bool:
        """Whether the noise grows with the intensity."""
        return self.origin < self.span[1]

    @property
    def usual(self) -> float:
        """The deviation at the median intensity."""
        return float(self.at(np.array(self.typical)))

    def at(self, intensity: Array) -> Array:
        """The deviation at intensities, in their unit."""
        x = (intensity - self.origin) * (1.0 if self.rising else -1.0)
        width = self.span[1] - self.span[0]
        square = self.a + x * (self.b + np.maximum(x, 0.0) * self.c)
        least = LEAST**2 * (self.a + width * (self.b + width * self.c))
        return np.sqrt(np.maximum(square, max(least, ONE_PHOTON * self.b**2)))


@dataclass(frozen=True, eq=False)
class _Classes:
    """Classes of intensity: the mean intensity, the variance of the noise, and the number of blocks of each, (m,)."""

    at: Array
    variance: Array
    count: Array


def noise_by_intensity(parts: Sequence[tuple[Array, Array]], quantum: float = 0.0) -> ByIntensity | None:
    """The noise of one channel by intensity; None where it does not depend on it, or cannot be told.

    :param parts: pieces of the data (h, w), float64, and masks of their present samples.
    :param quantum: of which the values are multiples from zero on; 0: of none.
    """
    largest = max((float(np.abs(z[there]).max(initial=0.0)) for z, there in parts), default=0.0)
    if not SQUARED[0] < largest < SQUARED[1]:
        return None
    typical = float(np.median(np.concatenate([z[there] for z, there in parts])))
    means, squares = _blocks(parts, counted=quantum > 0)
    classes = _classes(means, squares)
    if classes is not None and _counted(classes, quantum):
        return ByIntensity(0.0, quantum, 0.0, 0.0, (0.0, float(classes.at[-1])), max(typical, quantum), photons=True)
    if quantum > 0 and (negative := _counted_down(parts, quantum, typical)):
        return negative
    if classes is None:
        return None
    found = min((_fitted(classes, up, typical) for up in (True, False)), key=lambda one: _misfit(one, classes))
    return found if _credible(found, classes, means) else None


def _counted_down(parts: Sequence[tuple[Array, Array]], quantum: float, typical: float) -> ByIntensity | None:
    """The noise of a negative: numbers of photons counted down from the greatest value, where there are none; None for others."""
    top = max(float(z[there].max()) for z, there in parts if there.any())
    means, squares = _blocks([(top - z, there) for z, there in parts], counted=True)
    classes = _classes(means, squares)
    if classes is None or classes.at[0] > FEW_PHOTONS * quantum or not _counted(classes, quantum, EXPLAINS_NEGATIVE):
        return None
    few, many = np.quantile(means, [0.05, 0.95])
    if many < RATIO**2 * max(few, SOME_PHOTONS * quantum):
        return None
    span = top - float(classes.at[-1]), top
    return ByIntensity(0.0, quantum, 0.0, top, span, min(typical, top - quantum), photons=True)


def _counted(classes: _Classes, quantum: float, explains: float = EXPLAINS) -> bool:
    """Whether the values are numbers of photons, whose variance is one quantum times the intensity, up to texture.

    :param explains: the largest scatter of that variance, in those of the variance alone.
    """
    seen = classes.at >= SOME_PHOTONS * quantum
    if quantum == 0 or seen.sum() < 3:
        return False
    ratio = classes.variance[seen] / (quantum * classes.at[seen])
    scatter = _scatter(ratio)
    return OF_PHOTONS[0] < np.median(ratio) < OF_PHOTONS[1] and scatter < min(
        SCATTER, explains * _scatter(classes.variance[seen])
    )


def _scatter(variance: Array) -> float:
    """The deviation of the log of the deviation, by the median: a class of blocks across an edge is no flat one."""
    return MAD * float(np.median(np.abs(0.5 * np.log(variance / np.median(variance)))))


def _blocks(parts: Sequence[tuple[Array, Array]], counted: bool = False) -> tuple[Array, Array]:
    """The mean intensity and the mean squared second difference, as a variance of the noise, of whole blocks (n,).

    :param counted: whether zero is a number like the others, and no end at which noise is clipped.
    """
    known = [z[there] for z, there in parts]
    low = np.nan if counted else min((float(some.min()) for some in known if some.size), default=0.0)
    high = max((float(some.max()) for some in known if some.size), default=0.0)
    means, squares = [np.zeros(0)], [np.zeros(0)]
    for z, there in parts:
        if min(z.shape) < SIDE:
            continue
        rest = np.zeros(z.shape)
        rest[1:-1, 1:-1] = residuals((np.where(there, z, 0.0), np.ones_like(there)))[0]
        for start in (0, SIDE // 2):  # overlapping blocks scatter less
            block, difference, whole = (_cut(a[start:, start:]) for a in (z, rest, there))
            good = whole.all(axis=(1, 2)) & (((block == low) | (block == high)).mean(axis=(1, 2)) <= CLIPPED)
            means.append(block[good].mean(axis=(1, 2)))
            squares.append(np.square(difference[good][:, 1:-1, 1:-1]).mean(axis=(1, 2)))
    return np.concatenate(means), np.concatenate(squares)


def _cut(a: Array) -> Array:
    """The whole blocks (n, SIDE, SIDE) of an array (h, w), side by side from its first sample."""
    down, across = (n // SIDE for n in a.shape)
    blocks = a[: down * SIDE, : across * SIDE].reshape(down, SIDE, across, SIDE)
    return blocks.swapaxes(1, 2).reshape(-1, SIDE, SIDE)


def _classes(means: Array, squares: Array) -> _Classes | None:
    """The variance of the flat blocks in classes of intensity with equal numbers of blocks; None for too few."""
    if len(means) < FEW * CLASS_SIZE:
        return None
    order = np.argsort(means, kind="stable")
    parts = np.array_split(order, min(CLASSES, len(order) // CLASS_SIZE))
    variance = np.array([np.quantile(squares[part], FLAT) for part in parts]) / _of_flat()
    at, count = np.array([means[part].mean() for part in parts]), np.array([len(part) for part in parts])
    seen = variance > 0
    return _Classes(at[seen], variance[seen], count[seen]) if seen.sum() >= FEW else None


def _fitted(classes: _Classes, up: bool, typical: float) -> ByIntensity:
    """The dependence of least relative error.

    :param up: whether the noise grows with the intensity.
    """
    from scipy.optimize import nnls

    span = float(classes.at[0]), float(classes.at[-1])
    origin = span[0] if up else span[1]
    width = span[1] - span[0] or 1.0
    x = np.abs(classes.at - origin) / width
    terms, fit, numbers = np.stack([np.ones_like(x), x, x * x], axis=1), classes.variance, np.zeros(3)
    for _ in range(3):  # relative to the fit, so that a class that is low by chance does not pull it down
        weights = np.sqrt(classes.count) / fit
        numbers = nnls(terms * weights[:, None], classes.variance * weights)[0]
        fit = np.maximum(terms @ numbers, LEAST**2 * classes.variance.max())
    a, b, c = (float(number) for number in numbers)
    return ByIntensity(a, b / width, c / width**2, origin, span, typical)


def _misfit(found: ByIntensity, classes: _Classes) -> float:
    """The root of the mean squared error (log of the deviation)."""
    error = np.log(found.at(classes.at)) - 0.5 * np.log(classes.variance)
    return float(np.sqrt(np.average(np.square(error), weights=classes.count)))


def _credible(found: ByIntensity, classes: _Classes, means: Array) -> bool:
    """Whether the noise depends on the intensity clearly, and as the model says."""
    ends = found.at(np.quantile(means, [0.05, 0.95]))
    logs = 0.5 * np.log(classes.variance)
    scatter = float(
        np.sqrt(np.average(np.square(logs - np.average(logs, weights=classes.count)), weights=classes.count))
    )
    misfit = _misfit(found, classes)
    explained = 1.0 - (misfit / scatter) ** 2 if scatter > 0 else 0.0
    fits = any(misfit <= most and explained >= least for most, least in CREDIBLE)
    return float(ends.max() / ends.min()) >= RATIO and fits


@lru_cache(maxsize=1)
def _of_flat() -> float:
    """The quantile FLAT of the mean squared second difference in a block of white noise of deviation 1.

    It is a quadratic form; it is approximated by a gamma distribution with the same mean and variance.
    """
    second = np.eye(SIDE - 2, SIDE) - 2.0 * np.eye(SIDE - 2, SIDE, 1) + np.eye(SIDE - 2, SIDE, 2)
    one = second.T @ second / 6.0
    mean = np.trace(one) ** 2 / (SIDE - 2) ** 2
    variance = 2.0 * np.sum(one * one) ** 2 / (SIDE - 2) ** 4
    return float(scipy.special.gammaincinv(mean**2 / variance, FLAT) * variance / mean)
