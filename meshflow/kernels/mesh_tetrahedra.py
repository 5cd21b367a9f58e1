"""Values on a mesh of tetrahedra: weights of edges and volumes, and sums over the tetrahedra around each vertex.

The edges of a tetrahedron are EDGES, and corner c of a mesh is corner ``c % 4`` of tetrahedron ``c // 4``.
"""

from typing import Annotated

from meshflow.kernels.gate import kernel
from meshflow.kernels.parameters import Array, read, real, threads, write

__all__ = ["EDGES", "tetrahedra_gathered", "tetrahedra_measured"]

EDGES = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))
Cells = Annotated[Array, read("int32", "m", 4, below="n")]
Threads = Annotated[int | None, threads]


@kernel
def tetrahedra_measured(
    u: Annotated[Array, read("float64", "n", "k")],
    cells: Cells,
    frames: Annotated[Array, read("float64", "m", 7)],
    scale: Annotated[float, real],
    sharpness: Annotated[float, real],
    weights: Annotated[Array, write("float64", "m", 6)],
    volumes: Annotated[Array, write("float64", "m")],
    threads: Threads = None,
) -> None:
    """Weights and volumes of tetrahedra that values lift into a space of more dimensions.

    :param u: the values of the vertices.
    :param frames: of each tetrahedron: the gradient from the differences along the three legs, lower triangular, row by row, and
        the volume.
    :param scale: alpha squared; 0: the ground itself.
    :param weights: minus the stiffness between the ends of each of the EDGES.
    """


@kernel
def tetrahedra_gathered(
    first: Annotated[Array, read("int64", "n+1")],
    corners: Annotated[Array, read("int32", "c")],
    cells: Cells,
    weights: Annotated[Array, read("float64", "m", 6)],
    volumes: Annotated[Array, read("float64", "m")],
    u: Annotated[Array, read("float64", "n", "k")],
    pull: Annotated[Array, write("float64", "n", "k")],
    quarters: Annotated[Array, write("float64", "n")],
    attraction: Annotated[Array | None, write("float64", "n", optional=True)] = None,
    threads: Threads = None,
) -> None:
    """Sums over the tetrahedra around each vertex.

    :param pull: of w (u_i - u_j) over their edges at the vertex.
    :param quarters: of a quarter of their volumes.
    :param attraction: of the weights above zero of their edges at the vertex.
    """
