"""Connectivity of a mesh: the corners around each vertex, border edges, the pattern of its matrices.

Corner c of a mesh is corner ``c % 3`` of triangle ``c // 3``.
"""

from typing import Annotated

from meshflow.kernels.gate import kernel
from meshflow.kernels.parameters import Array, read, size, threads, write

__all__ = ["corners_around", "count_shared", "list_shared", "mark_border", "pattern_entries", "pattern_rows"]

First = Annotated[Array, read("int64", "n+1")]
Corners = Annotated[Array, read("int32", "c")]
Faces = Annotated[Array, read("int32", "m", 3, below="n")]
Threads = Annotated[int | None, threads]


@kernel
def corners_around(
    n: Annotated[int, size],
    faces: Faces,
    first: Annotated[Array, write("int64", "n+1")],
    corners: Annotated[Array, write("int32", "c")],
) -> None:
    """The start of the corners of each vertex, ``first``, and the corners of all vertices in order.

    :param n: number of vertices.
    """


@kernel
def mark_border(first: First, corners: Corners, faces: Faces, lonely: Annotated[Array, write("bool", "c")]) -> None:
    """Mark the corners opposite to edges that belong to one triangle only."""


@kernel
def count_shared(
    first: First,
    corners: Corners,
    faces: Faces,
    start: Annotated[Array, write("int64", "n+1")],
    threads: Threads = None,
) -> int:
    """The start of the edges of exactly two triangles, by their lower vertices; returns how many there are."""
    raise NotImplementedError


@kernel
def list_shared(
    first: First,
    corners: Corners,
    faces: Faces,
    start: Annotated[Array, read("int64", "n+1")],
    one: Annotated[Array, write("int64", "e")],
    other: Annotated[Array, write("int64", "e")],
    threads: Threads = None,
) -> None:
    """The corners opposite to each of these edges, the lower one and the other.

    :param start: from :func:`count_shared`.
    """


@kernel
def pattern_rows(
    first: First,
    corners: Corners,
    faces: Faces,
    indptr: Annotated[Array, write("int32", "n+1")],
    threads: Threads = None,
) -> int:
    """The start of the rows of the CSR pattern of vertices that share a triangle; returns the number of entries."""
    raise NotImplementedError


@kernel
def pattern_entries(
    first: First,
    corners: Corners,
    faces: Faces,
    indptr: Annotated[Array, read("int32", "n+1")],
    indices: Annotated[Array, write("int32", "e")],
    slots: Annotated[Array, write("uint8", "c", 2)],
    diagonal: Annotated[Array, write("int32", "n")],
    threads: Threads = None,
) -> None:
    """The columns of the pattern, sorted in each row, and the positions of entries.

    ``slots`` receives those of the two neighbours of each corner, relative to its row (255: it must be searched for),
    ``diagonal`` those of the diagonal, relative to the first row.

    :param indptr: from :func:`pattern_rows`.
    """
