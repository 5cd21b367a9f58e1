"""Diffusion of the normals of triangles, and points that follow them.

The normals of the triangles are three channels on the dual of the mesh. The weight between two triangles that share the edge e is
|e| / |d|, where d is the path from centroid to centroid across the midpoint of e: the cotangent weight of the dual where the
paths are perpendicular to the edges. A triangle lies on one side of a crease, while a vertex lies on both. Therefore creases
stay as sharp as the triangles allow, whereas normals at vertices leave a strip of tilted triangles beside each crease.
"""

from dataclasses import dataclass

import numpy as np

from meshflow.geometry.connectivity import Connectivity, connect, shared_sides
from meshflow.geometry.fewer_sweeps import fewer_sweeps, widest
from meshflow.geometry.once import once
from meshflow.geometry.validation import Array, indices_of
from meshflow.kernels import mesh_normals as kernels

__all__ = [
    "NormalDiffusion", "averaged", "beyond", "conductances", "corner_means", "crease_weights", "followed", "mean_altitude",
    "mean_edge", "measured", "normals_at", "shifted", "side_lengths", "spread",
]  # fmt: skip

# The least eigenvalue of a sweep of points that follow normals: none goes farther than 4/3 of the way. Stages per root of the
# number of sweeps: 7 for 10. With 5, points of irregular triangles fit their normals less well.
SLOWEST, FOLLOWED = -1.0 / 3.0, 2.6


@once
def beyond(faces: Array) -> Array:
    """The triangle (m, 3) across the edge opposite each corner; -1 at the boundary, and where more than two share the edge."""
    one, other = shared_sides(faces)
    found = np.full(faces.size, -1, np.int32)
    found[one], found[other] = other // 3, one // 3
    return found.reshape(-1, 3)


def measured(points: Array, faces: Array) -> tuple[Array, Array]:
    """Unit normals (m, 3) and areas (m,) of triangles in R^3; a triangle without area has the normal zero."""
    normals, areas = np.empty((len(faces), 3)), np.empty(len(faces))
    kernels.triangle_normals(np.ascontiguousarray(points, dtype=np.float64), indices_of(faces), normals, areas)
    return normals, areas


def mean_edge(points: Array, faces: Array) -> float:
    """h, the mean length of the edges of the triangles; 0 where there is none."""
    if not len(faces):
        return 0.0
    return float(side_lengths(points, faces).mean())


def corner_means(values: Array, faces: Array) -> Array:
    """The mean (m, k) of the values (n, k) at the corners of each triangle."""
    one, two, three = (values[faces[:, corner]] for corner in range(3))
    return (one + two + three) / 3.0


def side_lengths(points: Array, faces: Array) -> Array:
    """Lengths (m, 3) of the sides opposite each corner, of triangles in R^d."""
    lengths = np.empty((len(faces), 3))
    kernels.side_lengths(np.ascontiguousarray(points, dtype=np.float64), indices_of(faces), lengths)
    return lengths


def mean_altitude(points: Array, faces: Array) -> float:
    """The mean altitude of the triangles on their longest sides, 0.87 edges if they are equilateral; tiny instead of 0."""
    if not len(faces):
        return float(np.finfo(float).tiny)
    longest = side_lengths(points, faces).max(axis=1)
    twice = 2.0 * measured(points, faces)[1]
    altitudes = np.divide(twice, longest, out=np.zeros(len(faces)), where=longest > 0)
    return max(float(altitudes.mean()), float(np.finfo(float).tiny))


def normals_at(points: Array, faces: Array) -> Array:
    """Unit normals (n, 3) of the vertices, the area-weighted mean of their triangles; zero where undefined."""
    c, out = connect((faces,), len(points)), np.empty((len(points), 3))
    kernels.vertex_normals(c.first, c.corners, *measured(points, c.faces), out)
    return out


def conductances(points: Array, faces: Array, across: Array) -> Array:
    """|e| / |d| (m, 3) of the edge opposite each corner; zero at the boundary."""
    out = np.empty(across.shape)
    kernels.edge_conductances(points, indices_of(faces), across, out)
    return out


@dataclass(frozen=True, eq=False)
class NormalDiffusion:
    """The parameters of the diffusion of the normals of triangles.

    :param areas: (m,).
    :param weights: (m, 3), :func:`conductances` of the sides.
    :param across: (m, 3), :func:`beyond` each side.
    :param contrast: factor on the difference of unit normals.
    :param sharpness: q of the flux.
    """

    areas: Array
    weights: Array
    across: Array
    contrast: float
    sharpness: float


def spread(normals: Array, by: NormalDiffusion, dt: float, sweeps: int, room: Array | None = None) -> Array:
    """Unit normals (m, 3) after ``sweeps`` steps of dt of an edge-preserving diffusion.

    A dn/dt = sum of w g (n_beyond - n), g = (1 + |contrast (n_beyond - n)|^2)^(-q / 2), the flux of a variant of gamma -1 and
    sharpness q (2: Perona and Malik, (1)). Each step is implicit in the triangle itself: a mean with positive weights, which
    is stable for every dt. It is computed by fewer stages (:func:`fewer_sweeps`).

    :param dt: squared length.
    :param room: (m, 3), written to as the normals themselves are then; one of the two is the result. By default new arrays.
    """
    now, out = (normals.copy(), np.empty_like(normals)) if room is None else (normals, room)
    power = -0.5 * by.sharpness
    for keep, pull in fewer_sweeps(sweeps):
        kernels.spread_normals(now, by.areas, by.weights, by.across, dt, by.contrast**2, power, keep, pull, out)
        now, out = out, now
    return now


def crease_weights(normals: Array, by: NormalDiffusion) -> Array:
    """w g (m, 3) of :func:`spread` for each side; zero where there is no triangle beyond."""
    out = np.empty(by.weights.shape)
    kernels.crease_weights(normals, by.weights, by.across, by.contrast**2, -0.5 * by.sharpness, out)
    return out


def averaged(values: Array, weights: Array, across: Array, sweeps: float, stages: int) -> Array:
    """T(w0) times the values (m, 2) on triangles after so many sweeps v := v + sum of w (v_beyond - v), by fewer stages.

    T is the polynomial of Chebyshev of the degree ``stages``, w0 the :func:`widest`: what the sweeps leave of what alternates
    between neighbours is at most 1 / T(w0).

    :param weights: w (m, 3) of the edge opposite each corner, their sums at most 1; zero where there is no triangle beyond.
    """
    now, before, w0, pull = values.copy(), np.zeros_like(values), widest(sweeps, stages), 0.5
    for _ in range(stages):
        kernels.average_pairs(weights, across, -pull * (w0 + 1.0), -2.0 * pull * w0, now, before)
        now, before, pull = before, now, 1.0
    return now


def shifted(c: Connectivity, normals: Array, weights: Array, offsets: Array, ridge: float) -> Array:
    """Motions (n, 3) of the vertices, so that the planes of the triangles around each move by offsets (m,) along their normals.

    In a direction on which the normals around a vertex do not agree it moves less.

    :param weights: (m,), of the triangles.
    :param ridge: a share of the sum of the squares of the normals; directions that have less are left out.
    """
    out = np.empty((c.size, 3))
    kernels.shift_along_normals(c.first, c.corners, normals, weights, offsets, ridge, out)
    return out


def followed(
    points: Array, c: Connectivity, normals: Array, held: Array, sweeps: int, rooms: tuple[Array, Array] | None = None
) -> Array:
    """Points (n, 3) moved towards the planes of the triangles around them with normals (m, 3) (Sun et al. 2007).

    In a sweep x_i moves by the mean of n_f n_f . (c_f - x_i) over the triangles f around it, c_f their centroids. Motion is
    along normals only, so that nothing moves where all triangles lie in one plane. It is computed by fewer stages.

    :param held: (n,), points that stay.
    :param rooms: (n, 3) and (m, 3), written to as the points themselves are then; the result is they or the first of these. By
        default new arrays.
    """
    now, (out, heights) = points, rooms or (np.empty_like(points), np.empty_like(normals))
    now = now.copy() if rooms is None else now
    for keep, pull in fewer_sweeps(sweeps, SLOWEST, FOLLOWED):
        kernels.follow_normals(now, c.first, c.corners, c.faces, normals, held, keep, pull, heights, out)
        now, out = out, now
    return now
