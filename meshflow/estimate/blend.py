"""A weighted mean of several runs, with the nonnegative weights of least estimated risk."""

from itertools import combinations

import numpy as np

from meshflow.geometry.validation import Array

__all__ = ["blended"]


def blended(changes: Array, left: Array) -> tuple[Array, float]:
    """The weights w that minimize w . changes w + 2 w . left, with w >= 0 and sum 1, and that minimum.

    With d_i = u_i - u0 the risk of sum w_i u_i is mean (sum w_i d_i)^2 + 2 sum w_i left_i - sigma^2. It is quadratic in w,
    because the divergence is linear. There are few runs, so every subset of them is tried.

    :param changes: (m, m), mean d_i d_j.
    :param left: (m,), sigma^2 times the share of the noise that remains after each run.
    """
    count, best, least = len(left), np.zeros(len(left)), np.inf
    for size in range(1, count + 1):
        for some in combinations(range(count), size):
            weights = np.zeros(count)
            weights[list(some)] = _even(changes[np.ix_(some, some)], left[list(some)])
            value = float(weights @ changes @ weights + 2.0 * weights @ left)
            if (weights >= 0).all() and value < least:
                best, least = weights, value
    return best, least


def _even(changes: Array, left: Array) -> Array:
    """The weights of sum 1 and of any sign that minimize the same form."""
    m = len(left)
    system = np.zeros((m + 1, m + 1))
    system[:m, :m], system[:m, m], system[m, :m] = changes, 1.0, 1.0
    found = np.linalg.lstsq(system, np.append(-left, 1.0), rcond=None)[0]
    return found[:m]
