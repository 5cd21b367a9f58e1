"""Humphrey's classes: Laplacian smoothing, corrected by the displacements of the neighbours [Vollmer 99]."""

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
    """Humphrey's classes: Laplacian smoothing, then a step back by the mean displacement.

    J. Vollmer, R. Mencl, H. Müller, *Improved Laplacian smoothing of noisy surface meshes*, Eurographics 1999 [Vollmer 99].

    Example:

        >>> from meshflow.synthetic import sphere
        >>> ball = sphere(3)
        >>> hc(ball.noisy("nrm", 0.2), ball.faces).shape == ball.points.shape
        True

    :param points: (n, d).
    :param faces: (m, 3).
    :param alpha: the weight of the original points against the previous ones, in [0, 1].
    :param beta: the weight of the vertex itself against its neighbours, in [0, 1]; above 0.5 the paper proves convergence.
    :param steps: number of steps, 0 or more.
    :param border: what the vertices of a border do: ``fixed``, ``curve`` or ``free``.
    :returns: points (n, d).
    :raises InputError: for invalid arrays or parameters.
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
