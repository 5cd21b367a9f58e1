"""The noise of magnitudes: of a signal with Gaussian noise in both of its parts, as magnetic resonance gives them (Rice 1944).

Where the signal is strong, the deviation of a magnitude is that of the noise. Where there is none, it is 0.655 of it, and the
mean of the magnitude is 1.253 of it instead of 0 (Gudbjartsson and Patz 1995). As Foi (2011) does, f is found for which the noise
of f(magnitude) is nearly the same at every signal, and the way back is that of the mean of f, so that it is without bias.

Near no signal this mean is level, f(0) + c signal^2. There the noise that is left after smoothing would come back as a signal, of
the size of its square root, and what is within this noise is taken for no signal.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.special import ive

from meshflow.geometry.validation import Array

__all__ = ["Magnitudes", "sigma_of_air"]

# The number of places of a table, how far it reaches, in deviations, and the places at which a mean over one part of the noise is
# taken. Beyond its end f is a straight line, which is off by less than 1 / 100 of the noise.
PLACES, REACH, NODES = 2048, 64.0, 24
# How often the rate of f is corrected by the noise that is left uneven; with more, strong noise is smoothed less well.
EVENED = 1
# From so many deviations of signal on the variance is taken from its series, whose terms do not cancel.
STRONG = 30.0
# Air is told by the magnitudes below so many deviations, where there is little signal; the number of rounds.
LOW, ROUNDS = 1.5, 40


@dataclass(frozen=True)
class Magnitudes:
    """The noise of magnitudes by their signal.

    :ivar sigma: the deviation of the noise in each part of the signal, which is that of strong magnitudes.
    """

    sigma: float
    photons: ClassVar[bool] = False

    def __str__(self) -> str:
        weak = float(self.at(np.zeros(1))[0])
        return f"that of magnitudes, {weak:.3g} without a signal, {self.sigma:.3g} at a strong one"

    def to_dict(self) -> dict[str, object]:
        """The numbers as values for JSON."""
        return {"magnitudes": True, "sigma": self.sigma}

    @property
    def usual(self) -> float:
        """The deviation of strong magnitudes."""
        return self.sigma

    def at(self, intensity: Array) -> Array:
        """The deviation of the magnitudes of a signal, in its unit."""
        return self.sigma * _moments(intensity / self.sigma)[1]

    def table(self, left: float = 0.0) -> Array:
        """Intensities, f, and the mean of f over noise, (3, m); f has the noise ``sigma`` at every signal.

        :param left: the deviation of the noise in what is brought back. What is above the mean of no signal by less comes back
            as none; of a signal of twice the noise and more nothing changes.
        """
        at = np.linspace(0.0, np.sqrt(REACH), PLACES) ** 2
        mean, deviation = _moments(at)
        rate = 1.0 / np.interp(at, mean, deviation)
        for _ in range(EVENED):
            rate /= np.interp(at, mean, _over_noise(at, rate)[1])
        shifted = _over_noise(at, rate)[0] + left / self.sigma * np.exp(-0.5 * np.square(at))
        shifted = np.maximum.accumulate(shifted)
        # Whatever is below the mean of no signal comes back as none.
        made = np.stack([at, _integral(at, rate), shifted])
        return self.sigma * np.concatenate([made[:, :1] - [[0.0], [0.0], [1.0]], made], axis=1)


def _integral(at: Array, rate: Array) -> Array:
    """f at places (m,), the integral of its rate."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(at))])


def _over_noise(at: Array, rate: Array) -> tuple[Array, Array]:
    """Mean and deviation of f(magnitude) at signals (m,), by quadrature over both parts of the noise."""
    f = _integral(at, rate)
    nodes, weights = np.polynomial.hermite_e.hermegauss(NODES)
    weights = weights / weights.sum()
    mean, square = np.zeros(len(at)), np.zeros(len(at))
    for one, much in zip(nodes, weights, strict=True):
        magnitudes = np.hypot(at[:, None] + nodes, one)
        off = np.interp(magnitudes, at, f) + np.maximum(magnitudes - at[-1], 0.0) * rate[-1] - f[:, None]
        mean += much * (off @ weights)
        square += much * (np.square(off) @ weights)
    return f + mean, np.sqrt(square - np.square(mean))


def _moments(signal: Array) -> tuple[Array, Array]:
    """Mean and deviation of magnitudes, both in the deviation of the noise, as the signal is."""
    half = 0.5 * np.square(signal)
    mean = np.sqrt(0.5 * np.pi) * ((1.0 + half) * ive(0, 0.5 * half) + half * ive(1, 0.5 * half))
    near = np.minimum(half, 0.5 * STRONG**2)
    weak = 2.0 + 2.0 * near - np.square(np.where(half > near, 0.0, mean))
    strong = 1.0 - 0.25 / np.maximum(half, 1.0)
    return mean, np.sqrt(np.where(half > near, strong, weak))


def sigma_of_air(low: Array, sigma: float) -> float:
    """The noise by the magnitudes that have hardly a signal: those below ``LOW`` times the noise.

    Their squares have an exponential distribution, of mean 2 sigma^2, which is cut off there.

    :param low: (n,), magnitudes of which many have no signal.
    :param sigma: at least about the noise.
    """
    share = 2.0 - LOW**2 / np.expm1(0.5 * LOW**2)
    for _ in range(ROUNDS):
        squares = np.square(low[low < LOW * sigma])
        if not squares.size:
            return 0.0
        before, sigma = sigma, float(np.sqrt(squares.mean() / share))
        if abs(sigma - before) < 1e-4 * before:
            break
    return sigma
