"""Values whose noise is the same at every intensity: f(v), the integral of 1 / sigma(v).

For photon noise f is the square root of Anscombe (1948), with read noise nearly that of Murtagh, Starck and Bijaoui (1995). The
mean of f(v) over noise is not f of the mean: the way back is that of the mean of f, so that it is without bias (Makitalo and Foi
2011, 2013), here for photons, for magnitudes, and for Gaussian noise of any sigma(v).
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln, xlogy

from meshflow.estimate.magnitudes import Magnitudes
from meshflow.estimate.noise_by_intensity import ONE_PHOTON, ByIntensity
from meshflow.geometry.validation import Array

__all__ = ["Stabilizer"]

# The number of places at which f is tabulated, and of those at which a mean over noise is taken.
PLACES, NODES = 2048, 12
# How far the table reaches beyond the range of the values, in deviations of the noise at its ends.
BEYOND = 6.0
# The noise is at least this share of that of the flat blocks.
TOLD = 0.85
# Up to so many photons their mean is a sum over their numbers; beyond, the asymptotic mean has no error in single precision.
SUMMED = 100


@dataclass(frozen=True, eq=False)
class Stabilizer:
    """The way to values of constant noise and back, of each channel.

    :ivar noise: of each channel by intensity; None: it does not depend on it, the values stay as they are.
    :ivar tables: intensities, f, and the mean of f over noise, (3, PLACES), of each channel.
    """

    noise: tuple[ByIntensity | Magnitudes | None, ...]
    tables: tuple[Array | None, ...]

    @classmethod
    def of(cls, noise: tuple[ByIntensity | Magnitudes | None, ...]) -> "Stabilizer | None":
        """The one for a noise; None where the noise of no channel depends on the intensity."""
        if not any(noise):
            return None
        return cls(noise, tuple(None if one is None else _table(one) for one in noise))

    def after(self, left: tuple[float, ...]) -> "Stabilizer":
        """The way back from values in which noise is left, of a deviation for each channel (:meth:`.Magnitudes.table`)."""
        tables = tuple(
            one.table(much) if isinstance(one, Magnitudes) else table
            for one, table, much in zip(self.noise, self.tables, left, strict=True)
        )
        return Stabilizer(self.noise, tables)

    @property
    def photons(self) -> bool:
        """Whether the values of a channel are numbers of photons."""
        return any(one is not None and one.photons for one in self.noise)

    @property
    def least(self) -> tuple[float, ...]:
        """The least deviation of the stabilized noise of each channel.

        Weak patches say less than there is where a few photons have less noise than the root says; that of flat blocks may
        contain texture.
        """
        return tuple(0.0 if one is None else (1.0 if one.photons else TOLD) * one.usual for one in self.noise)

    def stabilized(self, values: Array) -> Array:
        """Values (h, w), of a volume (d, h, w), channels last, with the noise of the median intensity, where they are 0."""
        return self._by_channel(values, 0, 1)

    def back(self, values: Array) -> Array:
        """Stabilized values without noise, as intensities."""
        return self._by_channel(values, 2, 0)

    def _by_channel(self, values: Array, from_row: int, to_row: int) -> Array:
        made = np.array(values, copy=True)
        planes = made[..., None] if len(self.tables) == 1 else made
        for k, table in enumerate(self.tables):
            if table is not None:
                planes[..., k] = _carried(planes[..., k].astype(np.float64), table[from_row], table[to_row])
        return made


def _table(noise: ByIntensity | Magnitudes) -> Array:
    """Intensities, f, and the mean of f over noise, (3, PLACES)."""
    if isinstance(noise, Magnitudes):
        return noise.table()
    at, f, mean = _of_photons(noise) if noise.photons else _of_gaussian(noise)
    middle = np.interp(noise.typical, at, f)
    return np.stack([at, f - middle, np.maximum.accumulate(mean) - middle])


def _of_photons(noise: ByIntensity) -> tuple[Array, Array, Array]:
    """The table of numbers of photons, of ``b`` each; of a negative mirrored."""
    span, typical = (abs(end - noise.origin) for end in (noise.span[1 if noise.rising else 0], noise.typical))
    most = span / noise.b
    at = np.linspace(0.0, np.sqrt(most + BEYOND * np.sqrt(most) + 1.0), PLACES) ** 2
    scale = noise.b * np.sqrt(typical / noise.b + ONE_PHOTON)
    few, numbers = at <= SUMMED, np.arange(2 * SUMMED)
    mean = np.sqrt(at + 0.125)
    chance = np.exp(xlogy(numbers, at[few, None]) - at[few, None] - gammaln(numbers + 1.0))
    mean[few] = chance @ np.sqrt(numbers + ONE_PHOTON)
    made = [at * noise.b, 2.0 * scale * np.sqrt(at + ONE_PHOTON), 2.0 * scale * mean]
    # Whatever is below the mean of no photons comes back as none.
    below = made[0][0], made[1][0], made[2][0] - scale
    at, f, mean = (np.concatenate([[first], row]) for first, row in zip(below, made, strict=True))
    if noise.rising:
        return at, f, mean
    return noise.origin - at[::-1], -f[::-1], -mean[::-1]


def _of_gaussian(noise: ByIntensity) -> tuple[Array, Array, Array]:
    """The table of noise of any dependence."""
    low, high = noise.span
    reach = BEYOND * float(noise.at(np.array(noise.span)).max())
    at = np.linspace(low - reach, high + reach, PLACES)
    rate = noise.usual / noise.at(at)
    f = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(at))])
    nodes, weights = np.polynomial.hermite_e.hermegauss(NODES)
    mean = _carried(at[:, None] + noise.at(at)[:, None] * nodes, at, f) @ (weights / weights.sum())
    return at, f, mean


def _carried(values: Array, x: Array, y: Array) -> Array:
    """Values of x as those of y, by a table; beyond its ends by their slopes."""
    made = np.interp(values, x, y)
    for end, inner in ((0, 1), (-1, -2)):
        slope = (y[inner] - y[end]) / (x[inner] - x[end]) if x[inner] != x[end] else 0.0
        beyond = values < x[0] if end == 0 else values > x[-1]
        made[beyond] = y[end] + slope * (values[beyond] - x[end])
    return made
