"""Structural similarity of images."""

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import InputError
from meshflow.geometry.validation import Array, positive

__all__ = ["WINDOW", "structural_similarity"]

WINDOW = 7  # samples per side
# The constants of the paper that avoid 0 / 0, as shares of the range of the values.
K1, K2 = 0.01, 0.03


def structural_similarity(found: ArrayLike, truth: ArrayLike, peak: float) -> float:
    """Mean structural similarity of two images; 1 where they are equal.

    Z. Wang, A. Bovik, H. Sheikh, E. Simoncelli, *Image quality assessment: from error visibility to structural similarity*,
    2004, with means over windows of 7 x 7 samples instead of Gaussian ones, and sample variances (divided by n - 1).
    Windows that reach beyond the image are left out. The result is the mean over the channels.

    Example:

        >>> import numpy as np
        >>> structural_similarity(np.eye(9), np.eye(9), 1.0)
        1.0

    :param found: (h, w) or (h, w, k), 7 x 7 samples or more, all finite.
    :param truth: the same shape.
    :param peak: the range of the values.
    :raises InputError: for different shapes, smaller images, values that are not finite, or a peak that is not positive.
    """
    one, other = (_planes(values) for values in (found, truth))
    if one.shape != other.shape:
        raise InputError(f"structural similarity: two images of one shape expected, got {one.shape} and {other.shape}")
    if min(one.shape[:2]) < WINDOW:
        raise InputError(f"structural similarity: {WINDOW} x {WINDOW} samples or more expected, got {one.shape[:2]}")
    if not (np.isfinite(one).all() and np.isfinite(other).all()):
        raise InputError("structural similarity: finite samples expected, some are missing; crop both images")
    peak = positive(peak, "structural similarity: peak")
    return float(np.mean([_of_plane(one[..., k], other[..., k], peak) for k in range(one.shape[2])]))


def _planes(values: ArrayLike) -> Array:
    """(h, w, k), float64."""
    image = np.asarray(values, dtype=np.float64)
    if image.ndim not in (2, 3):
        raise InputError(f"structural similarity: images (h, w) or (h, w, k) expected, got shape {image.shape}")
    return image if image.ndim == 3 else image[..., None]


def _of_plane(one: Array, other: Array, peak: float) -> float:
    from scipy.ndimage import uniform_filter

    def mean(values: Array) -> Array:
        """Means over windows."""
        return np.asarray(uniform_filter(values, WINDOW))

    count = WINDOW * WINDOW
    unbiased = count / (count - 1)
    x, y = mean(one), mean(other)
    xx = unbiased * (mean(one * one) - x * x)
    yy = unbiased * (mean(other * other) - y * y)
    xy = unbiased * (mean(one * other) - x * y)
    c1, c2 = (K1 * peak) ** 2, (K2 * peak) ** 2
    values = ((2 * x * y + c1) * (2 * xy + c2)) / ((x * x + y * y + c1) * (xx + yy + c2))
    edge = (WINDOW - 1) // 2
    return float(values[edge:-edge, edge:-edge].mean())
