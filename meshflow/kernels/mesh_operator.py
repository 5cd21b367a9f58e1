"""The cotangent operator of a mesh: measures of the triangles, and sums over the triangles around each vertex.

Corner c of a mesh is corner ``c % 3`` of triangle ``c // 3``. ``first`` and ``corners`` give the corners around each vertex
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

    :param forms: for lengths in further coordinates, which are added to those of the points; see :func:`chart_forms`.
    :param sharpness: q, which stretches the lengths of the points relative to those of the forms.
    """


@kernel
def form_angles(
    forms: Annotated[Array, read("float64", "m", 4)],
    cot: Annotated[Array, write("float64", "m", 3)],
    area: Annotated[Array, write("float64", "m")],
    threads: Threads = None,
) -> None:
    """Cotangents and areas of triangles given by quadratic forms."""


@kernel
def chart_forms(
    charts: Annotated[Array, read("float64", "m", 3, "d")],
    forms: Annotated[Array, write("float64", "m", 4)],
    threads: Threads = None,
) -> None:
    """Quadratic forms of triangles given by corners: the dot products at three corners, and four times the squared area."""


@kernel
def triangle_bounds(
    cot: Cotangents,
    area: Areas,
    kind: Annotated[int, integer],
    bounds: Annotated[Array, write("float64", "m")],
    threads: Threads = None,
) -> None:
    """Upper bounds of the eigenvalues of M^-1 L, one per triangle, per squared length."""


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
    """The area of each vertex."""


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
    """The area gradient for coordinates of corners in separate charts of the triangles."""


@kernel
def border_conormals(
    border: Annotated[Array, read("int64", "b")],
    faces: Faces,
    cot: Cotangents,
    charts: Annotated[Array, read("float64", "b", 3, "d")],
    gradient: Annotated[Array, write("float64", "n", "d")],
) -> None:
    """Remove the boundary part of an area gradient, half the conormal of each boundary edge.

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
    """Area of the triangles around each vertex, projected along its direction."""


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
    """The entries of the stiffness L in a pattern, or L_ij (d_i . d_j) for vertices that move along rays.

    :param indptr: of the pattern, from :func:`meshflow.kernels.mesh_connectivity.pattern_rows`; ``indices``, ``slots`` and
        ``diagonal`` from :func:`meshflow.kernels.mesh_connectivity.pattern_entries`.
    """
