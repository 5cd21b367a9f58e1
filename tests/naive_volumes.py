"""The flow of volumes, written literally and slowly on explicit tetrahedra: the truth that its engine is compared with."""

import itertools

import numpy as np
from naive import angle_cotangent


def tetrahedron_volume(corners):
    """The volume of a tetrahedron (4, d) in R^d: the root of the Gram determinant of its legs, over six."""
    legs = corners[1:] - corners[0]
    return np.sqrt(np.linalg.det(legs @ legs.T)) / 6


def tetrahedron_weights(corners):
    """Weights (4, 4) of a tetrahedron (4, d) in R^d: length of the opposite edge times cotangent of the angle at it, over six."""
    weights = np.zeros((4, 4))
    for i, j in itertools.permutations(range(4), 2):
        k, m = {0, 1, 2, 3} - {i, j}
        edge = corners[m] - corners[k]
        length = np.sqrt(edge @ edge)
        across = [p - (p @ edge) / length**2 * edge for p in (corners[i] - corners[k], corners[j] - corners[k])]
        weights[i, j] = length * angle_cotangent(*across) / 6
    return weights


def volume_gradient(points, tetrahedra):
    """The gradient of the volume of tetrahedra in R^d: the sum of w_ij (X_i - X_j)."""
    gradient = np.zeros_like(points)
    for corners in tetrahedra:
        weights = tetrahedron_weights(points[corners])
        for i, j in itertools.permutations(range(4), 2):
            gradient[corners[i]] += weights[i, j] * (points[corners[i]] - points[corners[j]])
    return gradient


def freudenthal(shape, diagonal):
    """The tetrahedra (m, 4) of a grid: in each cell the six paths along its main diagonal, one for each order of the axes.

    Bit 0 of ``diagonal`` says that it runs against the rows (y), bit 1 that it runs against the slices (z).
    """
    number, found = np.arange(np.prod(shape)).reshape(shape), []
    begin = np.array([diagonal >> 1 & 1, diagonal & 1, 0])
    for cell in np.ndindex(*(size - 1 for size in shape)):
        for order in itertools.permutations(range(3)):
            at, path = begin.copy(), [number[tuple(cell + begin)]]
            for axis in order:
                at[axis] = 1 - at[axis]
                path.append(number[tuple(cell + at)])
            found.append(path)
    return np.array(found)


def volume_rate(values, spacing, alpha, diagonals, *, gamma=0.0, sharpness=1.0):
    """-s P B on tetrahedra, of values (d, h, w, k), NaN where missing; W^q by stretching the free lengths."""
    shape, k = values.shape[:3], values.shape[3]
    at = np.stack(
        np.meshgrid(*(np.arange(n) * s for n, s in zip(shape, spacing, strict=True)), indexing="ij"), -1
    ).reshape(-1, 3)
    u = values.reshape(-1, k)
    pull, mass, flat = np.zeros(u.shape), np.zeros(len(u)), np.zeros(len(u))
    for corners in np.concatenate([freudenthal(shape, diagonal) for diagonal in diagonals]):
        if np.isnan(u[corners]).any():
            continue
        base, free = at[corners], alpha * u[corners]
        gradient = np.linalg.solve(base[1:] - base[0], free[1:] - free[0])
        slope2 = np.square(gradient).sum()
        stretch = sharpness if slope2 == 0 else ((1 + slope2) ** sharpness - 1) / slope2
        lifted = np.hstack([base, np.sqrt(stretch) * free])
        weights = tetrahedron_weights(lifted)
        for i, j in itertools.permutations(range(4), 2):
            pull[corners[i]] += weights[i, j] * (u[corners[i]] - u[corners[j]])
        mass[corners] += tetrahedron_volume(lifted) / 4
        flat[corners] += tetrahedron_volume(base) / 4
    there = mass > 0
    rate = np.zeros(u.shape)
    rate[there] = -((flat[there] / mass[there]) ** gamma / mass[there])[:, None] * pull[there]
    return rate.reshape(values.shape)
