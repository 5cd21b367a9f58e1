"""Which variant of the family, and for how long: the risk estimated from the noisy data alone."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from meshflow.flow.family import Variant

__all__ = ["FINER", "PROBE", "TWICE", "Candidate", "Configuration", "as_good", "ranked"]

# The twin starts beside the flow by this share of the noise: a derivative, to the rounding of single precision.
PROBE = 0.1
# Weights of twicing that are looked at: they cost no further run.
TWICE = (0.0, 0.5, 1.0)
# Contrasts tried beside the best one.
FINER = 1.35


@dataclass(frozen=True)
class Configuration:
    """A variant and the contrast it is taken with.

    :ivar contrast: alpha, length per unit of the value.
    :ivar twice: w of u(t) + w (u(t) - u(2 t)), twicing in time (Tukey 1977): what the flow would still take away is given
        back. Of the heat equation with w = 1 the response is 1 - (1 - exp(-k^2 t))^2, flat where the data is.
    :ivar boundary: of the grid it was tried on, where that is another than the data's own.
    """

    variant: Variant
    contrast: float
    twice: float = 0.0
    boundary: str = ""

    @property
    def words(self) -> dict[str, Any]:
        """Names to numbers and words, in reading order."""
        m = self.variant
        named = {"gamma": m.gamma, "sharpness": m.sharpness, "patch": m.patch, "contrast": self.contrast}
        return {**named, "twicing": self.twice, **({"boundary": self.boundary} if self.boundary else {})}


@dataclass(frozen=True)
class Candidate:
    """What a configuration is expected to leave.

    :ivar configuration: a :class:`Configuration`, or another thing with ``words``.
    :ivar times: at which the risk was estimated, squared length; the first is zero.
    :ivar squares: mean square error, squared unit of the values; at time zero sigma^2. What sigma is wrong by shifts all of
        them alike: they may be negative, and are compared all the same.
    :ivar doubt: standard error of its least mean square error less that of the chosen one; 0 of that, and where it is not known.
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
        """Time and mean square error where that is least, of the times looked at."""
        i = int(np.argmin(self.squares))
        return self.times[i], self.squares[i]

    @property
    def risk(self) -> float:
        """The least root mean square error."""
        return float(np.sqrt(max(self.least[1], 0.0)))


def ranked(candidates: Iterable[Candidate]) -> tuple[Candidate, ...]:
    """Candidates by their least risk, the least first."""
    return tuple(sorted(candidates, key=lambda candidate: candidate.least[1]))


def as_good(candidate: Candidate, chosen: Candidate) -> bool:
    """Whether a candidate errs as little as the chosen one, as far as the estimate can tell."""
    return candidate is not chosen and abs(candidate.least[1] - chosen.least[1]) <= candidate.doubt
