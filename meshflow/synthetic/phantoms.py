"""Phantoms: volumes like those of medicine whose truth is known. Values lie between 0 (air) and about 1."""

from collections.abc import Sequence

import numpy as np

from meshflow.geometry.validation import Array, whole

__all__ = ["head", "shepp_logan", "thorax"]

# Centre (x, y, z), half axes, angle about z in degrees, and what is added within: the ten ellipsoids of Kak and Slaney (1988,
# table 3.2), with the contrasts of Toft (1996).
_SHEPP_LOGAN = (
    ((0.0, 0.0, 0.0), (0.69, 0.92, 0.9), 0.0, 1.0),
    ((0.0, -0.0184, 0.0), (0.6624, 0.874, 0.88), 0.0, -0.8),
    ((0.22, 0.0, -0.25), (0.41, 0.16, 0.21), 108.0, -0.2),
    ((-0.22, 0.0, -0.25), (0.31, 0.11, 0.22), 72.0, -0.2),
    ((0.0, 0.35, -0.25), (0.21, 0.25, 0.5), 0.0, 0.1),
    ((0.0, 0.1, -0.25), (0.046, 0.046, 0.046), 0.0, 0.1),
    ((-0.08, -0.65, -0.25), (0.046, 0.023, 0.02), 0.0, 0.1),
    ((0.06, -0.65, -0.25), (0.046, 0.023, 0.02), 90.0, 0.1),
    ((0.06, -0.105, 0.625), (0.056, 0.04, 0.1), 90.0, 0.2),
    ((0.0, 0.1, 0.625), (0.056, 0.056, 0.1), 0.0, -0.2),
)
# Samples along each axis over which a sample is averaged, so that edges are as those of an instrument.
_FINER = 2


def shepp_logan(side: int = 64) -> Array:
    """The head of Shepp and Logan in three dimensions: ten ellipsoids of even density.

    Example:

        >>> round(float(shepp_logan(32)[16, 16, 16]), 2)
        0.2

    :param side: of the volume, samples.
    :returns: (side, side, side), float64.
    """
    z, y, x = _places(side)
    values = np.zeros((len(z),) * 3)
    for centre, axes, angle, more in _SHEPP_LOGAN:
        values[_ellipsoid(x, y, z, centre, axes, np.radians(angle))] += more
    return _averaged(values)


def head(side: int = 64) -> Array:
    """A head as T1-weighted magnetic resonance shows it: scalp, skull, fluid, folded grey matter around white matter, ventricles,
    and a field of sensitivity that varies by a tenth.

    Example:

        >>> round(float(head(32).max()), 1)
        0.9

    :param side: of the volume, samples.
    :returns: (side, side, side), float64.
    """
    z, y, x = _places(side)
    r = np.sqrt((x / 0.78) ** 2 + (y / 0.92) ** 2 + (z / 0.85) ** 2)
    folds = np.sin(9.0 * x + 2.0 * np.sin(7.0 * z)) * np.sin(8.0 * y + 1.0) + np.sin(11.0 * z + 3.0 * x * y)
    cortex = 0.78 + 0.035 * folds
    white = 0.66 + 0.06 * folds
    values = np.zeros(r.shape)
    for inside, value in ((r < 1.0, 0.85), (r < 0.94, 0.08), (r < 0.88, 0.22), (r < cortex, 0.55), (r < white, 0.8)):
        values[inside] = value
    for side_of in (-1.0, 1.0):
        values[_ellipsoid(x, y, z, (0.14 * side_of, 0.0, 0.05), (0.07, 0.34, 0.16), 0.2 * side_of)] = 0.2
        values[_ellipsoid(x, y, z, (0.3 * side_of, 0.02, -0.05), (0.1, 0.2, 0.16), 0.4 * side_of)] = 0.62
    values *= 1.0 + 0.1 * np.cos(1.3 * x + 0.4) * np.cos(1.1 * y - 0.3) * np.cos(0.9 * z)
    return _averaged(values)


def thorax(side: int = 64) -> Array:
    """A chest as computed tomography shows it: soft tissue, lungs with vessels, ribs and a spine with a shell of dense bone.

    Example:

        >>> thorax(32).shape
        (32, 32, 32)

    :param side: of the volume, samples.
    :returns: (side, side, side), float64.
    """
    z, y, x = _places(side)
    values = np.zeros((len(z),) * 3)
    body = (x / 0.95) ** 2 + (y / 0.7) ** 2 + 0.0 * z
    values[body < 1.0], values[body < 0.85] = 0.38, 0.5
    lungs = np.zeros(values.shape, bool)
    for at in (-0.42, 0.42):
        lungs |= _ellipsoid(x, y, z, (at, 0.02, 0.0), (0.33, 0.45, 1.1), 0.0)
    heart = _ellipsoid(x, y, z, (0.12, -0.18, -0.2), (0.3, 0.26, 0.4), 0.3)
    values[lungs] = 0.1
    values[lungs & (_vessels(x, y, z) < 1.0)] = 0.48
    values[heart] = 0.56
    ribs = (np.abs(np.sqrt(body) - 0.9) < 0.035) & (np.abs((3.2 * z + 1.2 * y) % 1.0 - 0.5) < 0.18)
    values[ribs] = 0.85
    spine = np.hypot(x, y - 0.42) + 0.02 * np.cos(14.0 * z)
    values[spine < 0.14], values[spine < 0.105], values[spine < 0.05] = 0.95, 0.7, 0.45
    return _averaged(values)


def _vessels(x: Array, y: Array, z: Array) -> Array:
    """The distance to the nearest of some winding vessels, in their radius."""
    nearest = np.full(np.broadcast_shapes(x.shape, y.shape, z.shape), np.inf)
    for i in range(9):
        turn = 2.4 * i
        at_x = 0.42 * (-1.0) ** i + 0.2 * np.sin(3.0 * z + turn)
        at_y = 0.24 * np.cos(2.0 * z + 1.7 * turn)
        nearest = np.minimum(nearest, np.hypot(x - at_x, y - at_y) / (0.02 + 0.006 * (i % 4)))
    return nearest


def _places(side: int) -> tuple[Array, Array, Array]:
    """z (n, 1, 1), y (1, n, 1) and x (1, 1, n) between -1 and 1, of n = 2 side samples."""
    n = _FINER * whole(side, "side", 2)
    along = (np.arange(n) + 0.5) / n * 2.0 - 1.0
    return along[:, None, None], along[None, :, None], along[None, None, :]


def _ellipsoid(x: Array, y: Array, z: Array, centre: Sequence[float], axes: Sequence[float], angle: float) -> Array:
    """The mask (n, n, n) of an ellipsoid that is turned about the z axis."""
    u, v, w = x - centre[0], y - centre[1], z - centre[2]
    along, across = np.cos(angle) * u + np.sin(angle) * v, np.cos(angle) * v - np.sin(angle) * u
    return (along / axes[0]) ** 2 + (across / axes[1]) ** 2 + (w / axes[2]) ** 2 < 1.0


def _averaged(values: Array) -> Array:
    """The means of blocks of 2 x 2 x 2 samples."""
    n = len(values) // _FINER
    return values.reshape(n, _FINER, n, _FINER, n, _FINER).mean(axis=(1, 3, 5))
