"""The classics of mesh smoothing with uniform weights, plain and correct, for comparison and for those who ask by name.

They treat a mesh as a graph: every edge counts alike, or by its length, so that vertices drift along the surface and shapes of
uneven triangles change although they are smooth. The flows of meshflow do not; these are here since others are measured by them.

What the neighbours of a border vertex are, by name: ``curve`` (default), its neighbours along the border alone, so that a border
is smoothed as the curve that it is (the hierarchical neighbourhoods of [Taubin 95]); ``free``, all of them; ``fixed``, none: it
stays. Either way the order of the triangles and of their corners has no say.
"""

from typing import Any, get_args

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import bicgstab

from meshflow.errors import InputError, NotConverged
from meshflow.geometry.laplacians import Border, neighbour_means
from meshflow.geometry.validation import Array

__all__ = ["Border", "hc", "mu", "scale_dependent", "taubin", "umbrella"]

Matrix = Any  # a scipy.sparse.csr_matrix; its type stubs do not know its methods


def umbrella(points: Array, faces: Array, weight: float = 0.5, steps: int = 10, border: Border = "curve") -> Array:
    """Laplacian smoothing, x += weight (mean of the neighbours - x) (Field 1988; the umbrella of [Taubin 95], [DMSB99]).

    It shrinks: a closed mesh ends in a point.

    :param points: (n, d).
    :param faces: (m, 3).
    :param weight: of a step, in (0, 1].
    :param steps: how many, 0 or more.
    :returns: points (n, d).
    :raises InputError: for arrays or parameters other than these.
    """
    x, mean = _ready(points, faces, steps, border)
    if not 0 < weight <= 1:
        raise InputError(f"umbrella: a weight above 0, at most 1, expected, got {weight}")
    for _ in range(steps):
        x += weight * (mean @ x - x)
    return x


def taubin(
    points: Array,
    faces: Array,
    weight: float = 0.5,
    passband: float = 0.1,
    steps: int = 10,
    border: Border = "curve",
) -> Array:
    """Smoothing without shrinking, a step of lambda and one of mu < -lambda in turn, 1 / lambda + 1 / mu = passband.

    G. Taubin, *A signal processing approach to fair surface design*, SIGGRAPH 1995 [Taubin 95].

    :param points: (n, d).
    :param faces: (m, 3).
    :param weight: lambda, in (0, 1].
    :param passband: k_PB: frequencies of the umbrella (0 to 2) below it are kept; 0 or more, below 1 / weight.
    :param steps: pairs of them, 0 or more.
    :returns: points (n, d).
    :raises InputError: for arrays or parameters other than these.
    """
    x, mean = _ready(points, faces, steps, border)
    if not (0 < weight <= 1 and 0 <= passband < 1 / weight):
        raise InputError(
            f"taubin: 0 < weight <= 1 and 0 <= passband < 1 / weight expected, got {weight} and {passband}"
        )
    back = mu(weight, passband)
    for _ in range(steps):
        x += weight * (mean @ x - x)
        x += back * (mean @ x - x)
    return x


def mu(weight: float, passband: float) -> float:
    """The weight of Taubin's step back, from 1 / lambda + 1 / mu = passband."""
    return weight / (passband * weight - 1.0)


def hc(
    points: Array,
    faces: Array,
    alpha: float = 0.0,
    beta: float = 0.5,
    steps: int = 10,
    border: Border = "curve",
) -> Array:
    """Humphrey's classes: Laplacian smoothing, then back by what the neighbours, too, have been moved.

    J. Vollmer, R. Mencl, H. Müller, *Improved Laplacian smoothing of noisy surface meshes*, Eurographics 1999 [Vollmer 99].

    :param points: (n, d).
    :param faces: (m, 3).
    :param alpha: how much of the way back is to the first points, and not to the last ones; in [0, 1].
    :param beta: how much of it is the vertex' own, and not its neighbours'; in [0, 1]. (Above 0.5 the paper proves convergence.)
    :param steps: how many, 0 or more.
    :returns: points (n, d).
    :raises InputError: for arrays or parameters other than these.
    """
    x, mean = _ready(points, faces, steps, border)
    if not (0 <= alpha <= 1 and 0 <= beta <= 1):
        raise InputError(f"hc: alpha and beta from 0 to 1 expected, got {alpha} and {beta}")
    first = x.copy()
    for _ in range(steps):
        ahead = mean @ x
        back = ahead - (alpha * first + (1.0 - alpha) * x)
        x = ahead - (beta * back + (1.0 - beta) * (mean @ back))
    return x


def scale_dependent(points: Array, faces: Array, time: float = 1.0, steps: int = 1, border: Border = "curve") -> Array:
    """The scale-dependent umbrella, implicit: (I - dt L) x+ = x, L x = 2 / E sum (x_j - x_i) / |e_ij|, E = sum |e_ij|.

    M. Desbrun, M. Meyer, P. Schröder, A. Barr, *Implicit fairing of irregular meshes using diffusion and curvature flow*,
    SIGGRAPH 1999 [DMSB99], section 4.2: lengths are those at the begin of each step, and it is solved by biconjugate gradients.
    (On even triangles L is half the Laplacian: the sum over six neighbours h away is 3 h^2 / 2 of it, and E is 6 h.)

    :param points: (n, d).
    :param faces: (m, 3).
    :param time: of all steps together, in squared mean edges; above 0.
    :param steps: how many, 0 or more.
    :returns: points (n, d).
    :raises InputError: for arrays or parameters other than these, or an edge without length.
    :raises NotConverged: when the solver does not reach a residual of 1e-8.
    """
    x, mean = _ready(points, faces, steps, border)
    if not 0 < time < np.inf:
        raise InputError(f"scale_dependent: a time above 0 expected, got {time}")
    # The pattern of the mean: who looks at whom; a fixed vertex looks at itself alone, at no distance.
    rows, columns = mean.nonzero()
    away = rows != columns
    rows, columns = rows[away], columns[away]
    for turn in range(steps):
        length = np.linalg.norm(x[rows] - x[columns], axis=1)
        if not length.all():
            raise InputError(f"scale_dependent: edges with length expected, got {int((length == 0).sum())} without")
        if turn == 0:
            dt = time / steps * float(length.mean()) ** 2
        total = np.bincount(rows, weights=length, minlength=len(x))
        pull = 2.0 * dt / (length * total[rows])  # pyright: ignore[reportPossiblyUnboundVariable]
        entries = (np.concatenate([1.0 + np.bincount(rows, weights=pull, minlength=len(x)), -pull]),)
        own = np.arange(len(x))
        where = (np.concatenate([own, rows]), np.concatenate([own, columns]))
        x = _solved(sparse.csr_matrix((*entries, where), shape=(len(x), len(x))), x)
    return x


def _solved(matrix: Matrix, right: Array) -> Array:
    """x (n, d) of matrix @ x = right, from right, by biconjugate gradients with Jacobi's preconditioner."""
    jacobi = sparse.diags(1.0 / matrix.diagonal())
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


def _ready(points: Array, faces: Array, steps: int, border: Border) -> tuple[Array, Matrix]:
    """A copy of the points, float64, and the matrix (n, n) that takes the mean of the neighbours; rows sum to 1."""
    x, faces = np.array(points, dtype=np.float64), np.asarray(faces)
    if x.ndim != 2 or not np.isfinite(x).all():
        raise InputError(f"classics: finite points (n, d) expected, got shape {x.shape}")
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
        raise InputError(f"classics: faces (m, 3) of indices expected, got shape {faces.shape}, dtype {faces.dtype}")
    if faces.size and (faces.min() < 0 or faces.max() >= len(x)):
        raise InputError(f"classics: indices below {len(x)} expected, got {faces.min()} to {faces.max()}")
    if int(steps) != steps or steps < 0:
        raise InputError(f"classics: a whole number of steps, 0 or more, expected, got {steps}")
    if border not in get_args(Border):
        raise InputError(f"border: {', '.join(get_args(Border))} expected, got {border!r}")
    return x, neighbour_means(faces.astype(np.int64), len(x), border)
