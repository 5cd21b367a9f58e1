"""The power spectrum of a rough surface with noise on it: three numbers for white noise, two more for correlated noise.

    P(k) = A |k / k0|^-beta + F + N G(k_r; L) G(k_c; L),      G(k; L): the power of a sampled Gaussian of deviation L, 1 at k = 0

A self-affine surface is a power law; what is white is level; noise that was blurred or interpolated is level up to a frequency of
about 1 / (2 pi L) and falls beyond it, faster than any power. The parameters are those of greatest Whittle likelihood,
sum w (I / P + log P), found by Fisher scoring; beta has a weak prior, what is known of terrains and photographs.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from meshflow.geometry.validation import Array

__all__ = ["Frequencies", "Spectrum", "fitted"]

# Where surfaces are told apart from noise: the power law is stated at a quarter of the sampling frequency.
REFERENCE = 0.25
# Exponents of spectra of terrains and photographs, their mean and deviation (Mandelbrot 1982: 2 H + 2, H from 0 to 1).
BETA, BETA_SPREAD = 3.3, 0.8
# Least and greatest log A, beta, log F, log N, log L.
LOWEST = np.array([-150.0, 0.5, -150.0, -150.0, np.log(0.3)])
HIGHEST = np.array([150.0, 8.0, 150.0, 150.0, np.log(3.2)])
# Iterations at most, and the change of the log likelihood at which they end.
ITERATIONS, ENOUGH = 30, 1e-2
# Aliases of the sampled Gaussian.
ALIASES = np.arange(-2, 3)


@dataclass(frozen=True, eq=False)
class Frequencies:
    """Frequencies of a spectrum, (m,) each, cycles per sample.

    :ivar rows: along the columns, from row to row; ``columns``: from column to column.
    :ivar weights: how many independent values of one tile are averaged in each.
    """

    rows: Array
    columns: Array
    weights: Array

    @cached_property
    def radius(self) -> Array:
        """Distance from zero frequency."""
        return np.hypot(self.rows, self.columns)

    @cached_property
    def log_radius(self) -> Array:
        """The logarithm of the radius over that at which a surface's power is stated."""
        return np.log(self.radius / REFERENCE)


@dataclass(frozen=True)
class Spectrum:
    """A fitted spectrum, powers in squared units of the values.

    :ivar surface: A, the power of the surface at a quarter of the sampling frequency; ``exponent``: beta.
    :ivar white: F; the variance of what is white.
    :ivar blurred: N, the power of the correlated noise at frequency zero; 0 for none.
    :ivar length: L, samples.
    :ivar misfit: twice the log likelihood lost to a spectrum that is free at each frequency.
    """

    surface: float
    exponent: float
    white: float
    blurred: float
    length: float
    misfit: float

    def of_surface(self, at: Frequencies) -> Array:
        """The power (m,) of the surface."""
        return self.surface * (at.radius / REFERENCE) ** -self.exponent

    def of_blurred(self, at: Frequencies) -> Array:
        """The power (m,) of the correlated noise."""
        return self.blurred * gaussian(at.rows, self.length)[0] * gaussian(at.columns, self.length)[0]

    def covariance(self, reach: int) -> Array:
        """The covariance (2 reach + 1, 2 reach + 1) of the noise by lag in rows and columns."""
        at = np.arange(-64, 64) / 128.0
        power = gaussian(at, self.length)[0]
        lags = np.cos(2.0 * np.pi * np.outer(np.arange(-reach, reach + 1), at)) @ power / at.size
        found = self.blurred * np.outer(lags, lags)
        found[reach, reach] += self.white
        return found


def gaussian(at: Array, length: float) -> tuple[Array, Array]:
    """The power of white noise filtered by a sampled Gaussian, by frequency, 1 at zero, and its derivative by log length."""
    exponent = -2.0 * np.pi**2 * length**2 * (at[:, None] - ALIASES) ** 2
    each = np.exp(exponent)
    none = -2.0 * np.pi**2 * length**2 * ALIASES**2
    whole, whole_rate = each.sum(axis=1), (each * 2.0 * exponent).sum(axis=1)
    zero, zero_rate = np.exp(none).sum(), (np.exp(none) * 2.0 * none).sum()
    power = (whole / zero) ** 2
    return power, 2.0 * power * (whole_rate / whole - zero_rate / zero)


def fitted(power: Array, at: Frequencies, weights: Array, starts: list[list[float]], offset: float = 0.0) -> Spectrum:
    """The spectrum of greatest likelihood from several starts.

    :param power: (m,), the mean of the spectra of tiles.
    :param offset: added to power and model alike: what is far below it does not count.
    :param weights: (m,), independent values behind each mean.
    :param starts: log A and beta, then log F, then log N and log L: 2, 3 or 5 numbers, the others are left out of the model.
    """
    ends = [_climbed(power + offset, at, weights, np.array(start), offset) for start in starts]
    best, misfit = min(ends, key=lambda end: end[1])
    numbers = [float(number) for number in best]
    white = np.exp(numbers[2]) if len(numbers) > 2 else 0.0
    blurred, length = (np.exp(numbers[3]), np.exp(numbers[4])) if len(numbers) > 4 else (0.0, 0.0)
    return Spectrum(np.exp(numbers[0]), numbers[1], float(white), float(blurred), float(length), 2.0 * misfit)


def _climbed(power: Array, at: Frequencies, weights: Array, start: Array, offset: float) -> tuple[Array, float]:
    """Parameters of greatest likelihood near a start, and the log likelihood that a free spectrum has more."""
    low, high = LOWEST[: len(start)], HIGHEST[: len(start)]
    here = np.clip(start, low, high)
    misfit, model, slopes = _misfit(here, power, at, weights, offset)
    damping = 1e-2
    for _ in range(ITERATIONS):
        relative = slopes / model
        gradient = relative @ (weights * (power / model - 1.0))
        information = (relative * weights) @ relative.T
        gradient[1] -= (here[1] - BETA) / BETA_SPREAD**2
        information[1, 1] += 1.0 / BETA_SPREAD**2
        scale = np.diag(np.diag(information) + 1e-6)
        while damping < 1e8:
            step = np.linalg.solve(information + damping * scale, gradient)
            there = np.clip(here + np.clip(step, -2.0, 2.0), low, high)
            lower, model_there, slopes_there = _misfit(there, power, at, weights, offset)
            if lower < misfit:
                break
            damping *= 6.0
        else:
            return here, misfit
        gained, here, misfit, model, slopes = misfit - lower, there, lower, model_there, slopes_there
        damping = max(damping / 6.0, 1e-7)
        if gained < ENOUGH:
            break
    return here, misfit


def _misfit(numbers: Array, power: Array, at: Frequencies, weights: Array, offset: float) -> tuple[float, Array, Array]:
    """The log likelihood that is lost, the model (m,), and its derivatives (p, m) by the parameters."""
    log_radius = at.log_radius
    surface = np.exp(numbers[0] - numbers[1] * log_radius)
    model, slopes = surface + offset, [surface, -surface * log_radius]
    if len(numbers) > 2:
        white = np.full_like(surface, np.exp(numbers[2]))
        model = model + white
        slopes.append(white)
    if len(numbers) > 4:
        (down, down_rate), (across, across_rate) = (gaussian(f, np.exp(numbers[4])) for f in (at.rows, at.columns))
        blurred = np.exp(numbers[3])
        model = model + blurred * down * across
        slopes += [blurred * down * across, blurred * (down_rate * across + down * across_rate)]
    ratio = power / model
    prior = 0.5 * ((numbers[1] - BETA) / BETA_SPREAD) ** 2
    return float(weights @ (ratio - np.log(ratio) - 1.0) + prior), model, np.array(slopes)
