"""Conjugate gradients for all columns at once, in compiled loops: what most implicit steps spend their time in."""

from typing import Any

import numpy as np
import scipy.sparse as sparse

from meshflow.geometry.validation import Array
from meshflow.kernels import conjugate_gradients as kernels

__all__ = ["conjugate_gradients", "packed_matrix", "product", "rows_of"]

Rows = tuple[Array, Array, Array]
# Where near and far entries begin; both rows and the value of near ones; row, column and value of far ones.
Packed = tuple[Array, Array, Array, Array, Array, Array, Array]

# Products of numbers that are worth a call: between calls it can be interrupted.
WORK = 300_000_000


def conjugate_gradients(
    matrix: Any, right: Array, guess: Array | None, tolerance: float, most: int, order: Array | None = None
) -> tuple[Array, int]:
    """x (n, k) with matrix @ x = right (n, k), and how many iterations it took; Jacobi preconditioning (Hestenes and Stiefel).

    Columns have coefficients of their own and share the passes over the matrix.

    :param matrix: (n, n), sparse, symmetric positive definite.
    :param guess: (n, k), where it begins; zero where there is none.
    :param tolerance: norm of the residual over that of ``right``, of the worst column, at which it ends.
    :param most: iterations at which it ends in any case.
    :param order: the rows (n,), near ones near each other: the sooner it is done. None: as they are.
    """
    rows, goal = rows_of(matrix), tolerance**2 * np.einsum("ij,ij->j", right, right)
    left = right if guess is None else right - product(matrix, guess)
    size = np.einsum("ij,ij->j", left, left)
    done, some = 0, 1 + WORK // max(1, len(rows[2]) * right.shape[1])
    packed, diagonal, scale = packed_matrix(rows, order)
    r = np.empty(right.shape)
    kernels.pack_vectors(order, scale, np.ascontiguousarray(left), r, 0)
    x, p, q = np.zeros(right.shape), r.copy(), np.empty(right.shape)
    rho = np.einsum("ij,ij->j", r, r)
    while done < most and not (size <= goal).all():
        done += kernels.conjugate_gradients(*packed, diagonal, goal, x, r, p, q, rho, size, min(some, most - done))
    del packed, r, p, q  # before there is one more array
    found = np.zeros(right.shape) if guess is None else np.array(guess, dtype=np.float64, order="C")
    kernels.pack_vectors(order, scale, x, found, 1)
    return found, done


def product(matrix: Any, x: Array) -> Array:
    """matrix @ x (n, k), by as many threads as there are; the matrix (n, n) sparse."""
    out = np.empty(x.shape)
    kernels.matrix_product(*rows_of(matrix), np.ascontiguousarray(x, np.float64), out)
    return out


def packed_matrix(rows: Rows, order: Array | None) -> tuple[Packed, Array, Array]:
    """A matrix as the kernel of the iterations reads it, its diagonal (n,), and 1 / root of that (n,), in the order of the rows.

    :param rows: where they begin (n + 1,), columns (e,), values (e,).
    :param order: as in :func:`conjugate_gradients`.
    """
    n = len(rows[0]) - 1
    where = None
    if order is not None:
        where = np.empty(n, np.int32)
        where[order] = np.arange(n, dtype=np.int32)
    near, far, diagonal = np.empty(n + 1, np.int32), np.empty(n + 1, np.int32), np.empty(n)
    kernels.pack_rows(*rows, order, where, near, far, diagonal)
    scale = 1.0 / np.sqrt(diagonal)
    a, b = near[-1], far[-1]
    entries = np.empty((a, 2), np.uint16), np.empty(a), np.empty(b, np.uint16), np.empty(b, np.int32), np.empty(b)
    kernels.pack_entries(*rows, order, where, scale, near, far, *entries)
    return (near, far, *entries), diagonal, scale


def rows_of(matrix: Any) -> Rows:
    """Where rows begin, columns, and values, as the kernels read them; copied only where they are of another type."""
    rows = sparse.csr_matrix(matrix)
    first, columns = rows.indptr.astype(np.int32, copy=False), rows.indices.astype(np.int32, copy=False)
    return first, columns, rows.data.astype(np.float64, copy=False)
