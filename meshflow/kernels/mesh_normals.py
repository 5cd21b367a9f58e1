"""Diffusion of the normals of triangles, and points that follow them."""

from typing import Annotated

from meshflow.kernels.gate import kernel
from meshflow.kernels.parameters import Array, read, real, threads, write

__all__ = [
    "average_pairs", "crease_weights", "directed_weights", "edge_conductances", "follow_normals", "shift_along_normals",
    "side_lengths", "spread_normals", "triangle_normals", "vertex_normals",
]  # fmt: skip

Points = Annotated[Array, read("float64", "n", 3)]
Faces = Annotated[Array, read("int32", "m", 3, below="n")]
Normals = Annotated[Array, read("float64", "m", 3)]
Across = Annotated[Array, read("int32", "m", 3)]
Threads = Annotated[int | None, threads]


@kernel
def triangle_normals(
    points: Points,
    faces: Faces,
    normals: Annotated[Array, write("float64", "m", 3)],
    areas: Annotated[Array, write("float64", "m")],
    threads: Threads = None,
) -> None:
    """Unit normals and areas of triangles; a triangle without area has the normal zero."""


@kernel
def side_lengths(
    points: Annotated[Array, read("float64", "n", "d")],
    faces: Faces,
    lengths: Annotated[Array, write("float64", "m", 3)],
    threads: Threads = None,
) -> None:
    """The lengths of the sides opposite to each corner."""


@kernel
def edge_conductances(
    points: Points,
    faces: Faces,
    across: Across,
    conductances: Annotated[Array, write("float64", "m", 3)],
    threads: Threads = None,
) -> None:
    """|e| / |d| of the edge opposite each corner, d the path from centroid to centroid; zero at the boundary.

    :param across: the triangle beyond the edge opposite each corner; negative for none.
    """


@kernel
def spread_normals(
    normals: Normals,
    areas: Annotated[Array, read("float64", "m")],
    weights: Normals,
    across: Across,
    dt: Annotated[float, real],
    contrast2: Annotated[float, real],
    power: Annotated[float, real],
    keep: Annotated[float, real],
    pull: Annotated[float, real],
    out: Annotated[Array, write("float64", "m", 3)],
    threads: Threads = None,
) -> None:
    """n + keep (out - n) + pull (s - n), normalized, replaces out, the normals of the stage before n.

    s is one step of dt of A dn/dt = sum of w (1 + contrast2 |n_beyond - n|^2)^power (n_beyond - n), normalized.

    :param weights: w, of the edge opposite each corner.
    :param across: as in :func:`edge_conductances`.
    """


@kernel
def crease_weights(
    normals: Normals,
    weights: Normals,
    across: Across,
    contrast2: Annotated[float, real],
    power: Annotated[float, real],
    out: Annotated[Array, write("float64", "m", 3)],
    threads: Threads = None,
) -> None:
    """The weights times (1 + contrast2 |n_beyond - n|^2)^power; zero where there is no triangle beyond."""


@kernel
def average_pairs(
    weights: Normals,
    across: Across,
    scale: Annotated[float, real],
    twice: Annotated[float, real],
    values: Annotated[Array, read("float64", "m", 2)],
    before: Annotated[Array, write("float64", "m", 2)],
    threads: Threads = None,
) -> None:
    """scale D v - twice v - before replaces before, the stage before the values v.

    D v is the sum of w (v - v_beyond) over the sides of each triangle.

    :param weights: w, of the edge opposite each corner.
    :param across: as in :func:`edge_conductances`.
    """


@kernel
def vertex_normals(
    first: Annotated[Array, read("int64", "n+1")],
    corners: Annotated[Array, read("int32", "c")],
    normals: Normals,
    weights: Annotated[Array, read("float64", "m")],
    out: Annotated[Array, write("float64", "n", 3)],
    threads: Threads = None,
) -> None:
    """The directions of the sums of the normals times weights over the triangles around each vertex; zero where that sum is."""


@kernel
def shift_along_normals(
    first: Annotated[Array, read("int64", "n+1")],
    corners: Annotated[Array, read("int32", "c")],
    normals: Normals,
    weights: Annotated[Array, read("float64", "m")],
    offsets: Annotated[Array, read("float64", "m")],
    ridge: Annotated[float, real],
    out: Annotated[Array, write("float64", "n", 3)],
    threads: Threads = None,
) -> None:
    """Least squares of n_f . x = offset_f over the triangles f around each vertex.

    :param ridge: the share of the squares of the normals below which a direction is left out.
    """


@kernel
def follow_normals(
    points: Points,
    first: Annotated[Array, read("int64", "n+1")],
    corners: Annotated[Array, read("int32", "c")],
    faces: Faces,
    normals: Normals,
    held: Annotated[Array, read("bool", "n")],
    keep: Annotated[float, real],
    pull: Annotated[float, real],
    heights: Annotated[Array, write("float64", "m", 3)],
    out: Annotated[Array, write("float64", "n", 3)],
    threads: Threads = None,
) -> None:
    """x + keep (out - x) + pull s replaces out, the points of the stage before x.

    s is the mean of n_f n_f . (c_f - x) over the triangles f around each point, c_f their centroids.

    :param held: points that stay.
    :param heights: a work array, n_f . (c_f - x) at the corners.
    """


@kernel
def directed_weights(
    points: Points,
    faces: Faces,
    normals: Points,
    threshold: Annotated[float, real],
    weights: Annotated[Array, write("float64", "m", 3)],
    threads: Threads = None,
) -> None:
    """Weights, instead of cotangents, of a diffusion along directions of small curvature.

    :param normals: of the vertices.
    :param threshold: the curvature, per length, above which a direction is not followed.
    """
