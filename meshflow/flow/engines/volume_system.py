"""What an implicit step of a volume solves: weights of edges, and no matrix."""

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from meshflow.flow.engines.grid_system import banded, iterated
from meshflow.geometry.validation import Array
from meshflow.kernels.volume import DIRECTIONS, volume_multiplied

__all__ = ["VolumeSystem"]


@dataclass(frozen=True, eq=False)
class VolumeSystem:
    """(mass + dt stiffness) change = dt mass rate, mass being M / s.

    :ivar inertia: (d, h, w), one where a sample does not move.
    :ivar edges: (e, d, h, w), minus the entries of the stiffness for the neighbours in the first e DIRECTIONS; zero where either
        end does not move.
    :ivar diagonal: (d, h, w), the stiffness of a sample with itself.
    :ivar threads: as :class:`.volume.VolumeFlow`.
    """

    inertia: Array
    edges: Array
    diagonal: Array
    threads: int | None = None

    @classmethod
    def of(cls, edges: Array, inverses: Array, held: Array | None, unit: float, threads: int | None) -> "VolumeSystem":
        """From the weights (e, d, h, w) of all edges, each kept where it begins.

        :param inverses: (d, h, w), s / M, and ``unit`` the length in which M and the weights are counted.
        """
        moves = (inverses > 0) & np.isfinite(inverses)
        if held is not None:
            moves &= held == 0
        diagonal = np.zeros_like(inverses)
        for weights, (x, y, z) in zip(edges, DIRECTIONS[: len(edges)], strict=True):
            near, far = _ends((z, y, x))
            diagonal[near] += weights[near]
            diagonal[far] += weights[near]
            weights[near] *= moves[near] & moves[far]
        inertia = np.divide(unit**2, inverses, out=np.ones_like(inverses), where=moves)
        return cls(inertia.astype(edges.dtype), edges, np.where(moves, diagonal, 0).astype(edges.dtype), threads)

    @property
    def mass(self) -> Array:
        """(n,), one where a sample does not move."""
        return self.inertia.ravel()

    def matrix(self, dt: float) -> Any:
        """mass + dt stiffness, (n, n), in double precision."""
        _, h, w = self.inertia.shape
        ends = [(z * h + y) * w + x for x, y, z in DIRECTIONS[: len(self.edges)]]
        return banded(self.inertia.ravel() + dt * self.diagonal.ravel().astype(np.float64), -dt, self.edges, ends)

    def conjugate_gradients(self, dt: float, right: Array, tolerance: float) -> Array:
        """x (n, k) with (mass + dt stiffness) x = right, preconditioned by the diagonal, all columns at once, in place.

        In single precision no further than rounding allows (2e-6).

        :raises NotConverged: with the residual reached and the iterations.
        """
        _, _, w = self.inertia.shape
        weight = (self.inertia + dt * self.diagonal).astype(self.edges.dtype)
        multiply = partial(self._multiply, weight, dt)
        return iterated(multiply, weight.reshape(-1, w), right, tolerance, self.threads)

    def _multiply(self, weight: Array, dt: float, p: Array, q: Array, dots: Array) -> None:
        shape = (len(p), *weight.shape)
        volume_multiplied(p.reshape(shape), q.reshape(shape), weight, self.edges, dt, dots, self.threads)


def _ends(end: tuple[int, int, int]) -> tuple[Any, Any]:
    """Where edges begin and where they end, for those whose both ends are on the grid."""
    near = tuple(slice(-min(by, 0) or None, -max(by, 0) or None) for by in end)
    far = tuple(slice(max(by, 0) or None, min(by, 0) or None) for by in end)
    return near, far
