"""The noise of a volume, from slices of it: across the axis of the widest spacing, and, if it is correlated, across another."""

from dataclasses import replace

import numpy as np

from meshflow.estimate.noise import ENOUGH, Noise, Window, noise_in_windows
from meshflow.estimate.spread import spread_tiles
from meshflow.geometry.validation import Array
from meshflow.surfaces.volume import Steps

__all__ = ["noise_of_volume"]

# The largest number of slices, and of the windows along each side of a slice.
SLICES, TILES = 12, 4
# The least number of samples along an axis whose correlation is estimated.
LONG = 16


def noise_of_volume(values: Array, missing: Array, spacing: Steps) -> Noise:
    """Estimate the noise of a volume, as that of images (:func:`.noise.noise_of`), from slices spread over it.

    Noise that is correlated within slices is taken for separable: its correlation along the third axis is that of slices that
    contain this axis.

    :param values: (d, h, w) or (d, h, w, k).
    :param missing: (d, h, w).
    :param spacing: (dz, dy, dx).
    """
    across = int(np.argmax(spacing)) if max(spacing) > min(spacing) else 0
    found = noise_in_windows(values, missing, _windows(missing.shape, across))
    if found.correlation is None:
        return found
    within = [axis for axis in range(3) if axis != across]
    other = within[0]
    planes, first = found.correlation, np.ones(1)
    if missing.shape[across] >= LONG:
        beside = noise_in_windows(values, missing, _windows(missing.shape, other))
        if beside.correlation is not None:
            middle = len(beside.correlation) // 2
            # The axes of a slice are in the order of the volume.
            lags = beside.correlation if across < within[1] else beside.correlation.T
            first = lags[:, middle]
    whole = np.moveaxis(first[:, None, None] * planes[None], 0, across)
    return replace(found, correlation=whole)


def _windows(shape: tuple[int, ...], across: int) -> list[Window]:
    """Windows of slices across an axis."""
    rows, columns = (size for axis, size in enumerate(shape) if axis != across)
    count = int(np.clip(ENOUGH // (rows * columns), min(SLICES, shape[across]), shape[across]))
    found: list[Window] = []
    for i in np.unique(np.linspace(0, shape[across] - 1, count + 2)[1:-1].round().astype(int)):
        for top, left in spread_tiles((rows, columns), ENOUGH // count, TILES):
            parts: list[slice | int] = [top, left]
            parts.insert(across, int(i))
            found.append(tuple(parts))
    return found
