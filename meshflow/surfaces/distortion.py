"""The lens distortion of OpenCV: from ideal to distorted image coordinates, and back.

With r^2 = x^2 + y^2, radial = (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6),

    x_d = x radial + 2 p1 x y + p2 (r^2 + 2 x^2),    y_d = y radial + p1 (r^2 + 2 y^2) + 2 p2 x y.
"""

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array, number

__all__ = ["coefficients", "distorted", "undistorted"]

COUNTS = (0, 4, 5, 8)
# Newton's method converges quadratically from the distorted place; a ray that needs more steps lies beyond the fold.
CLOSE, MOST = 1e-12, 40


def coefficients(given: object) -> tuple[float, ...]:
    """The numbers k1, k2, p1, p2[, k3[, k4, k5, k6]], checked.

    :raises InputError: for another count than 0, 4, 5 or 8, or numbers that are not finite.
    """
    values = np.asarray(given, dtype=object).ravel()
    if len(values) not in COUNTS:
        raise InputError(
            f"distortion: 0, 4, 5 or 8 numbers k1, k2, p1, p2[, k3[, k4, k5, k6]] expected, got {len(values)}; "
            "undistort the image first if its lens has another model (fisheye, thin prism, tilted)"
        )
    return tuple(number(value, "distortion") for value in values)


def distorted(x: Array, y: Array, lens: tuple[float, ...]) -> tuple[Array, Array]:
    """Where rays (x, y, 1) meet the image plane, in focal lengths."""
    return _mapped(x, y, lens)[:2]


def undistorted(x: Array, y: Array, lens: tuple[float, ...]) -> tuple[Array, Array]:
    """The rays (x', y', 1) that meet the image plane at x, y, in focal lengths: Newton's method, to 1e-12.

    :raises InputError: where there is none: the model folds back inside the image, so the coefficients do not belong to it.
    """
    u, v = np.array(x, dtype=np.float64), np.array(y, dtype=np.float64)
    with np.errstate(all="ignore"):  # divergence is reported below
        for _ in range(MOST):
            a, b, (aa, ab, ba, bb) = _mapped(u, v, lens)
            a, b, turned = x - a, y - b, aa * bb - ab * ba
            if np.hypot(a, b).max() <= CLOSE / 10:
                break
            u, v = u + (bb * a - ab * b) / turned, v + (aa * b - ba * a) / turned
        a, b, (aa, ab, ba, bb) = _mapped(u, v, lens)
        lost = ~((np.hypot(x - a, y - b) <= CLOSE * (1 + np.hypot(x, y))) & (aa * bb - ab * ba > 0))
    if lost.any():
        at = np.argmax(lost)
        raise InputError(
            f"distortion {lens}: no ray is found for {int(lost.sum())} of {lost.size} pixels, the first at "
            f"({x.ravel()[at]:.3g}, {y.ravel()[at]:.3g}) focal lengths from the axis: the model folds back there; "
            "give the coefficients of this image, in the order k1, k2, p1, p2[, k3[, k4, k5, k6]], or crop it"
        )
    return u, v


def _mapped(x: Array, y: Array, lens: tuple[float, ...]) -> tuple[Array, Array, tuple[Array, Array, Array, Array]]:
    """The distorted place and its derivatives (dx_d/dx, dx_d/dy, dy_d/dx, dy_d/dy)."""
    k1, k2, p1, p2, k3, k4, k5, k6 = (*lens, *(0.0,) * (8 - len(lens)))
    r = x * x + y * y
    over, under = 1 + r * (k1 + r * (k2 + r * k3)), 1 + r * (k4 + r * (k5 + r * k6))
    radial = over / under
    # by r^2
    slope = (k1 + r * (2 * k2 + 3 * r * k3) - radial * (k4 + r * (2 * k5 + 3 * r * k6))) / under
    across = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
    return (
        x * radial + 2 * p1 * x * y + p2 * (r + 2 * x * x),
        y * radial + p1 * (r + 2 * y * y) + 2 * p2 * x * y,
        (
            radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x,
            across,
            across,
            radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x,
        ),
    )
