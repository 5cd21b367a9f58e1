"""Symmetric tensors: components that keep distances, logarithms and exponentials, and the cone of positive definite ones."""

import numpy as np

from meshflow.geometry.validation import Array

__all__ = ["exponential", "held_definite", "least_eigenvalue", "logarithm", "packed", "unpacked"]

# Rounds of bisection: the share of a change is then known to 1e-9.
ROUNDS = 30


def packed(tensors: Array) -> Array:
    """The components (..., 3) or (..., 6) of tensors (..., 2, 2) or (..., 3, 3): xx, yy, √2 xy, or xx, yy, zz, √2 yz, √2 xz, √2
    xy.

    With the weights √2 the distance of two tensors is the Frobenius norm of their difference, in whatever frame they are written
    (the notation of Mandel).
    """
    d = tensors.shape[-1]
    rows, columns = _beside(d)
    diagonal = np.stack([tensors[..., i, i] for i in range(d)], axis=-1)
    halves = 0.5 * (tensors[..., rows, columns] + tensors[..., columns, rows])
    root = tensors.dtype.type(np.sqrt(2.0))
    return np.concatenate([diagonal, root * halves], axis=-1)


def unpacked(components: Array) -> Array:
    """The tensors (..., d, d) of components (..., 3) or (..., 6)."""
    d = 2 if components.shape[-1] == 3 else 3
    rows, columns = _beside(d)
    tensors = np.zeros((*components.shape[:-1], d, d), components.dtype)
    for i in range(d):
        tensors[..., i, i] = components[..., i]
    halves = components[..., d:] / components.dtype.type(np.sqrt(2.0))
    tensors[..., rows, columns] = tensors[..., columns, rows] = halves
    return tensors


def logarithm(tensors: Array) -> Array:
    """The logarithms (..., d, d) of positive definite tensors."""
    return _mapped(tensors, np.log)


def exponential(tensors: Array) -> Array:
    """The exponentials (..., d, d) of symmetric tensors, which are positive definite."""
    return _mapped(tensors, np.exp)


def least_eigenvalue(tensors: Array) -> Array:
    """The smallest eigenvalue (...) of each tensor (..., d, d)."""
    return np.linalg.eigvalsh(tensors.astype(np.float64))[..., 0]


def held_definite(before: Array, after: Array, least: float) -> tuple[Array, int]:
    """Tensors (n, d, d) none of whose eigenvalues is below ``least``, and how many were held for that.

    Where a tensor after smoothing has a smaller eigenvalue, only the largest share of its change is made that has none: the
    smallest eigenvalue is a concave function of a symmetric tensor, so that the shares that will do are all those up to a largest
    one. Where the tensor before has one as well, its eigenvalues are raised instead.

    :param before: (n, d, d); ``after``: likewise; ``least``: above zero.
    """
    out = np.flatnonzero(least_eigenvalue(after) < least)
    if not len(out):
        return after, 0
    start, change = before[out].astype(np.float64), after[out].astype(np.float64) - before[out]
    low, high = np.zeros(len(out)), np.ones(len(out))
    for _ in range(ROUNDS):
        middle = 0.5 * (low + high)
        good = least_eigenvalue(start + middle[:, None, None] * change) >= least
        low, high = np.where(good, middle, low), np.where(good, high, middle)
    found = start + low[:, None, None] * change
    values, axes = np.linalg.eigh(found)
    raised = values[:, 0] < least
    found[raised] = (axes * np.maximum(values, least)[:, None, :] @ np.swapaxes(axes, 1, 2))[raised]
    held = after.copy()
    held[out] = found
    return held, len(out)


def _mapped(tensors: Array, function: np.ufunc) -> Array:
    values, axes = np.linalg.eigh(tensors.astype(np.float64))
    found = (axes * function(values)[..., None, :]) @ np.swapaxes(axes, -1, -2)
    return (0.5 * (found + np.swapaxes(found, -1, -2))).astype(tensors.dtype)


def _beside(d: int) -> tuple[list[int], list[int]]:
    """Rows and columns of the entries beside the diagonal, in order: yz, xz, xy."""
    return ([0], [1]) if d == 2 else ([1, 0, 0], [2, 2, 1])
