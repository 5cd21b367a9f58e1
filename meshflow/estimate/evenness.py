"""Whether noise is everywhere, as noise is: lines of text, bricks and other textures leave quiet places between them."""

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from meshflow.geometry.validation import Array

__all__ = ["leaves_gaps"]

# The side of a block, from one to the next, and the share of the blocks that are quiet places.
SIDE, STEP, SHARE = 12, 6, 0.05
# The deviation in the quietest blocks over that of the noise is less than this for textures (0.28 to 0.54 between lines of text,
# and bricks); with noise that is everywhere it is 0.77 or more.
GAPS = 0.58
# A block holds too few independent numbers of noise that is wider than this, in samples; the least number of blocks.
WIDEST, FEW = 0.8, 40


def leaves_gaps(parts: Sequence[tuple[Array, Array]], covariance: Array, length: float) -> bool:
    """Whether the quietest places have far less than the noise.

    :param parts: pieces of the data (h, w), float64, and masks of their present samples.
    :param covariance: (side, side), of the noise by lag, lag (0, 0) at [0, 0].
    :param length: of the noise, in samples.
    """
    squares = np.concatenate([np.zeros(0), *(_squares(z, there) for z, there in parts)])
    if length > WIDEST or len(squares) < FEW:
        return False
    return float(np.quantile(squares, SHARE)) < GAPS**2 * _expected(covariance)


def _squares(z: Array, there: Array) -> Array:
    """The variance (n,) in blocks about the best plane; of blocks that are whole, and that no end of the range has clipped."""
    if min(z.shape) < SIDE:
        return np.zeros(0)
    known = z[there]
    ends = (known.min(), known.max()) if known.size else (0.0, 0.0)
    usable = there & (z != ends[0]) & (z != ends[1])
    at = np.s_[::STEP, ::STEP]
    whole = sliding_window_view(usable, (SIDE, SIDE))[at].all(axis=(2, 3))
    blocks = sliding_window_view(z, (SIDE, SIDE))[at][whole].reshape(-1, SIDE * SIDE)
    plane = _planes()
    squares = (np.square(blocks - (blocks @ plane) @ plane.T)).sum(axis=1) / (SIDE * SIDE - 3)
    return squares[squares > 0]  # what is level has been levelled


def _expected(covariance: Array) -> float:
    """The variance of the noise in a block about the best plane."""
    place = np.indices((SIDE, SIDE)).reshape(2, -1)
    lag = (place[:, :, None] - place[:, None, :]) % len(covariance)
    among = covariance[lag[0], lag[1]]
    plane = _planes()
    return float((np.trace(among) - np.trace(plane.T @ among @ plane)) / (SIDE * SIDE - 3))


def _planes() -> Array:
    """(SIDE^2, 3), orthonormal planes on a block."""
    along = np.arange(SIDE) - (SIDE - 1) / 2.0
    rows, columns = np.meshgrid(along, along, indexing="ij")
    return np.linalg.qr(np.stack([np.ones(SIDE * SIDE), rows.ravel(), columns.ravel()], axis=1))[0]
