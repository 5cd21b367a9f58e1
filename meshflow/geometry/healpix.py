"""The centres of the pixels of HEALPix, an equal-area grid of the sphere (Górski et al., ApJ 622 (2005), 759-771)."""

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array

__all__ = ["healpix_places"]

# The ring of the lowest corner of each of the twelve base pixels, in nside, and its longitude, in eighths of a turn.
_RINGS = np.array([2, 2, 2, 2, 3, 3, 3, 3, 4, 4, 4, 4])
_TURNS = np.array([1, 3, 5, 7, 0, 2, 4, 6, 1, 3, 5, 7])


def healpix_places(pixels: int, nest: bool) -> tuple[Array, Array]:
    """Longitude and latitude (n,) of the centres, degrees.

    :param pixels: their number, 12 nside², nside a power of two where they are nested.
    :param nest: in the order NESTED, else RING.
    :raises InputError: for another number.
    """
    nside = round((pixels / 12) ** 0.5)
    if pixels == 0 or 12 * nside**2 != pixels or (nest and nside & (nside - 1)):
        power = ", nside a power of two," if nest else ""
        raise InputError(f"HEALPix: 12 nside² pixels{power} expected, such as {12 * max(1, nside) ** 2}, got {pixels}")
    ring, across = _nested(nside) if nest else _rings(nside)
    return _places(nside, ring, across)


def _rings(nside: int) -> tuple[Array, Array]:
    """The ring (n,) of each pixel from north to south, 1 to 4 nside - 1, and its number within it, from 1."""
    rings = np.arange(1, 4 * nside)
    count = 4 * np.minimum(np.minimum(rings, nside), 4 * nside - rings)
    ring = np.repeat(rings, count)
    return ring, np.arange(len(ring)) - np.repeat(np.cumsum(count) - count, count) + 1


def _nested(nside: int) -> tuple[Array, Array]:
    """The same of nested pixels: each base pixel is a square whose bits of x and y alternate in the number."""
    face, inside = np.divmod(np.arange(12 * nside**2), nside**2)
    x, y = np.zeros_like(inside), np.zeros_like(inside)
    for bit in range(int(nside).bit_length()):
        x |= ((inside >> (2 * bit)) & 1) << bit
        y |= ((inside >> (2 * bit + 1)) & 1) << bit
    ring = _RINGS[face] * nside - x - y - 1
    wide = np.minimum(np.minimum(ring, nside), 4 * nside - ring)
    across = (_TURNS[face] * wide + x - y + 1 + _shift(nside, ring)) // 2
    return ring, np.where(across < 1, across + 4 * nside, np.where(across > 4 * wide, across - 4 * wide, across))


def _shift(nside: int, ring: Array) -> Array:
    """1 for each second ring around the equator, which is turned by half a pixel."""
    return np.where((ring >= nside) & (ring <= 3 * nside), (ring - nside) % 2, 0)


def _places(nside: int, ring: Array, across: Array) -> tuple[Array, Array]:
    """Longitude and latitude of the pixels of rings, degrees: (2) to (9) of the paper."""
    wide = np.minimum(np.minimum(ring, nside), 4 * nside - ring)
    cap = 1.0 - wide**2 / (3.0 * nside**2)
    z = np.where(ring < nside, cap, np.where(ring > 3 * nside, -cap, 4.0 / 3.0 - 2.0 * ring / (3.0 * nside)))
    turns = (across - 0.5 * (1 + _shift(nside, ring))) / (4.0 * wide)
    return 360.0 * (turns % 1.0), np.degrees(np.arcsin(z))
