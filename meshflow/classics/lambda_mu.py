"""Smoothing without shrinking: steps of lambda and of mu, 1 / lambda + 1 / mu = passband [Taubin 95]."""

from meshflow.classics.inputs import ready
from meshflow.errors import InputError
from meshflow.flow.methods.lambda_mu import mu
from meshflow.geometry.laplacians import Border
from meshflow.geometry.validation import Array

__all__ = ["mu", "taubin"]


def taubin(
    points: Array,
    faces: Array,
    weight: float = 0.5,
    passband: float = 0.1,
    steps: int = 10,
    border: Border = "curve",
) -> Array:
    """Smoothing without shrinking: alternating steps of lambda and mu < -lambda, 1 / lambda + 1 / mu = passband.

    G. Taubin, *A signal processing approach to fair surface design*, SIGGRAPH 1995 [Taubin 95].

    Example:

        >>> from meshflow.synthetic import sphere
        >>> ball = sphere(3)
        >>> taubin(ball.noisy("nrm", 0.2), ball.faces).shape == ball.points.shape
        True

    :param points: (n, d).
    :param faces: (m, 3).
    :param weight: lambda, in (0, 1].
    :param passband: k_PB, from 0 to below 1 / weight; frequencies of the umbrella (0 to 2) below it are kept.
    :param steps: number of pairs of steps, 0 or more.
    :param border: as in :func:`hc`.
    :returns: points (n, d).
    :raises InputError: for invalid arrays or parameters.
    """
    x, mean = ready(points, faces, steps, border)
    if not (0 < weight <= 1 and 0 <= passband < 1 / weight):
        raise InputError(
            f"taubin: 0 < weight <= 1 and 0 <= passband < 1 / weight expected, got {weight} and {passband}"
        )
    back = mu(weight, passband)
    for _ in range(steps):
        x += weight * (mean @ x - x)
        x += back * (mean @ x - x)
    return x
