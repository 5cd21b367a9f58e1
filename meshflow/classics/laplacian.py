"""Laplacian smoothing: every vertex moves towards the mean of its neighbours, x += w (mean - x)."""

from meshflow.classics.inputs import ready
from meshflow.errors import InputError
from meshflow.geometry.laplacians import Border
from meshflow.geometry.validation import Array

__all__ = ["umbrella"]


def umbrella(points: Array, faces: Array, weight: float = 0.5, steps: int = 10, border: Border = "curve") -> Array:
    """Laplacian smoothing, x += weight (mean of the neighbours - x) (Field 1988; the umbrella of [Taubin 95], [DMSB99]).

    It shrinks the mesh; a closed mesh converges to a point.

    Example:

        >>> import numpy as np
        >>> from meshflow.synthetic import sphere
        >>> ball = sphere(3)
        >>> moved = umbrella(ball.points, ball.faces)
        >>> bool(np.linalg.norm(moved, axis=1).max() < 1.0)  # it shrinks
        True

    :param points: (n, d).
    :param faces: (m, 3).
    :param weight: of a step, in (0, 1].
    :param steps: number of steps, 0 or more.
    :param border: as in :func:`hc`.
    :returns: points (n, d).
    :raises InputError: for invalid arrays or parameters.
    """
    x, mean = ready(points, faces, steps, border)
    if not 0 < weight <= 1:
        raise InputError(f"umbrella: a weight above 0, at most 1, expected, got {weight}")
    for _ in range(steps):
        x += weight * (mean @ x - x)
    return x
