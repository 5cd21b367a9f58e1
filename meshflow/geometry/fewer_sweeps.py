"""Many sweeps of a relaxation by fewer stages, each of which costs one sweep (van der Houwen and Sommeijer 1980)."""

from functools import lru_cache
from math import ceil, cosh, sqrt, tanh

__all__ = ["fewer_sweeps", "widest"]

# Stages per root of the number of sweeps. With 1.75 what alternates between neighbours is left to 8 % by 20 sweeps in 8 stages,
# as the normal filter takes them; with 1.5 to 20 %.
STAGES = 1.75
# Rounds of bisection, to all digits.
HALVED = 64


@lru_cache(maxsize=64)
def fewer_sweeps(sweeps: int, least: float = -1.0, stages: float = STAGES) -> tuple[tuple[float, float], ...]:
    """``keep`` and ``pull`` of each stage Y_j = Y_(j-1) + keep (Y_(j-2) - Y_(j-1)) + pull (S Y_(j-1) - Y_(j-1)).

    The stages lead as far as so many sweeps Y := S Y, where S is a mean with positive weights, and are stable like these: errors
    are multiplied by T(w0 + w1 z) / T(w0), z = -sweeps (1 - s) with the eigenvalues s of S, T the polynomial of Chebyshev of the
    degree of the number of stages. What S damps, they damp.

    :param least: a lower bound of the eigenvalues; that of any mean is -1.
    :param stages: per root of the number of sweeps with eigenvalues from -1 on.
    """
    half = 0.5 * (1.0 - least)
    count = ceil(stages * sqrt(half * sweeps))
    if count >= sweeps:
        return ((0.0, 1.0),) * sweeps
    w0 = widest(half * sweeps, count)
    found, before, last = [(0.0, 0.5 * (w0 + 1.0) / (w0 * half))], 1.0, w0
    for _ in range(count - 1):
        before, last, first = last, 2.0 * w0 * last - before, before
        found.append((-first / last, (w0 + 1.0) * before / (last * half)))
    return tuple(found)


def widest(sweeps: float, stages: int) -> float:
    """The largest w0 with which z from -2 ``sweeps`` to 0 is in the range of T(w0 + w1 z), whose slope at 0 is T(w0)."""
    low, high = 1e-9, 20.0  # of acosh(w0)
    for _ in range(HALVED):
        middle = 0.5 * (low + high)
        reaches = stages * tanh(stages * middle) / tanh(0.5 * middle)  # (w0 + 1) T'(w0) / T(w0)
        low, high = (middle, high) if reaches > 2.0 * sweeps else (low, middle)
    return cosh(low)
