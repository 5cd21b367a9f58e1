"""Soft constraints: a factor on the rate of each vertex."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sparse

from meshflow.errors import InputError
from meshflow.flow.blend import RATE, Blend
from meshflow.flow.contract import Flow, System
from meshflow.flow.low_pass import Operator, generator_of
from meshflow.flow.wrapper import Around
from meshflow.geometry.validation import Array

__all__ = ["Scaled", "Slowed", "slowed", "speed_of"]

# The smallest factor in an implicit step; slower vertices stay.
SLOWEST = 1e-6


def speed_of(given: Any, shape: tuple[int, ...]) -> Array:
    """The mobility that a caller gives, as float64.

    :param given: numbers between 0 (stays) and 1 (moves freely), one per sample, or one for all.
    :param shape: of the samples: (h, w) or (n,).
    :raises InputError: for another shape, or a number outside.
    """
    try:
        values = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError) as cause:
        raise InputError(f"mobility: a number or an array of numbers expected, got {type(given).__name__}") from cause
    values = np.full(shape, values) if values.ndim == 0 else values
    if values.shape != shape:
        raise InputError(f"mobility: a number, or one per sample, shape {shape}, expected, got {values.shape}")
    if not ((values >= 0) & (values <= 1)).all():
        bad = values[~((values >= 0) & (values <= 1))].flat[0]
        raise InputError(f"mobility: numbers between 0 (fixed) and 1 (free) expected, got {bad}")
    return values


@dataclass(frozen=True, eq=False)
class _SlowedSystem:
    """A system with larger masses."""

    system: System
    speed: Array

    @property
    def mass(self) -> Array:
        """M / s (n,)."""
        return self.system.mass / self.speed

    def matrix(self, dt: float) -> Any:
        """The matrix with the larger masses."""
        return self.system.matrix(dt) + sparse.diags(self.mass - self.system.mass)


class Scaled(Around):
    """du/dt = s rate(u), s a factor for each vertex."""

    def factor(self, u: Array) -> Array:
        """s (n, 1) at u, of absolute value at most 1."""
        raise NotImplementedError

    def rate(self, u: Array, diagonal: int = 0, blend: Blend = RATE, out: Array | None = None) -> Array:
        """du/dt (n, k), or what the blend makes of it."""
        # The step of the inner flow is scaled, not its rate: a round of the normal filter is not a multiple of a rate.
        change = self.flow.rate(u, diagonal, blend.bare)
        if blend.keep != 0.0:
            change -= u if blend.keep == 1.0 else blend.keep * u
        change *= self.factor(u)
        return blend.of_change(u, change, out)

    def system(self, u: Array, diagonal: int = 0) -> System:
        """Mass / |s| and stiffness; the sign of s is in the rate, so that an implicit step is damped in both cases."""
        factor = np.abs(self.factor(u)[:, 0].astype(np.float64))
        return _SlowedSystem(self.flow.system(u, diagonal), np.maximum(factor, SLOWEST))


class Slowed(Scaled):
    """du/dt = s rate(u), s in [0, 1] for each vertex: soft constraints [DMSB99]; hard ones where s is 0.

    For a low-pass filter s multiplies the time, for the normal filter the displacement of each round.

    :param flow: an engine; where s is 0 its vertices are fixed.
    :param speed: s (n, 1).
    """

    def __init__(self, flow: Flow, speed: Array) -> None:
        super().__init__(flow)
        self.speed = speed.astype(flow.start().dtype)

    def factor(self, u: Array) -> Array:
        """s (n, 1), independent of u."""
        return self.speed

    def generator(self, u: Array, weights: Operator, presmooth: float = 0.0) -> Any:
        """s A (n, n).

        :raises InputError: for a flow without one.
        """
        return sparse.csr_matrix(sparse.diags(self.speed[:, 0]) @ generator_of(self.flow, u, weights, presmooth))


def slowed(flow: Flow, speed: Array | None) -> Flow:
    """A flow with the given mobility.

    :param speed: s (n, 1), 0 to 1; None: all vertices move freely.
    """
    return flow if speed is None else Slowed(flow, speed)
