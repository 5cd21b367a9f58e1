"""Noise that is correlated between samples, from the power spectrum of the flattest tiles.

The tiles (:mod:`.noise_tiles`) are selected whose power is no higher than that of noise. The first selection has those near the
lowest mean log power at low frequencies, where texture is strongest. Three further selections have those that agree with the
fitted spectrum (:mod:`.noise_model`) at the frequencies where it is noise.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from meshflow.estimate.noise_model import Frequencies, Spectrum, fitted, gaussian
from meshflow.estimate.noise_tiles import SIDES, Tiles, tiling
from meshflow.geometry.validation import Array

__all__ = ["HINT", "LEAST", "MISFIT", "WAVES", "Found", "correlation_of", "length_of", "spectral_noise"]

# The least number of tiles.
LEAST = 5
# The share of lowest tiles at the start of the selection; its tolerance in deviations of noise; the number of selections.
LOWEST, MARGIN, ROUNDS = 0.05, 3.0, 3
# Frequencies of the first selection, cycles per sample.
LOW = 0.26
# The end of the band of low frequencies, in frequencies of the tile.
LOWEST_BAND = 3.84
# The log power of a periodogram has this deviation.
LOG_SPREAD = np.pi / np.sqrt(6.0)
# Powers below this share of the noise at frequency zero have no effect.
FAR_BELOW = 0.02
# Where the surface is weak, the noise may exceed the fitted one by this factor.
FREE = 2.0
# The least gain of log likelihood by correlation in the first fit; below it the estimate ends.
HINT = 3.0
# The least gain of log likelihood by another shape or a second length, and the largest ratio of the misfits.
GAIN, BETTER = 30.0, 0.5
# Noise is correlated if it exceeds surface and white noise somewhere by a factor, is likelier than white noise by a gain of log
# likelihood, and has a length of at least so many samples: one of SINGLE. It must also be found in FEW tiles, fit their power
# (squared relative error), and be neither too narrow nor as wide as surfaces (a share of the side of a tile).
SINGLE = ((1.25, 40.0, 0.0), (2.0, 20.0, 0.5))
FEW, MISFIT, NARROWEST, WIDEST = 6, 0.2, 0.35, 0.0875
# Less scatter of power between tiles is that of waves of a smooth surface (1.0 to 1.3); of noise it is 1.8 to 2.3.
# Fewer tiles than SCATTERED do not show it.
WAVES, SCATTERED = 1.5, 24
# If more than the share MIXED of it is white, which is usually white noise on a texture, or the exponent of the surface is below
# LEVEL, one of OF_MIXED is demanded instead. If the lengths also differ by the factor SKEWED, as for lines of text and bricks,
# the noise is not correlated.
OF_MIXED = ((2.5, 100.0, 0.0), (4.0, 30.0, 0.45))
MIXED, LEVEL, SKEWED = 0.05, 1.2, 1.6
# With an exponent of the surface above this the model is not that of the data, which has terraces or a pattern.
STEEPEST = 7.0
# Less is demanded where the spectrum fits closely (squared relative error), and its surface is self-affine, of an exponent of 2
# to 4 (Mandelbrot 1982). Clean fractal surfaces have gains below 13 and lengths of half a sample, elevation models exponents
# above 4.5, textures errors above 0.0026, or white noise in the greater part.
CLOSE, SELF_AFFINE, ON_SELF_AFFINE = 0.002, 4.3, ((0.4, 20.0, 0.9),)
# Smaller tiles hold fewer of the low frequencies that tell noise from surfaces: these are demanded of them.
OF_SMALL = ((2.0, 40.0, 0.5),)
# A spectrum is that of a rough surface and white noise if its squared relative error is below GOOD, and the exponent of the
# surface is between these; that of a texture is smaller, that of a smooth surface larger.
GOOD, ROUGH = 0.009, (2.4, 3.7)
# Correlations below UNTOLD, and those of lags beyond REACH, are not reported.
UNTOLD, REACH = 0.03, 8


@dataclass(frozen=True, eq=False)
class Found:
    """The noise in the flattest tiles.

    :ivar spectrum: with correlated noise.
    :ivar plain: with white noise alone.
    :ivar power: (m,), mean power of the tiles chosen.
    :ivar chosen: (n,), of all tiles.
    :ivar at: the frequencies, with weight 0 where they contain offsets of lines.
    :ivar scatter: of the power of the tiles: 2 for noise, about 1 for the waves of a smooth surface.
    """

    spectrum: Spectrum
    plain: Spectrum
    power: Array
    chosen: Array
    at: Frequencies
    scatter: float

    @property
    def side(self) -> int:
        """The number of samples along a side of a tile."""
        return 2 * (len(self.at.lines) - 1)

    @property
    def tiles(self) -> int:
        """The number of chosen tiles."""
        return int(self.chosen.sum())

    @property
    def evidence(self) -> float:
        """The gain of log likelihood by correlation."""
        return 0.5 * (self.plain.misfit - self.spectrum.misfit)

    @property
    def above(self) -> float:
        """The largest ratio of the correlated noise to surface and white noise."""
        at, spectrum = self.at, self.spectrum
        return float((spectrum.of_blurred(at) / (spectrum.of_surface(at) + spectrum.white)).max())

    @property
    def error(self) -> float:
        """The squared relative error of the fitted spectrum."""
        return self.spectrum.misfit / (2.0 * self.tiles * self.at.weights.sum())

    @property
    def widest(self) -> float:
        """The length, in samples, at which noise is not told from the surface."""
        return WIDEST * self.side

    @property
    def correlated(self) -> bool:
        """Whether the noise is correlated beyond doubt."""
        spectrum, narrow, wide = self.spectrum, min(self.spectrum.lengths), max(self.spectrum.lengths)
        mixed = spectrum.exponent < LEVEL or spectrum.white > MIXED * float(self.covariance()[0, 0])
        if (mixed and wide > SKEWED * narrow) or spectrum.exponent > STEEPEST or self.scatter < WAVES:
            return False
        demanded = OF_MIXED if mixed else SINGLE if self.side == SIDES[0] else OF_SMALL
        if not mixed and self.side == SIDES[0] and self.error < CLOSE and spectrum.exponent < SELF_AFFINE:
            demanded = (*demanded, *ON_SELF_AFFINE)
        clear = any(
            self.above > above and self.evidence > evidence and wide >= length for above, evidence, length in demanded
        )
        return clear and self.tiles >= FEW and self.error < MISFIT and NARROWEST < wide < self.widest

    @property
    def floor(self) -> float | None:
        """The variance of white noise on a rough surface whose spectrum is a power law; None if the tiles do not show one.

        Such a surface fills weak patches as noise does: on one of exponent 2.7 without noise 0.018 of the range is found in
        patches, 0.005 here.
        """
        plain = self.plain
        error = plain.misfit / (2.0 * self.tiles * self.at.weights.sum())
        return plain.white if error < GOOD and ROUGH[0] <= plain.exponent <= ROUGH[1] else None

    def noise(self) -> Array:
        """The power (side, side / 2 + 1) of the noise.

        At frequencies at which the surface has less than half of the power, it is the remaining power, whatever its shape;
        elsewhere, also at the lowest frequencies, it is the fitted noise, scaled to agree with its neighbours.
        """
        shared, half, spectrum = tiling(self.side), self.side // 2, self.spectrum
        at = self.at
        surface, fit = spectrum.of_surface(at), spectrum.of_blurred(at) + spectrum.white
        clear = (surface < 0.5 * self.power) & (at.weights > 0)
        near = clear & (at.radius < np.quantile(at.radius[clear], 0.15, method="higher")) if clear.any() else clear
        scale = float((self.power - surface)[near].sum() / fit[near].sum()) if near.any() else 1.0
        down, across = np.indices((half + 1, half + 1))
        whole = Frequencies(at.lines, down.ravel(), across.ravel(), np.ones(down.size))
        quarter = scale * (spectrum.of_blurred(whole) + spectrum.white).reshape(down.shape)
        left = np.clip(self.power - surface, 0.0, FREE * fit)
        quarter[shared.used] = np.where(clear, left, quarter[shared.used])
        return np.concatenate([quarter, quarter[half - 1 : 0 : -1]])

    def covariance(self) -> Array:
        """The covariance (side, side) of the noise by lag in rows and columns, lag (0, 0) at [0, 0]."""
        return np.fft.irfft2(self.noise(), (self.side, self.side))


def spectral_noise(tiles: Tiles, rows: bool = False, columns: bool = False) -> Found | None:
    """The noise of one channel.

    :param rows: whether rows have offsets, which are then left out; ``columns``: whether columns have.
    :returns: None where there are too few tiles, or most are constant.
    """
    at = tiling(tiles.side).at
    lines = (at.across < 2) & rows | (at.down < 2) & columns  # frequencies of offsets, widened by the window
    at = replace(at, weights=np.where(lines, 0.0, at.weights))
    rough = np.min(tiles.power, axis=1, initial=np.inf) > 0
    if rough.sum() < max(LEAST, 0.5 * len(rough)):
        return None
    power = tiles.power[rough]
    chosen, offset = _flattest(power, at), 0.0
    mean, weights = power[chosen].mean(axis=0), at.weights * chosen.sum()
    spectrum, plain = fitted(mean, at, weights, _starts(mean, at)), _plain(mean, at, weights, offset)
    if 0.5 * (plain.misfit - spectrum.misfit) > HINT:
        for _ in range(ROUNDS):
            offset = FAR_BELOW * (spectrum.blurred + spectrum.white)
            chosen = _agreeing(power, at, spectrum, offset)
            mean, weights = power[chosen].mean(axis=0), at.weights * chosen.sum()
            spectrum = fitted(mean, at, weights, [spectrum.numbers[:5], *_starts(mean, at)], offset)
            spectrum = _reshaped(mean, at, weights, spectrum, offset)
        plain = _plain(mean, at, weights, offset)
    every = np.zeros(len(rough), bool)
    every[np.flatnonzero(rough)[chosen]] = True
    return Found(spectrum, plain, mean, every, at, _scatter(tiles, every, spectrum, at))


def _scatter(tiles: Tiles, chosen: Array, spectrum: Spectrum, at: Frequencies) -> float:
    """The mean square over the squared mean of the power of tiles, the median over frequencies at which it is noise.

    :returns: 2 for noise, whose power is distributed exponentially, and for few tiles; about 1 for waves, which have the same
        power everywhere.
    """
    noise = spectrum.of_blurred(at)
    share, half = np.zeros(tiling(tiles.side).used.shape), tiles.side // 2
    share[tiling(tiles.side).used] = noise / (noise + spectrum.of_surface(at) + spectrum.white) * (at.weights > 0)
    clear = np.concatenate([share, share[half - 1 : 0 : -1]]) > 0.5
    clear[:, [0, -1]] = False  # real numbers, or nearly, scatter more
    if not clear.any() or chosen.sum() < SCATTERED:
        return 2.0
    power = np.square(np.abs(tiles.transform[chosen][:, clear]))
    return float(np.median(np.square(power).mean(axis=0) / np.square(power.mean(axis=0))))


def _flattest(power: Array, at: Frequencies) -> Array:
    """Tiles (n,) whose mean log power at low frequencies is about as low as that of the lowest."""
    low = at.radius <= LOW
    score = np.log(power[:, low]) @ at.weights[low] / at.weights[low].sum()
    margin = MARGIN * LOG_SPREAD / np.sqrt(at.weights[low].sum())
    return _below(score, float(np.quantile(score, LOWEST)) + margin)


def _agreeing(power: Array, at: Frequencies, spectrum: Spectrum, offset: float) -> Array:
    """Tiles (n,) with no more power than the spectrum at the frequencies at which it is noise."""
    noise = spectrum.of_blurred(at) + spectrum.white
    whole = noise + spectrum.of_surface(at) + offset
    share = (noise / whole) ** 2
    weights = at.weights * share / (at.weights @ share)
    spread = np.sqrt(weights @ share / (at.weights @ share))
    return _below(((power + offset) / whole) @ weights, 1.0 + MARGIN * float(spread))


def _below(score: Array, limit: float) -> Array:
    """Where a score is at most the limit; the lowest scores are always included."""
    return score <= max(limit, float(np.partition(score, LEAST - 1)[LEAST - 1]))


def _levels(mean: Array, at: Frequencies) -> tuple[float, float, float]:
    """Powers at low, middle and high frequencies."""
    radius, lowest = at.radius, LOWEST_BAND * at.lines[1]
    bands = (radius < lowest, (radius > lowest) & (radius < 0.3), radius > 0.4)
    low, middle, high = (float(np.median(mean[band])) for band in bands)
    return low, middle, high


def _plain(mean: Array, at: Frequencies, weights: Array, offset: float) -> Spectrum:
    """The spectrum with no noise, or with white noise alone."""
    _, middle, high = _levels(mean, at)
    bare = [np.log(middle), 3.3]
    ends = [fitted(mean, at, weights, [start], offset) for start in (bare, [*bare, np.log(high)])]
    return min(ends, key=lambda end: end.misfit)


def _reshaped(mean: Array, at: Frequencies, weights: Array, spectrum: Spectrum, offset: float) -> Spectrum:
    """The spectrum with noise of another shape, or of two lengths, where that one fits much better."""
    numbers = spectrum.numbers
    for other in (
        fitted(mean, at, weights, [numbers], offset, "spline"),
        fitted(mean, at, weights, [[*numbers, numbers[4]]], offset),
    ):
        if 0.5 * (spectrum.misfit - other.misfit) > GAIN and other.misfit < BETTER * spectrum.misfit:
            spectrum = other
    return spectrum


def _starts(mean: Array, at: Frequencies) -> list[list[float]]:
    """Starting values of the fit with correlated noise."""
    low, _, high = _levels(mean, at)
    surface, white, blurred = np.log(low * 0.1) - 2.0, np.log(high * 0.3), np.log(max(low * 0.5, high))
    return [[surface, 3.3, white, blurred, np.log(length)] for length in (0.5, 1.0, 2.0)]


def correlation_of(covariance: Array) -> Array | None:
    """The correlation (2 r + 1, 2 r + 1) by lag, 1 in the middle, r the last significant lag; None for white noise.

    :param covariance: (side, side), from :meth:`Found.covariance`.
    """
    most = min(REACH, len(covariance) // 2 - 1)
    lags = np.roll(covariance / covariance[0, 0], (most, most), (0, 1))[: 2 * most + 1, : 2 * most + 1]
    lags = 0.5 * (lags + lags[::-1, ::-1])
    far = np.maximum(*np.abs(np.mgrid[-most : most + 1, -most : most + 1]))
    reach = int(far[np.abs(lags) > UNTOLD].max())
    inner = slice(most - reach, most + reach + 1)
    return lags[inner, inner] if reach else None


def length_of(correlation: Array | None) -> tuple[float, float]:
    """Deviations of the Gaussian filter that gives white noise the same correlation of neighbours, from row to row and along
    rows.
    """
    if correlation is None:
        return 0.0, 0.0
    middle = correlation.shape[0] // 2
    return _length(float(correlation[middle + 1, middle])), _length(float(correlation[middle, middle + 1]))


def _length(neighbours: float) -> float:
    """The deviation of the Gaussian for a correlation of neighbours."""
    return float(np.interp(neighbours, *_known(), left=0.0))


@lru_cache(maxsize=1)
def _known() -> tuple[Array, Array]:
    """The correlation of neighbours by the deviation of the Gaussian."""
    lengths, lines = np.linspace(0.15, 4.0, 100), np.arange(-64, 64) / 128.0
    none = np.zeros(0, np.intp)
    at = Frequencies(lines, none, none, np.zeros(0))
    powers = np.array([gaussian(at, length)[0] for length in lengths])
    return powers @ np.cos(2.0 * np.pi * lines) / powers.sum(axis=1), lengths
