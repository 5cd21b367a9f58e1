"""What an implicit step solves on a grid: seven-point weights (nine where both diagonals are there), and no matrix."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sparse

from meshflow.errors import NotConverged
from meshflow.geometry.validation import Array
from meshflow.kernels.grid import grid_descended, grid_multiplied, grid_turned

__all__ = ["GridSystem", "banded", "iterated"]

# Residuals that rounding allows, relative to the right-hand side, by bytes of a number.
REACHED = {4: 2e-6, 8: 1e-13}
# Where the other end of an edge lies, by the rows of ``edges``: to the right, below, and along the two diagonals.
ENDS = ((0, 1), (1, 0), (1, -1), (1, 1))


@dataclass(frozen=True, eq=False)
class GridSystem:
    """(mass + dt stiffness) change = dt mass rate, mass being M |d|^2 / s and stiffness L_ij (d_i . d_j).

    :ivar inertia: (h, w), one where a sample does not move.
    :ivar edges: (4, h, w), minus the entries of the stiffness for the neighbours to the right, below, below on the left and
        below on the right; zero where either end does not move.
    :ivar diagonal: (h, w), the stiffness of a sample with itself.
    :ivar threads: as :class:`.grid.GridFlow`.
    """

    inertia: Array
    edges: Array
    diagonal: Array
    threads: int | None = None

    @classmethod
    def of(
        cls, edges: Array, inverses: Array, held: Array | None, rays: Array | None, unit: float, threads: int | None
    ) -> "GridSystem":
        """From the weights (4, h, w) of all edges, each kept where it begins.

        :param inverses: (h, w), s / M |d|^2, and ``unit`` the length in which M is counted.
        :param rays: (3, h, w), d; None where every sample moves straight up.
        """
        moves = (inverses > 0) & np.isfinite(inverses)
        if held is not None:
            moves &= held == 0
        square = np.ones_like(inverses) if rays is None else np.square(rays).sum(axis=0)
        diagonal = np.zeros_like(inverses)
        for weights, end in zip(edges, ENDS, strict=True):
            near, far = _ends(end, inverses.shape)
            diagonal[near] += weights[near] * square[near]
            diagonal[far] += weights[near] * square[far]
            weights[near] *= (moves[near] & moves[far]) * (
                1 if rays is None else (rays[:, *near] * rays[:, *far]).sum(axis=0)
            )
        inertia = np.divide(unit**2, inverses, out=np.ones_like(inverses), where=moves)
        return cls(inertia.astype(edges.dtype), edges, np.where(moves, diagonal, 0).astype(edges.dtype), threads)

    @property
    def mass(self) -> Array:
        """(n,), one where a sample does not move."""
        return self.inertia.ravel()

    def matrix(self, dt: float) -> Any:
        """mass + dt stiffness, (n, n), in double precision."""
        w = self.inertia.shape[1]
        ends = [down * w + right for down, right in ENDS]
        return banded(self.inertia.ravel() + dt * self.diagonal.ravel().astype(np.float64), -dt, self.edges, ends)

    def conjugate_gradients(self, dt: float, right: Array, tolerance: float) -> Array:
        """x (n, k) with (mass + dt stiffness) x = right, preconditioned by the diagonal, all columns at once, in place.

        In single precision no further than rounding allows (2e-6).

        :raises NotConverged: with the residual reached and the iterations.
        """
        weight = (self.inertia + dt * self.diagonal).astype(self.edges.dtype)
        return iterated(partial(self._multiply, weight, dt), weight, right, tolerance, self.threads)

    def _multiply(self, weight: Array, dt: float, p: Array, q: Array, dots: Array) -> None:
        grid_multiplied(p, q, weight, self.edges, dt, dots, self.threads)


def banded(diagonal: Array, factor: float, edges: Array, ends: Sequence[int]) -> Any:
    """The symmetric matrix (n, n) of weights of edges, in double precision.

    :param diagonal: (n,).
    :param factor: of the weights.
    :param edges: (e, ...), n weights each; ``ends``: how far, in samples, the other end of each edge lies.
    """
    diagonals, offsets = [diagonal], [0]
    for weights, end in zip(edges, ends, strict=True):
        line = factor * weights.ravel()[: diagonal.size - end].astype(np.float64)
        diagonals += [line, line]
        offsets += [end, -end]
    bands: Any = offsets
    return sparse.csr_matrix(sparse.diags(diagonals, bands))


def iterated(
    multiplied: Callable[[Array, Array, Array], None],
    weight: Array,
    right: Array,
    tolerance: float,
    threads: int | None,
) -> Array:
    """x (n, k) with the product of a matrix and x equal to right (n, k): conjugate gradients, preconditioned by the diagonal.

    :param multiplied: of p (k, h, w) and q likewise: writes the product of the matrix and p to q, and p . q of each channel to a
        third array.
    :param weight: (h, w), the diagonal, of the number type that the iterations have.
    :raises NotConverged: with the residual reached and the iterations.
    """
    shape, kind = (right.shape[1], *weight.shape), weight.dtype
    r = np.array(right.T.reshape(shape), dtype=kind, order="C")
    goal = max(tolerance, REACHED[kind.itemsize]) * np.sqrt(np.square(r, dtype=np.float64).sum(axis=(1, 2)))
    x, p, q = r / weight, np.zeros(shape, kind), np.empty(shape, kind)
    curvature, sums, beta = np.empty(len(r)), np.empty((2, len(r))), np.zeros(len(r))
    multiplied(x, q, curvature)
    r -= q
    grid_descended(beta, p, q, x, r, weight, sums, threads)
    limit = 20 * int(np.sqrt(weight.size)) + 200
    for _iteration in range(limit):
        if (np.sqrt(sums[0]) <= goal).all():
            return x.reshape(len(x), -1).T
        rho = sums[1].copy()
        grid_turned(beta, r, weight, p, threads)
        multiplied(p, q, curvature)
        alpha = np.divide(rho, curvature, out=np.zeros_like(rho), where=curvature > 0)
        grid_descended(alpha, p, q, x, r, weight, sums, threads)
        beta = np.divide(sums[1], rho, out=np.zeros_like(rho), where=rho > 0)
    worst = float(np.max(np.sqrt(sums[0]) / np.where(goal > 0, goal, 1.0))) * max(tolerance, REACHED[kind.itemsize])
    raise NotConverged(
        f"solver cg: relative residual {worst:.1e} after {limit} iterations, {tolerance:.1e} was asked for "
        f"({weight.size} samples); try solver='direct', a smaller dt, or a larger tolerance"
    )


def _ends(end: tuple[int, int], shape: tuple[int, int]) -> tuple[Any, Any]:
    """Where edges begin and where they end, for those whose both ends are on the grid."""
    (down, right), (h, w) = end, shape
    columns = slice(max(-right, 0), w - max(right, 0)), slice(max(right, 0), w - max(-right, 0))
    return (slice(0, h - down), columns[0]), (slice(down, h), columns[1])
