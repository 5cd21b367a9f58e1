"""Channels in which noise is the same in all and in none correlated, from differences of neighbours."""

import numpy as np

from meshflow.geometry.validation import Array

__all__ = ["whitening"]

# Rounds in which the differences that are not noise alone are left out, and the share that is kept.
ROUNDS, KEPT = 4, 0.7
# Differences for each entry of the covariance, at least; the least variance along any direction, as a share of the mean.
ENOUGH, FLOOR = 20, 0.02


def whitening(values: Array, missing: Array) -> Array:
    """The symmetric matrix (k, k) with which ``values @ matrix`` have the same noise in every direction, and as much as before.

    The covariance of the noise is that of second differences along the axes, in which smooth values vanish; large ones, by their
    own covariance, are edges. Of few samples, or without differences, it is the identity. In channels that are turned, the matrix
    is turned with them.

    :param values: (..., k), on a grid of any number of axes.
    :param missing: (...), samples that are not used.
    """
    k, found = values.shape[-1], []
    for axis in range(missing.ndim):
        u, there = np.moveaxis(values, axis, 0).astype(np.float64), ~np.moveaxis(missing, axis, 0)
        all_there = there[:-2] & there[1:-1] & there[2:]
        u = np.where(there[..., None], u, 0.0)
        found.append((u[:-2] - 2.0 * u[1:-1] + u[2:])[all_there])
    apart = np.concatenate([np.zeros((0, k)), *found])
    if len(apart) < ENOUGH * k * k or not apart.any():
        return np.eye(k)
    roots, axes = _roots(apart)
    for _ in range(ROUNDS):
        far = np.square(apart @ axes / roots).sum(axis=1)
        roots, axes = _roots(apart[far <= np.quantile(far, KEPT)])
    return (axes * (np.sqrt(np.mean(np.square(roots))) / roots)) @ axes.T


def _roots(apart: Array) -> tuple[Array, Array]:
    """The deviations (k,) of differences (m, k) along their principal axes, the columns of (k, k)."""
    variances, axes = np.linalg.eigh(apart.T @ apart / len(apart))
    return np.sqrt(np.maximum(variances, max(FLOOR * variances.mean(), np.finfo(float).tiny))), axes
