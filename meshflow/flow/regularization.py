"""Evening out the sampling of a mesh before a flow: noise along the surface."""

from dataclasses import dataclass

from meshflow.flow.contract import Flow
from meshflow.flow.low_pass import filtered
from meshflow.flow.steppers import Stepper
from meshflow.flow.workspace import Workspace
from meshflow.geometry.connectivity import Connectivity
from meshflow.geometry.laplacians import umbrella_generator
from meshflow.geometry.validation import Array

__all__ = ["Regularized", "Regularizing"]


@dataclass(frozen=True, eq=False)
class Regularizing:
    """A bi-Laplacian filter with uniform weights, along the border too.

    :param connectivity: of the points.
    :param step: mean edge.
    :param mobility: (n,), of each point, from 0 (fixed) to 1.
    :param time: of the filter, squared length.
    """

    connectivity: Connectivity
    step: float
    mobility: Array
    time: float

    def of(self, x: Array) -> Array:
        """The points (n, 3) after it."""
        even = umbrella_generator(self.connectivity, self.step, self.mobility > 0, curve=True)
        new = filtered(even, x, self.time, 2)  # points that are fixed stay, since their rows are zero
        slow = (self.mobility > 0) & (self.mobility < 1)
        new[slow] = x[slow] + self.mobility[slow, None] * (new[slow] - x[slow])
        return new


class Regularized:
    """A stepper whose first step begins with evening out the sampling.

    :param stepper: of the flow.
    """

    def __init__(self, stepper: Stepper, regularizing: Regularizing) -> None:
        self.name, self.stepper, self.regularizing = stepper.name, stepper, regularizing

    @property
    def rates(self) -> int:
        """The rates of the inner stepper."""
        return self.stepper.rates

    def step(self, flow: Flow, u: Array, dt: float, diagonal: int = 0, workspace: Workspace | None = None) -> Array:
        """The points (n, 3) after time dt."""
        begun = self.regularizing.of(u) if diagonal == 0 else u
        return self.stepper.step(flow, begun, dt, diagonal, workspace)

    def largest(self, flow: Flow, u: Array) -> float:
        """The largest stable step of the inner stepper."""
        return self.stepper.largest(flow, u)
