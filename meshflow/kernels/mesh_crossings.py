"""Triangles of a mesh that cross each other, or are folded."""

from typing import Annotated

from meshflow.kernels.gate import kernel
from meshflow.kernels.parameters import Array, read, real, threads, write

__all__ = ["crossing_pairs", "folded_pairs"]


@kernel
def crossing_pairs(
    points: Annotated[Array, read("float64", "n", 3)],
    faces: Annotated[Array, read("int32", "m", 3, below="n")],
    pairs: Annotated[Array, write("int32", "k", 2)],
    threads: Annotated[int | None, threads] = None,
) -> int:
    """The number of pairs of triangles that cross each other; the first k of them are written.

    Triangles with a common edge are left out.
    """
    raise NotImplementedError


@kernel
def folded_pairs(
    normals: Annotated[Array, read("float64", "m", 3)],
    pairs: Annotated[Array, read("int64", "e", 2)],
    cosine: Annotated[float, real],
    folded: Annotated[Array, write("bool", "e")],
    threads: Annotated[int | None, threads] = None,
) -> None:
    """Whether the normals of each pair of triangles have a cosine below a number."""
