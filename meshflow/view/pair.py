"""Data before and after, and the difference between them."""

from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array
from meshflow.surfaces.data import SurfaceData
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.view.appearance import taken
from meshflow.view.attributes import attribute_change
from meshflow.view.scale import Scale, ranging, symmetric, together

__all__ = ["Pair", "paired", "values_on"]


@dataclass(frozen=True, eq=False)
class Pair:
    """Data before and after, on the same samples.

    :param before: a data object.
    :param after: a data object of the same kind and size.
    :param removed: before minus after, as in every picture, report and number of this package: positive where something was
        removed; for a mesh the motion inwards along the normals of ``before``. Its colours are symmetric about 0.
    :param notes: sentences for the user.
    :param worn: for meshes that differ only in a scalar, or whose one channel moves: its colours before and after.
    """

    before: SurfaceData
    after: SurfaceData
    removed: Scale
    notes: tuple[str, ...]
    worn: tuple[Scale, Scale] | None = None


def paired(before: object, after: object, unit: str | None, own_colours: bool = False) -> Pair:
    """Pair two objects that :func:`meshflow.view.appearance.taken` recognizes.

    The second grid is shown with the spacing or the camera of the first. For meshes with equal points and different colours or
    other vertex attributes, these attributes are compared, and a note says so.

    :param unit: of what changes; by default that of the data object.
    :param own_colours: show meshes in their own colours.
    :raises InputError: for data of different kind, size or triangles.
    """
    (one, first), (other, second) = taken(before, own_colours), taken(after, own_colours)
    if type(one) is not type(other) and not (isinstance(one, Mesh) and isinstance(other, Mesh)):
        kinds = f"before is a {type(one).__name__}, after a {type(other).__name__}"
        raise InputError(f"{kinds}: data of one kind expected")
    values, what = _removed(one, other)
    notes, worn = (*first, *second), None
    if isinstance(one, Mesh) and isinstance(other, Mesh) and (change := attribute_change(before, after, one, other)):
        (values, what), notes = change.removed, (*notes, change.reported)
        if change.before.shape[1] in (3, 4):  # colours, or drawn as colours where they are in the range of bytes
            one, other = change.worn(one, change.before), change.worn(other, change.after)
        elif change.before.shape[1] == 1:
            worn = together(*(ranging(column[:, 0], change.name, "") for column in (change.before, change.after)))
    elif isinstance(one, Mesh) and isinstance(other, Mesh):
        worn = _of_values(one, other)
    if isinstance(one, RangeImage) and isinstance(other, RangeImage):
        other = replace(other, camera=one.camera)
    elif not isinstance(one, (Mesh, RangeImage)) and not isinstance(other, (Mesh, RangeImage)):
        other = replace(other, spacing=one.spacing)
    if unit is None:
        unit = one.unit if isinstance(one, (HeightField, RangeImage)) else ""
    there = values[np.isfinite(values)]
    if there.size == 0:
        raise InputError("before and after have no sample in common: wherever one is present, the other is missing")
    scale = symmetric(values, what, unit, "nothing was removed")
    equal = () if there.any() else ("before and after are equal",)
    return Pair(one, other, scale, tuple(dict.fromkeys((*notes, *equal))), worn)


def values_on(mesh: Mesh, like: Mesh | None = None) -> Scale | None:
    """The colours of one channel that moves on a mesh; None for any other mesh.

    :param like: whose values the colours span, without the least and the greatest hundredth; by default its own.
    """
    spans = mesh if like is None else like
    if mesh.moves != "channels" or mesh.channels is None or spans.channels is None or mesh.channels.shape[1] != 1:
        return None
    low, high = (float(end) for end in np.percentile(spans.channels, (1, 99)))
    return ranging(mesh.channels[:, 0].astype(np.float64), "values", "", (low, high) if high > low else None)


def _of_values(one: Mesh, other: Mesh) -> tuple[Scale, Scale] | None:
    """The colours of one channel that moves, before and after, which span the values before."""
    first, second = values_on(one), values_on(other, one)
    return None if first is None or second is None else (first, second)


def _removed(before: SurfaceData, after: SurfaceData) -> tuple[Array, str]:
    """Before minus after, NaN where either is missing, and its name."""
    if isinstance(before, Mesh) or isinstance(after, Mesh):
        return _removed_of_mesh(cast(Mesh, before), cast(Mesh, after))  # both are of one kind
    columns = [_column(data) for data in (before, after)]
    shapes = [
        data.values.shape if isinstance(data, Image) else column.shape
        for data, column in zip((before, after), columns, strict=True)
    ]
    if shapes[0] != shapes[1]:
        raise InputError(f"before has shape {shapes[0]}, after {shapes[1]}: the same samples expected; crop one")
    words = {HeightField: "height before − after", RangeImage: "depth before − after"}
    channels = before.values.shape[2:] if isinstance(before, Image) else ()
    brightness = "mean of the channels, before − after" if channels not in ((), (1,)) else "before − after"
    return columns[0] - columns[1], words.get(type(before), brightness)


def _column(data: HeightField | Image | RangeImage) -> Array:
    """The number per sample (h, w) that is compared, NaN where missing."""
    if isinstance(data, Image):
        return _grey(data)
    values = data.z if isinstance(data, HeightField) else data.depth
    return np.where(data.missing, np.nan, values.astype(np.float64))


def _grey(image: Image) -> Array:
    """The mean of the channels (h, w), NaN where missing."""
    values = image.values.astype(np.float64)
    values = values if values.ndim == 2 else values.mean(axis=2)
    return np.where(image.missing, np.nan, values)


def _removed_of_mesh(before: Mesh, after: Mesh) -> tuple[Array, str]:
    """Motion inwards along the normals of ``before``; where only channels move, the mean of their decrease."""
    if before.points.shape != after.points.shape:
        raise InputError(f"before has points {before.points.shape}, after {after.points.shape}: the same expected")
    if not np.array_equal(before.faces, after.faces):
        raise InputError(
            f"before has faces {before.faces.shape}, after {after.faces.shape}, not the same triangles: "
            "vertices can be compared on one triangulation only"
        )
    if after.moves == "channels" and after.channels is not None and before.channels is not None:
        if before.channels.shape != after.channels.shape:
            shapes = f"before has channels {before.channels.shape}, after {after.channels.shape}"
            raise InputError(f"{shapes}: the same expected")
        removed = before.channels.astype(np.float64) - after.channels
        return removed.mean(axis=1), "mean of the channels, before − after"
    moved, normals = before.points.astype(np.float64) - after.points, before.normals
    if normals is None:
        return np.linalg.norm(moved, axis=1), "distance moved"
    return np.einsum("nd,nd->n", moved, normals), "moved inwards along the normal"
