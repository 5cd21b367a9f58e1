"""The scale-dependent umbrella in implicit steps, (I - dt L) x+ = x: with weights 1 / distance [DMSB99]."""

from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import bicgstab

from meshflow.classics.inputs import ready
from meshflow.errors import InputError, NotConverged
from meshflow.geometry.laplacians import Border, scale_dependent_generator
from meshflow.geometry.validation import Array

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

__all__ = ["scale_dependent"]


def scale_dependent(points: Array, faces: Array, time: float = 1.0, steps: int = 1, border: Border = "curve") -> Array:
    """The scale-dependent umbrella, implicit: (I - dt L) x+ = x, L x = 2 / E sum (x_j - x_i) / |e_ij|, E = sum |e_ij|.

    M. Desbrun, M. Meyer, P. Schröder, A. Barr, *Implicit fairing of irregular meshes using diffusion and curvature flow*,
    SIGGRAPH 1999 [DMSB99], section 4.2. Lengths are those at the start of each step; the system is solved by biconjugate
    gradients. On equilateral triangles L is half the Laplacian, since the sum over six neighbours at distance h is 3 h^2 / 2 of
    it and E is 6 h.

    Example:

        >>> from meshflow.synthetic import sphere
        >>> ball = sphere(3)
        >>> scale_dependent(ball.noisy("nrm", 0.2), ball.faces).shape == ball.points.shape
        True

    :param points: (n, d).
    :param faces: (m, 3).
    :param time: of all steps together, in squared mean edges, positive.
    :param steps: number of steps, 0 or more.
    :param border: as in :func:`hc`.
    :returns: points (n, d).
    :raises InputError: for invalid arrays or parameters, or an edge of length zero.
    :raises NotConverged: when the solver does not reach a residual of 1e-8.
    """
    x, mean = ready(points, faces, steps, border)
    if not 0 < time < np.inf:
        raise InputError(f"scale_dependent: a time above 0 expected, got {time}")
    moves, dt = np.ones(len(x), bool), 0.0
    for turn in range(steps):
        operator = scale_dependent_generator(mean, x, moves)
        if turn == 0:
            rows, columns = mean.nonzero()
            length = np.linalg.norm(x[rows] - x[columns], axis=1)[rows != columns]
            dt = time / steps * float(length.mean()) ** 2
        x = _solved(sparse.csr_matrix(sparse.identity(len(x)) + 0.5 * dt * operator), x)
    return x


def _solved(matrix: "csr_matrix", right: Array) -> Array:
    """Solve matrix @ x = right for x (n, d) by biconjugate gradients with Jacobi's preconditioner, starting from right."""
    jacobi = sparse.diags(1.0 / np.asarray(matrix.diagonal(), dtype=np.float64))
    found = np.empty_like(right)
    for column in range(right.shape[1]):
        found[:, column], failed = bicgstab(
            matrix, right[:, column], right[:, column], rtol=1e-8, M=jacobi, maxiter=2000
        )
        if failed:
            raise NotConverged(
                f"scale_dependent: no residual of 1e-8 after 2000 iterations ({len(right)} unknowns); take more steps"
            )
    return found
