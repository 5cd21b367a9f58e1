"""Conjugate gradients for all columns at once, in compiled loops: what most implicit steps spend their time in."""

from typing import Any

import numpy as np
import scipy.sparse as sparse

from meshflow.geometry.validation import Array
from meshflow.kernels import conjugate_gradients as kernels

__all__ = ["conjugate_gradients", "product"]

# Products of numbers that are worth a call: between calls it can be interrupted.
WORK = 100_000_000


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
    first, columns, values = _rows(matrix)
    jacobi = 1.0 / matrix.diagonal()
    n, k = right.shape
    x = jacobi[:, None] * right if guess is None else np.array(guess, dtype=np.float64, order="C")
    r, q = product(matrix, x), np.empty((n, k))
    np.subtract(right, r, out=r)
    p = np.zeros((n, 4 if k == 3 else k))  # four numbers never lie across two lines of the cache
    p[:, :k] = jacobi[:, None] * r
    rho, size = np.einsum("ij,ij->j", r, p[:, :k]), np.einsum("ij,ij->j", r, r)
    goal = tolerance**2 * np.einsum("ij,ij->j", right, right)
    done, some = 0, 1 + WORK // max(1, len(values) * k)
    while done < most and not (size <= goal).all():
        done += kernels.conjugate_gradients(
            first, columns, values, jacobi, goal, x, r, p, q, rho, size, min(some, most - done)
        )
    return x, done


def product(matrix: Any, x: Array) -> Array:
    """matrix @ x (n, k), by as many threads as there are; the matrix (n, n) sparse."""
    out = np.empty(x.shape)
    kernels.matrix_product(*_rows(matrix), np.ascontiguousarray(x, np.float64), out)
    return out


def _rows(matrix: Any) -> tuple[Array, Array, Array]:
    """Where rows begin, columns, and values, as the kernels read them; copied only where they are of another type."""
    rows = sparse.csr_matrix(matrix)
    return (
        rows.indptr.astype(np.int32, copy=False),
        rows.indices.astype(np.int32, copy=False),
        rows.data.astype(np.float64, copy=False),
    )
