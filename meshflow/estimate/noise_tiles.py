"""Spectra of tiles of a grid, for the estimate of correlated noise.

Tiles of 32 x 32 samples, or of fewer where edges are dense, overlap by half. The best fitting quadratic is subtracted from each
tile, and it is multiplied by a Hann window, so that the steep spectrum of a surface does not leak into the frequencies of the
noise.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from meshflow.estimate.noise_model import Frequencies
from meshflow.geometry.validation import Array

__all__ = ["SIDES", "Tiles", "Tiling", "folded", "tiles_of", "tiling"]

# The sides of tiles: the usual one, and that where edges are dense.
SIDES = (32, 16)
# The largest number of tiles, evenly spread.
MOST = 600
# The largest clipped share of a tile, if at least FEW tiles satisfy it.
CLIPPED, FEW = 0.02, 12
# The number of tiles in a product of matrices, which is not shared among threads (see patch_noise.py).
BLOCK = 40
# The independent share of the values of windowed tiles that overlap by half.
INDEPENDENT = 0.4


@dataclass(frozen=True, eq=False)
class Tiling:
    """The data shared by all tiles.

    :ivar basis: (side^2, 6), orthonormal quadratics.
    :ivar window: (side, side), of mean square 1 / side^2, so that white noise has its variance as power.
    :ivar at: the frequencies used, (m,).
    :ivar used: (side / 2 + 1, side / 2 + 1), mask of them in a quarter of the spectrum.
    """

    basis: Array
    window: Array
    at: Frequencies
    used: Array


@dataclass(frozen=True, eq=False)
class Tiles:
    """Tiles of one channel.

    :ivar transform: (n, side, side / 2 + 1), the Fourier transform of each.
    :ivar names: (n,), increasing: a number for the position of each, the same in all channels.
    """

    transform: Array
    names: Array

    @property
    def side(self) -> int:
        """The number of samples along a side of a tile."""
        return self.transform.shape[1]

    @cached_property
    def power(self) -> Array:
        """The power (n, m) by frequency; mean over both signs of a frequency along the columns."""
        return folded(np.real(self.transform) ** 2 + np.imag(self.transform) ** 2)


@lru_cache(maxsize=len(SIDES))
def tiling(side: int) -> Tiling:
    """Basis, window and frequencies of all tiles of a side."""
    along = (np.arange(side) + 0.5) / side * 2.0 - 1.0
    powers = [np.outer(along**i, along**j).ravel() for i in range(3) for j in range(3 - i)]
    hann = 0.5 - 0.5 * np.cos(2.0 * np.pi * (np.arange(side) + 0.5) / side)
    window = np.outer(hann, hann)
    half = side // 2
    rows, columns = np.indices((half + 1, half + 1))
    count = np.full(rows.shape, 2.0)  # a frequency and its mirror image, which is the same on an axis
    for edge in (0, -1):
        count[edge] = count[:, edge] = 1.0
    used = np.hypot(rows, columns) >= 2.0  # lower frequencies contain the rest of the quadratic
    at = Frequencies(np.arange(half + 1) / side, rows[used], columns[used], count[used] * INDEPENDENT)
    return Tiling(np.linalg.qr(np.array(powers).T)[0], window / np.sqrt(np.sum(window**2)), at, used)


def tiles_of(parts: list[tuple[Array, Array]], side: int = SIDES[0]) -> Tiles:
    """The tiles of one channel without missing samples.

    :param parts: pieces of the data (h, w), and masks of their present samples.
    """
    half, shared = side // 2, tiling(side)
    places = [_places(there, side) for _, there in parts]
    clear = [place[~clipped] for place, clipped in zip(places, _clipped(parts, places, side), strict=True)]
    if sum(map(len, clear)) >= FEW:
        places = clear
    total = max(1, sum(len(place) for place in places))
    cut, names, before = [np.zeros((0, side, side))], [np.zeros(0, np.intp)], 0
    for (z, _), place in zip(parts, places, strict=True):
        some = min(len(place), -(-len(place) * MOST // total))
        if some:
            rows, columns = place[np.arange(some) * len(place) // some].T
            names.append(before + rows * z.shape[1] + columns)
            cut.append(sliding_window_view(z, (side, side))[rows * half, columns * half])
        before += z.size
    flat = np.concatenate(cut).astype(np.float64).reshape(-1, side * side)
    flat -= flat.mean(axis=1, keepdims=True)
    whole = len(flat) // BLOCK * BLOCK
    for some in (flat[:whole].reshape(-1, BLOCK, side * side), flat[whole:]):
        some -= (some @ shared.basis) @ shared.basis.T
    return Tiles(np.fft.rfft2(flat.reshape(-1, side, side) * shared.window), np.concatenate(names))


def _clipped(parts: list[tuple[Array, Array]], places: list[Array], side: int) -> list[Array]:
    """For each place a mask (n,): whether more than a few samples of its tile are at an end of the range, where noise is
    clipped.
    """
    known = [z if there.all() else z[there] for z, there in parts]
    ends = (min(some.min(initial=np.inf) for some in known), max(some.max(initial=-np.inf) for some in known))
    found = []
    for (z, _), place in zip(parts, places, strict=True):
        cut = (z == ends[0]) | (z == ends[1])
        if len(place) == 0 or cut.mean() < 0.1 * CLIPPED:
            found.append(np.zeros(len(place), bool))
            continue
        rows, columns = place.T * (side // 2)
        found.append(sliding_window_view(cut, (side, side))[rows, columns].mean(axis=(1, 2)) > CLIPPED)
    return found


def folded(spectrum: Array) -> Array:
    """A real spectrum (n, side, side / 2 + 1) as the mean of both signs of each frequency along the columns, (n, m)."""
    half = spectrum.shape[1] // 2
    quarter = spectrum[:, : half + 1].copy()
    quarter[:, 1:half] = 0.5 * (quarter[:, 1:half] + spectrum[:, :half:-1])
    return quarter[:, tiling(spectrum.shape[1]).used]


def _places(there: Array, side: int) -> Array:
    """The positions (n, 2), in half tiles, of tiles without missing samples."""
    if min(there.shape) < side:
        return np.zeros((0, 2), np.intp)
    half = side // 2
    count = ((there.shape[0] - side) // half + 1, (there.shape[1] - side) // half + 1)
    if there.all():
        return np.argwhere(np.ones(count, bool))
    return np.argwhere(sliding_window_view(there, (side, side))[::half, ::half].all(axis=(2, 3)))
