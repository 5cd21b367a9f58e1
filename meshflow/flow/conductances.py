"""Conductances g(s) of nonlinear diffusion, du/dt = div(g(s) grad u), s = contrast |grad u|, and their potentials."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array

__all__ = ["CONDUCTANCES", "Conductance", "ConductanceName", "conductance_of", "power_of"]

ConductanceName = Literal["rational", "exponential", "tukey", "hypersurface", "geman-mcclure"]


@dataclass(frozen=True)
class Conductance:
    """A conductance g as a function of s^2, at most 1, and the potential phi with phi'(s) = s g(s), phi(0) = 0.

    :ivar of: g.
    :ivar potential: phi.
    """

    of: Callable[[Array], Array]
    potential: Callable[[Array], Array]


CONDUCTANCES: dict[str, Conductance] = {
    # PM90, the two of the paper, 1 / (1 + s^2) and exp(-s^2), with s = |grad u| / K. The first one is that of the
    # Lorentzian, phi = log(1 + s^2) / 2 (Hebert and Leahy; ABBFC97).
    "rational": Conductance(lambda s2: 1.0 / (1.0 + s2), lambda s2: 0.5 * np.log1p(s2)),
    "exponential": Conductance(lambda s2: np.exp(-s2), lambda s2: -0.5 * np.expm1(-s2)),
    # Tukey's biweight (Black, Sapiro, Marimont, Heeger 1998), scaled to g(0) = 1: (1 - s^2)^2 up to s = 1, then 0.
    "tukey": Conductance(
        lambda s2: np.square(1.0 - np.minimum(s2, 1.0)), lambda s2: (1.0 - (1.0 - np.minimum(s2, 1.0)) ** 3) / 6.0
    ),
    # Minimal surfaces (Charbonnier; ABBFC97): phi = sqrt(1 + s^2) - 1, which at high contrast is total variation.
    "hypersurface": Conductance(lambda s2: 1.0 / np.sqrt(1.0 + s2), lambda s2: s2 / (1.0 + np.sqrt(1.0 + s2))),
    # Geman and McClure (ABBFC97): phi = s^2 / (1 + s^2) / 2.
    "geman-mcclure": Conductance(lambda s2: 1.0 / np.square(1.0 + s2), lambda s2: 0.5 * s2 / (1.0 + s2)),
}


def power_of(sharpness: float) -> Conductance:
    """g = 1 / W^q, W^2 = 1 + s^2, as in the family of this project: q 1, 2 and 4 are hypersurface, rational, Geman-McClure.

    :param sharpness: q, above 0.
    """
    q = sharpness
    if q == 2.0:
        return CONDUCTANCES["rational"]
    return Conductance(
        lambda s2: (1.0 + s2) ** (-q / 2.0), lambda s2: np.expm1((1.0 - q / 2.0) * np.log1p(s2)) / (2.0 - q)
    )


def conductance_of(word: str) -> Conductance:
    """The conductance of a name.

    :raises InputError: for an unknown name.
    """
    if word not in CONDUCTANCES:
        raise InputError(f"conductance: one of {', '.join(CONDUCTANCES)} expected, got {word!r}")
    return CONDUCTANCES[word]
