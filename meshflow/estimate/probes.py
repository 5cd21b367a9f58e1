"""Random probes for Monte Carlo estimates of the risk: fields of deviation 1 with the correlation of the noise."""

import numpy as np

from meshflow.geometry.validation import Array

__all__ = ["gain_of", "probes", "root_of"]


def probes(
    shape: tuple[int, ...],
    count: int = 1,
    correlation: Array | None = None,
    between: Array | None = None,
    seed: int = 0,
) -> Array:
    """Fields b of mean 0 and covariance C, the correlation of the noise: E[b . J b] = tr(C J) for every matrix J.

    For white noise they are random signs, whose estimate has the least variance, zero for a diagonal J. For correlated noise they
    are Gaussian and periodic: opposite sides of the grid correlate, which has no effect because no flow joins them.

    :param shape: (k, h, w), channels, rows and columns; of a volume (k, d, h, w).
    :param count: the number of probes, p.
    :param correlation: (2r+1, 2r+1), by lag in rows and columns, 1 in the middle, of a volume by lag in three axes; None: white.
    :param between: (k, k), correlation of channels; None: none.
    :param seed: of the random numbers.
    :returns: (p, *shape), float32.
    """
    draw = np.random.default_rng(seed)
    if correlation is None and between is None:
        return (2 * draw.integers(0, 2, (count, *shape), dtype=np.int8) - 1).astype(np.float32)
    found = _correlated(draw, (count, *shape), correlation)
    if between is not None:
        found = np.einsum("ij,pj...->pi...", root_of(between), found)
    return found.astype(np.float32)


def _correlated(draw: np.random.Generator, shape: tuple[int, ...], correlation: Array | None) -> Array:
    """Gaussian fields (p, k, ...), white or filtered with the square root of their spectrum, clipped at zero."""
    if correlation is None:
        return draw.standard_normal(shape, dtype=np.float32)
    need = shape[2:]
    wide = tuple(max(have, side) for have, side in zip(need, correlation.shape, strict=True))
    white, axes = draw.standard_normal((*shape[:2], *wide), dtype=np.float32), tuple(range(2, len(shape)))
    filtered = np.fft.irfftn(np.fft.rfftn(white, axes=axes) * gain_of(correlation, wide), s=wide, axes=axes)
    return filtered[(..., *(slice(size) for size in need))]


def gain_of(correlation: Array, shape: tuple[int, ...]) -> Array:
    """The square root of the spectrum of a correlation by lag, clipped at zero, of mean square 1.

    :param correlation: (2r+1, 2r+1), or of three axes, 1 in the middle.
    :param shape: (h, w) or (d, h, w), of a periodic field that is at least as large.
    :returns: (h, w / 2 + 1) or (d, h, w / 2 + 1), the factors of a real Fourier transform.
    """
    kernel = np.zeros(shape)
    lags = (np.arange(size) - size // 2 for size in correlation.shape)
    kernel[np.ix_(*(lag % size for lag, size in zip(lags, shape, strict=True)))] = correlation
    power = np.maximum(np.fft.fftn(kernel).real, 0.0)
    return np.sqrt(power / power.mean())[..., : shape[-1] // 2 + 1]


def root_of(matrix: Array) -> Array:
    """The symmetric square root of a correlation matrix (k, k)."""
    values, vectors = np.linalg.eigh(np.asarray(matrix, np.float64))
    return (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
