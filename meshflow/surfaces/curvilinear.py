"""Grids whose rows and columns are curved, or spaced unevenly."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import InputError
from meshflow.geometry.options import named_fields
from meshflow.geometry.validation import Array, nowhere, real
from meshflow.surfaces.irregular import Irregular, Vertices, present, used
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.triangles import triangles_of_cells

__all__ = ["Curvilinear", "coordinates_of"]


@named_fields
@dataclass(frozen=True, eq=False, repr=False)
class Curvilinear(Irregular):
    """A grid of rows and columns whose samples may lie anywhere. Its values are smoothed.

    Each cell is cut by its shorter diagonal. A rectilinear grid, with straight rows and columns of uneven spacing, is given by
    one x for each column and one y for each row. Samples that are missing are holes.

    Example:

        >>> import numpy as np
        >>> from meshflow import Curvilinear, smooth
        >>> r, angle = np.geomspace(1, 4, 30), np.linspace(0, np.pi / 2, 40)  # a quarter of a ring
        >>> x, y = r[:, None] * np.cos(angle), r[:, None] * np.sin(angle)
        >>> noise = 0.1 * np.random.default_rng(0).normal(size=x.shape)
        >>> smoothed = smooth(Curvilinear(x, y, x * y + noise)).values
        >>> bool(np.std(smoothed - x * y) < 0.05)
        True

    :param x: (h, w), or (w,), one for each column.
    :param y: (h, w), or (h,), one for each row; the unit of x.
    :param values: (h, w) or (h, w, k); NaN: missing.
    :param z: (h, w), where the grid is a surface in space; None: it lies on a plane.
    :param missing: (h, w), further samples that are missing.
    :raises InputError: for shapes that disagree, fewer than 2 x 2 samples, and a grid without a triangle.
    """

    x: Array
    y: Array
    values: Array
    z: Array | None = None
    missing: Array = field(default_factory=nowhere)

    def __post_init__(self) -> None:
        x, y = coordinates_of(self.x, self.y, ("x", "y"))
        places = [x, y] if self.z is None else [x, y, real(self.z, "z")]
        if places[-1].shape != x.shape:
            raise InputError(f"z: shape {x.shape} expected, as x and y have, got {places[-1].shape}")
        values, missing = present(self.values, np.stack(places, axis=-1), self.missing, "curvilinear grid")
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "missing", missing)
        _ = self.mesh

    @property
    def shape(self) -> tuple[int, ...]:
        """(h, w)."""
        return self.values.shape[:2]

    @property
    def columns(self) -> Array:
        """The values (n, k)."""
        return self.values.reshape(self.missing.size, -1)

    def with_columns(self, columns: Array) -> "Curvilinear":
        """A copy with other values."""
        return replace(self, values=columns.reshape(self.values.shape))

    def found(self) -> Vertices:
        """The samples that are not missing."""
        return Vertices.of(self.missing.reshape(-1))

    def spanned(self) -> Mesh:
        """Two triangles for each cell."""
        x, y = coordinates_of(self.x, self.y, ("x", "y"))
        places = np.stack([x, y] if self.z is None else [x, y, np.asarray(self.z)], axis=-1).astype(np.float64)
        faces = self.vertices.home[triangles_of_cells(places, self.missing)]
        points = places.reshape(self.missing.size, -1)[self.vertices.first]
        return used(faces, points, self.vertices.means(self.columns), "curvilinear grid")


def coordinates_of(x: ArrayLike, y: ArrayLike, names: tuple[str, str]) -> tuple[Array, Array]:
    """The coordinates (h, w) of a grid, from arrays (h, w), or from one for each column (w,) and one for each row (h,).

    :param names: of the coordinates, for messages.
    :raises InputError: for anything else, and for fewer than 2 x 2 samples.
    """
    one, two = real(np.ma.filled(x, np.nan), names[0]), real(np.ma.filled(y, np.nan), names[1])
    if one.ndim == two.ndim == 1:
        one, two = np.broadcast_to(one, (len(two), len(one))), np.broadcast_to(two[:, None], (len(two), len(one)))
    if one.ndim != 2 or one.shape != two.shape:
        raise InputError(
            f"{' and '.join(names)}: arrays of one shape (h, w) expected, or one number for each column (w,) and for each row "
            f"(h,); got {one.shape} and {two.shape}"
        )
    if min(one.shape) < 2:
        raise InputError(
            f"{' and '.join(names)}: at least 2 x 2 samples are needed to span a triangle, got {one.shape}"
        )
    return one, two
