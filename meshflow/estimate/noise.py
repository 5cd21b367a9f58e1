"""What data says about its own noise: standard deviation, quantum, and how the noise grows with depth or intensity."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sparse

from meshflow.estimate.noise_spectrum import correlated_noise, correlation_of, length_of
from meshflow.estimate.patch_noise import patch_noise
from meshflow.geometry.laplacians import neighbour_means
from meshflow.geometry.validation import Array

__all__ = ["Growth", "Noise", "noise_growth", "noise_of", "noise_on", "spread_tiles"]

# Median absolute deviation of a Gaussian to its standard deviation.
MAD = 1.4826
# Samples looked at, at most, on tiles spread over the grid: more change nothing that matters.
ENOUGH, TILES = 1_000_000, 8
# Values of which it is asked first whether most differ: then they are not quantised, and no more need be sorted.
GLANCE = 20_000
# Classes of depth or intensity, of equally many samples, and the least of those.
CLASSES, CLASS_SIZE = 24, 50

Tile = tuple[slice, slice]


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of samples, in the unit of the values.

    :ivar sigma: standard deviation; the root mean square over the channels; 0 where none is found.
    :ivar quantum: smallest step between values of quantised data; 0 where they are continuous.
    :ivar channels: sigma of each channel.
    :ivar share: of the samples that lie on whole multiples of the quantum, one another's distance; 0 without a quantum.
    :ivar how: what found it: ``patches``, ``spectrum`` (correlated noise), ``differences``, or ``nothing`` for too few samples.
    :ivar correlation: (2 r + 1, 2 r + 1), of samples by their lag in rows and columns, 1 in the middle; None: the noise is white.
    :ivar length: standard deviation, in samples, of the Gaussian that correlates neighbours of white noise as much; 0: white.
    :ivar between: (k, k), the correlation between channels; None for one channel, or where it was not looked at.
    """

    sigma: float
    quantum: float
    channels: tuple[float, ...] = ()
    share: float = 0.0
    how: str = "nothing"
    correlation: Array | None = None
    length: float = 0.0
    between: Array | None = None


@dataclass(frozen=True)
class Growth:
    """sigma = a + b x + c x^2, x a depth or an intensity; a, b, c >= 0.

    :ivar span: least and greatest x looked at.
    """

    a: float
    b: float
    c: float
    span: tuple[float, float]

    def at(self, x: Array) -> Array:
        """sigma at x; beyond the span, as at its end."""
        held = np.clip(x, *self.span)
        return self.a + held * (self.b + held * self.c)


def noise_of(values: Array, missing: Array) -> Noise:
    """Estimate the noise of a grid, robustly.

    From the weakly textured patches of at most a million samples (:func:`.patch_noise.patch_noise`); where a grid has
    too few of them, the median absolute deviation of second differences (Immerkaer 1996). At least quantum / sqrt 12, the
    error of rounding. A strong texture that is everywhere counts as noise in part: no estimate that looks at one image can tell.

    :param values: (h, w) or (h, w, k).
    :param missing: (h, w).
    """
    stack = values.reshape(*missing.shape, -1)
    sigmas, quanta, shares, covariances, how = [], [], [], [], "nothing"
    tiles = spread_tiles(missing.shape)
    for channel in np.moveaxis(stack, 2, 0):
        parts = [(channel[tile].astype(np.float64), ~missing[tile]) for tile in tiles]
        quantum, share = _quantum(np.concatenate([channel[tile][~missing[tile]] for tile in tiles]))
        sigma, by = _sigma(parts)
        covariance = correlated_noise(parts, quantum)
        if covariance is not None:
            sigma, by = float(np.sqrt(covariance[0, 0])), "spectrum"
            covariances.append(covariance)
        how = by if how in ("nothing", "patches") else how
        largest = max((np.abs(part[there]).max(initial=0.0) for part, there in parts), default=0.0)
        if sigma <= 2.0 * np.finfo(values.dtype).eps * largest:
            sigma = 0.0  # the rounding of numbers is no noise
        if sigma > 0 or (quantum > 0 and _terraced(parts, quantum)):
            sigma = max(sigma, quantum / np.sqrt(12.0))
        sigmas.append(sigma)
        quanta.append(quantum)
        shares.append(share)
    whole = float(np.sqrt(np.mean(np.square(sigmas))))
    correlation = correlation_of(np.sum(covariances, axis=0)) if covariances else None
    return Noise(whole, max(quanta), tuple(sigmas), max(shares), how, correlation, length_of(correlation))


def _sigma(parts: list[tuple[Array, Array]]) -> tuple[float, str]:
    """Standard deviation of a channel, and what found it."""
    sigma = patch_noise(parts)
    if sigma is not None:
        return sigma, "patches"
    residuals = np.concatenate([residual[there] for residual, there in map(_residuals, parts)])
    if residuals.size == 0:
        return 0.0, "nothing"
    return MAD * float(np.median(np.abs(residuals))), "differences"


def _terraced(parts: list[tuple[Array, Array]], quantum: float) -> bool:
    """Whether neighbours that differ do so by one quantum, mostly: something smooth was rounded, and not drawn in blocks."""
    steps, single, levels = 0, 0, set()
    for z, there in parts:
        for axis in (0, 1):
            both = np.take(there, range(1, there.shape[axis]), axis) & np.take(
                there, range(there.shape[axis] - 1), axis
            )
            difference = np.abs(np.diff(np.where(there, z, 0.0), axis=axis)[both]) / quantum
            steps += int((difference > 0.5).sum())
            single += int(((difference > 0.5) & (difference < 1.5)).sum())
        levels.update(np.unique(z[there])[:3].tolist())
    return len(levels) > 2 and 2 * single > steps


def noise_growth(values: Array, missing: Array, levels: Array | None = None, enough: int = ENOUGH) -> Growth | None:
    """How the noise of a grid grows with its own values (depth) or with ``levels`` (intensity).

    Second differences in classes of equally many samples, sigma = a + b x + c x^2 fitted by least squares with a, b, c >= 0, each
    class weighted by its own sigma. Differences across jumps are few and the median does not see them.

    :param values: (h, w).
    :param missing: (h, w).
    :param levels: (h, w); by default the values, averaged over 3 x 3.
    :param enough: so many samples are looked at, at most.
    :returns: None for too few samples.
    """
    from scipy.optimize import nnls

    if min(missing.shape) < 3:
        return None
    tiles = spread_tiles(missing.shape, enough)  # all of one size: looked at as one stack
    part = np.stack([values[tile] for tile in tiles]).astype(np.float64)
    residual, whole = _residuals((part, np.stack([~missing[tile] for tile in tiles])))
    level = _averaged(part) if levels is None else np.stack([levels[tile][1:-1, 1:-1] for tile in tiles])
    x = level[whole].astype(np.float64)
    if x.size < 3 * CLASS_SIZE:
        return None
    order, residual = np.argsort(x), np.abs(residual[whole])
    parts = np.array_split(order, max(3, min(CLASSES, x.size // CLASS_SIZE)))
    at = np.array([np.median(x[part]) for part in parts])
    sigma = np.array([MAD * np.median(residual[part]) for part in parts])
    if not sigma.any():
        return Growth(0.0, 0.0, 0.0, (float(at[0]), float(at[-1])))
    scale, size = max(float(np.abs(at).max()), np.finfo(float).tiny), float(sigma.max())
    weight = 1.0 / np.maximum(sigma, 0.05 * size)
    terms = np.stack([np.ones_like(at), at / scale, (at / scale) ** 2], axis=1)
    a, b, c = nnls(terms * weight[:, None], sigma * weight)[0]
    return Growth(float(a), float(b / scale), float(c / scale**2), (float(at[0]), float(at[-1])))


def noise_on(channels: Array, faces: Array, normals: Array | None = None) -> Noise:
    """Estimate the noise of values on the vertices of a mesh, robustly.

    Median absolute deviation of (I - A)^2 applied to the values, A the mean of the neighbours, each vertex divided by what that
    makes of noise: what varies linearly from neighbour to neighbour, curvature among it, is left out.

    :param channels: (n, k); with ``normals`` the points (n, d).
    :param faces: (m, 3).
    :param normals: (n, d): the noise along them instead of that of each channel.
    """
    n = len(channels)
    umbrella: Any = sparse.csr_matrix(sparse.identity(n) - neighbour_means(faces, n, "free"))
    twice = umbrella @ umbrella
    gain = np.sqrt(np.asarray(twice.multiply(twice).sum(axis=1)).ravel())
    inner = gain > 0
    if normals is None:
        rough = (twice @ channels.astype(np.float64)).T
    else:
        rough = (umbrella @ np.einsum("ij,ij->i", umbrella @ channels.astype(np.float64), normals))[None]
    sigmas = [MAD * float(np.median(np.abs(r[inner] / gain[inner]))) if inner.any() else 0.0 for r in rough]
    rounding = 2.0 * np.finfo(channels.dtype).eps * float(np.abs(channels).max(initial=0.0))
    sigmas = [0.0 if sigma <= rounding else sigma for sigma in sigmas]
    quanta = [(0.0, 0.0)] if normals is not None else [_quantum(channel) for channel in channels.T]
    whole = float(np.sqrt(np.mean(np.square(sigmas))))
    how = "differences" if inner.any() else "nothing"
    return Noise(whole, max(q for q, _ in quanta), tuple(sigmas), max(s for _, s in quanta), how)


def spread_tiles(shape: tuple[int, ...], enough: int = ENOUGH, count: int = TILES) -> list[Tile]:
    """Windows that hold at most ``enough`` samples together, spread evenly; the whole grid where it is small."""
    h, w = shape
    if h * w <= enough:
        return [(slice(0, h), slice(0, w))]
    side = int(np.sqrt(enough)) // count
    high, wide = min(h, side), min(w, side)
    tops = np.unique(np.linspace(0, h - high, max(1, count * side // high)).astype(int))
    lefts = np.unique(np.linspace(0, w - wide, max(1, count * side // wide)).astype(int))
    return [(slice(top, top + high), slice(left, left + wide)) for top in tops for left in lefts]


def _residuals(part: tuple[Array, Array]) -> tuple[Array, Array]:
    """Second differences (..., h, w) as deviations of one sample, and where all that they ask is there.

    (1, -2, 1) across rows times the same across columns, of noise 6 sigma; along the one side that is long enough, sqrt 6 sigma.
    """
    z, there = part
    gain, whole = 1.0, there
    for axis in (-2, -1):
        if z.shape[axis] < 3:
            continue
        rows, there = np.moveaxis(z, axis, 0), np.moveaxis(whole, axis, 0)
        with np.errstate(invalid="ignore", over="ignore"):
            z = np.moveaxis(rows[:-2] - 2.0 * rows[1:-1] + rows[2:], 0, axis)
        whole = np.moveaxis(there[:-2] & there[1:-1] & there[2:], 0, axis)
        gain *= np.sqrt(6.0)
    return (z / gain, whole) if gain > 1.0 else (z, np.zeros_like(whole))


def _averaged(z: Array) -> Array:
    """The mean of the 3 x 3 samples around, (..., h - 2, w - 2)."""
    h, w = z.shape[-2:]
    total = z[..., : h - 2, : w - 2].copy()
    for r, c in ((r, c) for r in range(3) for c in range(3) if r or c):
        total += z[..., r : h - 2 + r, c : w - 2 + c]
    return total / 9.0


def _quantum(values: Array) -> tuple[float, float]:
    """The step of which all values are multiples, up to rounding, and the share that is; 0 where there is none."""
    glance = values[:: max(1, values.size // GLANCE)]
    if glance.size >= GLANCE and len(np.unique(glance)) > glance.size / 4:
        return 0.0, 0.0
    some = values[:: max(1, values.size // ENOUGH)].astype(np.float64)
    levels, counts = np.unique(some, return_counts=True)
    if len(levels) < 2 or len(levels) > some.size / 4:
        return 0.0, 0.0
    for step in _steps(levels):
        multiples = (levels - levels[np.argmax(counts)]) / step
        slack = 1e-3 + np.finfo(values.dtype).eps * np.abs(levels) / step
        on = float(counts[np.abs(multiples - np.rint(multiples)) < slack].sum() / some.size)
        if on > 0.99:
            return step, on
    return 0.0, 0.0


def _steps(levels: Array) -> Iterator[float]:
    """What the quantum may be: the least difference of levels, and that of most of them, where a few samples lie between."""
    differences = np.diff(levels)
    yield float(differences.min())
    yield float(np.median(differences))
