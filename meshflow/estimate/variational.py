"""The time of a variational restoration by the discrepancy principle: the residual equals the noise."""

from dataclasses import dataclass

import numpy as np

from meshflow.estimate.plan import Plan
from meshflow.flow.contract import Flow
from meshflow.flow.proximal import Proximal
from meshflow.geometry.validation import Array
from meshflow.surfaces.mesh import Mesh

__all__ = ["time_of_noise"]

# Until the residual is this near to the noise, at most so many restorations, each to this share of its change.
NEAR, MOST, ROUGH = 0.005, 25, 1e-2
# The search goes out by factors of four, at most five.
STRIDE, STRIDES = float(np.log(4.0)), 5


def time_of_noise(plan: Plan, sigma: float) -> float:
    """The time at which the root mean square of u(t) - u(0) is sigma, for a step of :class:`Proximal`; by regula falsi in log t.

    The residual grows with the time, as the weight of the fidelity falls. Where it does not reach sigma, or only beyond 1000
    times the first time, the longest time that was tried is returned.

    :param plan: with the method, its contrast, and a first guess of the time.
    :param sigma: of one channel, unit of the values.
    """
    data, method, first = plan.data, plan.request.heights, plan.time
    if isinstance(data, Mesh):
        flow, stays = method.on_surface(data.lifted(plan.lift), False), data.fixed
    else:
        flow = method.on_grid(data.gridded(plan.lift), plan.request.compute.threads)
        stays = data.fixed | data.missing
    moves = ~stays.ravel()
    restored = _Restored(flow, moves, sigma, flow.start())
    low, high = float(np.log(first)), float(np.log(first)) + STRIDE
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
