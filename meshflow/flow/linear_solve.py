"""Solve a sparse symmetric positive definite system for all channels at once, or fail loudly."""

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock
from typing import Any, Literal

import numpy as np
import scipy.sparse
from scipy.sparse.linalg import splu

from meshflow.errors import InputError, NotConverged
from meshflow.flow.conjugate_gradients import conjugate_gradients, product
from meshflow.geometry.validation import Array

__all__ = ["Method", "choose", "solve"]

Sparse = Any  # a scipy.sparse.csr_matrix; its type stubs do not know its methods
Method = Literal["auto", "direct", "cg", "multigrid"]

# Below SMALL unknowns a factorization costs less than an iteration's overhead; above STIFF (condition of the system scaled by
# its diagonal) conjugate gradients need more work than the setup of a multigrid hierarchy.
SMALL = 3000
STIFF = 10_000.0
# Mass, as a share of the diagonal, that makes a system regular whose own has been lost.
ROUNDING = 1e-13
_DRAWING = Lock()
# The number of rows for the typical condition.
SAMPLE = 20000


def choose(matrix: Sparse) -> Method:
    """The method that suits size and step.

    Rows of the stiffness sum to zero, so a row's sum is its mass, and the typical ratio of diagonal to mass the condition.
    """
    if matrix.shape[0] <= SMALL:
        return "direct"
    some = matrix[:: 1 + matrix.shape[0] // SAMPLE]
    mass, diagonal = np.asarray(some.sum(axis=1)).ravel(), matrix.diagonal()[:: 1 + matrix.shape[0] // SAMPLE]
    ratio = np.divide(diagonal, mass, out=np.ones_like(mass), where=mass > 0)
    return "multigrid" if 2.0 * float(np.median(ratio)) > STIFF else "cg"


def solve(
    matrix: Sparse,
    right: Array,
    guess: Array | None,
    method: Method,
    tolerance: float = 1e-9,
    order: Array | None = None,
) -> Array:
    """x (n, k) with matrix @ x = right (n, k), each column to a relative residual below the tolerance.

    :param matrix: (n, n), symmetric positive definite.
    :param guess: (n, k), where iterations begin; by default ``right`` over the diagonal.
    :param method: ``direct`` (SuperLU), ``cg`` (conjugate gradients, Jacobi), ``multigrid`` (smoothed aggregation, pyamg);
        ``auto``: that of :func:`choose`, and where slivers keep iterations from converging, the direct one.
    :param order: the unknowns (n,), those that a row joins near each other: conjugate gradients are sooner done.
    :raises NotConverged: with the residual reached, the iterations, and what to try.
    """
    if method == "auto":
        first = choose(matrix)
        try:
            return solve(matrix, right, guess, first, tolerance, order)
        except NotConverged:
            if first == "direct":
                raise
            return solve(matrix, right, guess, "direct", tolerance)
    if method != "cg" and method not in _SOLVERS:
        raise InputError(f"solver: auto, cg, {', '.join(_SOLVERS)} expected, got {method!r}")
    if not (np.isfinite(matrix.data).all() and np.isfinite(right).all()):
        raise NotConverged(
            f"solver {method}: the system holds NaN or infinity; a triangle or a rate is out of range, take a smaller dt"
        )
    if method == "cg":
        most = 20 * int(np.sqrt(len(right))) + 200
        x, iterations = conjugate_gradients(matrix, right, guess, tolerance, most, order)
    else:
        x, iterations = _SOLVERS[method](matrix, right, guess, tolerance)
    scale, residual = _norms(right), _norms(right - product(matrix, x))
    with np.errstate(invalid="ignore"):
        good = residual <= max(10.0 * tolerance, 1e-12) * scale
        if not good.all():  # the residual cannot be below the rounding of the product
            good |= residual <= 8.0 * np.finfo(float).eps * np.linalg.norm(abs(matrix) @ np.abs(x), axis=0)
    if not good.all():
        worst = float(np.max(residual / np.where(scale > 0, scale, 1.0)))
        other = "a smaller dt" if method == "direct" else "solver='direct', a smaller dt, or a larger tolerance"
        raise NotConverged(
            f"solver {method}: relative residual {worst:.1e} after {iterations} iterations, {tolerance:.1e} was "
            f"asked for ({matrix.shape[0]} unknowns); try {other}"
        )
    return x


def _norms(columns: Array) -> Array:
    """The norm of each column."""
    return np.sqrt(np.einsum("ij,ij->j", columns, columns))


def _direct(matrix: Sparse, right: Array, guess: Array | None, tolerance: float) -> tuple[Array, int]:
    symmetric = {"SymmetricMode": True, "DiagPivotThresh": 0.0}
    # Scaled to a unit diagonal, so that a nearly vanished triangle does not cost the others digits.
    half = 1.0 / np.sqrt(matrix.diagonal())
    scaled = scipy.sparse.diags(half) @ matrix @ scipy.sparse.diags(half)
    try:
        factor = splu(scaled.tocsc(), permc_spec="MMD_AT_PLUS_A", options=symmetric)
    except RuntimeError:  # SuperLU raises it for a singular matrix
        # Where free triangles have shrunk to segments or points, mass is lost in the rounding of the stiffness. Its value does
        # not matter there, since they shrink to a point at once; the residual shows whether they did.
        mass = ROUNDING * scipy.sparse.identity(len(half))
        try:
            factor = splu((scaled + mass).tocsc(), permc_spec="MMD_AT_PLUS_A", options=symmetric)
        except RuntimeError as cause:
            raise NotConverged(f"solver direct: {cause}; a mass is zero or not finite") from cause
    half = half[:, None]
    x = half * factor.solve(half * right)
    for _ in range(2):  # refinements: slivers cost SuperLU digits
        x = x + half * factor.solve(half * (right - matrix @ x))
    return x, 1


@contextmanager
def _same_numbers() -> Iterator[None]:
    """The same random numbers each time, by which pyamg estimates spectral radii; the caller's state comes back."""
    with _DRAWING:
        state = np.random.get_state()  # noqa: NPY002  (pyamg draws from it)
        np.random.seed(0)  # noqa: NPY002
        try:
            yield
        finally:
            np.random.set_state(state)  # noqa: NPY002


def _multigrid(matrix: Sparse, right: Array, guess: Array | None, tolerance: float) -> tuple[Array, int]:
    """Conjugate gradients preconditioned by smoothed aggregation, for the system scaled to a unit diagonal."""
    import pyamg

    half: Array = 1.0 / np.sqrt(matrix.diagonal())
    scaled = scipy.sparse.diags(half) @ matrix @ scipy.sparse.diags(half)
    with _same_numbers():
        hierarchy = pyamg.smoothed_aggregation_solver(scaled.tocsr(), symmetry="symmetric", max_coarse=200)
    x, most = np.empty_like(right), 0
    for column in range(right.shape[1]):
        residuals: list[float] = []
        solution: Any = hierarchy.solve(
            half * right[:, column],
            x0=half * right[:, column] if guess is None else guess[:, column] / half,
            tol=0.1 * tolerance,
            maxiter=300,
            accel="cg",
            residuals=residuals,
        )
        x[:, column] = half * solution
        most = max(most, len(residuals))
    return x, most


_SOLVERS = {"direct": _direct, "multigrid": _multigrid}
