"""Soft constraints: each vertex goes as fast as it is let."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sparse

from meshflow.errors import InputError
from meshflow.flow.blend import RATE, Blend
from meshflow.flow.contract import Flow, System
from meshflow.flow.low_pass import Weights, generator_of
from meshflow.flow.wrapper import Around
from meshflow.geometry.validation import Array

__all__ = ["Scaled", "Slowed", "slowed", "speed_of"]

# The least speed that an implicit step knows: a vertex that is slower stays.
SLOWEST = 1e-6


def speed_of(given: Any, shape: tuple[int, ...]) -> Array:
    """The speeds of a caller, float64.

    :param given: numbers between 0 (stays) and 1 (goes as it would), one per sample, or one for all.
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
        raise InputError(f"mobility: numbers between 0 (stays) and 1 (goes as it would) expected, got {bad}")
    return values


@dataclass(frozen=True, eq=False)
class _SlowedSystem:
    """A system whose masses are heavier."""

    system: System
    speed: Array

    @property
    def mass(self) -> Array:
        """M / s (n,)."""
        return self.system.mass / self.speed

    def matrix(self, dt: float) -> Any:
        """With the heavier masses."""
        return self.system.matrix(dt) + sparse.diags(self.mass - self.system.mass)


class Scaled(Around):
    """du/dt = s rate(u), s a factor for each vertex."""

    def factor(self, u: Array) -> Array:
        """s (n, 1) at u, none of a size above 1."""
        raise NotImplementedError

    def rate(self, u: Array, diagonal: int = 0, blend: Blend = RATE, out: Array | None = None) -> Array:
        """du/dt (n, k), or what the blend makes of it."""
        # By the step of the inner flow, not by its rate: a round of facets is no multiple of one.
        change = self.flow.rate(u, diagonal, blend.bare)
        if blend.keep != 0.0:
            change -= u if blend.keep == 1.0 else blend.keep * u
        change *= self.factor(u)
        return blend.of_change(u, change, out)

    def system(self, u: Array, diagonal: int = 0) -> System:
        """Mass / |s| and stiffness; the sign of s is that of the rate, so that an implicit step is damped either way."""
        factor = np.abs(self.factor(u)[:, 0].astype(np.float64))
        return _SlowedSystem(self.flow.system(u, diagonal), np.maximum(factor, SLOWEST))


class Slowed(Scaled):
    """du/dt = s rate(u), s in [0, 1] for each vertex: soft constraints [DMSB99]; hard ones where s is 0.

    Of a filter it is the time that is multiplied, of facets the way of each round.

    :param flow: an engine; where s is 0 its vertices are fixed.
    :param speed: s (n, 1).
    """

    def __init__(self, flow: Flow, speed: Array) -> None:
        super().__init__(flow)
        self.speed = speed.astype(flow.start().dtype)

    def factor(self, u: Array) -> Array:
        """s (n, 1), whatever u."""
        return self.speed

    def generator(self, u: Array, weights: Weights) -> Any:
        """s A (n, n).

        :raises InputError: for a flow without one.
        """
        return sparse.csr_matrix(sparse.diags(self.speed[:, 0]) @ generator_of(self.flow, u, weights))


def slowed(flow: Flow, speed: Array | None) -> Flow:
    """A flow whose vertices go as fast as they are let.

    :param speed: s (n, 1), 0 to 1; None: all go freely.
    """
    return flow if speed is None else Slowed(flow, speed)
