"""Solve a sparse symmetric positive definite system for all channels at once, or fail loudly."""

from typing import Literal

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import splu

from meshflow.errors import InputError, NotConverged
from meshflow.geometry.gates import Array

__all__ = ["Method", "choose", "solve"]

Method = Literal["auto", "direct", "cg", "multigrid"]

# Below SMALL unknowns a factorization costs less than an iteration's overhead; above STIFF (condition of the system scaled by
# its diagonal) conjugate gradients need more work than the setup of a multigrid hierarchy.
SMALL = 3000
STIFF = 400.0


def choose(matrix: sparse.csr_matrix, mass: Array) -> Method:
    """The method that suits size and step: the typical ratio of a diagonal entry to its mass is the condition."""
    if len(mass) <= SMALL:
        return "direct"
    return "multigrid" if 2.0 * float(np.median(matrix.diagonal() / mass)) > STIFF else "cg"


def solve(matrix: sparse.csr_matrix, right: Array, guess: Array, method: Method, tolerance: float = 1e-9) -> Array:
    """x (n, k) with matrix @ x = right (n, k), each column to a relative residual below the tolerance.

    :param matrix: (n, n), symmetric positive definite.
    :param guess: (n, k), where iterations begin.
    :param method: ``direct`` (SuperLU), ``cg`` (conjugate gradients, Jacobi), ``multigrid`` (smoothed aggregation, pyamg).
    :raises NotConverged: with the residual reached, the iterations, and what to try.
    """
    solvers = {"direct": _direct, "cg": _cg, "multigrid": _multigrid}
    if method not in solvers:
        raise InputError(f"solver: one of {', '.join(solvers)} expected, got {method!r}")
    x, iterations = solvers[method](matrix, right, guess, tolerance)
    scale = np.linalg.norm(right, axis=0)
    residual = np.linalg.norm(right - matrix @ x, axis=0)
    with np.errstate(invalid="ignore"):
        good = residual <= max(10.0 * tolerance, 1e-12) * scale
    if not good.all():
        worst = float(np.max(residual / np.where(scale > 0, scale, 1.0)))
        other = "a smaller dt" if method == "direct" else "solver='direct', a smaller dt, or a larger tolerance"
        raise NotConverged(f"solver {method}: relative residual {worst:.1e} after {iterations} iterations, {tolerance:.1e} was "
                           f"asked for ({matrix.shape[0]} unknowns); try {other}")
    return x


def _direct(matrix: sparse.csr_matrix, right: Array, guess: Array, tolerance: float) -> tuple[Array, int]:
    symmetric = {"SymmetricMode": True, "DiagPivotThresh": 0.0}
    try:
        factor = splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", options=symmetric)
    except RuntimeError as cause:  # SuperLU's word for a singular matrix
        raise NotConverged(f"solver direct: {cause}; a mass is zero or not finite") from cause
    x = factor.solve(right)
    return x + factor.solve(right - matrix @ x), 1  # one refinement: slivers cost SuperLU digits


def _cg(matrix: sparse.csr_matrix, right: Array, guess: Array, tolerance: float) -> tuple[Array, int]:
    """Conjugate gradients with Jacobi preconditioning; the columns share the products with the matrix."""
    jacobi = 1.0 / matrix.diagonal()[:, None]
    x, limit = guess.copy(), 20 * int(np.sqrt(len(right))) + 200
    r = right - matrix @ x
    z = jacobi * r
    p = z.copy()
    rho = np.einsum("ij,ij->j", r, z)
    goal = tolerance * np.linalg.norm(right, axis=0)
    for iteration in range(limit):
        if (np.linalg.norm(r, axis=0) <= goal).all():
            return x, iteration
        q = matrix @ p
        curvature = np.einsum("ij,ij->j", p, q)
        alpha = np.divide(rho, curvature, out=np.zeros_like(rho), where=curvature > 0)
        x += alpha * p
        r -= alpha * q
        z = jacobi * r
        rho, before = np.einsum("ij,ij->j", r, z), rho
        p *= np.divide(rho, before, out=np.zeros_like(rho), where=before > 0)
        p += z
    return x, limit


def _multigrid(matrix: sparse.csr_matrix, right: Array, guess: Array, tolerance: float) -> tuple[Array, int]:
    """Conjugate gradients preconditioned by smoothed aggregation, for the system scaled to a unit diagonal."""
    import pyamg

    half = 1.0 / np.sqrt(matrix.diagonal())
    scaled = sparse.diags(half) @ matrix @ sparse.diags(half)
    hierarchy = pyamg.smoothed_aggregation_solver(scaled.tocsr(), symmetry="symmetric", max_coarse=200)
    x, most = np.empty_like(right), 0
    for column in range(right.shape[1]):
        residuals: list[float] = []
        solution = hierarchy.solve(half * right[:, column], x0=guess[:, column] / half, tol=0.1 * tolerance, maxiter=300,
                                   accel="cg", residuals=residuals)
        x[:, column] = half * solution
        most = max(most, len(residuals))
    return x, most
