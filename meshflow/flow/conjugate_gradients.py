"""Conjugate gradients for all columns at once, in compiled loops: what most implicit steps spend their time in."""

from typing import Any

import numpy as np
from numba import njit, prange

from meshflow.geometry.validation import Array

__all__ = ["conjugate_gradients"]

# Rows of a matrix that one thread does at a time. Sums of blocks are added in their order, so that they do not depend on the
# number of threads.
BLOCK = 2048


def conjugate_gradients(
    matrix: Any, right: Array, guess: Array | None, tolerance: float, most: int
) -> tuple[Array, int]:
    """x (n, k) with matrix @ x = right (n, k), and how many iterations it took; Jacobi preconditioning (Hestenes and Stiefel).

    Columns have coefficients of their own and share the passes over the matrix.

    :param matrix: (n, n), CSR, symmetric positive definite.
    :param guess: (n, k), where it begins; ``right`` over the diagonal where there is none.
    :param tolerance: norm of the residual over that of ``right``, of the worst column, at which it ends.
    :param most: iterations at which it ends in any case.
    """
    first, columns, values = matrix.indptr, matrix.indices, matrix.data
    jacobi = 1.0 / matrix.diagonal()
    n, k = right.shape
    x = jacobi[:, None] * right if guess is None else np.array(guess, dtype=np.float64, order="C")
    r = np.empty((n, k))
    product, descend = (_product_of_three, _descend_three) if k == 3 else (_product, _descend)
    sums = np.empty(((n + BLOCK - 1) // BLOCK, 2, k))
    product(first, columns, values, x, r, sums)
    np.subtract(right, r, out=r)
    p, q = jacobi[:, None] * r, np.empty((n, k))
    rho, size = np.einsum("ij,ij->j", r, p), np.einsum("ij,ij->j", r, r)
    goal = tolerance**2 * np.einsum("ij,ij->j", right, right)
    for iteration in range(most):
        if (size <= goal).all():
            return x, iteration
        product(first, columns, values, p, q, sums)
        curvature = sums[:, 0].sum(axis=0)
        alpha = np.divide(rho, curvature, out=np.zeros_like(rho), where=curvature > 0)
        descend(x, r, p, q, jacobi, alpha, sums)
        (new, size), before = sums.sum(axis=0), rho
        rho = new
        _turn(p, r, jacobi, np.divide(rho, before, out=np.zeros_like(rho), where=before > 0))
    return x, most


@njit(cache=True, parallel=True, fastmath={"contract"}, error_model="numpy")
def _product(first, columns, values, p, q, sums):
    """q = A p, and p . q of each block."""
    for block in prange(len(sums)):
        for c in range(p.shape[1]):
            dot = 0.0
            for i in range(block * BLOCK, min(len(p), (block + 1) * BLOCK)):
                total = 0.0
                # Indices that cannot be negative spare a comparison each: half of the time.
                for e in range(np.uint64(first[i]), np.uint64(first[i + 1])):
                    total += values[e] * p[np.uint64(columns[e]), c]
                q[i, c] = total
                dot += total * p[i, c]
            sums[block, 0, c] = dot


@njit(cache=True, parallel=True, fastmath={"contract"}, error_model="numpy")
def _product_of_three(first, columns, values, p, q, sums):
    """As :func:`_product`, for points of R^3: a row of the matrix is read once for all three."""
    for block in prange(len(sums)):
        dot0 = dot1 = dot2 = 0.0
        for i in range(block * BLOCK, min(len(p), (block + 1) * BLOCK)):
            x = y = z = 0.0
            for e in range(np.uint64(first[i]), np.uint64(first[i + 1])):
                j, w = np.uint64(columns[e]), values[e]
                x += w * p[j, 0]
                y += w * p[j, 1]
                z += w * p[j, 2]
            q[i, 0], q[i, 1], q[i, 2] = x, y, z
            dot0 += x * p[i, 0]
            dot1 += y * p[i, 1]
            dot2 += z * p[i, 2]
        sums[block, 0, 0], sums[block, 0, 1], sums[block, 0, 2] = dot0, dot1, dot2


@njit(cache=True, parallel=True, fastmath={"contract"}, error_model="numpy")
def _descend(x, r, p, q, jacobi, alpha, sums):
    """x += alpha p, r -= alpha q; r . D^-1 r and r . r of each block."""
    for block in prange(len(sums)):
        for c in range(p.shape[1]):
            by, rho, size = alpha[c], 0.0, 0.0
            for i in range(block * BLOCK, min(len(p), (block + 1) * BLOCK)):
                x[i, c] += by * p[i, c]
                r[i, c] -= by * q[i, c]
                square = r[i, c] * r[i, c]
                rho += jacobi[i] * square
                size += square
            sums[block, 0, c], sums[block, 1, c] = rho, size


@njit(cache=True, parallel=True, fastmath={"contract"}, error_model="numpy")
def _descend_three(x, r, p, q, jacobi, alpha, sums):
    """As :func:`_descend`, for points of R^3: one pass, not three."""
    a, b, c = alpha[0], alpha[1], alpha[2]
    for block in prange(len(sums)):
        rho0 = rho1 = rho2 = size0 = size1 = size2 = 0.0
        for i in range(block * BLOCK, min(len(p), (block + 1) * BLOCK)):
            x[i, 0] += a * p[i, 0]
            x[i, 1] += b * p[i, 1]
            x[i, 2] += c * p[i, 2]
            r0, r1, r2 = r[i, 0] - a * q[i, 0], r[i, 1] - b * q[i, 1], r[i, 2] - c * q[i, 2]
            r[i, 0], r[i, 1], r[i, 2] = r0, r1, r2
            by = jacobi[i]
            rho0, rho1, rho2 = rho0 + by * r0 * r0, rho1 + by * r1 * r1, rho2 + by * r2 * r2
            size0, size1, size2 = size0 + r0 * r0, size1 + r1 * r1, size2 + r2 * r2
        sums[block, 0, 0], sums[block, 0, 1], sums[block, 0, 2] = rho0, rho1, rho2
        sums[block, 1, 0], sums[block, 1, 1], sums[block, 1, 2] = size0, size1, size2


@njit(cache=True, parallel=True, fastmath={"contract"}, error_model="numpy")
def _turn(p, r, jacobi, beta):
    """p = D^-1 r + beta p."""
    for i in prange(len(p)):
        for c in range(p.shape[1]):
            p[i, c] = jacobi[i] * r[i, c] + beta[c] * p[i, c]
