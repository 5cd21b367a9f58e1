"""The coefficients of super-time-stepping: Runge-Kutta-Legendre of first and second order (Meyer, Balsara, Aslam 2014).

s stages of one rate each are stable over about s^2 / 2 explicit steps (first order) or s^2 / 4 (second order).
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import ceil, sqrt

import numpy as np

__all__ = ["Schedule", "reach", "schedule", "stages"]


@dataclass(frozen=True)
class Schedule:
    """A step of s stages; dt is the length of the whole step.

    :ivar order: 1 or 2.
    :ivar first: Y_1 = Y_0 + first dt L(Y_0).
    :ivar back: of Y_j = Y_(j-1) + back (Y_(j-2) - Y_(j-1)) + home (Y_0 - Y_(j-1)) + dt (rate L(Y_(j-1)) + begin L(Y_0)),
        j = 2 to s, as ``home``, ``rate`` and ``begin``; home and begin are zero for first order.
    """

    order: int
    first: float
    back: tuple[float, ...]
    home: tuple[float, ...]
    rate: tuple[float, ...]
    begin: tuple[float, ...]

    @cached_property
    def error(self) -> tuple[float, float, float, float]:
        """The weights of Y_s, Y_(s-1), Y_0 and dt L(Y_0) in the error of the step, to its order; zeros for one stage.

        The error is estimated by comparing Y_s with Y_(s-1), which has the same order at an earlier time.

        For y' = L y the stages are polynomials in z = dt L: Y_s = 1 + z (+ z^2 / 2) + c z^m and
        Y_(s-1) = 1 + t z (+ (t z)^2 / 2) + d z^m. A combination of both with Y_0 and dt L(Y_0) that cancels the
        lower powers leaves a multiple of z^m.
        """
        order = self.order
        if len(self.back) + 1 < order + 1:
            return 0.0, 0.0, 0.0, 0.0
        z = np.zeros(5)
        z[1] = 1.0
        start = np.array([1.0, 0.0, 0.0, 0.0, 0.0])
        before, last = start, start + self.first * z
        for n, h, r, g in zip(self.back, self.home, self.rate, self.begin, strict=True):
            shifted = np.concatenate([[0.0], last[:-1]])
            before, last = last, last + n * (before - last) + h * (start - last) + r * shifted + g * z
        t, m = before[1], order + 1
        missing = 1.0 / np.prod(np.arange(1, m + 1)) - last[m]
        scale = float(missing / (last[m] - before[m] / t**order))
        of_rate = 0.0 if order == 1 else -(1.0 - 1.0 / t)
        return scale, -scale / float(t**order), scale * (1.0 / float(t**order) - 1.0), scale * of_rate


def reach(order: int, s: int) -> float:
    """The number of explicit steps that s stages reach."""
    return (s * s + s) / 2 if order == 1 else (s * s + s - 2) / 4


def stages(order: int, steps: float) -> int:
    """The smallest number of stages that reaches a number of explicit steps."""
    exact = (sqrt(1 + 8 * steps) - 1) / 2 if order == 1 else (sqrt(9 + 16 * steps) - 1) / 2
    return max(1 if order == 1 else 2, ceil(exact - 1e-9))


@lru_cache(maxsize=256)
def schedule(order: int, s: int) -> Schedule:
    """The coefficients of a step of s stages; at least one of first order, two of second."""
    if order == 1:
        w = 2.0 / (s * s + s)
        back = tuple((1 - j) / j for j in range(2, s + 1))
        rate = tuple((2 * j - 1) / j * w for j in range(2, s + 1))
        none = (0.0,) * (s - 1)
        first, home, begin = w, none, none
    else:
        b = [1 / 3, 1 / 3] + [(j * j + j - 2) / (2 * j * (j + 1)) for j in range(2, s + 1)]
        w = 4.0 / (s * s + s - 2)
        ahead = [(2 * j - 1) / j * b[j] / b[j - 1] for j in range(2, s + 1)]
        back = tuple((1 - j) / j * b[j] / b[j - 2] for j in range(2, s + 1))
        home = tuple(1 - m - n for m, n in zip(ahead, back, strict=True))
        rate = tuple(m * w for m in ahead)
        begin = tuple(-(1 - b[j - 1]) * m * w for j, m in zip(range(2, s + 1), ahead, strict=True))
        first = b[1] * w
    return Schedule(order, first, back, home, rate, begin)
