"""The time of a variational restoration: the residual equals the noise (discrepancy principle), or the risk is least."""

from dataclasses import dataclass, replace

import numpy as np

from meshflow.estimate.plan import Decided, Plan
from meshflow.estimate.risk import PROBE
from meshflow.estimate.vertex_numbers import signs_of
from meshflow.flow.contract import Flow
from meshflow.flow.proximal import Proximal
from meshflow.geometry.validation import Array
from meshflow.surfaces.data import on_surface
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh

__all__ = ["at_rest"]

# Until the residual is this near to the noise, at most so many restorations, each to this share of its change.
NEAR, MOST, ROUGH = 0.002, 25, 2e-3
# The search goes out by factors of four, at most five.
STRIDE, STRIDES = float(np.log(4.0)), 5
# The risk is estimated at so many times below that of the noise, this factor apart (log), each to this share of its change.
TIMES, APART, FINE = 12, 0.5 * float(np.log(2.0)), 1e-3


def at_rest(plan: Plan, sigma: float) -> Plan:
    """The plan of a restoration with its time.

    :param plan: with the method, its contrast, and a first guess of the time.
    :param sigma: of one channel, unit of the values.
    """
    time = time_of_noise(plan, sigma)
    if getattr(plan.request.heights, "balance", "noise") == "risk":
        time = _time_of_least_risk(plan, sigma, time)
        return plan.with_({"time": Decided("estimated", "the least estimated risk")}, time=time)
    return plan.with_({"time": Decided("estimated", "the residual equals the noise")}, time=time)


def time_of_noise(plan: Plan, sigma: float) -> float:
    """The time at which the root mean square of u(t) - u(0) is sigma, for a step of :class:`Proximal`; by regula falsi in log t.

    The residual grows with the time, as the weight of the fidelity falls. Where it does not reach sigma, or only beyond 1000
    times the first time, the longest time that was tried is returned.
    """
    flow, moves = _flow(plan)
    restored = _Restored(flow, moves, sigma, flow.start())
    low, high = float(np.log(plan.time)), float(np.log(plan.time)) + STRIDE
    below, above = restored.residual(low), restored.residual(high)
    for _ in range(STRIDES):
        if below > 0:
            low, high, above = low - STRIDE, low, below
            below = restored.residual(low)
        elif above < 0:
            low, high, below = high, high + STRIDE, above
            above = restored.residual(high)
    if not below <= 0 <= above:
        return float(np.exp(high))
    for _ in range(MOST):
        middle = low + (high - low) * float(np.clip(-below / max(above - below, NEAR), 0.1, 0.9))
        at = restored.residual(middle)
        if abs(at) < NEAR:
            return float(np.exp(middle))
        low, below, high, above = (middle, at, high, above) if at < 0 else (low, below, middle, at)
    return float(np.exp(0.5 * (low + high)))


def _time_of_least_risk(plan: Plan, sigma: float, longest: float) -> float:
    """The time of least risk by Stein's estimate, mean |u - f|^2 - sigma^2 + 2 sigma^2 b . (u(f + e b) - u(f)) / (n e).

    b are random signs. The residual equals the noise only after the least risk, so that shorter times are looked at.
    """
    (flow, moves), probe = _flow(plan), _probe(plan)
    twin, _ = _flow(replace(plan, data=_with(plan, PROBE * sigma * probe)))
    signs, states = probe.reshape(len(moves), -1)[moves], [flow.start(), twin.start()]
    risks = []
    times = [longest * float(np.exp(-APART * step)) for step in range(-1, TIMES)]
    for time in times:
        states = [
            Proximal(tolerance=FINE).solved(one, one.start(), time, last)
            for one, last in zip((flow, twin), states, strict=True)
        ]
        change = (states[0] - flow.start())[moves]
        slope = float(np.mean(signs * (states[1] - states[0])[moves])) / (PROBE * sigma)
        risks.append(float(np.mean(np.square(change))) - sigma**2 + 2.0 * sigma**2 * slope)
    return times[int(np.argmin(risks))]


def _flow(plan: Plan) -> tuple[Flow, Array]:
    """The flow of a plan, and which samples (n,) move."""
    data, method = on_surface(plan.data, "a variational method"), plan.request.heights
    if isinstance(data, Mesh):
        return method.on_surface(data.lifted(plan.lift), False), ~data.fixed
    flow = method.on_grid(data.gridded(plan.lift), plan.request.compute.threads)
    return flow, ~(data.fixed | data.missing).ravel()


def _probe(plan: Plan) -> Array:
    """Random signs, one for each value, in the shape of the values."""
    data = plan.data
    if isinstance(data, Mesh):
        channels = np.zeros((len(data.points), 1)) if data.channels is None else data.channels
        return signs_of(data.points, data.faces, channels)
    shape = data.values.shape if isinstance(data, Image) else data.missing.shape
    return np.random.default_rng(0).choice(np.array([-1.0, 1.0]), size=shape)


def _with(plan: Plan, change: Array) -> HeightField | Image | Mesh:
    """The data of a plan with changed values."""
    data = plan.data
    if isinstance(data, Mesh) and data.channels is not None:
        return replace(data, channels=data.channels + change)
    if isinstance(data, Image):
        return replace(data, values=data.values + change)
    if isinstance(data, HeightField):
        return replace(data, z=data.z + change)
    raise TypeError(f"values above a base expected, got {type(data).__name__}")


@dataclass(eq=False)
class _Restored:
    """Restorations at several times, each begun at the last one.

    :ivar last: (n, k), the last one.
    """

    flow: Flow
    moves: Array
    sigma: float
    last: Array

    def residual(self, log_time: float) -> float:
        """The logarithm of the residual over the noise."""
        start = self.flow.start()
        self.last = Proximal(tolerance=ROUGH).solved(self.flow, start, float(np.exp(log_time)), self.last)
        square = float(np.mean(np.square((self.last - start)[self.moves])))
        return 0.5 * float(np.log(max(square, np.finfo(float).tiny))) - float(np.log(self.sigma))
