"""The power spectrum of a rough surface with noise on it: three numbers for white noise, two or three more for correlated noise.

    P(k) = A |k / k0|^-beta + F + N G(k_r; L_r) G(k_c; L_c)

G(k; L) is the power of a sampled Gaussian of deviation L, 1 at k = 0 (``blur``), or exp(-(2 pi L k)^4), which is flat up to a
higher frequency and falls more steeply, as after interpolation by splines (``spline``).

A self-affine surface has a power law; white noise has a constant spectrum; the spectrum of blurred or interpolated noise is
constant up to a frequency of about 1 / (2 pi L) and falls faster than any power above it. The parameters maximize the Whittle
likelihood, which is minus the sum of w (I / P + log P), by Fisher scoring; beta has a weak prior from terrains and photographs.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Literal

import numpy as np

from meshflow.geometry.validation import Array

Shape = Literal["blur", "spline"]

__all__ = ["Frequencies", "Spectrum", "fitted"]

# The reference frequency k0 of the power law: a quarter of the sampling frequency.
REFERENCE = 0.25
# Mean and deviation of the exponents of spectra of terrains and photographs (Mandelbrot 1982: 2 H + 2, H from 0 to 1).
BETA, BETA_SPREAD = 3.3, 0.8
# Least and greatest log A, beta, log F, log N, log L_r, log L_c.
LOWEST = np.array([-150.0, 0.5, -150.0, -150.0, np.log(0.3), np.log(0.1)])
HIGHEST = np.array([150.0, 8.0, 150.0, 150.0, np.log(3.2), np.log(3.2)])
# The largest number of iterations, and the change of the log likelihood at which they end.
ITERATIONS, ENOUGH = 30, 1e-2
# The largest change of a parameter in one iteration.
FARTHEST = 2.0
# Aliases of the sampled Gaussian.
ALIASES, ONES = np.arange(-1.0, 2.0), np.ones(3)


@dataclass(frozen=True, eq=False)
class Frequencies:
    """Frequencies of a spectrum, (m,), cycles per sample.

    :ivar lines: (l,), the frequencies that occur along either axis.
    :ivar down: (m,), the index in ``lines`` of each frequency from row to row; ``across``: from column to column.
    :ivar weights: (m,), how many independent values of one tile are averaged in each.
    """

    lines: Array
    down: Array
    across: Array
    weights: Array

    @cached_property
    def radius(self) -> Array:
        """Distance from zero frequency."""
        return np.hypot(self.lines[self.down], self.lines[self.across])

    @cached_property
    def log_radius(self) -> Array:
        """The logarithm of the radius over k0."""
        return np.log(self.radius / REFERENCE)

    @cached_property
    def aliased(self) -> Array:
        """(3, l + 1), the squared frequencies of the aliases of each line; the last ones are those of frequency zero."""
        return _aliased(self.lines)


@dataclass(frozen=True)
class Spectrum:
    """A fitted spectrum, powers in squared units of the values.

    :ivar surface: A, the power of the surface at a quarter of the sampling frequency; ``exponent``: beta.
    :ivar white: F, the variance of the white noise.
    :ivar blurred: N, the power of the correlated noise at frequency zero; 0 without it.
    :ivar lengths: L_r and L_c, samples.
    :ivar misfit: twice the loss of log likelihood against a spectrum that is free at each frequency.
    :ivar shape: of G.
    :ivar numbers: the parameters of :func:`fitted`.
    """

    surface: float
    exponent: float
    white: float
    blurred: float
    lengths: tuple[float, float]
    misfit: float
    numbers: tuple[float, ...]
    shape: Shape = "blur"

    def of_surface(self, at: Frequencies) -> Array:
        """The power (m,) of the surface."""
        return self.surface * (at.radius / REFERENCE) ** -self.exponent

    def of_blurred(self, at: Frequencies) -> Array:
        """The power (m,) of the correlated noise."""
        down, across = (SHAPES[self.shape](at, length)[0] for length in self.lengths)
        return self.blurred * down[at.down] * across[at.across]


def _aliased(lines: Array) -> Array:
    """The squared frequencies (3, l + 1) of the aliases of frequencies (l,), and of zero."""
    return (np.append(lines, 0.0) - ALIASES[:, None]) ** 2


def gaussian(at: Frequencies, length: float) -> tuple[Array, Array]:
    """The power (l,) of white noise filtered by a sampled Gaussian at the lines of ``at``, 1 at zero, and its derivative by log
    length.
    """
    exponent = -2.0 * np.pi**2 * length**2 * at.aliased
    each = np.exp(exponent)
    whole = ONES @ each
    rate = (ONES @ (each * exponent)) * (2.0 / whole)
    power = (whole[:-1] / whole[-1]) ** 2
    return power, 2.0 * power * (rate[:-1] - rate[-1])


def spline(at: Frequencies, length: float) -> tuple[Array, Array]:
    """exp(-(2 pi length k)^4) at the lines k of ``at``, (l,), and its derivative by log length."""
    exponent = -((2.0 * np.pi * length * at.lines) ** 4)
    power = np.exp(exponent)
    return power, 4.0 * exponent * power


SHAPES = MappingProxyType({"blur": gaussian, "spline": spline})


@dataclass(frozen=True, eq=False)
class _Problem:
    """The input of a fit besides the power: frequencies, weights (m,), offset and shape."""

    at: Frequencies
    weights: Array
    offset: float
    shape: Shape


def fitted(
    power: Array,
    at: Frequencies,
    weights: Array,
    starts: Sequence[Sequence[float]],
    offset: float = 0.0,
    shape: Shape = "blur",
) -> Spectrum:
    """The spectrum of maximum likelihood, from several starts.

    :param power: (m,), the mean of the spectra of tiles.
    :param shape: of the power of correlated noise.
    :param offset: added to both power and model, so that powers far below it have no effect.
    :param weights: (m,), the number of independent values in each mean.
    :param starts: log A and beta, then log F, then log N and log L, or log L_r and log L_c: 2, 3, 5 or 6 numbers; the model
        has only these terms.
    """
    ends = [_climbed(power + offset, _Problem(at, weights, offset, shape), np.array(start)) for start in starts]
    best, misfit = min(ends, key=lambda end: end[1])
    numbers = [float(number) for number in best]
    white = float(np.exp(numbers[2])) if len(numbers) > 2 else 0.0
    blurred = float(np.exp(numbers[3])) if len(numbers) > 4 else 0.0
    lengths = (float(np.exp(numbers[4])), float(np.exp(numbers[-1]))) if len(numbers) > 4 else (0.0, 0.0)
    return Spectrum(float(np.exp(numbers[0])), numbers[1], white, blurred, lengths, 2.0 * misfit, tuple(numbers), shape)


def _climbed(power: Array, problem: _Problem, start: Array) -> tuple[Array, float]:
    """Parameters of maximum likelihood near a start, and the loss of log likelihood against a free spectrum."""
    low, high = LOWEST[: len(start)], HIGHEST[: len(start)]
    here = _between(start, low, high)
    misfit, model, slopes = _misfit(here, power, problem)
    damping = 1e-2
    for _ in range(ITERATIONS):
        relative = slopes / model
        gradient = relative @ (problem.weights * (power / model - 1.0))
        information = (relative * problem.weights) @ relative.T
        gradient[1] -= (here[1] - BETA) / BETA_SPREAD**2
        information[1, 1] += 1.0 / BETA_SPREAD**2
        scale = np.diag(np.diag(information) + 1e-6)
        while damping < 1e8:
            step = np.linalg.solve(information + damping * scale, gradient)
            there = _between(here + _between(step, -FARTHEST, FARTHEST), low, high)
            lower, model_there, slopes_there = _misfit(there, power, problem)
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


def _between(numbers: Array, low: Array | float, high: Array | float) -> Array:
    """``numbers`` clipped; several times as fast as np.clip for a handful of them."""
    return np.minimum(np.maximum(numbers, low), high)


def _misfit(numbers: Array, power: Array, problem: _Problem) -> tuple[float, Array, Array]:
    """The loss of log likelihood, the model (m,), and its derivatives (p, m) with respect to the parameters."""
    at, shape = problem.at, SHAPES[problem.shape]
    slopes = np.empty((len(numbers), len(power)))
    surface = np.exp(numbers[0] - numbers[1] * at.log_radius, out=slopes[0])
    np.multiply(-surface, at.log_radius, out=slopes[1])
    model = surface + problem.offset
    if len(numbers) > 2:
        slopes[2] = np.exp(numbers[2])
        model += slopes[2]
    if len(numbers) > 4:
        scale, along = np.exp(numbers[3]), shape(at, np.exp(numbers[4]))
        other = along if len(numbers) == 5 else shape(at, np.exp(numbers[-1]))
        down, down_rate = ((scale * part).take(at.down) for part in along)
        across, across_rate = (part.take(at.across) for part in other)
        model += np.multiply(down, across, out=slopes[3])
        np.multiply(down_rate, across, out=slopes[4])
        if len(numbers) > 5:
            np.multiply(down, across_rate, out=slopes[5])
        else:
            slopes[4] += down * across_rate
    ratio = power / model
    prior = 0.5 * ((numbers[1] - BETA) / BETA_SPREAD) ** 2
    return float(problem.weights @ (ratio - np.log(ratio) - 1.0) + prior), model, slopes
