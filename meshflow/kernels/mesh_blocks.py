"""Triangles in blocks that fit the cache of a core: steps of points in R^3 without arrays of cotangents."""

from typing import Annotated

from meshflow.kernels.gate import kernel
from meshflow.kernels.parameters import Array, integer, read, real, threads, write

__all__ = ["count_blocks", "march_blocks", "number_blocks"]

Faces = Annotated[Array, read("int32", "m", 3, below="n")]
Block = Annotated[Array, read("int32", "n")]


@kernel
def count_blocks(faces: Faces, block: Block, first: Annotated[Array, write("int64", "b+1")]) -> int:
    """The start of the triangles of each block, those with a corner among its vertices; returns their number.

    :param block: of each vertex.
    """
    raise NotImplementedError


@kernel
def number_blocks(
    faces: Faces,
    order: Block,
    block: Block,
    size: Annotated[int, integer],
    first: Annotated[Array, read("int64", "b+1")],
    vertices: Annotated[Array, write("int32", "v")],
    start: Annotated[Array, write("int64", "b+1")],
    triangles: Annotated[Array, write("uint16", "t", 3)],
) -> int:
    """Number the vertices of each block, own ones first, and its triangles; returns the largest number of vertices of a block.

    :param order: the vertices, ``size`` of them for each block.
    :param first: from :func:`count_blocks`.
    :param vertices: with room for v = 3 t + n; those of each block begin at ``start``.
    """
    raise NotImplementedError


@kernel
def march_blocks(
    vertices: Annotated[Array, read("int32", "v")],
    start: Annotated[Array, read("int64", "b+1")],
    owned: Annotated[Array, read("int64", "b")],
    triangles: Annotated[Array, read("uint16", "t", 3)],
    first: Annotated[Array, read("int64", "b+1")],
    points: Annotated[Array, read("float64", "n", 3)],
    kind: Annotated[int, integer],
    held: Annotated[Array, read("bool", "n")],
    keep: Annotated[float, real],
    dt: Annotated[float, real],
    out: Annotated[Array, write("float64", "n", 3)],
    inverse: Annotated[Array | None, write("float64", "n", optional=True)],
    sharpest: Annotated[Array, write("float64", "b")],
    threads: Annotated[int | None, threads] = None,
) -> None:
    """keep X - dt M^-1 L X.

    :param kind: of mass, by the numbers of ``meshflow.geometry.operator.MASSES``.
    :param held: vertices that do not move.
    :param inverse: receives dt / M.
    :param sharpest: receives the largest cotangent of each block, infinite where a triangle has no area.
    """
