"""Checks of the arrays of all classic methods, and the neighbours of the vertices."""

from typing import TYPE_CHECKING, get_args

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.laplacians import Border, neighbour_means
from meshflow.geometry.validation import Array

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

__all__ = ["ready"]


def ready(points: Array, faces: Array, steps: int, border: Border) -> "tuple[Array, csr_matrix]":
    """A copy of the points, float64, and the matrix (n, n) of the mean of the neighbours, whose rows sum to 1.

    :param points: (n, d).
    :param faces: (m, 3).
    :param steps: a whole number, 0 or more.
    :param border: the neighbours of border vertices.
    :raises InputError: for invalid arrays or parameters.
    """
    x, faces = np.array(points, dtype=np.float64), np.asarray(faces)
    if x.ndim != 2 or not np.isfinite(x).all():
        raise InputError(f"classics: finite points (n, d) expected, got shape {x.shape}")
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
        raise InputError(f"classics: faces (m, 3) of indices expected, got shape {faces.shape}, dtype {faces.dtype}")
    if faces.size and (faces.min() < 0 or faces.max() >= len(x)):
        raise InputError(f"classics: indices below {len(x)} expected, got {faces.min()} to {faces.max()}")
    if int(steps) != steps or steps < 0:
        raise InputError(f"classics: a whole number of steps, 0 or more, expected, got {steps}")
    if border not in get_args(Border):
        raise InputError(f"border: {', '.join(get_args(Border))} expected, got {border!r}")
    return x, neighbour_means(faces.astype(np.int64), len(x), border)
