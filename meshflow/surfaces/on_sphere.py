"""Values around a globe: a grid of longitude and latitude, HEALPix, stations; their mesh is a closed surface in space."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import InputError
from meshflow.geometry.healpix import healpix_places
from meshflow.geometry.options import named_fields
from meshflow.geometry.planar_delaunay import delaunay_on_sphere, shorter_than
from meshflow.geometry.validation import Array, nowhere, positive, real
from meshflow.surfaces.curvilinear import coordinates_of
from meshflow.surfaces.irregular import Irregular, Vertices, present, used
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.triangles import triangles_of_cells

__all__ = ["OnSphere"]

# Places on the unit sphere that differ by less than this are one place.
ONE_PLACE = 1e-9
# A row ends where it begins if its ends are at most this many of its steps apart; a pole beyond the last row likewise.
CLOSED = 1.5
# healpy marks unseen pixels with -1.6375e30.
UNSEEN = -1.6e30


@named_fields
@dataclass(frozen=True, eq=False, repr=False)
class OnSphere(Irregular):
    """Values on a sphere, such as the Earth or the sky. The values are smoothed; their places stay.

    The surface is closed: there is no border at the ends of rows or at the poles, and no map projection is involved. The
    triangles are those of the cells of a grid; for single places, those of the Delaunay triangulation on the sphere (their
    convex hull; places that cover less than half of the sphere have a border). Samples of a grid at the same place (a row at
    a pole, 0 and 360 degrees) are one vertex, and come back equal. Missing samples are holes.

    Example:

        >>> import numpy as np
        >>> from meshflow import OnSphere, smooth
        >>> lon, lat = np.arange(0.0, 360, 10), np.arange(-85.0, 90, 10)  # degrees
        >>> warm = np.cos(np.radians(lat))[:, None] * np.ones(36)
        >>> noise = 0.1 * np.random.default_rng(0).normal(size=warm.shape)
        >>> smoothed = smooth(OnSphere(lon, lat, warm + noise)).values
        >>> bool(np.std(smoothed - warm) < 0.06)
        True

    :param lon: degrees: (n,), or of a grid (h, w), or (w,), one for each column.
    :param lat: degrees, -90 to 90: (n,), or of a grid (h, w), or (h,), one for each row.
    :param values: (n,), (n, k), (h, w) or (h, w, k); NaN: missing.
    :param radius: of the sphere, which is the unit of lengths: time is in squared radii with 1, the default, and in squared
        kilometres on the Earth with 6371.0088.
    :param max_edge: triangles with a longer edge are left out, unit of the radius. None: none.
    :param missing: further samples that are missing.
    :raises InputError: for other shapes, latitudes beyond 90 degrees, two of (n,) places at one place, and places that span no
        triangle.
    """

    lon: Array
    lat: Array
    values: Array
    radius: float = 1.0
    max_edge: float | None = None
    missing: Array = field(default_factory=nowhere)

    def __post_init__(self) -> None:
        positive(self.radius, "radius")
        if self.max_edge is not None:
            positive(self.max_edge, "max_edge")
        values, missing = present(self.values, self._places, self.missing, "sphere")
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "missing", missing)
        _ = self.mesh

    @classmethod
    def healpix(cls, values: ArrayLike, *, nest: bool = False, radius: float = 1.0) -> "OnSphere":
        """Values of the pixels of HEALPix (Górski et al. 2005), at their centres.

        :param values: (12 nside²,) or (12 nside², k); NaN and values that healpy takes for unseen (-1.6375e30) are missing.
        :param nest: in the order NESTED instead of RING.
        :raises InputError: for another number of pixels.
        """
        array = real(np.ma.filled(values, np.nan), "HEALPix map")
        lon, lat = healpix_places(len(array), nest)
        unseen = np.asarray((array.reshape(len(array), -1) < UNSEEN).any(axis=1))
        return cls(lon, lat, array, radius, missing=unseen)

    @property
    def shape(self) -> tuple[int, ...]:
        """(n,) or (h, w)."""
        return self.missing.shape

    @property
    def columns(self) -> Array:
        """The values (n, k)."""
        return self.values.reshape(self.missing.size, -1)

    def with_columns(self, columns: Array) -> "OnSphere":
        """A copy with other values."""
        return replace(self, values=columns.reshape(self.values.shape))

    @cached_property
    def _places(self) -> Array:
        """Longitude and latitude (n, 2) or (h, w, 2), degrees.

        :raises InputError: for shapes that disagree, and for latitudes beyond 90 degrees.
        """
        lon, lat, shape = np.ma.filled(self.lon, np.nan), np.ma.filled(self.lat, np.nan), np.shape(self.values)
        if np.ndim(lon) == np.ndim(lat) == 1 and shape[:2] != (len(lat), len(lon)):
            if len(lon) != len(lat):
                raise InputError(
                    f"sphere: lon (n,) and lat (n,) with values (n,), or lon (w,) and lat (h,) with values (h, w) expected, got "
                    f"{len(lon)}, {len(lat)} and {shape}"
                )
            lon, lat = real(lon, "lon"), real(lat, "lat")
        else:
            lon, lat = coordinates_of(lon, lat, ("lon", "lat"))
        beyond = float(np.nanmax(np.abs(lat), initial=0.0))
        if beyond > 90.0 + 1e-6:
            raise InputError(
                f"lat: degrees from -90 to 90 expected, got {beyond:.6g}; are lon and lat swapped, or metres?"
            )
        places: Array = np.stack([lon, lat], axis=-1).astype(np.float64)
        return places

    @cached_property
    def _directions(self) -> Array:
        """Unit vectors (n, 3); of a place that is not known, zero."""
        lon, lat = np.radians(np.nan_to_num(self._places.reshape(-1, 2))).T
        known: Array = np.asarray(np.isfinite(self._places.reshape(-1, 2)).all(axis=1))
        found = np.column_stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
        return np.where(known[:, None], found, 0.0)

    @cached_property
    def _place(self) -> Array:
        """The number (n,) of the place of each sample; of samples at one place the same."""
        cells = np.rint(self._directions / ONE_PLACE).astype(np.int64)
        return np.unique(cells, axis=0, return_inverse=True)[1].reshape(-1)

    def found(self) -> Vertices:
        """The samples that are not missing; those of a grid at one place are one."""
        return Vertices.of(self.missing.reshape(-1), self._place if len(self.shape) == 2 else None)

    def spanned(self) -> Mesh:
        """The triangles on the sphere."""
        there = ~self.missing.reshape(-1)
        if len(self.shape) == 2:
            faces = self._of_grid()
        else:
            known = np.flatnonzero(np.isfinite(self._places).all(axis=1))
            faces = known[delaunay_on_sphere(self._directions[known], "sphere")]
        vertex = np.full(self.missing.size, -1)
        vertex[self._place[there]] = self.vertices.home[there]
        faces = vertex[self._place[faces]]
        apart = (faces != np.roll(faces, 1, axis=1)).all(axis=1)  # at a pole only one triangle of a cell is left
        points = self.radius * self._directions[self.vertices.first]
        faces = _outwards(points, faces[(faces >= 0).all(axis=1) & apart])
        if self.max_edge is not None:
            faces = shorter_than(points, faces, self.max_edge)
        return used(faces, points, self.vertices.means(self.columns), "sphere")

    def _of_grid(self) -> Array:
        """The triangles (m, 3) of a grid, of which the rows may end where they begin, and which may end one row before a pole."""
        height, width = self.shape
        x, number = self._directions.reshape(height, width, 3), np.arange(height * width).reshape(height, width)
        unknown: Array = np.logical_not(np.isfinite(self._places).all(axis=-1))
        whole = np.logical_not(unknown.any(axis=1))
        steps = np.linalg.norm(np.diff(x, axis=1), axis=-1).max(axis=1)
        around = np.linalg.norm(x[:, 0] - x[:, -1], axis=-1) <= CLOSED * steps
        if not whole.any() or not around[whole].all():
            return number.reshape(-1)[triangles_of_cells(x, unknown)]
        x, number, unknown = (np.concatenate([one, one[:, :1]], axis=1) for one in (x, number, unknown))
        faces = [number.reshape(-1)[triangles_of_cells(x, unknown)]]
        for row, beside in ((0, 1), (-1, -2)):
            lat, step = self._places[row, :, 1], self._places[row, 0, 1] - self._places[beside, 0, 1]
            if np.ptp(lat) < ONE_PLACE and 0 < 90.0 - abs(lat[0]) <= CLOSED * abs(step) and lat[0] * step > 0:
                _, first = np.unique(self._place[number[row]], return_index=True)
                faces.append(_cap(number[row, np.sort(first)]))
        return np.concatenate(faces)


def _cap(ring: Array) -> Array:
    """The triangles (k - 2, 3) of a polygon of vertices (k,), in a strip; on a circle its diagonals have no weight."""
    strip = np.empty_like(ring)
    strip[0::2], strip[1::2] = ring[: (len(ring) + 1) // 2], ring[(len(ring) + 1) // 2 :][::-1]
    return np.stack([strip[:-2], strip[1:-1], strip[2:]], axis=1)


def _outwards(points: Array, faces: Array) -> Array:
    """The triangles (m, 3), counterclockwise seen from outside."""
    a, b, c = (points[faces[:, i]] for i in range(3))
    inwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c) < 0
    return np.where(inwards[:, None], faces[:, ::-1], faces)
