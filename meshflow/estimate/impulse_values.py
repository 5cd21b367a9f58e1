"""Finds the values of salt-and-pepper impulses by how they are spread: alike everywhere, and independently of each other."""

import numpy as np

from meshflow.geometry.validation import Array

__all__ = ["Salted", "impulse_values"]

# The side of the blocks in which a value is counted, and the least share of their samples that must be known.
SIDE, KNOWN = 16, 0.5
# The least and the largest share of the samples that have a value of impulses; below, they are found by their neighbours alone.
LEAST, MOST = 0.04, 0.5
# The largest difference of a block from the usual share, in standard deviations, and the least share of blocks within it.
APART, ALIKE = 4.0, 0.7
# The number of neighbouring pairs of the value that independent impulses would have: at least PAIRS are expected, and the
# number is within this share and so many standard deviations.
PAIRS, OFF, DEVIATIONS = 40.0, 0.5, 4.0
# Data with fewer other levels is a drawing.
LEVELS = 16

Salted = list[tuple[float, float]]


def impulse_values(z: Array, there: Array) -> Salted:
    """The values that impulses may have, the least and the greatest of a channel, and the share of each.

    Impulses are independent of the picture: most blocks have the same share of them, and neighbours of one are impulses as often
    as other samples are. Black or white parts of a picture, lines, letters and regular dots are not spread in that way.

    :param z: (h, w), one channel.
    :param there: (h, w), its present samples.
    :returns: pairs of a value and its share; empty where none is spread so.
    """
    if min(z.shape) < 2 * SIDE or not there.any():
        return []
    known = z[there]
    found: Salted = []
    for value in (known.min(), known.max()):
        at = there & (z == value)
        if LEAST * known.size <= at.sum() <= MOST * known.size:
            share = _spread_alike(at, there)
            found += [(float(value), share)] * (share > 0.0)
    others = known[~np.isin(known, [value for value, _ in found])] if found else known
    return found if others.size and len(np.unique(others)) >= LEVELS else []


def _spread_alike(at: Array, there: Array) -> float:
    """The share of samples (h, w) of one value, if they are spread as impulses are; else 0."""
    counts, sizes = _by_blocks(at), _by_blocks(there)
    enough = sizes >= KNOWN * SIDE**2
    if not enough.any():
        return 0.0
    shares = counts / np.maximum(sizes, 1)
    share = float(np.median(shares[enough]))
    alike = enough & (np.abs(shares - share) <= APART * np.sqrt(share * (1.0 - share) / np.maximum(sizes, 1)))
    if share < LEAST or alike.sum() < ALIKE * enough.sum():
        return 0.0
    h, w = (SIDE * side for side in alike.shape)
    usual = np.repeat(np.repeat(alike, SIDE, axis=0), SIDE, axis=1)
    counted, value = there[:h, :w] & usual, at[:h, :w] & usual
    share = float(value.sum() / counted.sum())
    left, right = slice(None, -1), slice(1, None)
    both = slice(None)
    for one, other in (
        ((both, left), (both, right)),
        ((left, both), (right, both)),
        ((left, left), (right, right)),
        ((left, right), (right, left)),
    ):
        expected = share**2 * float((counted[one] & counted[other]).sum())
        pairs = float((value[one] & value[other]).sum())
        if expected < PAIRS or abs(pairs - expected) > OFF * expected + DEVIATIONS * np.sqrt(expected):
            return 0.0
    return share


def _by_blocks(mask: Array) -> Array:
    """The number of samples of a mask (h, w) in each whole block."""
    rows, columns = (side // SIDE for side in mask.shape)
    return mask[: rows * SIDE, : columns * SIDE].reshape(rows, SIDE, columns, SIDE).sum(axis=(1, 3))
