"""Triangles known by the lengths of their sides: what they measure, and edges flipped until they are Delaunay."""

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
    """Cotangents and areas of triangles of given sides, opposite each corner."""


@kernel
def flip_edges(
    faces: Annotated[Array, write("int32", "m", 3)],
    lengths: Annotated[Array, write("float64", "m", 3)],
    glue: Annotated[Array, write("int32", "c")],
) -> int:
    """Flip edges, in place, until no cotangent weight is below 0; how many flips it took.

    :param glue: for each side, counted as the corner opposite to it, the side that it lies on; negative where it is not flipped.
    """
    raise NotImplementedError
