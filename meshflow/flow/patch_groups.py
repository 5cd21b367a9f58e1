"""A second stage on a grid or a volume: filtering of groups of similar patches, which are found in a first result.

The second step of non-local Bayes (Lebrun, Buades, Morel, *A Nonlocal Bayesian Image Denoising Algorithm*, 2013). Patches that
are similar in the first result, the pilot, form a group with mean m and covariance C. With the covariance Cn of the noise, the
estimate for a noisy patch y is m + C (C + Cn)^-1 (y - m). The estimates of a sample from all groups are averaged.

Our additions: channels are transformed so that their noise is independent with deviation 1, and that they are the principal
axes of the pilot. They are then filtered separately in common groups. The filter is repeated with its own result as pilot,
because the result of a flow lacks details that the first pass restores.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from meshflow.geometry.validation import Array
from meshflow.kernels.interruption import interruptible
from meshflow.kernels.patch_groups import GroupOptions, patch_groups

__all__ = ["PatchGroups"]

# The weight of the squared distance in position (samples), in squares of the noise. It improves the result by 0.05 dB.
NEAR = 0.2


@dataclass(frozen=True)
class _Numbers:
    """The side of a patch in samples, the reach of the search along each axis, the number of patches in a group, and for each
    pass the assumed share of the noise and the stride of the references.

    The first pilot varies less than the data; with a smaller share of the noise its lost details are restored.
    """

    side: int
    reach: int
    members: int
    passes: tuple[tuple[float, int], ...]


# Sides from 3 to 8, reaches to 15 and groups from 32 to 100 differ by 0.03 dB on twelve photographs
# (tests/bench_second_stage.py). A third pass improves colours by 0.15 dB, but not a single channel.
OF_GRIDS = _Numbers(5, 10, 48, ((0.4, 4), (0.9, 3)))
OF_CHANNELS = _Numbers(5, 10, 48, ((0.5, 4), (0.9, 4), (0.9, 3)))
# On three phantoms of 48^3 samples at three levels of noise, sides of 3 and 4, reaches of 4 to 6 and groups of 48 to 100 differ
# by 0.1 dB; the second pass improves them by 0.7 dB, the third one by 0.35 dB.
OF_VOLUMES = _Numbers(4, 5, 64, ((0.5, 4), (0.9, 4), (0.9, 3)))


@dataclass(frozen=True, eq=False)
class PatchGroups:
    """Filtering in groups of similar patches, for noise of a known covariance.

    :ivar channels: (k, k), covariance of the noise between the channels of one sample, squared unit of the values; channels with
        variance 0 do not change.
    :ivar correlation: (2 r + 1, 2 r + 1), correlation of the noise by lag in rows and columns, 1 in the middle, the same for all
        channels, or of a volume by lag in three axes; None: the noise is white.
    """

    channels: Array
    correlation: Array | None = None

    @classmethod
    def of(cls, sigmas: Array, between: Array | None = None, correlation: Array | None = None) -> "PatchGroups":
        """The filter for given standard deviations of the channels.

        :param sigmas: (k,), unit of the values.
        :param between: (k, k), correlation of the noise between channels; None: none.
        :param correlation: see the class.
        """
        sigma = np.asarray(sigmas, np.float64)
        return cls(np.outer(sigma, sigma) * (np.eye(len(sigma)) if between is None else between), correlation)

    def filtered(self, values: Array, pilot: Array, missing: Array, threads: int | None = None) -> Array:
        """The filtered values (k, h, w), or (k, d, h, w) of a volume, with a first result as pilot.

        Samples without a complete patch, near missing ones or on a grid smaller than a patch, are those of the pilot. A patch
        of a volume of few slices has all of them.

        :param values: (k, h, w) or (k, d, h, w), float32 or float64.
        :param pilot: of the same shape and type.
        :param missing: (h, w) or (d, h, w), samples that must not be in a patch.
        :param threads: the number of threads.
        :returns: a new array like the pilot.
        """
        if missing.ndim == 2:
            return self._filtered(values[:, None], pilot[:, None], missing[None], threads)[:, 0]
        return self._filtered(values, pilot, missing, threads)

    def _filtered(self, values: Array, pilot: Array, missing: Array, threads: int | None) -> Array:
        """The filtered values (k, d, h, w); a grid of two axes has one slice, which a volume has not."""
        noisy = np.flatnonzero(np.diag(self.channels) > 0)
        numbers = (OF_GRIDS if len(noisy) == 1 else OF_CHANNELS) if len(missing) == 1 else OF_VOLUMES
        side = numbers.side
        if min(missing.shape[1:]) < side or not noisy.size or missing.all():
            return pilot.copy()
        deep = 1 if len(missing) == 1 else min(side, len(missing))
        number, gone = values.dtype.type, np.broadcast_to(missing, values.shape)
        offset = np.array([np.mean(part[~missing], dtype=np.float64) for part in pilot])
        offset = offset[noisy, None, None, None].astype(number)
        to, back = self._axes(np.where(gone, number(0), pilot)[noisy] - offset, ~missing, noisy)
        turned, first = (
            np.ascontiguousarray(
                np.tensordot(to.astype(number), np.where(gone[noisy], number(0), part[noisy] - offset), 1)
            )
            for part in (values, pilot)
        )
        whole = None if not missing.any() else np.ascontiguousarray(missing)
        covariance = self._of_patch((deep, side, side))
        for loss, stride in numbers.passes:
            options = GroupOptions(deep, side, stride, numbers.reach, numbers.members, NEAR, loss)
            run = partial(patch_groups, turned, first, whole, covariance, options, first, threads=threads)
            interruptible(lambda flag, run=run: run(stop=flag))
        out = pilot.copy()
        out[noisy] = np.where(gone[noisy], pilot[noisy], np.tensordot(back.astype(number), first, 1) + offset)
        return out

    def _axes(self, pilot: Array, there: Array, noisy: Array) -> tuple[Array, Array]:
        """The matrices (k, k) to channels of independent noise of deviation 1, the axes of a pilot (k, d, h, w), and back."""
        variances, axes = np.linalg.eigh(self.channels[np.ix_(noisy, noisy)])
        scales = np.sqrt(np.maximum(variances, 1e-6 * variances[-1]))
        white, colour = axes.T / scales[:, None], axes * scales
        if len(noisy) == 1:
            return np.abs(white), np.abs(colour)
        seen = white @ pilot[:, there].astype(np.float64)
        principal = np.linalg.eigh(seen @ seen.T)[1]
        return principal.T @ white, colour @ principal

    def _of_patch(self, shape: tuple[int, int, int]) -> Array:
        """The covariance (n, n) of the noise of the n samples of a patch, of deviation 1."""
        if self.correlation is None:
            return np.eye(int(np.prod(shape)))
        known = self.correlation if self.correlation.ndim == 3 else self.correlation[None]
        reaches = [max(size - 1, length // 2) for size, length in zip(shape, known.shape, strict=True)]
        lags = np.pad(known, [(reach - length // 2,) * 2 for reach, length in zip(reaches, known.shape, strict=True)])
        places = [axis.ravel() for axis in np.indices(shape)]
        found = lags[tuple(reach + at[:, None] - at for reach, at in zip(reaches, places, strict=True))]
        variances, axes = np.linalg.eigh(
            (found + found.T) / 2
        )  # with truncated lags it may not be positive semidefinite
        return (axes * np.maximum(variances, 1e-3)) @ axes.T
