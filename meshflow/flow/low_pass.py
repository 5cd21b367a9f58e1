"""A low-pass filter on a mesh: fairing of any order in one step."""

import cmath
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np
import scipy.sparse as sparse
from scipy.fft import dct

from meshflow.errors import InputError, NotConverged
from meshflow.flow.conjugate_gradients import rows_of
from meshflow.flow.contract import Flow
from meshflow.flow.workspace import Workspace
from meshflow.geometry.options import named_fields
from meshflow.geometry.validation import Array, whole
from meshflow.kernels.polynomials import chebyshev_degree

__all__ = ["LowPass", "Operator", "Weights", "filtered", "filtered_by_all", "generator_of"]

Weights = Literal["cotangent", "uniform"]
Operator = Literal["cotangent", "uniform", "scale-dependent"]
# The error of the polynomial, as a share of the deviation of a coordinate from its mean.
CLOSE = 1e-6
# The longest polynomial; where slivers would need a longer one, factorizations are used.
LONGEST = 1024


@runtime_checkable
class Generated(Protocol):
    """A flow whose operator is available as a matrix."""

    def generator(self, u: Array, weights: Operator, presmooth: float = 0.0) -> Any:
        """A (n, n) with du/dt = -A u in the metric of u, eigenvalues zero or positive; rows of fixed vertices are zero.

        :param presmooth: squared length; cotangents are those of u smoothed for that time.
        """
        ...


@named_fields
@dataclass(frozen=True)
class LowPass:
    """f(dt A) u with f(x) = 1 / (1 + x^order), A = M^-1 L: what is smoother than the square root of dt passes.

    Order 1 is the implicit fairing of [DMSB99], order 2 the bi-Laplacian. The higher the order, the less the pass band is damped:
    smooth shapes do not shrink, and lose their noise (as with the pass band of Taubin, Zhang and Golub 1996, but with the
    response of Butterworth, which never overshoots). It is computed by a Chebyshev polynomial that keeps constants to rounding.

    :param order: 1 to 20.
    :param weights: ``cotangent``: M^-1 L, for which planes do not move; ``uniform``: the umbrella, 4 / h^2 times the distance to
        the mean of the neighbours (equal to ``cotangent`` on an equilateral mesh of edge h), which also makes the sampling even:
        points drift on irregular meshes.
    :param presmooth: squared length: the cotangents are those of a copy after a filter of order 2 with uniform weights for this
        time. Those of noisy triangles are not those of the surface.
    :raises InputError: for another order or other weights.
    """

    order: int = 2
    weights: Weights = "cotangent"
    presmooth: float = 0.0
    name = "low-pass"
    rates = 1

    def __post_init__(self) -> None:
        if whole(self.order, "order", 1) > 20:
            raise InputError(f"order: a whole number from 1 to 20 expected, got {self.order}")

    def step(self, flow: Flow, u: Array, dt: float, diagonal: int = 0, workspace: Workspace | None = None) -> Array:
        """The free coordinates (n, k) after a filter of time dt.

        :raises InputError: for a flow without a matrix of its operator: on a grid, a normal filter, or with a fidelity term.
        """
        return filtered(generator_of(flow, u, self.weights, self.presmooth), u, dt, self.order)

    def largest(self, flow: Flow, u: Array) -> float:
        """Infinite: a filter of any length is stable."""
        return np.inf


def generator_of(flow: Flow, u: Array, weights: Operator, presmooth: float = 0.0) -> Any:
    """The operator of a flow at u as a matrix (n, n); with the cotangents of a copy that is smoothed for a time.

    :param presmooth: that time, squared length.
    :raises InputError: for a flow that has none.
    """
    if not isinstance(flow, Generated):
        raise InputError(f"low-pass: the matrix of an operator expected, {type(flow).__name__} has none; take MeshFlow")
    return flow.generator(u, weights, presmooth)


def filtered(generator: Any, u: Array, time: float, order: int) -> Array:
    """f(time A) u (n, k), f(x) = 1 / (1 + x^order): by a polynomial in A, or where that would be too long, by solving systems.

    :param generator: A (n, n), eigenvalues zero or positive, bounded by Gershgorin's theorem.
    :param time: squared length.
    :raises NotConverged: where a factorization fails.
    """
    found = filtered_by_all(generator, u, [(time, order)])[0]
    if found is not None:
        return found
    home = u.mean(axis=0)
    return np.where(_fastest(generator) > 0, home + _solved(generator, u - home, time, order), u)


def filtered_by_all(generator: Any, u: Array, asked: Sequence[tuple[float, int]]) -> list[Array | None]:
    """f(time A) u (n, k) for each time and order; None where a polynomial would be too long.

    The Chebyshev polynomials of A, which take most of the time, are common to all of them.

    :param generator: as for :func:`filtered`.
    :param asked: times, squared length, and orders.
    """
    fastest = _fastest(generator)
    top = float(fastest.max(initial=0.0))
    series = [_terms(time * top, order) if time * top > 0 else np.zeros(0) for time, order in asked]
    changes = _summed(generator, u, [np.zeros(0) if terms is None else terms for terms in series], top)
    # fixed vertices keep their bits
    filters = [np.where(fastest > 0, u + change, u) for change in changes]
    return [None if terms is None else one for terms, one in zip(series, filters, strict=True)]


def _fastest(generator: Any) -> Array:
    """Upper bounds (n, 1) of the eigenvalues, from each row; 0 for fixed vertices."""
    return np.asarray(np.abs(generator).sum(axis=1)).reshape(-1, 1)


def _summed(generator: Any, u: Array, series: Sequence[Array], top: float) -> list[Array]:
    """The sums (n, k) of Chebyshev polynomials of A, applied to u (n, k), with each series of terms.

    :param top: an upper bound of the eigenvalues.
    """
    longest = max(map(len, series), default=0)
    found = np.zeros((len(series), *u.shape))
    if longest == 0:
        return [found[i] for i in range(len(series))]
    terms = np.zeros((len(series), longest + longest % 2))
    for row, own in zip(terms, series, strict=True):
        row[: len(own)] = own
    rows, none = rows_of(generator), np.zeros((0, 2))
    now = np.ascontiguousarray(u - u.mean(axis=0), np.float64)
    before = np.zeros(now.shape)
    scale, twice = 2.0 / top, 1.0
    for count in range(0, longest, 2):  # two degrees, which are summed together
        if count > 0:
            chebyshev_degree(*rows, scale, twice, none, now, before, found[:0])
            now, before = before, now
        pair = np.ascontiguousarray(terms[:, count : count + 2])
        chebyshev_degree(*rows, scale, twice, pair, now, before, found)
        now, before, scale, twice = before, now, 4.0 / top, 2.0
    return [found[i] for i in range(len(series))]


def _terms(reach: float, order: int) -> Array | None:
    """Terms of Chebyshev's series of f(reach (1 + y) / 2) - 1 over y in [-1, 1], zero at y = -1; None for too many."""
    count = 256
    while count <= 4 * LONGEST:
        y = np.cos((np.arange(count) + 0.5) * np.pi / count)
        terms = np.asarray(dct(1.0 / (1.0 + (0.5 * reach * (1.0 + y)) ** order) - 1.0, type=2)) / count
        terms[0] *= 0.5
        left = np.cumsum(np.abs(terms[::-1]))[::-1]
        enough = int(np.argmax(left < CLOSE)) if (left < CLOSE).any() else count
        if enough <= min(count // 2, LONGEST):
            terms = terms[: max(enough, 2)]
            terms[0] -= float((terms * (-1.0) ** np.arange(len(terms))).sum())
            return terms
        count *= 2
    return None


def _solved(generator: Any, u: Array, time: float, order: int) -> Array:
    """The filter by partial fractions, with one factorization for each.

    1 / (1 + x^p) is the sum of -r / p / (x - r) over the p-th roots r of -1; a conjugate pair is twice the real part of one.
    """
    from scipy.sparse.linalg import splu

    n, found = len(u), np.zeros_like(u)
    for k in range((order + 1) // 2):
        root = cmath.exp(1j * cmath.pi * (2 * k + 1) / order)
        single = 2 * k + 1 == order
        shift = -1.0 if single else root
        matrix = sparse.csc_matrix(time * generator - shift * sparse.identity(n))
        try:
            factor = splu(matrix, permc_spec="MMD_AT_PLUS_A")
        except RuntimeError as cause:  # SuperLU raises it for a singular matrix
            raise NotConverged(f"low-pass: {cause}; mend the mesh, or take weights='uniform'") from cause
        right = u.astype(matrix.dtype)
        part = factor.solve(right)
        part = part + factor.solve(right - matrix @ part)  # one refinement: slivers cost SuperLU digits
        part = np.asarray(part * (-shift / order))
        found += (1.0 if single else 2.0) * np.real(part)
    return found
