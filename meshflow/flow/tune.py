"""What the data says about itself: its noise and its quantum, and the contrast and time that follow."""

from dataclasses import dataclass

import numpy as np

from meshflow.geometry.gates import Array

__all__ = ["Noise", "noise_of", "noise_on"]

# Median absolute deviation of a Gaussian to its standard deviation.
MAD = 1.4826
# Samples looked at, at most: the median of more changes nothing that matters.
ENOUGH = 2_000_000


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
    whole = _whole(missing)
    for channel in np.moveaxis(stack, 2, 0):
        step = _quantum(channel[~missing])
        quantum = max(quantum, step)
        curvature = _second_difference(channel.astype(np.float64))[whole]
        deviation = MAD * float(np.median(np.abs(curvature))) / 6.0 if curvature.size else 0.0
        sigmas.append(max(deviation, step / np.sqrt(12.0)))
    return Noise(float(np.sqrt(np.mean(np.square(sigmas)))), quantum)


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
    some = values[:: max(1, values.size // ENOUGH)].astype(np.float64)
    levels = np.unique(some)
    if len(levels) < 2 or len(levels) > some.size / 4:
        return 0.0
    step = float(np.diff(levels).min())
    multiples = (levels - levels[0]) / step
    slack = 1e-3 + np.finfo(values.dtype).eps * np.abs(levels) / step
    return step if (np.abs(multiples - np.rint(multiples)) < slack).all() else 0.0
