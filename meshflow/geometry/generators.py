"""The operator of a linear flow as a matrix: du/dt = -A u, by cotangents or by the umbrella."""

from typing import Any

import numpy as np
import scipy.sparse as sparse

from meshflow.geometry.connectivity import Connectivity
from meshflow.geometry.gates import Array
from meshflow.geometry.operator import fill_stiffness

__all__ = ["border_pull", "cotangent_generator", "umbrella_generator"]


def border_pull(connectivity: Connectivity, cot: Array) -> Any:
    """C (n, n): C @ X is what the area gradient holds at the boundary for want of a triangle beyond; to be added to L @ X.

    Half the outward conormal of each boundary edge times its length, at both its ends (DESIGN.md, section 2, ``linear``).
    """
    n, corner = connectivity.size, connectivity.border % 3
    triangle = connectivity.border // 3
    k, i, j = (connectivity.faces[triangle, (corner + turn) % 3] for turn in range(3))
    at_i, at_j = (0.5 * cot[triangle, (corner + turn) % 3] for turn in (1, 2))
    entries = np.concatenate([at_i + at_j, -at_i, -at_j])
    columns = np.concatenate([k, j, i])
    pulls = [sparse.coo_matrix((entries, (np.tile(end, 3), columns)), shape=(n, n)) for end in (i, j)]
    return sparse.csr_matrix(pulls[0] + pulls[1])


def cotangent_generator(connectivity: Connectivity, cot: Array, inertia: Array, moves: Array, linear: bool) -> Any:
    """M^-1 L, at the border corrected where ``linear``; zero in the rows of what does not move.

    :param inertia: M / s (n,).
    :param moves: (n,).
    """
    matrix = fill_stiffness(connectivity, cot)
    if linear and len(connectivity.border):
        matrix = matrix + border_pull(connectivity, cot)
    scale = np.divide(1.0, inertia, out=np.zeros_like(inertia), where=moves & (inertia > 0))
    return sparse.csr_matrix(sparse.diags(scale) @ matrix)


def umbrella_generator(connectivity: Connectivity, step: float, moves: Array, curve: bool) -> Any:
    """4 / h^2 (x_i - mean of the neighbours), as M^-1 L on an equilateral mesh of edges h; zero where nothing moves.

    :param step: h.
    :param curve: the border moves as a curve, 2 / h^2 (x_i - mean of its two neighbours there), else with all its neighbours.
    """
    faces, n = connectivity.faces.astype(np.int64), connectivity.size
    tails, heads = faces[:, [0, 1, 2]].ravel(), faces[:, [1, 2, 0]].ravel()
    real = np.repeat((faces != np.roll(faces, 1, axis=1)).all(axis=1), 3)
    joined = _joined(tails[real], heads[real], n)
    factor = np.full(n, 4.0 / step**2)
    if curve and len(connectivity.border):
        triangle, corner = connectivity.border // 3, connectivity.border % 3
        ends = [faces[triangle, (corner + turn) % 3] for turn in (1, 2)]
        rim, on_rim = _joined(ends[0], ends[1], n), np.zeros(n, bool)
        on_rim[np.concatenate(ends)] = True
        joined = sparse.diags((~on_rim).astype(float)) @ joined + rim
        factor[on_rim] = 2.0 / step**2
    degree = np.asarray(joined.sum(axis=1)).ravel()
    factor[~moves | (degree == 0)] = 0.0
    mean = sparse.diags(np.divide(1.0, degree, out=np.zeros(n), where=degree > 0)) @ joined
    return sparse.csr_matrix(sparse.diags(factor) @ (sparse.identity(n) - mean))


def _joined(tails: Array, heads: Array, n: int) -> Any:
    """Ones (n, n) where two vertices share an edge."""
    rows, columns = np.concatenate([tails, heads]), np.concatenate([heads, tails])
    matrix = sparse.csr_matrix((np.ones(len(rows)), (rows, columns)), shape=(n, n))
    matrix.data[:] = 1.0
    return matrix
