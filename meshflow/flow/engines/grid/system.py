"""What an implicit step solves on a grid: seven-point weights (nine where both diagonals are there), and no matrix."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sparse
from numba import njit

from meshflow.errors import NotConverged
from meshflow.flow.engines.grid.bands import bands, worked
from meshflow.flow.engines.grid.compiled import FORMULA, SUM, SWEEP
from meshflow.geometry.validation import Array

__all__ = ["GridSystem"]

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
    :ivar threads: as :class:`.rate.GridFlow`.
    """

    inertia: Array
    edges: Array
    diagonal: Array
    threads: int | None = None

    @classmethod
    def of(
        cls, edges: Array, inverses: Array, held: Array, rays: Array | None, unit: float, threads: int | None
    ) -> "GridSystem":
        """From the weights (4, h, w) of all edges, each kept where it begins, forward diagonals at their cell.

        :param inverses: (h, w), s / M |d|^2, and ``unit`` the length in which M is counted.
        :param rays: (3, h, w), d; None where every sample moves straight up.
        """
        moves = (inverses > 0) & np.isfinite(inverses)
        if held.size:
            moves &= held == 0
        edges[2, :, 1:] = edges[2, :, :-1].copy()  # from the cell to its right upper corner, where the edge begins
        edges[2, :, 0] = 0
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
        h, w = self.inertia.shape
        diagonals: list[Array] = [self.inertia.ravel() + dt * self.diagonal.ravel().astype(np.float64)]
        offsets: Any = [0]
        for weights, (down, right) in zip(self.edges, ENDS, strict=True):
            offset = down * w + right
            line = -dt * weights.ravel()[: h * w - offset].astype(np.float64)
            diagonals += [line, line]
            offsets += [offset, -offset]
        return sparse.csr_matrix(sparse.diags(diagonals, offsets))

    def conjugate_gradients(self, dt: float, right: Array, tolerance: float) -> Array:
        """x (n, k) with (mass + dt stiffness) x = right, preconditioned by the diagonal, all columns at once, in place.

        In single precision no further than rounding allows (2e-6).

        :raises NotConverged: with the residual reached and the iterations.
        """
        shape = (right.shape[1], *self.inertia.shape)
        kind = self.edges.dtype
        weight = (self.inertia + dt * self.diagonal).astype(kind)
        r = np.array(right.T.reshape(shape), dtype=kind, order="C")
        goal = max(tolerance, REACHED[kind.itemsize]) * np.sqrt(np.square(r, dtype=np.float64).sum(axis=(1, 2)))
        x, p, q = r / weight, np.zeros(shape, kind), np.empty(shape, kind)
        self._over(lambda rows: _multiplied(rows, x, q, weight, self.edges, kind.type(dt)))
        r -= q
        none, beta = np.zeros(len(r)), np.zeros(len(r))
        squares, rho = self._over(lambda rows: _descended(rows, none, p, q, x, r, weight))
        limit = 20 * int(np.sqrt(self.inertia.size)) + 200
        for _iteration in range(limit):
            if (np.sqrt(squares) <= goal).all():
                return x.reshape(len(x), -1).T
            self._over(lambda rows, beta=beta: _turned(rows, beta, r, weight, p))
            (curvature,) = self._over(lambda rows: _multiplied(rows, p, q, weight, self.edges, kind.type(dt)))
            alpha = np.divide(rho, curvature, out=np.zeros_like(rho), where=curvature > 0)
            squares, now = self._over(lambda rows, alpha=alpha: _descended(rows, alpha, p, q, x, r, weight))
            beta, rho = np.divide(now, rho, out=np.zeros_like(now), where=rho > 0), now
        worst = float(np.max(np.sqrt(squares) / np.where(goal > 0, goal, 1.0))) * max(tolerance, REACHED[kind.itemsize])
        raise NotConverged(
            f"solver cg: relative residual {worst:.1e} after {limit} iterations, {tolerance:.1e} was asked for "
            f"({self.inertia.size} samples); try solver='direct', a smaller dt, or a larger tolerance"
        )

    def _over(self, work: Any) -> Array:
        """Sums (what, k) of what the bands return, in their order."""
        return np.sum(worked(work, bands(*self.inertia.shape), self.threads), axis=0)


def _ends(end: tuple[int, int], shape: tuple[int, int]) -> tuple[Any, Any]:
    """Where edges begin and where they end, for those whose both ends are on the grid."""
    (down, right), (h, w) = end, shape
    columns = slice(max(-right, 0), w - max(right, 0)), slice(max(right, 0), w - max(-right, 0))
    return (slice(0, h - down), columns[0]), (slice(down, h), columns[1])


@njit(**SUM)
def _dot(a, b):
    """a . b in double precision."""
    total = 0.0
    for j in range(len(a)):
        total += float(a[j]) * float(b[j])
    return total


@njit(**FORMULA)
def _less(factor, weights, other, out):
    for j in range(len(out)):
        out[j] -= factor * weights[j] * other[j]


@njit(**SWEEP)
def _multiplied(rows, p, q, weight, edges, dt):
    """q = (mass + dt stiffness) p, and p . q of each channel, (1, k)."""
    h, w = weight.shape
    dots = np.zeros((1, len(p)))
    for c in range(len(p)):
        for r in range(rows[0], rows[1]):
            here, out = p[c, r], q[c, r]
            for j in range(w):
                out[j] = weight[r, j] * here[j]
            _less(dt, edges[0, r, : w - 1], here[1:], out[: w - 1])
            _less(dt, edges[0, r, : w - 1], here[: w - 1], out[1:])
            if r < h - 1:
                under = p[c, r + 1]
                _less(dt, edges[1, r], under, out)
                _less(dt, edges[2, r, 1:], under[: w - 1], out[1:])
                _less(dt, edges[3, r, : w - 1], under[1:], out[: w - 1])
            if r > 0:
                over = p[c, r - 1]
                _less(dt, edges[1, r - 1], over, out)
                _less(dt, edges[2, r - 1, 1:], over[1:], out[: w - 1])
                _less(dt, edges[3, r - 1, : w - 1], over[: w - 1], out[1:])
            dots[0, c] += _dot(here, out)
    return dots


@njit(**SWEEP)
def _descended(rows, alpha, p, q, x, r, weight):
    """x + alpha p and r - alpha q in their places; r . r and r . (r / weight) of each channel, (2, k)."""
    dots = np.zeros((2, len(p)))
    for c in range(len(p)):
        a = type(weight[0, 0])(alpha[c])
        for i in range(rows[0], rows[1]):
            step, residual, to, along = r[c, i], q[c, i], x[c, i], p[c, i]
            for j in range(len(step)):
                to[j] += a * along[j]
                step[j] -= a * residual[j]
            dots[0, c] += _dot(step, step)
            dots[1, c] += _scaled_dot(step, weight[i])
    return dots


@njit(**SUM)
def _scaled_dot(a, weight):
    """a . (a / weight) in double precision."""
    total = 0.0
    for j in range(len(a)):
        total += float(a[j]) * float(a[j] / weight[j])
    return total


@njit(**SWEEP)
def _turned(rows, beta, r, weight, p):
    """p = r / weight + beta p in its place."""
    for c in range(len(p)):
        b = type(weight[0, 0])(beta[c])
        for i in range(rows[0], rows[1]):
            for j in range(p.shape[2]):
                p[c, i, j] = r[c, i, j] / weight[i, j] + b * p[c, i, j]
    return np.zeros((1, len(p)))
