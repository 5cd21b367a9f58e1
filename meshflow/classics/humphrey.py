"""Humphrey's classes: Laplacian smoothing that is pushed back by what the neighbours have moved [Vollmer 99]."""

from meshflow.classics.inputs import ready
from meshflow.errors import InputError
from meshflow.geometry.laplacians import Border
from meshflow.geometry.validation import Array

__all__ = ["hc"]


def hc(
    points: Array,
    faces: Array,
    alpha: float = 0.0,
    beta: float = 0.5,
    steps: int = 10,
    border: Border = "curve",
) -> Array:
    """Humphrey's classes: Laplacian smoothing, then back by what the neighbours, too, have been moved.

    J. Vollmer, R. Mencl, H. Müller, *Improved Laplacian smoothing of noisy surface meshes*, Eurographics 1999 [Vollmer 99].

    :param points: (n, d).
    :param faces: (m, 3).
    :param alpha: how much of the way back is to the first points, and not to the last ones; in [0, 1].
    :param beta: how much of it is the vertex' own, and not its neighbours'; in [0, 1]. (Above 0.5 the paper proves convergence.)
    :param steps: how many, 0 or more.
    :returns: points (n, d).
    :raises InputError: for arrays or parameters other than these.
    """
    x, mean = ready(points, faces, steps, border)
    if not (0 <= alpha <= 1 and 0 <= beta <= 1):
        raise InputError(f"hc: alpha and beta from 0 to 1 expected, got {alpha} and {beta}")
    first = x.copy()
    for _ in range(steps):
        ahead = mean @ x
        back = ahead - (alpha * first + (1.0 - alpha) * x)
        x = ahead - (beta * back + (1.0 - beta) * (mean @ back))
    return x
