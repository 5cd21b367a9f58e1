"""The numbers that the engines of grids and of volumes run on: their type, and planes without missing samples."""

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array

__all__ = ["cleaned", "fits_single"]

# Decimal digits of powers of slopes that fit into double precision, and into single precision.
DOUBLE, SINGLE = 300.0, 36.0
# The least size of values whose powers fit whatever the contrast.
TINY = 1e-60


def fits_single(ends: tuple[float, float], contrast: float, spacing: float, power: float) -> bool:
    """Whether powers of the slopes of values fit into single precision.

    :param ends: the least and the greatest value.
    :param contrast: length per unit of the values; ``spacing``: the least distance of samples, a length.
    :param power: the highest one that is taken.
    :raises InputError: where they do not even fit into double precision, and for values that a noise has made infinite.
    """
    least, greatest = ends
    if not np.isfinite(greatest - least):  # values are finite: what was added to them is not
        raise InputError(
            "noise: with its strength it is too large for numbers of the type of the values; give a smaller noise or strength"
        )
    steep = contrast / spacing
    sizes = np.array([greatest - least, steep * (greatest - least), steep, max(abs(least), abs(greatest))])
    digits = power * float(np.abs(np.log10(sizes[sizes > 0])).max(initial=0.0))
    if digits > DOUBLE:
        if not TINY <= max(greatest - least, abs(least)) <= 1.0 / TINY:
            raise InputError(
                f"values from {least:.3g} to {greatest:.3g}: powers of them do not fit into double precision; scale the data"
            )
        raise InputError(
            f"values from {least:.3g} to {greatest:.3g} with contrast {contrast:.3g} (from noise and strength where not "
            f"given) and spacing {spacing:.3g}: powers of such slopes do not fit into double precision; give another noise, "
            "strength or contrast, or scale the data"
        )
    return digits <= SINGLE


def cleaned(planes: Array, missing: Array, dtype: np.dtype) -> Array:
    """Planes (k, h, w) or (k, d, h, w) in a row, read-only, zero where missing; what came if that is so already.

    :param missing: (h, w) or (d, h, w).
    """
    if missing.any():
        planes = np.where(missing, 0, planes)
    planes = np.ascontiguousarray(planes, dtype=dtype).view()
    planes.flags.writeable = False
    return planes
