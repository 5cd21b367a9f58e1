"""The risk of configurations over time, estimated from the noisy data only."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from meshflow.flow.family import Variant

__all__ = ["FINER", "PROBE", "TWICE", "Candidate", "Configuration", "as_good", "ranked"]

# The perturbation of the twin, as a share of the noise: its difference is a derivative, up to the rounding of single precision.
PROBE = 0.1
# Weights of twicing that are tried; they need no further run.
TWICE = (0.0, 0.5, 1.0)
# Contrasts tried beside the best one.
FINER = 1.35


@dataclass(frozen=True)
class Configuration:
    """A variant with its contrast.

    :ivar contrast: alpha, length per unit of the value.
    :ivar twice: w of u(t) + w (u(t) - u(2 t)), twicing in time (Tukey 1977): what the flow would remove next is added
        back. For the heat equation with w = 1 the response is 1 - (1 - exp(-k^2 t))^2, which is flat at low frequencies.
    :ivar boundary: of the grid, if it differs from that of the data.
    """

    variant: Variant
    contrast: float
    twice: float = 0.0
    boundary: str = ""

    @property
    def words(self) -> dict[str, Any]:
        """The options by name, in reading order."""
        m = self.variant
        if m.linear:
            return {"method": "heat", "twicing": self.twice, **({"boundary": self.boundary} if self.boundary else {})}
        named = {"gamma": m.gamma, "sharpness": m.sharpness, "patch": m.patch, "contrast": self.contrast}
        return {**named, "twicing": self.twice, **({"boundary": self.boundary} if self.boundary else {})}


@dataclass(frozen=True)
class Candidate:
    """A configuration with its estimated risk over time.

    :ivar configuration: a :class:`Configuration`, or another object with ``words``.
    :ivar times: at which the risk was estimated, squared length; the first is zero.
    :ivar squares: mean square error, squared unit of the values; at time zero sigma^2. An error of sigma shifts all
        of them equally: they may be negative, and can still be compared.
    :ivar doubt: standard error of the difference of its least mean square error and that of the chosen one; 0 for the chosen one,
        and if unknown.
    """

    configuration: Any
    times: tuple[float, ...]
    squares: tuple[float, ...]
    doubt: float = 0.0

    @property
    def risks(self) -> tuple[float, ...]:
        """Root mean square errors, unit of the values."""
        return tuple(float(np.sqrt(max(square, 0.0))) for square in self.squares)

    @property
    def least(self) -> tuple[float, float]:
        """The time and the mean square error at the minimum over ``times``."""
        i = int(np.argmin(self.squares))
        return self.times[i], self.squares[i]

    @property
    def risk(self) -> float:
        """The least root mean square error."""
        return float(np.sqrt(max(self.least[1], 0.0)))


def ranked(candidates: Iterable[Candidate]) -> tuple[Candidate, ...]:
    """Candidates sorted by their least risk."""
    return tuple(sorted(candidates, key=lambda candidate: candidate.least[1]))


def as_good(candidate: Candidate, chosen: Candidate) -> bool:
    """Whether a candidate differs from the chosen one by no more than the standard error."""
    return candidate is not chosen and abs(candidate.least[1] - chosen.least[1]) <= candidate.doubt
