"""Grids of pyvista that are terrains or images: flat ImageData, StructuredGrid of one layer."""

from functools import partial
from typing import Any

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array, mask_of
from meshflow.io.metadata import belong, looked_up
from meshflow.io.objects import Adopted
from meshflow.io.vertex_merging import fitted
from meshflow.surfaces.lift import HeightField, Image

__all__ = ["adopt_image", "adopt_terrain"]

# Steps between the points of a terrain may differ by this share of a step: float32 holds UTM metres to about 0.03 m.
_UNEVEN = 2e-3


def adopt_image(
    thing: Any, *, kind: Any = None, channels: Any = None, spacing: Any = None, fixed: Any = None, **other: Any
) -> Adopted:
    """Take a flat ImageData in: its active scalars (or the array that ``channels`` names) are what moves.

    One component is a height field (with ``kind="image"`` an image), several are an image. Integers come back as floating
    point, so that nothing is rounded; but colours (uint8, 3 or 4 components) as what they were.

    :raises InputError: for a volume, no array, or hints that do not belong.
    """
    belong(other, "an ImageData", ("kind", "channels", "spacing", "fixed"))
    if kind not in (None, "terrain", "image"):
        raise InputError(f"kind={kind!r}: an ImageData is a terrain or an image")
    long = [axis for axis in range(3) if thing.dimensions[axis] > 1]
    if len(long) != 2:
        raise InputError(
            f"ImageData of dimensions {tuple(thing.dimensions)}: two dimensions above 1 expected; take a slice, "
            "for example .extract_subset((0, nx - 1, 0, ny - 1, k, k))"
        )
    data, name = _scalars(thing, channels)
    values = np.array(data[name])
    cells = int(values.shape[0] != thing.n_points)
    # x runs fastest in VTK and y upwards; row 0 of a height field is the northmost
    order = np.arange(len(values)).reshape(thing.dimensions[long[1]] - cells, thing.dimensions[long[0]] - cells)[::-1]
    steps: Any = tuple(float(thing.spacing[axis]) for axis in long) if spacing is None else spacing
    stays = mask_of(fixed, (len(values),), "fixed")[order]
    if values.ndim == 2:
        if kind == "terrain":
            raise InputError(f"kind='terrain': the array {name!r} has {values.shape[1]} components, a terrain has one")
        noun = Image(values[order], steps, fixed=stays)
    else:
        noun = (Image if kind == "image" else HeightField)(values[order], steps, fixed=stays)
    colors = values.dtype == np.uint8 and values.ndim == 2 and values.shape[1] in (3, 4)
    notes = (
        () if values.dtype.kind == "f" or colors else (f"the array {name!r} of {values.dtype} becomes floating point",)
    )
    restore = partial(_restored_image, thing.copy(deep=True), bool(cells), name, order, colors)
    return Adopted(noun, restore, notes, partial(_samples, data, order))


def adopt_terrain(thing: Any, *, kind: Any = None, spacing: Any = None, fixed: Any = None, **other: Any) -> Adopted:
    """Take a StructuredGrid of one layer in: z above evenly spaced x and y moves.

    :raises InputError: for several layers, or x and y that are not evenly spaced along the axes; the message has the way out.
    """
    belong(other, "a StructuredGrid, of which z moves", ("kind", "spacing", "fixed"))
    if kind not in (None, "terrain"):
        raise InputError(f"kind={kind!r}: a StructuredGrid is a terrain, its z moves; images come as ImageData")
    long = [size for size in thing.dimensions if size > 1]
    if len(long) != 2:
        raise InputError(
            f"StructuredGrid of dimensions {tuple(thing.dimensions)}: one layer, two dimensions above 1 expected; "
            "take its surface: .extract_surface().triangulate()"
        )
    points = np.array(thing.points)
    order, steps = _laid_out(points, long[1], long[0])
    noun = HeightField(
        points[order, 2], steps if spacing is None else spacing, fixed=mask_of(fixed, (len(points),), "fixed")[order]
    )
    restore = partial(_restored_terrain, thing.copy(deep=True), order)
    return Adopted(noun, restore, samples=partial(_samples, thing.point_data, order))


def _samples(data: Any, order: Array, given: Any, word: str) -> Any:
    """One number per sample (h, w): of the array of a name, of an array in the order of the object, or as it is."""
    if isinstance(given, str):
        found = np.array(data[given]) if given in data else None
        return looked_up(given, word, (found, data.keys()))[order]
    values = np.asarray(given)
    return values[order] if values.shape == (order.size,) else given


def _scalars(thing: Any, channels: Any) -> tuple[Any, str]:
    """The data (of points or cells) and the name of the array that moves."""
    if channels is not None and not isinstance(channels, str):
        raise InputError(f"channels: the name of an array of the ImageData expected, got {type(channels).__name__}")
    for data in (thing.point_data, thing.cell_data):
        if channels is not None and channels in data:
            return data, channels
    if channels is not None:
        raise InputError(f"channels={channels!r}: no such array; there are {', '.join(thing.array_names) or 'none'}")
    for data in (thing.point_data, thing.cell_data):
        name = data.active_scalars_name or (data.keys()[0] if len(data) == 1 else None)
        if name is not None:
            return data, name
    raise InputError(
        f"ImageData without active scalars ({', '.join(thing.array_names) or 'no arrays'}): say which array moves, "
        "channels='name'"
    )


def _restored_image(image: Any, cells: bool, name: str, order: Array, colors: bool, noun: HeightField | Image) -> Any:
    smooth = noun.z if isinstance(noun, HeightField) else noun.values
    new = image.copy(deep=True)
    data = new.cell_data if cells else new.point_data
    active = new.active_scalars_info
    values = np.empty((order.size, *smooth.shape[2:]), smooth.dtype)
    values[order] = smooth
    if colors or values.dtype == data[name].dtype:
        data[name][:] = fitted(values, data[name].dtype)
    else:
        data[name] = values
        if active.name is not None:
            new.set_active_scalars(active.name, preference=active.association.name.lower())
    return new


def _restored_terrain(grid: Any, order: Array, noun: HeightField) -> Any:
    new = grid.copy(deep=True)
    points = np.array(new.points)
    points[order, 2] = noun.z
    new.points = points
    return new


def _laid_out(points: Array, rows: int, columns: int) -> tuple[Array, tuple[float, float]]:
    """Where the points of a terrain stand, northmost row first: indices (h, w), and (dx, dy).

    :raises InputError: when x and y are not evenly spaced along the axes.
    """
    order = np.arange(len(points)).reshape(rows, columns)
    x, y = points[:, 0].astype(np.float64), points[:, 1].astype(np.float64)
    if abs(x[order[0, 1]] - x[order[0, 0]]) < abs(y[order[0, 1]] - y[order[0, 0]]):
        order = order.T  # x along the slow index: StructuredGrid(*numpy.meshgrid(x, y), z)
    if x[order[0, -1]] < x[order[0, 0]]:
        order = order[:, ::-1]
    if y[order[-1, 0]] > y[order[0, 0]]:
        order = order[::-1]
    h, w = order.shape
    dx, dy = (x[order[0, -1]] - x[order[0, 0]]) / (w - 1), (y[order[0, 0]] - y[order[-1, 0]]) / (h - 1)
    even_x = np.abs(x[order] - (x[order[0, 0]] + dx * np.arange(w))).max() if dx > 0 else np.inf
    even_y = np.abs(y[order] - (y[order[0, 0]] - dy * np.arange(h))[:, None]).max() if dy > 0 else np.inf
    if not (even_x <= _UNEVEN * dx and even_y <= _UNEVEN * dy):
        raise InputError(
            "StructuredGrid: x and y evenly spaced along the axes expected, so that z alone moves; these are not. "
            "As a mesh that moves in space: .extract_surface().triangulate()"
        )
    return order, (float(dx), float(dy))
