"""The mean of frames of the same view, and the standard deviation of each sample."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from meshflow.errors import InputError
from meshflow.estimate.noise_growth import MAD, noise_growth
from meshflow.estimate.quantization import steps_of
from meshflow.geometry.validation import Array

__all__ = ["Averaged", "averaged"]

# Frames are compared with the first on at least BLOCKS blocks of BLOCK x BLOCK samples. A frame that differs by more than the
# share MOVED of its noise shows a moved view. The view is still if the typical difference is below STILL.
BLOCK, BLOCKS, MOVED, STILL = 8, 40, 0.25, 0.12
# Depths of a sample that differ by this many deviations of the noise belong to two surfaces.
SURFACES = 6.0
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
    :ivar moved: the numbers, from 1, of the frames that were left out because the view had moved.
    """

    mean: Array
    sigma: Array
    count: Array
    moved: tuple[int, ...] = ()

    @property
    def weights(self) -> Array:
        """1 / variance of the mean, 0 where there is none."""
        return np.where(self.count > 0, 1.0 / np.square(np.where(self.count > 0, self.sigma, 1.0)), 0.0)


def averaged(frames: Iterable[Array]) -> Averaged:
    """The mean of frames of the same view, and its standard deviation from their spread.

    Frames whose means over blocks differ from those of the first by more than a quarter of the noise show a moved view and are
    left out. Depths of a sample that differ by far more than the noise belong to two surfaces. The surface of the first frame is
    used. If the view is still, and the first frame has fewer than two neighbours on its surface, the more frequent surface is
    used. The spread of few frames is uncertain. Therefore the variance of each sample is combined with that of all samples of
    its depth, which counts like four further frames. One frame at a time is in memory.

    :param frames: (h, w) each, NaN, infinite and 0 where missing.
    :raises InputError: for fewer than two frames, or frames of different sizes, units or views.
    """
    first = noise = usual = None
    seen, moved, shifts = 0, [], []
    one = other = _Means.of((0, 0))
    for frame in frames:
        values = np.asarray(frame, dtype=np.float64)
        if first is None:
            if values.ndim != 2:
                raise InputError(f"frames: depths (h, w) expected, got shape {values.shape}")
            first, noise = values, _noise_of_one(values)
            one, other = _Means.of(values.shape), _Means.of(values.shape)
        if values.shape != first.shape:
            raise InputError(f"frames: all of one size expected, got {first.shape} and {values.shape}")
        there = _known(values)
        seen += 1
        if there.any():
            typical = float(np.median(values[there]))
            usual = typical if usual is None else usual
            if not usual / OTHER < typical < usual * OTHER:
                raise InputError(
                    f"frames: depths of one unit and one view expected, got medians of {usual:.4g} and, in frame {seen}, "
                    f"{typical:.4g}"
                )
        if noise is not None:
            shifts.append(_off(values, first, noise))
            if shifts[-1] > MOVED:
                moved.append(seen)
                continue
        far = there & one.far(values, noise)
        one.add(values, there & ~far)
        other.add(values, far & ~other.far(values, noise))
    if first is None or seen < 2:
        raise InputError(f"frames: two or more of the same view expected, got {seen}")
    still = not shifts or float(np.median(shifts)) < STILL
    more = (other.count > one.count) & _alone(first, noise) & still
    count, mean, squares = (
        np.where(more, two, own)
        for own, two in ((one.count, other.count), (one.mean, other.mean), (one.squares, other.squares))
    )
    spread = _spread(first, mean, squares, count)
    gone = count == 0
    sigma = np.where(gone, np.nan, spread / np.sqrt(np.maximum(count, 1)))
    return Averaged(np.where(gone, np.nan, mean), sigma, count.astype(np.int64), tuple(moved))


@dataclass(frozen=True, eq=False)
class _Means:
    """Running means (Welford 1962), updated in place: count, mean, and sum of squares about the mean, (h, w) each."""

    count: Array
    mean: Array
    squares: Array

    @classmethod
    def of(cls, shape: tuple[int, ...]) -> "_Means":
        """Empty means."""
        return cls(np.zeros(shape), np.zeros(shape), np.zeros(shape))

    def far(self, values: Array, noise: Array | None) -> Array:
        """Mask of the values that differ from the mean of the previous ones by more than SURFACES deviations of the noise."""
        if noise is None:
            return np.zeros(self.count.shape, bool)
        with np.errstate(invalid="ignore"):
            return (self.count > 0) & (np.abs(values - self.mean) > SURFACES * noise)

    def add(self, values: Array, there: Array) -> None:
        """Add the present values."""
        np.add(self.count, there, out=self.count)
        off = np.where(there, values - self.mean, 0.0)
        np.add(self.mean, off / np.maximum(self.count, 1), out=self.mean)
        np.add(self.squares, off * np.where(there, values - self.mean, 0.0), out=self.squares)


def _alone(values: Array, noise: Array | None) -> Array:
    """Mask (h, w) of the samples with fewer than two neighbours on the same surface."""
    near = np.zeros(values.shape, np.int64)
    if noise is None:
        return near < 2
    known = np.where(_known(values), values, np.nan)
    for one, two in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        with np.errstate(invalid="ignore"):
            together = np.abs(known[one] - known[two]) <= SURFACES * noise[one]
        near[one] += together
        near[two] += together
    return near < 2


def _known(values: Array) -> Array:
    """Mask (h, w) of the samples with a depth."""
    return np.isfinite(values) & (values != 0)


def _noise_of_one(values: Array) -> Array | None:
    """The noise of a frame at each sample (h, w); None if it cannot be estimated."""
    missing = ~_known(values)
    growth = noise_growth(np.where(missing, 0.0, values), missing)
    if growth is None or missing.all():
        return None
    known = np.where(missing, float(np.median(values[~missing])), values)
    noise, steps = growth.at(known), steps_of(values[~missing])
    noise = noise if steps is None else np.maximum(noise, steps.at(known))
    return noise if float(noise.min()) > 0 else None


def _off(values: Array, first: Array, noise: Array) -> float:
    """The typical difference of a frame and the first in units of the noise: of means over blocks, minus the noise of these."""
    h, w = (n // BLOCK * BLOCK for n in values.shape)
    there = _known(values) & _known(first)
    off = np.where(there, values - first, 0.0)[:h, :w] / noise[:h, :w]
    whole = there[:h, :w].reshape(h // BLOCK, BLOCK, w // BLOCK, BLOCK).all(axis=(1, 3))
    means = off.reshape(h // BLOCK, BLOCK, w // BLOCK, BLOCK).mean(axis=(1, 3))[whole]
    if means.size < BLOCKS:
        return 0.0
    typical = MAD * float(np.median(np.abs(means)))
    return float(np.sqrt(max(typical**2 - 2.0 / BLOCK**2, 0.0)))


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
