"""Random fields with the deviation and the correlation of an estimated noise, the same for a window as for the whole grid."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from meshflow.estimate.noise import Noise
from meshflow.estimate.probes import gain_of, root_of
from meshflow.geometry.validation import Array

__all__ = ["NoiseFields"]

# The side of the blocks in which numbers are drawn, and how many are kept.
BLOCK, KEPT = 256, 64


@dataclass(frozen=True, eq=False)
class NoiseFields:
    """Gaussian fields of a noise.

    Numbers are drawn by blocks that lie on the whole grid, each from a seed of its own, so that a window holds the same numbers.

    :ivar noise: in the orientation of the grid; it has one deviation for all channels, or one for each.
    :ivar channels: their number; None: the values of the grid have shape (h, w).
    :ivar seed: of all fields.
    """

    noise: Noise
    channels: int | None = None
    seed: int = 0

    def at(self, run: int, window: tuple[slice, slice]) -> Array:
        """The field of a run in a window, (r, c) or (r, c, k), float32, unit of the values.

        :param run: a number, of one of several fields.
        :param window: rows and columns of the whole grid.
        """
        count, noise = self.channels or 1, self.noise
        planes = [self._one((self.seed, run, channel), window) for channel in range(count)]
        if noise.between is not None and len(noise.between) == count > 1:
            planes = [_mixed(row, planes) for row in root_of(noise.between).astype(np.float32)]
        planes = [np.float32(sigma) * plane for sigma, plane in zip(noise.of_channels(count), planes, strict=True)]
        return planes[0] if self.channels is None else np.stack(planes, axis=2)

    def _one(self, seed: tuple[int, ...], window: tuple[slice, slice]) -> Array:
        """The field of one channel, of deviation 1."""
        rows, columns = window
        found = np.empty((rows.stop - rows.start, columns.stop - columns.start), np.float32)
        gain = None
        if self.noise.correlation is not None:
            side = BLOCK + 2 * min(4 * max(self.noise.correlation.shape), BLOCK // 2)  # a block with a margin
            gain = gain_of(self.noise.correlation, (side, side))
        for i, (at_row, in_row) in _blocks(rows):
            for j, (at_column, in_column) in _blocks(columns):
                block = _white((*seed, i, j)) if gain is None else _correlated(seed, (i, j), gain)
                found[at_row, at_column] = block[in_row, in_column]
        return found


def _mixed(weights: Array, planes: list[Array]) -> Array:
    """The weighted sum of planes, added one by one so that a window has the bits of the whole."""
    made = weights[0] * planes[0]
    for weight, plane in zip(weights[1:], planes[1:], strict=True):
        made = made + weight * plane
    return made


def _blocks(part: slice) -> Iterator[tuple[int, tuple[slice, slice]]]:
    """The blocks along a side: number, place in the part, and place in the block."""
    for i in range(part.start // BLOCK, (part.stop - 1) // BLOCK + 1):
        start, stop = max(part.start, i * BLOCK), min(part.stop, (i + 1) * BLOCK)
        yield i, (slice(start - part.start, stop - part.start), slice(start - i * BLOCK, stop - i * BLOCK))


@lru_cache(maxsize=KEPT)
def _white(seed: tuple[int, ...]) -> Array:
    """White noise of one block; blocks before the grid, which only correlated noise needs, have seeds of their own."""
    words = [word & 0xFFFFFFFF for word in seed]
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(words))).standard_normal(
        (BLOCK, BLOCK), np.float32
    )


def _correlated(seed: tuple[int, ...], at: tuple[int, int], gain: Array) -> Array:
    """Correlated noise of one block: white noise around it, filtered.

    :param gain: of the frequencies of a block with a margin.
    """
    margin = (gain.shape[0] - BLOCK) // 2
    around = np.block([[_white((*seed, at[0] + i, at[1] + j)) for j in (-1, 0, 1)] for i in (-1, 0, 1)])
    inner = np.s_[BLOCK - margin : 2 * BLOCK + margin]
    wide = around[inner, inner]
    filtered = np.fft.irfft2(np.fft.rfft2(wide) * gain, s=wide.shape)
    return filtered[margin : margin + BLOCK, margin : margin + BLOCK].astype(np.float32)
