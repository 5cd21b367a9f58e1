"""How the noise of data grows with depth or intensity."""

from dataclasses import dataclass

import numpy as np

from meshflow.estimate.spread import ENOUGH, spread_tiles
from meshflow.geometry.validation import Array

__all__ = ["MAD", "Growth", "noise_growth", "residuals"]

# Median absolute deviation of a Gaussian to its standard deviation.
MAD = 1.4826
# Classes of depth or intensity with equal numbers of samples, and the least number of samples.
CLASSES, CLASS_SIZE = 24, 50


@dataclass(frozen=True)
class Growth:
    """sigma = a + b x + c x^2, x a depth or an intensity; a, b, c >= 0.

    :ivar span: the range of x used.
    """

    a: float
    b: float
    c: float
    span: tuple[float, float]

    def at(self, x: Array) -> Array:
        """sigma at x; outside the span that of its end."""
        held = np.clip(x, *self.span)
        return self.a + held * (self.b + held * self.c)


def noise_growth(values: Array, missing: Array, levels: Array | None = None, enough: int = ENOUGH) -> Growth | None:
    """The growth of the noise of a grid with its values (depth) or with ``levels`` (intensity).

    It uses second differences in classes of equal numbers of samples. sigma = a + b x + c x^2 is fitted by least squares with
    a, b, c >= 0, each class weighted by its sigma. The median is not affected by the few differences across jumps.

    :param values: (h, w).
    :param missing: (h, w).
    :param levels: (h, w); by default the values, averaged over 3 x 3.
    :param enough: the largest number of samples used.
    :returns: None for too few samples.
    """
    from scipy.optimize import nnls

    if min(missing.shape) < 3:
        return None
    tiles = spread_tiles(missing.shape, enough)  # all of one size, stacked
    part = np.stack([values[tile] for tile in tiles]).astype(np.float64)
    residual, whole = residuals((part, np.stack([~missing[tile] for tile in tiles])))
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
    if 2 * np.count_nonzero(sigma) > len(
        sigma
    ):  # classes of one value, as at the end of the range, say nothing of the others
        at, sigma = at[sigma > 0], sigma[sigma > 0]
    scale, size = max(float(np.abs(at).max()), np.finfo(float).tiny), float(sigma.max())
    weight = 1.0 / np.maximum(sigma, 0.05 * size)
    terms = np.stack([np.ones_like(at), at / scale, (at / scale) ** 2], axis=1)
    a, b, c = nnls(terms * weight[:, None], sigma * weight)[0]
    return Growth(float(a), float(b / scale), float(c / scale**2), (float(at[0]), float(at[-1])))


def residuals(part: tuple[Array, Array]) -> tuple[Array, Array]:
    """Second differences (..., h, w), scaled to the deviation of a sample, and where all their samples are present.

    They are (1, -2, 1) along rows times the same along columns, 6 sigma for noise; along one side only where the other is too
    short, sqrt 6 sigma.
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
