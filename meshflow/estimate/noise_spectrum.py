"""Noise that is correlated between samples, from the power spectrum of the flattest tiles.

Tiles of 32 x 32 samples overlap by half. From each its quadratic is taken, a Hann window is laid over it, and its power by
frequency is kept. Of all tiles those are chosen whose power is no more than noise would make it: first those near the lowest mean
of log power at low frequencies, where texture shows most, then, three times, those that agree with the spectrum found
(:mod:`.noise_model`) at the frequencies at which that is noise.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from meshflow.estimate.noise_model import Frequencies, Spectrum, fitted, gaussian
from meshflow.geometry.validation import Array

__all__ = ["Found", "correlated_noise", "correlation_of", "length_of", "spectral_noise"]

SIDE = 32
# Tiles looked at, at most, spread evenly; fewer than the least say nothing.
TILES, LEAST = 600, 5
# Of the values of windowed tiles that overlap by half, the share that is independent.
INDEPENDENT = 0.4
# The lowest share of tiles, where the choice begins; how many deviations of noise above that tiles may be; how often it is made.
LOWEST, MARGIN, ROUNDS = 0.05, 3.0, 3
# Frequencies at which the choice begins, cycles per sample.
LOW = 0.26
# The log power of a periodogram has this deviation.
# What is below this share of the noise at frequency zero does not count.
FAR_BELOW = 0.02
# Where the surface is weak the noise may exceed the fitted one so many times.
FREE = 2.0
# Noise is correlated if it exceeds surface and white noise somewhere so many times, is so much likelier than white noise (log),
# is found in so many tiles, fits their power (squared relative error), and is neither too narrow to tell nor as wide as surfaces.
ABOVE, EVIDENCE, FEW, MISFIT, NARROWEST, WIDEST = 1.25, 40.0, 6, 0.5, 0.35, 2.8
# Of the range of the values noise is at least this share, and correlations below the other are not told.
FAINT, UNTOLD = 1e-5, 0.03
# Noise of so many times the error of rounding, or less, is that error.
ROUNDING = 1.25
# Lags that are told at most.
REACH = 8
LOG_SPREAD = np.pi / np.sqrt(6.0)


@dataclass(frozen=True, eq=False)
class Found:
    """The noise in the flattest tiles.

    :ivar spectrum: with correlated noise.
    :ivar plain: with white noise alone.
    :ivar power: (m,), mean power of the tiles chosen.
    :ivar tiles: that were chosen, ``of`` those that were looked at.
    :ivar above: how many times the correlated noise exceeds surface and white noise where it does most.
    """

    spectrum: Spectrum
    plain: Spectrum
    power: Array
    tiles: int
    of: int
    above: float

    @property
    def evidence(self) -> float:
        """Log likelihood gained by correlation."""
        return 0.5 * (self.plain.misfit - self.spectrum.misfit)

    @property
    def correlated(self) -> bool:
        """Whether the noise is correlated beyond doubt."""
        misfit = self.spectrum.misfit / (2.0 * self.tiles * _tiling().at.weights.sum())
        clear = self.above > ABOVE and self.evidence > EVIDENCE and self.tiles >= FEW and misfit < MISFIT
        return clear and NARROWEST < self.spectrum.length < WIDEST

    def covariance(self) -> Array:
        """The covariance (SIDE, SIDE) of the noise by lag in rows and columns, lag (0, 0) at [0, 0].

        Where the surface has less than half of the power of a frequency, it is what the surface leaves of it, whatever its shape;
        elsewhere, at the lowest frequencies too, it is the fitted one, scaled to agree with its neighbours.
        """
        tiling, half = _tiling(), SIDE // 2
        at, spectrum = tiling.at, self.spectrum
        surface, fit = spectrum.of_surface(at), spectrum.of_blurred(at) + spectrum.white
        clear = surface < 0.5 * self.power
        near = clear & (at.radius < np.quantile(at.radius[clear], 0.15, method="higher")) if clear.any() else clear
        scale = float((self.power - surface)[near].sum() / fit[near].sum()) if near.any() else 1.0
        rows, columns = np.mgrid[0 : half + 1, 0 : half + 1] / SIDE
        whole = Frequencies(rows.ravel(), columns.ravel(), np.ones(rows.size))
        quarter = scale * (spectrum.of_blurred(whole) + spectrum.white).reshape(rows.shape)
        quarter[tiling.used] = np.where(clear, np.clip(self.power - surface, 0.0, FREE * fit), quarter[tiling.used])
        power = np.concatenate([quarter, quarter[half - 1 : 0 : -1]])
        return np.fft.irfft2(power, (SIDE, SIDE))


@dataclass(frozen=True, eq=False)
class _Tiling:
    """What all tiles share: the quadratics (SIDE^2, 6), the window (SIDE, SIDE), frequencies, which of a quarter those are."""

    basis: Array
    window: Array
    at: Frequencies
    used: Array


@lru_cache(maxsize=1)
def _tiling() -> _Tiling:
    along = (np.arange(SIDE) + 0.5) / SIDE * 2.0 - 1.0
    powers = [np.outer(along**i, along**j).ravel() for i in range(3) for j in range(3 - i)]
    basis = np.linalg.qr(np.array(powers).T)[0]
    hann = 0.5 - 0.5 * np.cos(2.0 * np.pi * (np.arange(SIDE) + 0.5) / SIDE)
    window = np.outer(hann, hann)
    half = SIDE // 2
    rows, columns = np.mgrid[0 : half + 1, 0 : half + 1] / SIDE
    count = np.full(rows.shape, 2.0)  # of a frequency and its mirror image; those on an axis are their own
    for edge in (0, -1):
        count[edge] = count[:, edge] = 1.0
    used = np.hypot(rows, columns) * SIDE >= 2.0  # below is what is left of the quadratic
    at = Frequencies(rows[used], columns[used], count[used] * INDEPENDENT)
    return _Tiling(basis, window / np.sqrt(np.sum(window**2)), at, used)


def spectral_noise(parts: list[tuple[Array, Array]]) -> Found | None:
    """The noise of one channel.

    :param parts: tiles of the data (h, w), and which of their samples are there.
    :returns: None where too few tiles are whole, or most are constant.
    """
    power, at = _powers(parts), _tiling().at
    if len(power) < LEAST:
        return None
    rough = (power > 0).all(axis=1)
    if rough.mean() < 0.5:
        return None
    power = power[rough]
    if len(power) < LEAST:
        return None
    chosen, offset = _flattest(power, at), 0.0
    for _ in range(ROUNDS):
        spectrum = _correlated(power[chosen].mean(axis=0), at, at.weights * chosen.sum(), offset)
        offset = FAR_BELOW * (spectrum.blurred + spectrum.white)
        chosen = _agreeing(power, at, spectrum, offset)
    mean, weights = power[chosen].mean(axis=0), at.weights * chosen.sum()
    spectrum = _correlated(mean, at, weights, offset)
    low, middle, high = _levels(mean, at)
    white = [np.log(middle), 3.3]
    plain = min(
        (fitted(mean, at, weights, [start], offset) for start in (white, [*white, np.log(high)])),
        key=lambda one: one.misfit,
    )
    rest = spectrum.of_surface(at) + spectrum.white
    return Found(spectrum, plain, mean, int(chosen.sum()), len(power), float((spectrum.of_blurred(at) / rest).max()))


def correlated_noise(parts: list[tuple[Array, Array]], quantum: float = 0.0) -> Array | None:
    """The covariance (SIDE, SIDE) of the noise of one channel by lag, if it is correlated and more than rounding; None otherwise.

    :param parts: as of :func:`spectral_noise`.
    :param quantum: the step of the values, 0 for none: the errors of rounding a smooth surface are correlated, too.
    """
    found = spectral_noise(parts)
    if found is None or not found.correlated:
        return None
    covariance = found.covariance()
    values = [z[there] for z, there in parts]
    widest = max(float(np.ptp(some)) for some in values if some.size)
    least = max(FAINT * widest, ROUNDING * quantum / np.sqrt(12.0))
    return covariance if np.sqrt(covariance[0, 0]) > least else None


def _powers(parts: list[tuple[Array, Array]]) -> Array:
    """The power (n, m) by frequency of all tiles of which every sample is there."""
    tiling, half, cut = _tiling(), SIDE // 2, []
    total = sum(max(0, z.shape[0] // half - 1) * max(0, z.shape[1] // half - 1) for z, _ in parts)
    for z, there in parts:
        if min(z.shape) < SIDE:
            continue
        tiles = sliding_window_view(z, (SIDE, SIDE))[::half, ::half].reshape(-1, SIDE, SIDE)
        whole = sliding_window_view(there, (SIDE, SIDE))[::half, ::half].all(axis=(2, 3)).ravel()
        places = np.flatnonzero(whole)
        some = min(len(places), int(np.ceil(len(places) * TILES / max(total, TILES))))
        cut.append(tiles[places[(np.arange(some) * len(places)) // max(some, 1)]].reshape(some, SIDE * SIDE))
    if not cut:
        return np.zeros((0, int(tiling.used.sum())))
    flat = np.concatenate(cut).astype(np.float64)
    flat -= flat.mean(axis=1, keepdims=True)
    flat -= (flat @ tiling.basis) @ tiling.basis.T
    transform = np.fft.rfft2(flat.reshape(-1, SIDE, SIDE) * tiling.window)
    power = transform.real**2 + transform.imag**2
    folded = power[:, : half + 1].copy()
    folded[:, 1:half] = 0.5 * (folded[:, 1:half] + power[:, :half:-1])
    return folded[:, tiling.used]


def _flattest(power: Array, at: Frequencies) -> Array:
    """Tiles (n,) whose mean log power at low frequencies is about as low as that of the lowest."""
    low = at.radius <= LOW
    score = np.log(power[:, low]) @ at.weights[low] / at.weights[low].sum()
    margin = MARGIN * LOG_SPREAD / np.sqrt(at.weights[low].sum())
    return _below(score, float(np.quantile(score, LOWEST)) + margin)


def _agreeing(power: Array, at: Frequencies, spectrum: Spectrum, offset: float) -> Array:
    """Tiles (n,) that have no more power than the spectrum at the frequencies at which that is noise."""
    noise = spectrum.of_blurred(at) + spectrum.white
    whole = noise + spectrum.of_surface(at) + offset
    share = (noise / whole) ** 2
    weights = at.weights * share / (at.weights @ share)
    spread = np.sqrt(np.sum(weights**2 / at.weights))
    return _below(((power + offset) / whole) @ weights, 1.0 + MARGIN * float(spread))


def _below(score: Array, limit: float) -> Array:
    """Where a score is no more than the limit, and the least ones in any case."""
    return score <= max(limit, float(np.partition(score, LEAST - 1)[LEAST - 1]))


def _levels(mean: Array, at: Frequencies) -> tuple[float, float, float]:
    """Powers at low, middle and high frequencies."""
    radius = at.radius
    bands = (radius < 0.12, (radius > 0.12) & (radius < 0.3), radius > 0.4)
    low, middle, high = (float(np.median(mean[band])) for band in bands)
    return low, middle, high


def _correlated(mean: Array, at: Frequencies, weights: Array, offset: float) -> Spectrum:
    """The spectrum with correlated noise."""
    low, _, high = _levels(mean, at)
    surface, white, blurred = np.log(low * 0.1) - 2.0, np.log(high * 0.3), np.log(max(low * 0.5, high))
    return fitted(
        mean, at, weights, [[surface, 3.3, white, blurred, np.log(length)] for length in (0.5, 1.0, 2.0)], offset
    )


def correlation_of(covariance: Array) -> Array | None:
    """The correlation (2 r + 1, 2 r + 1) by lag, 1 in the middle, r the last lag at which it counts; None for white noise.

    :param covariance: (SIDE, SIDE) as of :meth:`Found.covariance`.
    """
    lags = np.roll(covariance / covariance[0, 0], (REACH, REACH), (0, 1))[: 2 * REACH + 1, : 2 * REACH + 1]
    lags = 0.5 * (lags + lags[::-1, ::-1])
    far = np.maximum(*np.abs(np.mgrid[-REACH : REACH + 1, -REACH : REACH + 1]))
    reach = int(far[np.abs(lags) > UNTOLD].max())
    inner = slice(REACH - reach, REACH + reach + 1)
    return lags[inner, inner] if reach else None


def length_of(correlation: Array | None) -> float:
    """The deviation in samples of a sampled Gaussian that correlates neighbours of white noise as much, both ways alike."""
    if correlation is None:
        return 0.0
    middle = correlation.shape[0] // 2
    found = [_length(float(correlation[middle + 1, middle])), _length(float(correlation[middle, middle + 1]))]
    return float(np.sqrt(np.mean(np.square(found))))


def _length(neighbours: float) -> float:
    """The deviation of the Gaussian from the correlation of neighbours."""
    lengths, at = np.linspace(0.15, 4.0, 100), np.arange(-64, 64) / 128.0
    powers = [gaussian(at, length)[0] for length in lengths]
    known = [float(power @ np.cos(2.0 * np.pi * at) / power.sum()) for power in powers]
    return float(np.interp(neighbours, known, lengths, left=0.0))
