"""What the data says about itself: its noise and its quantum, and the contrast and time that follow."""

from dataclasses import dataclass

import numpy as np

from meshflow.geometry.gates import Array

__all__ = ["Noise", "noise_of", "noise_on"]

# Median absolute deviation of a Gaussian to its standard deviation.
MAD = 1.4826
# Samples looked at, at most, on tiles spread over the grid: the median of more changes nothing that matters.
ENOUGH, TILES = 1_000_000, 8
# Values of which it is asked first whether most differ: then they are not quantised, and no more need be sorted.
GLANCE = 20_000


@dataclass(frozen=True)
class Noise:
    """Noise of samples on a grid.

    :ivar sigma: standard deviation, in the unit of the values; the root mean square over the channels.
    :ivar quantum: smallest step between values of quantised data; 0 where they are continuous.
    """

    sigma: float
    quantum: float


def noise_of(values: Array, missing: Array) -> Noise:
    """Estimate the noise of a grid, robustly.

    Median absolute deviation of the second difference across rows and columns (Immerkaer 1996), which planes do not reach, over
    the samples whose 3 x 3 neighbourhood is whole; at least quantum / sqrt 12, the error of rounding. Texture counts as noise.

    :param values: (h, w) or (h, w, k).
    :param missing: (h, w).
    """
    stack = values.reshape(*missing.shape, -1)
    sigmas, quantum = [], 0.0
    tiles = _tiles(missing.shape)
    whole = [_whole(missing[tile]) for tile in tiles]
    for channel in np.moveaxis(stack, 2, 0):
        step = _quantum(np.concatenate([channel[tile][~missing[tile]] for tile in tiles]))
        quantum = max(quantum, step)
        curvature = np.concatenate(
            [_second_difference(channel[tile].astype(np.float64))[w] for tile, w in zip(tiles, whole, strict=True)]
        )
        deviation = MAD * float(np.median(np.abs(curvature))) / 6.0 if curvature.size else 0.0
        sigmas.append(max(deviation, step / np.sqrt(12.0)))
    return Noise(float(np.sqrt(np.mean(np.square(sigmas)))), quantum)


def _tiles(shape: tuple[int, ...]) -> list[tuple[slice, slice]]:
    """Windows that hold at most ENOUGH samples together, spread evenly; the whole grid where it is small."""
    h, w = shape
    if h * w <= ENOUGH:
        return [(slice(0, h), slice(0, w))]
    side = int(np.sqrt(ENOUGH)) // TILES
    high, wide = min(h, side), min(w, side)
    tops = np.unique(np.linspace(0, h - high, TILES * side // high).astype(int))
    lefts = np.unique(np.linspace(0, w - wide, TILES * side // wide).astype(int))
    return [(slice(top, top + high), slice(left, left + wide)) for top in tops for left in lefts]


def noise_on(channels: Array, faces: Array) -> Noise:
    """Estimate the noise of values on the vertices of a mesh, robustly.

    Median absolute deviation of each value from the mean of its neighbours, which for noise is sigma sqrt(1 + 1 / neighbours).

    :param channels: (n, k).
    :param faces: (m, 3).
    """
    n = len(channels)
    pairs = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    pairs = np.concatenate([pairs, pairs[:, ::-1]])
    pairs = np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0)  # each neighbour once
    degree = np.bincount(pairs[:, 0], minlength=n)
    inner = degree > 0
    sigmas = []
    for channel in channels.T.astype(np.float64):
        around = np.bincount(pairs[:, 0], weights=channel[pairs[:, 1]], minlength=n)[inner] / degree[inner]
        residual = (channel[inner] - around) / np.sqrt(1.0 + 1.0 / degree[inner])
        sigmas.append(MAD * float(np.median(np.abs(residual))) if residual.size else 0.0)
    quantum = max(_quantum(channel) for channel in channels.T)
    return Noise(float(np.sqrt(np.mean(np.square(sigmas)))), quantum)


def _second_difference(z: Array) -> Array:
    """(1, -2, 1) across rows times (1, -2, 1) across columns; of noise its deviation is 6 sigma. (h - 2, w - 2)."""
    with np.errstate(invalid="ignore", over="ignore"):
        across = z[:, :-2] - 2.0 * z[:, 1:-1] + z[:, 2:]
        return across[:-2] - 2.0 * across[1:-1] + across[2:]


def _whole(missing: Array) -> Array:
    """Inner samples whose neighbourhood is whole, (h - 2, w - 2)."""
    h, w = missing.shape
    there = ~missing
    windows = [there[r : h - 2 + r, c : w - 2 + c] for r in range(3) for c in range(3)]
    return np.logical_and.reduce(windows)


def _quantum(values: Array) -> float:
    """The step of which all values are multiples, up to rounding; 0 where there is none or most values differ."""
    glance = values[:: max(1, values.size // GLANCE)]
    if glance.size >= GLANCE and len(np.unique(glance)) > glance.size / 4:
        return 0.0
    some = values[:: max(1, values.size // ENOUGH)].astype(np.float64)
    levels = np.unique(some)
    if len(levels) < 2 or len(levels) > some.size / 4:
        return 0.0
    step = float(np.diff(levels).min())
    multiples = (levels - levels[0]) / step
    slack = 1e-3 + np.finfo(values.dtype).eps * np.abs(levels) / step
    return step if (np.abs(multiples - np.rint(multiples)) < slack).all() else 0.0
