"""Errors of instruments: correlated noise of known covariance, a camera, stripes, and spikes.

All are reproducible: the same seed gives the same values.
"""

from dataclasses import dataclass
from io import BytesIO
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from PIL import Image
from scipy.ndimage import convolve1d

from meshflow.errors import InputError
from meshflow.geometry.validation import Array, number, whole

__all__ = ["Camera", "CorrelatedNoise", "spiked", "striped"]


@dataclass(frozen=True)
class CorrelatedNoise:
    """Filtered white Gaussian noise of deviation 1 and known correlation. The filter is separable along rows and columns.

    :param length: standard deviation of the filter in samples, (down the columns, along the rows) or one for both; 0: no filter.
        ``blur`` is a Gaussian; ``linear`` and ``cubic`` are the kernels of interpolation (Keys 1981) from a coarser grid with a
        spacing of ``length`` samples. Their correlation is that of resampled noise, averaged over positions.
    :param white: share of the variance that is white, 0 to 1.
    :param kind: of the filter.
    :raises InputError: for a negative length, a share outside of 0 to 1, or an unknown kind.
    """

    length: float | tuple[float, float] = 1.0
    white: float = 0.0
    kind: Literal["blur", "linear", "cubic"] = "blur"

    def __post_init__(self) -> None:
        if min(number(length, "length") for length in self.lengths) < 0:
            raise InputError(f"length: zero or more samples expected, got {self.length}")
        if not 0 <= number(self.white, "white") <= 1:
            raise InputError(f"white: a share between 0 and 1 expected, got {self.white}")
        if self.kind not in _KERNELS:
            raise InputError(f"kind: blur, linear or cubic expected, got {self.kind!r}")

    @property
    def lengths(self) -> tuple[float, float]:
        """The length down the columns and along the rows, samples."""
        return (float(self.length), float(self.length)) if isinstance(self.length, (int, float)) else self.length

    def drawn(self, shape: tuple[int, int], seed: int = 0) -> Array:
        """Noise (h, w) whose deviation is 1 on average over seeds."""
        rng = np.random.default_rng(whole(seed, "seed", 0))
        found = rng.normal(size=tuple(n + 2 * self._reach for n in shape))
        for axis, kernel in enumerate(self._kernels):
            found = convolve1d(found, kernel, axis=axis)
        inner = slice(self._reach, -self._reach)
        return np.sqrt(1.0 - self.white) * found[inner, inner] + np.sqrt(self.white) * rng.normal(size=shape)

    def correlation(self, reach: int) -> Array:
        """The correlation (2 reach + 1, 2 reach + 1) by lag in rows and columns, 1 in the middle."""
        along = []
        for kernel in self._kernels:
            lags = np.correlate(kernel, kernel, "full")
            middle = len(kernel) - 1
            wide = np.pad(lags, max(0, reach - middle))
            along.append(wide[len(wide) // 2 - reach : len(wide) // 2 + reach + 1])
        found = (1.0 - self.white) * np.outer(*along)
        found[reach, reach] = 1.0
        return found

    @property
    def _kernels(self) -> list[Array]:
        """The filters, of unit square sum, along either axis."""
        return [_KERNELS[self.kind](length, self._reach) for length in self.lengths]

    @property
    def _reach(self) -> int:
        return 1 + int(np.ceil(4.0 * max(self.lengths)))


def _normed(kernel: Array) -> Array:
    return kernel / np.sqrt(np.sum(kernel**2))


def _blur(length: float, reach: int) -> Array:
    """A sampled Gaussian."""
    at = np.arange(-reach, reach + 1)
    return _normed(np.exp(-0.5 * (at / length) ** 2) if length > 0 else (at == 0).astype(np.float64))


def _linear(length: float, reach: int) -> Array:
    """The triangle of linear interpolation from samples ``length`` apart."""
    at = np.abs(np.arange(-reach, reach + 1))
    return _normed(np.maximum(0.0, 1.0 - at / length) if length > 0 else (at == 0).astype(np.float64))


def _cubic(length: float, reach: int) -> Array:
    """The kernel of cubic convolution, a = -1/2, from samples ``length`` apart."""
    at = np.abs(np.arange(-reach, reach + 1)) / (length if length > 0 else 1.0)
    near, far = 1.5 * at**3 - 2.5 * at**2 + 1.0, -0.5 * at**3 + 2.5 * at**2 - 4.0 * at + 2.0
    return _normed(np.where(at <= 1.0, near, np.where(at < 2.0, far, 0.0)))


_KERNELS = {"blur": _blur, "linear": _linear, "cubic": _cubic}


@dataclass(frozen=True)
class Camera:
    """A digital camera: a mosaic of red, green and blue, shot and read noise, demosaicing, sRGB, rounding, JPEG.

    The noise of a photosite of light x, 0 to 1, has the variance ``shot`` x + ``reading``^2. Demosaicing is bilinear, so that
    the noise is correlated between samples and between channels; the curve of sRGB (IEC 61966-2-1) makes it larger in the dark.

    :param shot: variance per unit of light; with 0.002 the deviation at full light is 4 % of it.
    :param reading: standard deviation of the read noise, relative to full light.
    :param quality: of JPEG, 1 to 95, with full colour resolution; None: no JPEG.
    :param seed: of the noise.
    :raises InputError: for values outside of these ranges.
    """

    shot: float = 0.002
    reading: float = 0.002
    quality: int | None = 92
    seed: int = 0

    def __post_init__(self) -> None:
        if min(number(self.shot, "shot"), number(self.reading, "reading")) < 0:
            raise InputError(f"shot, reading: zero or more expected, got {self.shot} and {self.reading}")
        if self.quality is not None and not 1 <= whole(self.quality, "quality", 1) <= 95:
            raise InputError(f"quality: 1 to 95 expected, got {self.quality}")
        whole(self.seed, "seed", 0)

    def photograph(self, scene: ArrayLike) -> tuple[Array, Array]:
        """Photographs of a scene (h, w, 3), grey levels 0 to 255, float64: one with noise, and one without.

        :raises InputError: for a scene that is not (h, w, 3).
        """
        grey = np.asarray(scene, dtype=np.float64)
        if grey.ndim != 3 or grey.shape[2] != 3:
            raise InputError(f"scene: (h, w, 3) expected, got {grey.shape}")
        light = _light(np.clip(grey, 0.0, 255.0) / 255.0)
        spread = np.sqrt(self.shot * light + self.reading**2)
        noisy = light + spread * np.random.default_rng(self.seed).normal(size=light.shape)
        return self._file(np.rint(self._developed(noisy))), self._developed(light)

    def _developed(self, light: Array) -> Array:
        """Grey levels (h, w, 3), demosaiced: red and blue are sampled at every second row and column, green at the rest."""
        rows, columns = np.indices(light.shape[:2])
        red, blue = (rows % 2 == 0) & (columns % 2 == 0), (rows % 2 == 1) & (columns % 2 == 1)
        made = np.empty_like(light)
        for k, here in enumerate((red, ~(red | blue), blue)):
            near = np.array([0.5, 1.0, 0.5])
            total, count = np.where(here, light[..., k], 0.0), here.astype(np.float64)
            for axis in (0, 1):
                total, count = (convolve1d(part, near, axis=axis, mode="mirror") for part in (total, count))
            made[..., k] = np.where(here, light[..., k], total / count)
        return 255.0 * _grey(np.clip(made, 0.0, 1.0))

    def _file(self, grey: Array) -> Array:
        """The grey levels after compression as JPEG."""
        if self.quality is None:
            return grey
        with BytesIO() as file:
            Image.fromarray(grey.astype(np.uint8)).save(file, format="JPEG", quality=self.quality, subsampling=0)
            with Image.open(file) as read:
                return np.asarray(read, dtype=np.float64)


def _light(grey: Array) -> Array:
    """The linear light of sRGB grey levels, both 0 to 1."""
    return np.where(grey <= 0.04045, grey / 12.92, ((grey + 0.055) / 1.055) ** 2.4)


def _grey(light: Array) -> Array:
    """The sRGB grey levels of linear light."""
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1.0 / 2.4) - 0.055)


def striped(values: ArrayLike, rows: float = 0.0, columns: float = 0.0, seed: int = 0) -> Array:
    """Values (h, w) with an offset for each row and each column, float64.

    Example:

        >>> import numpy as np
        >>> offsets = striped(np.zeros((20, 20)), rows=1.0)
        >>> bool(np.ptp(offsets, axis=1).max() < 1e-12)  # one offset for each row
        True

    :param values: (h, w).
    :param rows: standard deviation of the offsets of rows, and ``columns`` of columns, in the unit of the values.
    :param seed: of all random numbers.
    :raises InputError: for a deviation below zero.
    """
    made = np.array(values, dtype=np.float64)
    if min(number(rows, "rows"), number(columns, "columns")) < 0:
        raise InputError(f"rows, columns: zero or more expected, got {rows} and {columns}")
    rng = np.random.default_rng(whole(seed, "seed", 0))
    made += rows * rng.normal(size=(made.shape[0], 1))
    return made + columns * rng.normal(size=(1, made.shape[1]))


def spiked(values: ArrayLike, share: float, low: float, high: float, seed: int = 0) -> tuple[Array, Array]:
    """Values (h, w), float64, with a random share of them replaced by ``low`` or ``high``, and the mask (h, w) of these.

    Example:

        >>> import numpy as np
        >>> values, where = spiked(np.zeros((20, 20)), share=0.1, low=-9.0, high=9.0)
        >>> sorted(set(values[where].tolist()))
        [-9.0, 9.0]

    :param values: (h, w).
    :param share: of the samples, from 0 to 1.
    :param seed: of all random numbers.
    :raises InputError: for a share that is not between 0 and 1.
    """
    if not 0 <= number(share, "share") <= 1:
        raise InputError(f"share: between 0 and 1 expected, got {share}")
    made = np.array(values, dtype=np.float64)
    rng = np.random.default_rng(whole(seed, "seed", 0))
    hit = rng.random(made.shape) < share
    made[hit] = np.where(rng.random(int(hit.sum())) < 0.5, low, high)
    return made, hit
