"""Constraints that keep a flow near its data: a limit on every sample, and a fidelity term."""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sparse

from meshflow.errors import InputError
from meshflow.flow.blend import RATE, Blend
from meshflow.flow.contract import Flow, System
from meshflow.flow.wrapper import Around
from meshflow.geometry.validation import Array

__all__ = ["Both", "Faithful", "Hold", "Limit", "trust_of"]


class Hold(Protocol):
    """A constraint that is restored after every step."""

    def hold(self, u: Array) -> Array:
        """u, moved in place."""
        ...


@dataclass(frozen=True, eq=False)
class Both:
    """Two constraints, one after the other."""

    first: Hold
    then: Hold

    def hold(self, u: Array) -> Array:
        """u, moved in place; the second constraint holds exactly, the first as far as the second allows."""
        return self.then.hold(self.first.hold(u))


@dataclass(frozen=True, eq=False)
class Limit:
    """No free coordinate leaves u0 +- limit: after every step, u is projected on that box, or on a ball around each vertex.

    :param start: u0 (n, k).
    :param most: a number, or one per coordinate (n, k) or vertex (n, 1); unit of u.
    :param around: the limit is on the displacement of a vertex, independent of the axes, not on each of its coordinates.
    """

    start: Array
    most: Array
    around: bool = False

    @classmethod
    def of(cls, start: Array, limit: Any, shape: tuple[int, ...], around: bool = False) -> "Limit":
        """The limit that a caller gives.

        :param limit: a number, zero or more, or an array that broadcasts to ``shape``; infinite where there is none.
        :param shape: of the caller's data: (h, w), (h, w, k), (n,) or (n, k).
        :param around: limit the displacement of each vertex, where the limit is one number for all its coordinates.
        :raises InputError: for another shape, a negative or missing limit.
        """
        values = _weights(limit, shape, "max_change", finite=False)
        if values.ndim == 0:
            return cls(start, values.astype(start.dtype), around)
        whole = around and values.shape[-1] == 1
        to = (*shape[:-1], 1) if whole else shape
        return cls(start, np.broadcast_to(values, to).reshape(start.shape[0], -1).astype(start.dtype), whole)

    def hold(self, u: Array) -> Array:
        """u, moved into the box or the ball, in place; coordinates inside keep their bits."""
        if self.around:
            change = u - self.start
            length = np.linalg.norm(change, axis=1, keepdims=True)
            most = np.broadcast_to(self.most, length.shape)
            out = (length > most)[:, 0]
            u[out] = self.start[out] + change[out] * (most[out] / length[out])
            return u
        np.minimum(u, self.start + self.most, out=u)
        return np.maximum(u, self.start - self.most, out=u)


def trust_of(given: Any, shape: tuple[int, ...], n: int, contrast: float) -> Array:
    """The factor of a fidelity term, (n, k) or (n, 1), per time, from the weights of a caller.

    The steady state of the flow minimizes area + sum of m w (u - u0)^2 / 2 over the samples (exactly so for gamma = -1; m is the
    base area of a sample). w is the inverse of a squared value, such as 1 / sigma^2. With contrast alpha the term is
    w / alpha^2 (u0 - u).

    :param given: w, a number or an array that broadcasts to ``shape``, zero or more.
    :raises InputError: for NaN, negative or infinite weights, or another shape.
    """
    weights = _weights(given, shape, "data_weights", finite=True) / contrast**2
    if weights.ndim == 0:
        return np.full((1, 1), float(weights))
    return np.broadcast_to(weights, shape).reshape(n, -1)


def _weights(given: Any, shape: tuple[int, ...], name: str, finite: bool) -> Array:
    """Weights, zero or more, that broadcast to a shape; one per sample of an image applies to all its channels."""
    try:
        values = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError) as cause:
        raise InputError(f"{name}: a number or an array of numbers expected, got {type(given).__name__}") from cause
    if np.isnan(values).any() or (values < 0).any() or (finite and np.isinf(values).any()):
        bad = values[~(values >= 0) | (np.isinf(values) if finite else False)].flat[0]
        kind = "finite numbers" if finite else "numbers"
        raise InputError(f"{name}: {kind}, zero or more, expected, got {bad}")
    if len(shape) > 1 and values.ndim > 0 and values.shape == shape[:-1]:
        return values[..., None]
    try:
        np.broadcast_to(values, shape)
    except ValueError as cause:
        raise InputError(f"{name}: a number or an array of shape {shape} expected, got {values.shape}") from cause
    return values


@dataclass(frozen=True, eq=False)
class _FaithfulSystem:
    """A system with the fidelity term in its stiffness."""

    system: System
    trust: Array

    @property
    def mass(self) -> Array:
        """The mass (n,) of the inner system."""
        return self.system.mass

    def matrix(self, dt: float) -> Any:
        """The matrix of the inner system, with the data weights on its diagonal."""
        return self.system.matrix(dt) + sparse.diags(
            dt * self.mass * np.broadcast_to(self.trust[:, 0], self.mass.shape)
        )


class Faithful(Around):
    """A flow with a fidelity term, du/dt = rate(u) + trust (u0 - u): its steady state balances smoothness and data.

    :param flow: an engine.
    :param trust: (n, k), (n, 1) or (1, 1), per time, zero or more; fixed vertices stay.
    :param most: the largest one of the whole, of which the flow moves a part; None: of these.
    """

    def __init__(self, flow: Flow, trust: Array, most: float | None = None) -> None:
        super().__init__(flow)
        self.trust = trust.astype(flow.start().dtype)
        self.most = float(trust.max(initial=0.0)) if most is None else most

    def rate(self, u: Array, diagonal: int = 0, blend: Blend = RATE, out: Array | None = None) -> Array:
        """du/dt (n, k), or what the blend makes of it."""
        to = self.flow.rate(u, diagonal, blend, out)
        pull = self.flow.start() - u
        pull *= self.trust
        pull *= to.dtype.type(blend.dt)
        to += pull
        return to

    def bound(self, u: Array) -> float:
        """The bound of the flow plus the largest trust."""
        return self.flow.bound(u) + self.most

    def system(self, u: Array, diagonal: int = 0) -> System:
        """Mass and stiffness with the fidelity term (with different weights per channel, that of the first channel)."""
        return _FaithfulSystem(self.flow.system(u, diagonal), self.trust)
