"""A second stage on a grid or a volume: filtering of groups of similar patches, which are found in a first result.

The second step of non-local Bayes (Lebrun, Buades, Morel, *A Nonlocal Bayesian Image Denoising Algorithm*, 2013). Patches that
are similar in the first result, the pilot, form a group with mean m and covariance C. With the covariance Cn of the noise, the
estimate for a noisy patch y is m + C (C + Cn)^-1 (y - m). The estimates of a sample from all groups are averaged.

Our additions: channels are transformed so that their noise is independent with deviation 1, and that they are the principal
axes of the data. They are then filtered separately in common groups. The filter is repeated with its own result as pilot,
because the result of a flow lacks details that the first pass restores.

What a sample becomes depends on its surroundings alone, so that a window with its halo becomes what it becomes in the whole.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from meshflow.geometry.validation import Array
from meshflow.kernels.interruption import interruptible
from meshflow.kernels.patch_groups import GroupOptions, patch_groups
from meshflow.surfaces.orientation import Orientation

__all__ = ["PatchGroups", "Place"]

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


@dataclass(frozen=True)
class Place:
    """Where a window lies in a larger grid.

    :ivar begin: its first slice, row and column; of a grid of two axes row and column.
    :ivar shape: of the larger grid.
    """

    begin: tuple[int, ...]
    shape: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class PatchGroups:
    """Filtering in groups of similar patches, for noise of a known covariance.

    :ivar channels: (k, k), covariance of the noise between the channels of one sample, squared unit of the values; channels with
        variance 0 do not change.
    :ivar correlation: (2 r + 1, 2 r + 1), correlation of the noise by lag in rows and columns, 1 in the middle, the same for all
        channels, or of a volume by lag in three axes; None: the noise is white.
    :ivar axes: (m, m), the principal axes of the m channels with noise, as columns, once their noise is independent with
        deviation 1; None: those are not turned.
    :ivar place: of the window that is filtered; None: it is the whole.
    """

    channels: Array
    correlation: Array | None = None
    axes: Array | None = None
    place: Place | None = None

    @classmethod
    def of(cls, sigmas: Array, between: Array | None = None, correlation: Array | None = None) -> "PatchGroups":
        """The filter for given standard deviations of the channels.

        :param sigmas: (k,), unit of the values.
        :param between: (k, k), correlation of the noise between channels; None: none.
        :param correlation: see the class.
        """
        sigma = np.asarray(sigmas, np.float64)
        return cls(np.outer(sigma, sigma) * (np.eye(len(sigma)) if between is None else between), correlation)

    def along(self, values: Array, missing: Array) -> "PatchGroups":
        """The filter with the principal axes of data.

        :param values: (k, h, w) or (k, d, h, w); ``missing``: (h, w) or (d, h, w).
        """
        noisy = self._noisy
        if len(noisy) < 2 or missing.all():
            return self
        seen = values[noisy][:, ~missing].astype(np.float64)
        seen = self._whitened[0] @ (seen - seen.mean(axis=1, keepdims=True))
        return replace(self, axes=np.linalg.eigh(seen @ seen.T)[1])

    def oriented(self, way: Orientation) -> "PatchGroups":
        """The filter of a reoriented grid; that of a volume stays as it is."""
        known = self.correlation
        return self if known is None or known.ndim == 3 else replace(self, correlation=way.of(known))

    def reaches(self, axes: int) -> tuple[int, ...]:
        """How many samples away a sample decides what each pass makes of another one.

        A group changes what is as far from its reference as a member and a patch reach, and is made of as much on the other side.

        :param axes: of the grid, 2 or 3.
        """
        numbers = self._numbers(axes)
        return (2 * numbers.reach + numbers.side - 1,) * len(numbers.passes) if self._noisy.size else ()

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
        for number in range(len(self.reaches(missing.ndim))):
            pilot = self.passed(number, values, pilot, missing, threads)
        return pilot if self._noisy.size else pilot.copy()

    def passed(self, number: int, values: Array, pilot: Array, missing: Array, threads: int | None = None) -> Array:
        """The values after one pass of the filter, whose pilot is the result of the pass before; parameters of :meth:`filtered`.

        :param number: of the pass.
        """
        if missing.ndim == 2:
            made = self._passed(number, values[:, None], pilot[:, None], missing[None], threads)
            return made[:, 0]
        return self._passed(number, values, pilot, missing, threads)

    def _passed(self, number: int, values: Array, pilot: Array, missing: Array, threads: int | None) -> Array:
        """The values (k, d, h, w) after a pass; a grid of two axes has one slice, which a volume has not."""
        noisy, (begin, shape) = self._noisy, self._in_whole(missing.shape)
        numbers = self._numbers(2 if shape[0] == 1 else 3)
        side = numbers.side
        if min(shape[1:]) < side or missing.all():
            return pilot.copy()
        deep, gone = min(side, shape[0]), missing[None]
        to, back = self._turns()
        turned, first = (_mixed(to, np.where(gone, values.dtype.type(0), part[noisy])) for part in (values, pilot))
        loss, stride = numbers.passes[number]
        options = GroupOptions(deep, side, stride, numbers.reach, numbers.members, NEAR, loss, *begin, *shape)
        whole = None if not missing.any() else np.ascontiguousarray(missing)
        run = partial(
            patch_groups, turned, first, whole, self._of_patch((deep, side, side)), options, first, threads=threads
        )
        interruptible(lambda flag: run(stop=flag))
        out = pilot.copy()
        out[noisy] = np.where(gone, pilot[noisy], _mixed(back, first))
        return out

    @property
    def _noisy(self) -> Array:
        """The numbers of the channels with noise."""
        return np.flatnonzero(np.diag(self.channels) > 0)

    def _numbers(self, axes: int) -> _Numbers:
        """Those of a grid of two or three axes."""
        return OF_VOLUMES if axes == 3 else OF_GRIDS if len(self._noisy) == 1 else OF_CHANNELS

    def _in_whole(self, shape: tuple[int, ...]) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Where samples of a shape (d, h, w) begin in the whole, and its shape."""
        if self.place is None:
            return (0, 0, 0), shape
        flat = len(self.place.shape) == 2
        return ((0, *self.place.begin), (1, *self.place.shape)) if flat else (self.place.begin, self.place.shape)

    @property
    def _whitened(self) -> tuple[Array, Array]:
        """The matrices (m, m) to channels of independent noise of deviation 1, and back."""
        noisy = self._noisy
        variances, axes = np.linalg.eigh(self.channels[np.ix_(noisy, noisy)])
        scales = np.sqrt(np.maximum(variances, 1e-6 * variances[-1]))
        return axes.T / scales[:, None], axes * scales

    def _turns(self) -> tuple[Array, Array]:
        """The matrices (m, m) to the principal axes of channels of independent noise, and back."""
        white, colour = self._whitened
        if len(white) == 1:
            return np.abs(white), np.abs(colour)
        return (white, colour) if self.axes is None else (self.axes.T @ white, colour @ self.axes)

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


def _mixed(matrix: Array, planes: Array) -> Array:
    """The products of a matrix (m, m) with the channels of planes (m, ...), with the same bits wherever a sample lies."""
    made = np.empty_like(planes, order="C")
    for out, row in zip(made, matrix.astype(planes.dtype), strict=True):
        np.multiply(planes[0], row[0], out=out)
        for factor, plane in zip(row[1:], planes[1:], strict=True):
            out += factor * plane
    return made
