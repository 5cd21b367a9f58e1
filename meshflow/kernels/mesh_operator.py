"""The cotangent operator of a mesh: what its triangles measure, and what each vertex gathers from the triangles around it.

Corner c of a mesh is corner ``c % 3`` of triangle ``c // 3``. ``first`` and ``corners`` say which corners are around each vertex
(:func:`meshflow.kernels.mesh_connectivity.corners_around`). Masses have the numbers of ``meshflow.geometry.operator.MASSES``.
"""

from typing import Annotated

from meshflow.kernels.gate import kernel
from meshflow.kernels.parameters import Array, integer, read, real, threads, write

__all__ = [
    "area_gradient",
    "area_seen",
    "border_conormals",
    "chart_forms",
    "chart_gradient",
    "fill_stiffness",
    "form_angles",
    "triangle_angles",
    "triangle_bounds",
    "vertex_mass",
]

First = Annotated[Array, read("int64", "n+1")]
Corners = Annotated[Array, read("int32", "c")]
Faces = Annotated[Array, read("int32", "m", 3, below="n")]
Cotangents = Annotated[Array, read("float64", "m", 3)]
Areas = Annotated[Array, read("float64", "m")]
Threads = Annotated[int | None, threads]


@kernel
def triangle_angles(
    points: Annotated[Array, read("float64", "n", "d")],
    faces: Faces,
    forms: Annotated[Array | None, read("float64", "m", 4, optional=True)],
    sharpness: Annotated[float, real],
    cot: Annotated[Array, write("float64", "m", 3)],
    area: Annotated[Array, write("float64", "m")],
    threads: Threads = None,
) -> None:
    """Cotangents and areas of triangles in R^d (Desbrun et al. 2000, section 5.4).

    :param forms: lengths measured in further coordinates, added to those of the points; see :func:`chart_forms`.
    :param sharpness: q, which stretches the lengths of the points against those of the forms.
    """


@kernel
def form_angles(
    forms: Annotated[Array, read("float64", "m", 4)],
    cot: Annotated[Array, write("float64", "m", 3)],
    area: Annotated[Array, write("float64", "m")],
    threads: Threads = None,
) -> None:
    """Cotangents and areas of triangles known by their quadratic forms."""


@kernel
def chart_forms(
    charts: Annotated[Array, read("float64", "m", 3, "d")],
    forms: Annotated[Array, write("float64", "m", 4)],
    threads: Threads = None,
) -> None:
    """Quadratic forms, the dots at three corners and four times the squared area, of triangles given by their corners."""


@kernel
def triangle_bounds(
    cot: Cotangents,
    area: Areas,
    kind: Annotated[int, integer],
    bounds: Annotated[Array, write("float64", "m")],
    threads: Threads = None,
) -> None:
    """Upper bounds of the eigenvalues of M^-1 L that each triangle allows, per squared length."""


@kernel
def vertex_mass(
    first: First,
    corners: Corners,
    cot: Cotangents,
    area: Areas,
    kind: Annotated[int, integer],
    mass: Annotated[Array, write("float64", "n")],
    threads: Threads = None,
) -> None:
    """The area that belongs to each vertex."""


@kernel
def area_gradient(
    first: First,
    corners: Corners,
    faces: Faces,
    cot: Cotangents,
    points: Annotated[Array, read("float64", "n", "d")],
    gradient: Annotated[Array, write("float64", "n", "d")],
    threads: Threads = None,
) -> None:
    """Gradient of the area with respect to the points, in the metric of the cotangents (13)."""


@kernel
def chart_gradient(
    first: First,
    corners: Corners,
    cot: Cotangents,
    charts: Annotated[Array, read("float64", "m", 3, "d")],
    gradient: Annotated[Array, write("float64", "n", "d")],
    threads: Threads = None,
) -> None:
    """The same of coordinates that each triangle's corners have in a chart of its own."""


@kernel
def border_conormals(
    border: Annotated[Array, read("int64", "b")],
    faces: Faces,
    cot: Cotangents,
    charts: Annotated[Array, read("float64", "b", 3, "d")],
    gradient: Annotated[Array, write("float64", "n", "d")],
) -> None:
    """Take out of an area gradient what it holds at the boundary for want of a triangle beyond: half the conormal of each edge.

    :param border: the corners opposite to the boundary edges.
    :param charts: the coordinates of the corners of their triangles.
    """


@kernel
def area_seen(
    first: First,
    corners: Corners,
    faces: Faces,
    points: Annotated[Array, read("float64", "n", 3)],
    directions: Annotated[Array, read("float64", "n", 3)],
    seen: Annotated[Array, write("float64", "n")],
    threads: Threads = None,
) -> None:
    """Area of the triangles around each vertex after projecting them along its direction."""


@kernel
def fill_stiffness(
    first: First,
    corners: Corners,
    faces: Faces,
    indptr: Annotated[Array, read("int32", "n+1")],
    indices: Annotated[Array, read("int32", "e")],
    slots: Annotated[Array, read("uint8", "c", 2)],
    diagonal: Annotated[Array, read("int32", "n")],
    cot: Cotangents,
    rays: Annotated[Array | None, read("float64", "n", 3, optional=True)],
    data: Annotated[Array, write("float64", "e")],
    threads: Threads = None,
) -> None:
    """The numbers of the stiffness L in a pattern, or L_ij (d_i . d_j) of vertices that move along rays.

    :param indptr: of the pattern, as :func:`meshflow.kernels.mesh_connectivity.pattern_rows` makes it; ``indices``, ``slots`` and
        ``diagonal`` as :func:`meshflow.kernels.mesh_connectivity.pattern_entries` does.
    """
