"""Meshes of tetrahedra: values on the vertices of a body. Each vertex may move along its values."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from meshflow.errors import InputError, NothingThere
from meshflow.geometry.normals import mean_edge
from meshflow.geometry.options import named_fields
from meshflow.geometry.tetrahedra import Tetrahedra, skin_of, triangles_of_cells
from meshflow.geometry.validation import Array, mask_of, missing_among, must_have_squares, nowhere, real
from meshflow.surfaces.grid import Lift, held
from meshflow.surfaces.surface import Boundary

__all__ = ["TetMesh"]


@named_fields
@dataclass(frozen=True, eq=False)
class TetMesh:
    """Values on the vertices of tetrahedra: simulations, measurements in a body, geological models.

    All values of a vertex are free and coupled, as the channels of an :class:`Image` are; the points stay.

    Example:

        >>> import numpy as np
        >>> from meshflow import TetMesh, smooth
        >>> draw = np.random.default_rng(0)
        >>> points = draw.uniform(size=(2000, 3))
        >>> from scipy.spatial import Delaunay
        >>> truth = np.where(points[:, 0] < 0.5, 0.0, 1.0)
        >>> body = TetMesh(points, Delaunay(points).simplices, truth + 0.1 * draw.normal(size=2000))
        >>> bool(np.std(smooth(body).values - truth) < 0.07)
        True

    :param points: (n, d), d >= 3, finite.
    :param tetrahedra: (m, 4), vertices 0 to n - 1, in either orientation. Flat ones contribute nothing; isolated vertices stay.
    :param values: (n,) or (n, k); a vertex with a value that is NaN, infinite or masked is missing: its tetrahedra are not there.
    :param missing: (n,), further vertices that are missing.
    :param fixed: (n,), vertices that stay.
    :param unit: the name of the unit of lengths, for reports.
    :raises InputError: for shapes that disagree, an index out of range, points that are not finite, and no tetrahedron with
        volume whose vertices are all present.
    """

    points: Array
    tetrahedra: Array
    values: Array
    missing: Array = field(default_factory=nowhere)
    fixed: Array = field(default_factory=nowhere)
    unit: str = ""
    boundary: Boundary = field(default="neumann", init=False)

    def __post_init__(self) -> None:
        points = real(self.points, "points")
        must_have_squares(points, "points")
        if points.ndim != 2 or points.shape[1] < 3:
            raise InputError(
                f"points: shape (n, d) with d >= 3 expected, got {points.shape}; a mesh in the plane is a Mesh"
            )
        if not np.isfinite(points).all():
            bad = int((~np.isfinite(points)).any(axis=1).sum())
            raise InputError(f"points: finite numbers expected, {bad} of {len(points)} hold NaN or infinity; drop them")
        values, missing = _values(self.values, self.missing, len(points))
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "tetrahedra", _cells(self.tetrahedra, len(points)))
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "missing", missing)
        object.__setattr__(self, "fixed", mask_of(self.fixed, missing.shape, "fixed"))
        if not (self.spanned.volumes > 0).any():
            raise NothingThere(
                f"tetrahedra: at least one with volume whose vertices are present expected, got none of {len(self.tetrahedra)}"
            )

    def __repr__(self) -> str:
        n, k = len(self.points), 1 if self.values.ndim == 1 else self.values.shape[1]
        size = f"{n} points in R^{self.points.shape[1]}, {len(self.tetrahedra)} tetrahedra"
        return f"TetMesh({size}, {k} values {self.values.dtype}, {int(self.missing.sum())} missing)"

    @cached_property
    def cells(self) -> Array:
        """The tetrahedra (m, 4) whose four vertices are present."""
        if not self.missing.any():
            return self.tetrahedra
        return self.tetrahedra[~self.missing[self.tetrahedra].any(axis=1)]

    @cached_property
    def spanned(self) -> Tetrahedra:
        """The tetrahedra whose four vertices are present, and what does not change."""
        return Tetrahedra.of(self.points, self.cells)

    @property
    def sides(self) -> Array:
        """The triangles (4 m, 3) of the tetrahedra that are present, four of each."""
        return triangles_of_cells(self.cells)

    @property
    def skin(self) -> Array:
        """The triangles (b, 3) of the surface of the body, and of its holes."""
        return skin_of(self.cells)

    @cached_property
    def step(self) -> float:
        """h: the mean length of the edges, in the unit of the points."""
        return mean_edge(self.points, self.sides)

    def columns(self, lift: Lift) -> Array:
        """The values (n, k) as float64, zero where missing.

        :raises InputError: for the boundary ``plane-preserving``, which bodies do not have.
        """
        if lift.boundary == "plane-preserving":
            raise InputError("boundary: neumann or fixed expected for tetrahedra, got 'plane-preserving'")
        columns = np.array(self.values.reshape(len(self.points), -1), np.float64)
        columns[self.missing] = 0.0
        return columns

    def lowered(self, u: Array) -> "TetMesh":
        """A copy with values u (n, k), in their unit; missing vertices keep their bits."""
        return replace(self, values=held(self.values, u, self.missing))


def _cells(tetrahedra: Any, n: int) -> Array:
    """Tetrahedra (m, 4) as integers.

    :raises InputError: for another shape, and indices out of range.
    """
    array = np.asarray(tetrahedra)
    if array.ndim != 2 or array.shape[1] != 4:
        raise InputError(
            f"tetrahedra: shape (m, 4) expected, got {array.shape}; split other cells first (a pyvista.UnstructuredGrid is split "
            "here), triangles are a Mesh"
        )
    if array.dtype.kind not in "iu":
        raise InputError(f"tetrahedra: whole numbers expected, got dtype {array.dtype}")
    if array.size and not (array.min() >= 0 and array.max() < n):
        wrong = array.min() if array.min() < 0 else array.max()
        raise InputError(f"tetrahedra: vertices 0 to {n - 1} expected, got {wrong}")
    return array


def _values(values: Any, missing: Any, n: int) -> tuple[Array, Array]:
    """The values (n,) or (n, k), and the mask (n,) of missing vertices.

    :raises InputError: for another shape, and if all are missing.
    """
    array = real(np.ma.getdata(values), "values")
    if array.ndim not in (1, 2) or len(array) != n:
        raise InputError(f"values: shape ({n},) or ({n}, k) expected, one row for each point, got {array.shape}")
    must_have_squares(array, "values")
    gone = missing_among(values, array, missing, 1)
    if gone.all():
        raise NothingThere(f"values: all {n} are missing (NaN, infinite or masked); nothing to smooth")
    return array, gone
