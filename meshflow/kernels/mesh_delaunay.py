"""Triangles given by edge lengths: their angles and areas, and flips until they are Delaunay."""

from typing import Annotated

from meshflow.kernels.gate import kernel
from meshflow.kernels.parameters import Array, read, threads, write

__all__ = ["flip_edges", "length_angles"]


@kernel
def length_angles(
    lengths: Annotated[Array, read("float64", "m", 3)],
    cot: Annotated[Array, write("float64", "m", 3)],
    area: Annotated[Array, write("float64", "m")],
    threads: Annotated[int | None, threads] = None,
) -> None:
    """Cotangents and areas of triangles from edge lengths, opposite each corner."""


@kernel
def flip_edges(
    faces: Annotated[Array, write("int32", "m", 3)],
    lengths: Annotated[Array, write("float64", "m", 3)],
    glue: Annotated[Array, write("int32", "c")],
) -> int:
    """Flip edges, in place, until no cotangent weight is negative; returns the number of flips.

    :param glue: for each edge of a triangle, by its opposite corner, the matching edge of its neighbour; negative: not flipped.
    """
    raise NotImplementedError
