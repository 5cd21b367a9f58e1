"""The mean of frames of the same view, and the standard deviation of each sample."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from meshflow.errors import InputError
from meshflow.estimate.noise_growth import noise_growth
from meshflow.geometry.validation import Array

__all__ = ["Averaged", "averaged"]

# The weight of the noise model of all samples beside the spread of a sample, in frames.
PRIOR = 4.0
# Median depths of frames of one view differ by less than this factor.
OTHER = 1.5


@dataclass(frozen=True, eq=False)
class Averaged:
    """The mean of frames.

    :ivar mean: (h, w), NaN where no frame has a sample.
    :ivar sigma: (h, w), the standard deviation of the mean, unit of the values; NaN likewise.
    :ivar count: (h, w), number of frames that have the sample.
    """

    mean: Array
    sigma: Array
    count: Array

    @property
    def weights(self) -> Array:
        """1 / variance of the mean, 0 where there is none."""
        return np.where(self.count > 0, 1.0 / np.square(np.where(self.count > 0, self.sigma, 1.0)), 0.0)


def averaged(frames: Iterable[Array]) -> Averaged:
    """The mean of frames of the same view, and its standard deviation from their spread.

    The spread of few frames is uncertain. Therefore the variance of each sample is combined with that of all samples of its
    depth, which counts like four further frames. One frame at a time is in memory.

    :param frames: (h, w) each, NaN, infinite and 0 where missing.
    :raises InputError: for fewer than two frames, or frames of different sizes, units or views.
    """
    count = mean = squares = None
    seen, first, usual = 0, None, None
    for frame in frames:
        values = np.asarray(frame, dtype=np.float64)
        if count is None or mean is None or squares is None:
            if values.ndim != 2:
                raise InputError(f"frames: depths (h, w) expected, got shape {values.shape}")
            count, mean, squares = (np.zeros(values.shape) for _ in range(3))
            first = values
        if values.shape != count.shape:
            raise InputError(f"frames: all of one size expected, got {count.shape} and {values.shape}")
        there = np.isfinite(values) & (values != 0)
        seen += 1
        if there.any():
            typical = float(np.median(values[there]))
            usual = typical if usual is None else usual
            if not usual / OTHER < typical < usual * OTHER:
                raise InputError(
                    f"frames: depths of one unit and one view expected, got medians of {usual:.4g} and, in frame {seen}, "
                    f"{typical:.4g}"
                )
        count += there
        off = np.where(there, values - mean, 0.0)  # Welford 1962
        mean += off / np.maximum(count, 1)
        squares += off * np.where(there, values - mean, 0.0)
    if count is None or mean is None or squares is None or first is None or seen < 2:
        raise InputError(f"frames: two or more of the same view expected, got {seen}")
    spread = _spread(first, mean, squares, count)
    gone = count == 0
    sigma = np.where(gone, np.nan, spread / np.sqrt(np.maximum(count, 1)))
    return Averaged(np.where(gone, np.nan, mean), sigma, count.astype(np.int64))


def _spread(first: Array, mean: Array, squares: Array, count: Array) -> Array:
    """The standard deviation of a single frame at each sample."""
    own = squares / np.maximum(count - 1, 1)
    several = count > 1
    known = float(np.median(own[several])) if several.any() else 0.0
    missing = ~np.isfinite(first) | (first == 0)
    growth = noise_growth(np.where(missing, 0.0, first), missing)
    prior = np.full(mean.shape, known) if growth is None else np.square(growth.at(mean))
    if growth is not None and known > 0:  # the temporal noise, not the spatial one
        prior *= known / max(float(np.median(prior[several])), np.finfo(float).tiny)
    free = np.maximum(count - 1, 0)
    return np.sqrt((PRIOR * prior + free * own) / (PRIOR + free))
