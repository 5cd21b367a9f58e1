"""Differences of arrays, and the comparison of two data objects."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import InputError
from meshflow.geometry import operator
from meshflow.geometry.validation import Array
from meshflow.geometry.volume import is_closed, volume
from meshflow.surfaces.data import KINDS, Data, data_from, on_surface
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.surfaces.surface import Surface

__all__ = [
    "Comparison",
    "area",
    "compare",
    "distance_rms",
    "is_closed",
    "largest_difference",
    "median_difference",
    "normal_angle",
    "rms_difference",
    "volume",
]


def rms_difference(found: ArrayLike, truth: ArrayLike) -> float:
    """Root mean square of found - truth, in their unit, over the samples that are finite in both.

    Example:

        >>> rms_difference([1.0, 2.0], [1.0, 3.0])
        0.7071067811865476

    :param found: an array.
    :param truth: an array of the same shape.
    :raises InputError: when the shapes differ or no sample is finite in both.
    """
    return float(np.sqrt(np.mean(np.square(_sizes(found, truth)))))


def median_difference(found: ArrayLike, truth: ArrayLike) -> float:
    """Median of |found - truth|, in their unit, over the samples that are finite in both; it is robust to outliers.

    Example:

        >>> median_difference([1.0, 2.0, 9.0], [1.0, 2.5, 3.0])
        0.5

    :param found: an array.
    :param truth: an array of the same shape.
    :raises InputError: as :func:`rms_difference`.
    """
    return float(np.median(_sizes(found, truth)))


def largest_difference(found: ArrayLike, truth: ArrayLike) -> float:
    """Largest |found - truth|, in their unit, over the samples that are finite in both.

    Example:

        >>> largest_difference([1.0, 2.0], [1.0, 2.5])
        0.5

    :param found: an array.
    :param truth: an array of the same shape.
    :raises InputError: as :func:`rms_difference`.
    """
    return float(_sizes(found, truth).max())


def normal_angle(points: Array, others: Array, faces: Array) -> float:
    """Mean angle, degrees, between the normals of the same triangles over two sets of points; each triangle counts once.

    Triangles without area in either set have no normal and are not counted.

    Example:

        >>> import numpy as np
        >>> flat, faces = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]])
        >>> round(normal_angle(flat, flat + [[0, 0, 0], [0, 0, 1], [0, 0, 0]], faces), 6)
        45.0

    :param points: (n, 3).
    :param others: (n, 3).
    :param faces: (m, 3).
    :raises InputError: when the points are not two sets of n in R^3, or no triangle has area in both.
    """
    if np.shape(points) != np.shape(others) or np.ndim(points) != 2 or np.shape(points)[1] != 3:
        raise InputError(
            f"normals: two sets of points (n, 3) expected, got shapes {np.shape(points)} and {np.shape(others)}"
        )
    angles = _angles(np.asarray(points)[faces], np.asarray(others)[faces])
    if not angles.size:
        raise InputError(f"normals: at least one triangle with area in both expected, got none of {len(faces)}")
    return float(angles.mean())


def area(points: Array, faces: Array) -> float:
    """Total area of triangles (m, 3) over points (n, d), in squared unit of the points; any d."""
    return operator.total_area(points, faces)


def distance_rms(points: Array, distance: Callable[[Array], Array]) -> float:
    """Root mean square distance of points (n, 3) from a surface, in their unit.

    Example:

        >>> import numpy as np
        >>> distance_rms(np.eye(3) * 1.5, lambda points: np.linalg.norm(points, axis=1) - 1.0)  # from the unit sphere
        0.5

    :param points: (n, 3).
    :param distance: from points (n, 3) to distances (n,) from the true surface; their sign has no effect.
    """
    return rms_difference(distance(points), np.zeros(len(points)))


@dataclass(frozen=True)
class Comparison:
    """Differences of two data objects of one kind on the same samples.

    :ivar kind: ``height field | image | range image | mesh``.
    :ivar unit: of rms, median and largest; empty where the data object does not define it.
    :ivar samples: number of samples present in both.
    :ivar missing_before: number of samples missing before, for grids.
    :ivar missing_after: and after.
    :ivar rms: of heights, depths, or all channels together; for meshes of the displacement of the points (or of the channels
        where only those move; where both move, of both as one vector).
    :ivar along: for meshes in R^3 whose points move: root mean square displacement along the normals before, as noise is
        measured.
    :ivar median: of the absolute differences.
    :ivar largest: of the absolute differences.
    :ivar normal_angle: mean angle between the normals of the same triangle, degrees; None for images, whose channels and
        pixels have no common unit, and for surfaces outside R^3.
    :ivar area_before: of the triangles present in both; for a grid with forward diagonals and contrast 1; squared length.
    :ivar area_after: of the same triangles after.
    :ivar volume_before: of a closed mesh in R^3, cubed length; None otherwise.
    :ivar volume_after: of the same mesh after.
    """

    kind: str
    unit: str
    samples: int
    missing_before: int | None
    missing_after: int | None
    rms: float
    median: float
    largest: float
    normal_angle: float | None
    area_before: float
    area_after: float
    volume_before: float | None = None
    volume_after: float | None = None
    along: float | None = None

    def words(self) -> dict[str, str | int | float]:
        """The numbers by name, in reading order; ``unit`` is that of the differences. Numbers that do not apply are left out."""
        lines = {
            "kind": self.kind,
            "unit": self.unit or None,
            "samples compared": self.samples,
            "missing before": self.missing_before,
            "missing after": self.missing_after,
            "rms difference": self.rms,
            "rms along the normals": self.along,
            "median difference": self.median,
            "largest difference": self.largest,
            "mean angle of normals (degrees)": self.normal_angle,
            "area before": self.area_before,
            "area after": self.area_after,
            "volume before": self.volume_before,
            "volume after": self.volume_after,
        }
        return {name: value for name, value in lines.items() if value is not None}


def compare(before: Data | Array, after: Data | Array) -> Comparison:
    """Measure the differences of two data objects of the same kind on the same samples.

    Arrays (h, w) are height fields, arrays (h, w, k) images, with a spacing of 1.

    Example:

        >>> import numpy as np
        >>> from meshflow import HeightField
        >>> found = compare(HeightField(np.zeros((4, 4))), HeightField(np.ones((4, 4))))
        >>> found.rms
        1.0

    :param before: a data object, or an array.
    :param after: the same kind of data on the same samples.
    :raises InputError: when kinds, shapes, spacings, units, cameras or triangles differ, or no sample is present in both.
    """
    one, other = data_from(before, KINDS, "compare"), data_from(after, KINDS, "compare")
    if type(one) is not type(other):
        raise InputError(f"compare: data of one kind expected, got {_name(one)} and {_name(other)}")
    if isinstance(one, Mesh) or isinstance(other, Mesh):
        return _compared_meshes(cast(Mesh, one), cast(Mesh, other))
    grids = [on_surface(each, "compare") for each in (one, other)]
    return _compared_grids(*(one for one in grids if not isinstance(one, Mesh)))


def _compared_grids(before: HeightField | Image | RangeImage, after: HeightField | Image | RangeImage) -> Comparison:
    _must_share_a_frame(before, after)
    both = ~(before.missing | after.missing)
    if not both.any():
        raise InputError("compare: no sample is present in both; align them, or give data that overlaps")
    sizes = _sizes(_values(before)[both], _values(after)[both])
    lift = Lift(diagonals="forward")
    surfaces = before.lifted(lift), after.lifted(lift)
    # The first two corners identify a triangle of a grid; holes and depth jumps of either are left out of both.
    names = [surface.triangulations[0][:, 0] * both.size + surface.triangulations[0][:, 1] for surface in surfaces]
    one, other = (_corners(s, np.isin(names[i], names[1 - i])) for i, s in enumerate(surfaces))
    units = {data.unit for data in (before, after) if isinstance(data, (HeightField, RangeImage))}
    missing = int(before.missing.sum()), int(after.missing.sum())
    angles = None if isinstance(before, Image) else _angles(one, other)
    return _comparison((_name(before), max(units, default="")), int(both.sum()), missing, sizes, (one, other), angles)


def _compared_meshes(before: Mesh, after: Mesh) -> Comparison:
    for what in ("points", "faces", "channels"):
        shapes = np.shape(getattr(before, what)), np.shape(getattr(after, what))
        if shapes[0] != shapes[1]:
            raise InputError(f"compare: meshes of the same {what} expected, got shapes {shapes[0]} and {shapes[1]}")
    if not np.array_equal(before.faces, after.faces):
        raise InputError("compare: the same triangles expected, got two meshes with different faces; remesh neither")
    if before.moves != after.moves:
        raise InputError(f"compare: meshes that move alike expected, got moves {before.moves!r} and {after.moves!r}")
    # The free coordinates of the lifted surface are those that move: points, channels or both.
    one, other = before.lifted(Lift()), after.lifted(Lift())
    sizes = np.linalg.norm(other.start - one.start, axis=1)
    corners = before.points[before.faces].astype(np.float64), after.points[after.faces].astype(np.float64)
    space = before.points.shape[1] == 3
    found = _comparison((_name(before), ""), len(sizes), None, sizes, corners, _angles(*corners) if space else None)
    normals = before.normals
    if normals is not None and before.moves == "points":
        displacements = np.einsum("ij,ij->i", after.points.astype(np.float64) - before.points, normals)
        found = replace(found, along=float(np.sqrt(np.mean(displacements**2))))
    if not (space and is_closed(before.faces)):
        return found
    volumes = (volume(mesh.points, mesh.faces) for mesh in (before, after))
    return replace(found, volume_before=next(volumes), volume_after=next(volumes))


def _comparison(
    names: tuple[str, str],
    samples: int,
    missing: tuple[int, int] | None,
    sizes: Array,
    corners: tuple[Array, Array],
    angles: Array | None,
) -> Comparison:
    """A Comparison without volumes, from absolute differences (s,) and corners (m, 3, d) before and after."""
    return Comparison(
        kind=names[0],
        unit=names[1],
        samples=samples,
        missing_before=missing[0] if missing else None,
        missing_after=missing[1] if missing else None,
        rms=float(np.sqrt(np.mean(np.square(sizes)))),
        median=float(np.median(sizes)),
        largest=float(sizes.max()),
        normal_angle=float(angles.mean()) if angles is not None and angles.size else None,
        area_before=_area(corners[0]),
        area_after=_area(corners[1]),
    )


def _must_share_a_frame(before: HeightField | Image | RangeImage, after: HeightField | Image | RangeImage) -> None:
    """Refuse grids that differ in shape, and in spacing and unit, or in their camera."""
    shapes = _values(before).shape, _values(after).shape
    if shapes[0] != shapes[1]:
        raise InputError(f"compare: the same samples expected, got shapes {shapes[0]} and {shapes[1]}; crop one")
    if isinstance(before, RangeImage) or isinstance(after, RangeImage):
        before, after = cast(RangeImage, before), cast(RangeImage, after)  # both are of one kind
        if before.camera != after.camera:
            raise InputError(f"compare: one camera expected, got {before.camera} and {after.camera}")
        if before.measure != after.measure:
            raise InputError(
                f"compare: one measure expected, got {before.measure} and {after.measure}; read both alike"
            )
        return
    for axis, one, other in zip(("dx", "dy"), before.spacing, after.spacing, strict=True):
        if not np.allclose(one, other, rtol=1e-6, atol=0.0):
            got = f"{np.mean(one):g} and {np.mean(other):g}"
            raise InputError(f"compare: the same spacing {axis} expected, got {got}; give spacing, or resample one")
    units = {data.unit for data in (before, after) if isinstance(data, HeightField) and data.unit}
    if len(units) > 1:
        raise InputError(f"compare: heights in one unit expected, got {' and '.join(sorted(units))}; convert one")


def _sizes(found: ArrayLike, truth: ArrayLike) -> Array:
    """|found - truth| (s,) where both are finite."""
    one, other = np.asarray(found, dtype=np.float64), np.asarray(truth, dtype=np.float64)
    if one.shape != other.shape:
        raise InputError(f"differences: two arrays of one shape expected, got {one.shape} and {other.shape}")
    there = np.isfinite(one) & np.isfinite(other)
    if not there.any():
        raise InputError(f"differences: a sample that is finite in both expected, got none of {one.size}")
    return np.abs(one[there] - other[there])


def _values(data: HeightField | Image | RangeImage) -> Array:
    """The values of a grid, (h, w) or (h, w, k)."""
    if isinstance(data, HeightField):
        return data.z
    return data.depth if isinstance(data, RangeImage) else data.values


def _corners(surface: Surface, keep: Array) -> Array:
    """Corners (m, 3, d) of the triangles to keep; with a spacing per row, in the chart of each triangle."""
    faces = surface.triangulations[0][keep]
    if not surface.charts:
        return surface.points[faces]
    return np.concatenate([surface.charts[0][keep], surface.points[:, 2:][faces]], axis=2)


def _area(corners: Array) -> float:
    """Total area of triangles given by their corners (m, 3, d)."""
    return operator.total_area(corners.reshape(-1, corners.shape[2]), np.arange(3 * len(corners)).reshape(-1, 3))


def _angles(corners: Array, others: Array) -> Array:
    """Angles, degrees, between the normals of triangles (m, 3, 3) and others, for those with area in both."""
    one, other = _face_normals(corners), _face_normals(others)
    both = one.any(axis=1) & other.any(axis=1)
    one, other = one[both], other[both]
    # atan2 of sine and cosine, because arccos near 1 would round small angles to zero.
    sine, cosine = np.linalg.norm(np.cross(one, other), axis=1), np.einsum("ij,ij->i", one, other)
    return np.degrees(np.arctan2(sine, cosine))


def _face_normals(corners: Array) -> Array:
    """Normals (m, 3) of triangles (m, 3, 3), of twice the length of the area."""
    a, b, c = np.moveaxis(corners.astype(np.float64), 1, 0)
    return np.cross(b - a, c - a)


def _name(data: Data) -> str:
    names = {HeightField: "height field", Image: "image", RangeImage: "range image", Mesh: "mesh"}
    return names[type(data)]
