"""Triangles as carriers of normals: how normals spread from one to the next, how points follow. Arrays in, arrays out.

The normals of the triangles are three channels on the dual of the mesh. Between two triangles that share the edge e the flux is
|e| / |d|, d the way from centroid to centroid across the middle of e: the cotangent weight of the dual where the ways are
perpendicular to the edges. A triangle lies on one side of a crease, a vertex on both: so creases stay as sharp as the triangles
allow, where normals at the vertices (DESIGN.md, section 2) leave a strip of tilted triangles beside each of them.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import numba
import numpy as np
from numba import njit, prange

from meshflow.geometry.connectivity import Connectivity, shared_sides
from meshflow.geometry.validation import Array

__all__ = ["beyond", "conductances", "followed", "mean_edge", "measured", "normals_at", "spread"]


# Triangles below which threads cost more to meet than they bring.
SMALL = 60_000


@contextmanager
def _threads(size: int) -> Iterator[None]:
    """One thread for what is small."""
    many = numba.get_num_threads()
    numba.set_num_threads(1 if size < SMALL else many)
    try:
        yield
    finally:
        numba.set_num_threads(many)


def beyond(faces: Array) -> Array:
    """The triangle (m, 3) across the edge opposite each corner; -1 at the boundary, and where more than two share the edge."""
    one, other = shared_sides(faces)
    found = np.full(faces.size, -1, np.int32)
    found[one], found[other] = other // 3, one // 3
    return found.reshape(-1, 3)


def measured(points: Array, faces: Array) -> tuple[Array, Array]:
    """Unit normals (m, 3) and areas (m,) of triangles in R^3; a triangle without area has the normal zero."""
    normals, areas = np.empty((len(faces), 3)), np.empty(len(faces))
    _measured(points, faces, normals, areas)
    return normals, areas


def mean_edge(points: Array, faces: Array) -> float:
    """h, the mean length of the edges of the triangles; 0 where there is none."""
    if not len(faces):
        return 0.0
    corners = points[faces].astype(np.float64)
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())


def normals_at(points: Array, faces: Array) -> Array:
    """Unit normals (n, 3) of the vertices, the mean of their triangles by area; zero where there is none."""
    corners = points[faces].astype(np.float64)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat = faces.ravel()
    sums = np.stack([np.bincount(flat, np.repeat(part, 3), len(points)) for part in across.T], axis=1)
    lengths = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.divide(sums, lengths, out=np.zeros(sums.shape), where=lengths > 0)


def conductances(points: Array, faces: Array, across: Array) -> Array:
    """|e| / |d| (m, 3) of the edge opposite each corner; zero where nothing is beyond it."""
    out = np.empty(across.shape)
    _conductances(points, faces, across, out)
    return out


def spread(
    normals: Array,
    areas: Array,
    weights: Array,
    across: Array,
    dt: float,
    contrast: float,
    sharpness: float,
    sweeps: int,
) -> Array:
    """Unit normals (m, 3) after ``sweeps`` steps of dt of the diffusion of normals, edges kept.

    A dn/dt = sum of w g (n_beyond - n), g = (1 + |contrast (n_beyond - n)|^2)^(-q / 2), the flux of a member of gamma -1 and
    sharpness q (2: Perona and Malik, (1)). Each step is implicit in the triangle itself: a mean with positive weights, which is
    stable for every dt and leaves no normal outside those around it.

    :param dt: squared length.
    """
    one, other = normals.copy(), np.empty_like(normals)
    with _threads(len(areas)):
        for _ in range(sweeps):
            _spread(one, areas, weights, across, dt, contrast**2, -0.5 * sharpness, other)
            one, other = other, one
    return one


def followed(points: Array, connectivity: Connectivity, normals: Array, held: Array, sweeps: int) -> Array:
    """Points (n, 3) moved towards the planes that normals (m, 3) give the triangles around each (Sun et al. 2007).

    x_i moves by the mean of n_f n_f . (c_f - x_i) over the triangles f around it, c_f their centroids: along their normals
    alone, so that nothing moves where all triangles lie in one plane.

    :param held: (n,), points that stay.
    """
    one, other, c = points.copy(), np.empty_like(points), connectivity
    with _threads(len(c.faces)):
        for _ in range(sweeps):
            _follow(one, c.faces, c.first, c.corners, normals, held, other)
            one, other = other, one
    return one


@njit(cache=True, parallel=True)
def _measured(points, faces, normals, areas):
    for f in prange(len(faces)):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        ux, uy, uz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
        vx, vy, vz = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1], points[k, 2] - points[i, 2]
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        length = np.sqrt(x * x + y * y + z * z)
        areas[f] = 0.5 * length
        by = 1.0 / length if length > 0.0 else 0.0
        normals[f, 0], normals[f, 1], normals[f, 2] = x * by, y * by, z * by


@njit(cache=True, parallel=True)
def _conductances(points, faces, across, out):
    for f in prange(len(faces)):
        for c in range(3):
            g = across[f, c]
            if g < 0:
                out[f, c] = 0.0
                continue
            a, b = faces[f, (c + 1) % 3], faces[f, (c + 2) % 3]
            edge = here = there = 0.0
            for q in range(3):
                edge += (points[a, q] - points[b, q]) ** 2
                middle = 0.5 * (points[a, q] + points[b, q])
                own = (points[faces[f, 0], q] + points[faces[f, 1], q] + points[faces[f, 2], q]) / 3.0
                its = (points[faces[g, 0], q] + points[faces[g, 1], q] + points[faces[g, 2], q]) / 3.0
                here += (own - middle) ** 2
                there += (its - middle) ** 2
            way = np.sqrt(here) + np.sqrt(there)
            out[f, c] = np.sqrt(edge) / way if way > 0.0 else 0.0


@njit(cache=True, parallel=True)
def _spread(normals, areas, weights, across, dt, contrast2, power, out):
    for f in prange(len(normals)):
        nx, ny, nz = normals[f, 0], normals[f, 1], normals[f, 2]
        x, y, z = areas[f] * nx, areas[f] * ny, areas[f] * nz
        for c in range(3):
            g = across[f, c]
            if g < 0:
                continue
            bx, by, bz = normals[g, 0], normals[g, 1], normals[g, 2]
            turn2 = (bx - nx) ** 2 + (by - ny) ** 2 + (bz - nz) ** 2
            w = dt * weights[f, c] * _conducting(1.0 + contrast2 * turn2, power)
            x += w * bx
            y += w * by
            z += w * bz
        length = np.sqrt(x * x + y * y + z * z)
        if length > 0.0:
            out[f, 0], out[f, 1], out[f, 2] = x / length, y / length, z / length
        else:
            out[f, 0], out[f, 1], out[f, 2] = nx, ny, nz


@njit(cache=True)
def _conducting(stretch, power):
    # The powers of sharpness 2, 4 and 8, by products: a power costs more than all the rest.
    by = 1.0 / stretch
    if power == -1.0:
        return by
    if power == -2.0:
        return by * by
    if power == -4.0:
        return by * by * by * by
    return stretch**power


@njit(cache=True, parallel=True)
def _follow(points, faces, first, corners, normals, held, out):
    for i in prange(len(points)):
        x = y = z = 0.0
        count = first[i + 1] - first[i]
        for t in range(first[i], first[i + 1]):
            f, c = corners[t] // 3, corners[t] % 3
            j, k = faces[f, (c + 1) % 3], faces[f, (c + 2) % 3]
            nx, ny, nz = normals[f, 0], normals[f, 1], normals[f, 2]
            # n . (c_f - x_i) by differences: planes far from the origin rest to the last bits of their edges.
            high = (
                nx * ((points[j, 0] - points[i, 0]) + (points[k, 0] - points[i, 0]))
                + ny * ((points[j, 1] - points[i, 1]) + (points[k, 1] - points[i, 1]))
                + nz * ((points[j, 2] - points[i, 2]) + (points[k, 2] - points[i, 2]))
            ) / 3.0
            x += high * nx
            y += high * ny
            z += high * nz
        share = 1.0 / count if count > 0 and not held[i] else 0.0
        out[i, 0] = points[i, 0] + share * x
        out[i, 1] = points[i, 1] + share * y
        out[i, 2] = points[i, 2] + share * z
