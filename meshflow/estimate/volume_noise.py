"""The noise of a volume, from slices of it: across the axis of the widest spacing, and, if it is correlated, across another."""

from dataclasses import replace

import numpy as np
from scipy.ndimage import binary_dilation, uniform_filter

from meshflow.estimate.magnitudes import sigma_of_air
from meshflow.estimate.noise import ENOUGH, Noise, Window, noise_in_windows
from meshflow.estimate.spread import spread_tiles
from meshflow.geometry.validation import Array
from meshflow.surfaces.volume import Steps

__all__ = ["OF_MAGNITUDES", "noise_of_volume", "slices_of"]

# The largest number of slices, and of the windows along each side of a slice.
SLICES, TILES = 12, 4
# The least number of samples along an axis whose correlation is estimated.
LONG = 16
# The share of samples at an end of the range above which noise is cut off there; the least share that remains.
CUT, LEFT = 0.01, 0.1
# Air lies below so many times its own deviation, and is at least this share of a volume; how far its spread may be from that of
# magnitudes.
AIR, OF_AIR, ALIKE = 4.5, 0.05, 0.15
# The side of the cubes whose means tell the noise of the air, and how far above the expected mean these may be.
NEIGHBOURS, ABOVE = 5, 1.15
# The largest volume of which all such cubes are used, and the number of slabs of larger ones.
MOST, SLABS = 2**23, 4
# How the noise of magnitudes is found.
OF_MAGNITUDES = "air"
# Rounds in which air is told from tissue; the least number of pairs in the air, and the largest correlation of white noise there.
ROUNDS, ENOUGH_OF_AIR, WHITE = 4, 500, 0.2


def noise_of_volume(values: Array, missing: Array, spacing: Steps) -> Noise:
    """Estimate the noise of a volume, as that of images (:func:`.noise.noise_of`), from slices spread over it.

    Where many samples have the least or the greatest value, as the air has around a head, noise is cut off there: these samples
    and those beside them are left out.

    Of magnitudes, as magnetic resonance gives them, it is the noise where there is signal, which is larger than that of the air.

    Noise that is correlated within slices is taken for separable: its correlation along the third axis is that of slices that
    contain this axis.

    :param values: (d, h, w) or (d, h, w, k).
    :param missing: (d, h, w).
    :param spacing: (dz, dy, dx).
    """
    missing = missing | _clipped(values, missing)
    across = _across(spacing)
    found = noise_in_windows(values, missing, _windows(missing.shape, across))
    magnitude = _of_magnitudes(values, missing, found.sigma)
    white = found.correlation is None or _is_white(values, ~missing & (values < AIR * magnitude))
    if magnitude > 0 and white and (magnitude > found.sigma or found.correlation is not None):
        return replace(found, sigma=magnitude, channels=(magnitude,), correlation=None, how=OF_MAGNITUDES)
    if found.correlation is None:
        return found
    within = [axis for axis in range(3) if axis != across]
    other = within[0]
    planes, first = found.correlation, np.ones(1)
    if missing.shape[across] >= LONG:
        beside = noise_in_windows(values, missing, _windows(missing.shape, other))
        if beside.correlation is not None:
            middle = len(beside.correlation) // 2
            # The axes of a slice are in the order of the volume.
            lags = beside.correlation if across < within[1] else beside.correlation.T
            first = lags[:, middle]
    whole = np.moveaxis(first[:, None, None] * planes[None], 0, across)
    return replace(found, correlation=whole)


def _of_magnitudes(values: Array, missing: Array, sigma: float) -> float:
    """The noise of the signal of magnitude images, from their air; 0 where the air is not that of magnitudes.

    Where there is no signal, a magnitude has the distribution of Rayleigh: its deviation is 0.655 of the noise in each part of
    the signal, its median 1.177, and its deviation 0.523 of its mean (Gudbjartsson and Patz 1995).

    :param sigma: the noise found, which is that of the air where most of the volume is air.
    """
    if values.ndim > 3 or sigma <= 0 or float(values.min(where=~missing, initial=np.inf)) < 0:
        return 0.0
    known = values[~missing]
    for _ in range(ROUNDS):  # where sigma is too large, what lies below a multiple of it is not air alone
        low = known[known < AIR * sigma]
        sigma = min(sigma, float(np.median(low)) / 1.177) if low.size else 0.0
        if sigma <= 0:
            return 0.0
    air = known[known < AIR * sigma].astype(np.float64)
    if air.size < OF_AIR * known.size or (air == 0).mean() > CUT:
        return 0.0
    alike = abs(float(air.std() / air.mean()) / 0.523 - 1.0) < ALIKE
    return _by_means(values, missing, sigma_of_air(air, float(np.median(air)) / 1.177)) if alike else 0.0


def _by_means(values: Array, missing: Array, sigma: float) -> float:
    """The noise of magnitudes by means over cubes: they are 1.253 of it in the air, and larger where there is any signal.

    Single magnitudes of a weak signal are not told from those of the air, and would make the noise too large.

    :param sigma: by single magnitudes.
    """
    most, found = 2 * AIR * sigma, []
    for slab in _slabs(*values.shape):
        near = uniform_filter(np.where(missing[slab], most, np.minimum(values[slab], most)), NEIGHBOURS)
        found.append(near[near < ABOVE * np.sqrt(0.5 * np.pi) * sigma])
    means = np.sort(np.concatenate(found))
    if means.size < ENOUGH_OF_AIR:
        return sigma
    # The shortest interval with half of them.
    half = means.size // 2
    first = int(np.argmin(means[half:] - means[: means.size - half]))
    return float(means[first : first + half].mean() / np.sqrt(0.5 * np.pi))


def _slabs(depth: int, rows: int, columns: int) -> list[slice]:
    """The slices of a volume that are used, all of a small one, else a few slabs spread over it."""
    thick = max(NEIGHBOURS, MOST // (SLABS * rows * columns))
    if depth <= SLABS * thick:
        return [slice(0, depth)]
    return [slice(first, first + thick) for first in np.linspace(0, depth - thick, SLABS).astype(int).tolist()]


def _is_white(values: Array, air: Array) -> bool:
    """Whether neighbours (d, h, w) in the air are not correlated, so that what is correlated elsewhere is no noise."""
    for axis in range(3):
        near, far = (np.moveaxis(array, axis, 0) for array in (values, air))
        both = far[1:] & far[:-1]
        one, other = near[1:][both].astype(np.float64), near[:-1][both].astype(np.float64)
        if one.size < ENOUGH_OF_AIR or abs(np.corrcoef(one, other)[0, 1]) > WHITE:
            return False
    return True


def _clipped(values: Array, missing: Array) -> Array:
    """The samples (d, h, w) at an end of the range that many have, and those within two samples of them."""
    grey = values if values.ndim == 3 else values[..., 0]
    there = ~missing
    ends = grey.min(where=there, initial=np.inf), grey.max(where=there, initial=-np.inf)
    cut = np.zeros(missing.shape, bool)
    for end in ends:
        at = there & (grey == end)
        if at.sum() > CUT * there.sum():
            cut |= binary_dilation(at, iterations=2)
    return cut if (there & ~cut).sum() > LEFT * there.sum() else np.zeros(missing.shape, bool)


def slices_of(shape: tuple[int, ...], spacing: Steps) -> list[Window]:
    """Windows of slices that are spread over a volume, across the axis of the widest spacing.

    :param shape: (d, h, w).
    :param spacing: (dz, dy, dx).
    """
    return _windows(shape, _across(spacing))


def _across(spacing: Steps) -> int:
    """The axis of the widest spacing; the first where all are alike."""
    return int(np.argmax(spacing)) if max(spacing) > min(spacing) else 0


def _windows(shape: tuple[int, ...], across: int) -> list[Window]:
    """Windows of slices across an axis."""
    rows, columns = (size for axis, size in enumerate(shape) if axis != across)
    count = int(np.clip(ENOUGH // (rows * columns), min(SLICES, shape[across]), shape[across]))
    found: list[Window] = []
    for i in np.unique(np.linspace(0, shape[across] - 1, count + 2)[1:-1].round().astype(int)):
        for top, left in spread_tiles((rows, columns), ENOUGH // count, TILES):
            parts: list[slice | int] = [top, left]
            parts.insert(across, int(i))
            found.append(tuple(parts))
    return found
