"""Grids of pyvista that are terrains or images: flat ImageData, and StructuredGrid with one layer."""

from functools import partial

import numpy as np
import pyvista
from numpy.typing import ArrayLike

from meshflow.errors import Fact, InputError
from meshflow.geometry.validation import Array, nowhere, spacing_of
from meshflow.io.adapters.pyvista_cells import from_curved_grid
from meshflow.io.adapters.pyvista_volumes import volume_of_image_data
from meshflow.io.document import Imported
from meshflow.io.metadata import ReadOptions, looked_up
from meshflow.io.vertex_merging import fitted
from meshflow.surfaces.curvilinear import Curvilinear
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh

__all__ = ["from_image_data", "from_structured_grid"]

# Steps between points of a terrain may differ by this share, since float32 holds UTM metres to about 0.03 m.
_UNEVEN = 2e-3


def from_image_data(image: pyvista.ImageData, options: ReadOptions) -> Imported:
    """Import an ImageData, flat or a volume; its active scalars, or the array that ``channels`` names, move.

    One component is a height field (with ``kind="image"`` an image), several are an image. Integers are returned as floating
    point, so that nothing is rounded; colours (uint8, 3 or 4 components) keep their type.

    :param options: ``kind`` (``terrain | image | volume``), ``channels``, ``spacing``.
    :raises InputError: for a single row, no array, or options that do not belong.
    """
    options.must_belong("an ImageData", ("kind", "channels", "spacing", "nodata"))
    kind = options.kind
    if kind not in (None, "terrain", "image", "volume"):
        raise InputError(f"kind={kind!r}: an ImageData is a terrain, an image or a volume")
    long = [axis for axis in range(3) if image.dimensions[axis] > 1]
    if len(long) == 3 and kind in (None, "volume"):
        data, name = _scalars(image, options.channels)
        return volume_of_image_data(image, data, name, options)
    if len(long) != 2:
        raise InputError(
            f"ImageData of dimensions {tuple(image.dimensions)}: two dimensions above 1 expected; take a slice, "
            "for example .extract_subset((0, nx - 1, 0, ny - 1, k, k))"
        )
    data, name = _scalars(image, options.channels)
    values = np.array(data[name])
    cells = int(values.shape[0] != image.n_points)
    # x runs fastest in VTK and y upwards; row 0 of a height field is the northmost
    order = np.arange(len(values)).reshape(image.dimensions[long[1]] - cells, image.dimensions[long[0]] - cells)[::-1]
    own = (float(image.spacing[long[0]]), float(image.spacing[long[1]]))
    steps = own if options.spacing is None else spacing_of(options.spacing, len(order))
    missing = nowhere(options.missing_in(values[order]))
    if values.ndim == 2:
        if kind == "terrain":
            raise InputError(f"kind='terrain': the array {name!r} has {values.shape[1]} components, a terrain has one")
        found = Image(values[order], steps, missing)
    else:
        found = (Image if kind == "image" else HeightField)(values[order], steps, missing)
    colors = values.dtype == np.uint8 and values.ndim == 2 and values.shape[1] in (3, 4)
    notes = (
        () if values.dtype.kind == "f" or colors else (f"the array {name!r} of {values.dtype} becomes floating point",)
    )
    to_object = partial(_to_image_data, image.copy(deep=True), bool(cells), name, order, colors)
    return Imported(found, to_object, notes, partial(_samples, data, order))


def from_structured_grid(grid: pyvista.StructuredGrid, options: ReadOptions) -> Imported:
    """Import a StructuredGrid with one layer; z moves above x and y, or, on the surface as it is, a named array.

    Of three axes an array of the points moves (:func:`.pyvista_cells.from_curved_grid`).

    :param options: ``spacing``, ``nodata``; ``channels``, the name of an array of its points.
    :raises InputError: for several layers, or cells that lie above each other; the message says what to do.
    """
    if min(grid.dimensions) > 1 and (options.attribute or len(grid.point_data)):
        return from_curved_grid(grid, options)
    options.must_belong("a StructuredGrid, of which z moves", ("kind", "spacing", "nodata", "channels"))
    if options.kind not in (None, "terrain"):
        raise InputError(f"kind={options.kind!r}: a StructuredGrid is a terrain, its z moves; images come as ImageData")
    long = [size for size in grid.dimensions if size > 1]
    if len(long) != 2:
        raise InputError(
            f"StructuredGrid of dimensions {tuple(grid.dimensions)}: one layer, two dimensions above 1 expected; "
            "take its surface: .extract_surface().triangulate()"
        )
    points = np.array(grid.points)
    if options.channels is not None:
        return _on_surface(grid, points.reshape(long[1], long[0], 3), options)
    laid_out = _laid_out(points, long[1], long[0])
    if laid_out is None:
        return _above_plane(grid, points.reshape(long[1], long[0], 3))
    order, steps = laid_out
    if options.spacing is not None:
        steps = spacing_of(options.spacing, len(order))
    data = HeightField(points[order, 2], steps, nowhere(options.missing_in(points[order, 2])))
    kept = grid.copy(deep=True)

    def to_object(smoothed: HeightField) -> pyvista.StructuredGrid:
        """The grid with other heights."""
        return _to_structured_grid(kept, order, smoothed.z)

    return Imported(data, to_object, samples=partial(_samples, grid.point_data, order))


def _above_plane(grid: pyvista.StructuredGrid, points: Array) -> Imported:
    """The import of a terrain (h, w, 3) whose x and y are curved or unevenly spaced; z moves.

    :raises InputError: for cells that lie above each other.
    """
    one, two = np.diff(points[:-1, :, :2], axis=1), np.diff(points[:, :-1, :2], axis=0)
    turn = one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0]
    if not ((turn > 0).all() or (turn < 0).all()):
        raise InputError(
            "StructuredGrid: cells side by side in x and y expected, so that z alone moves; these lie above each other. As a "
            "mesh that moves in space: .extract_surface().triangulate(); or name the array that moves: channels='name'"
        )
    data = Curvilinear(points[..., 0], points[..., 1], points[..., 2])

    def to_object(mesh: Mesh) -> pyvista.StructuredGrid:
        """The grid with other heights."""
        return _to_structured_grid(grid, np.arange(grid.n_points), data.holding(mesh).columns[:, 0])

    note = Fact("x and y are curved or unevenly spaced: z is smoothed on a mesh")
    return Imported(data.mesh, to_object, (note,), partial(_vertices, grid.point_data, data))


def _on_surface(grid: pyvista.StructuredGrid, points: Array, options: ReadOptions) -> Imported:
    """The import of an array of the points (h, w, 3) of a surface, which moves.

    :raises InputError: for an array that is not there.
    """
    options.must_belong("a StructuredGrid, of which an array moves", ("kind", "channels"))
    name = options.attribute
    if name is None or name not in grid.point_data:
        there = ", ".join(grid.point_data.keys()) or "none"
        raise InputError(
            f"channels={options.attribute or '...'!r}: the name of a point array expected; there are {there}"
        )
    array = np.array(grid.point_data[name])
    values = array.reshape(*points.shape[:2], *array.shape[1:])
    data = Curvilinear(points[..., 0], points[..., 1], values, points[..., 2])

    def to_object(mesh: Mesh) -> pyvista.StructuredGrid:
        """The grid with another array."""
        new = grid.copy(deep=True)
        new.point_data[name] = data.holding(mesh).columns.reshape(array.shape)
        return new

    return Imported(data.mesh, to_object, (), partial(_vertices, grid.point_data, data))


def _vertices(
    data: pyvista.DataSetAttributes, grid: Curvilinear, given: ArrayLike | None, word: str
) -> ArrayLike | None:
    """One number per vertex: of the array of a name, or of an array with one for each point."""
    if isinstance(given, str):
        found = np.array(data[given]) if given in data else None
        given = looked_up(given, word, (found, data.keys()))
    values = np.asarray(given)
    return grid.aligned(values.reshape(grid.shape) if values.size == np.prod(grid.shape) and values.ndim else given)


def _samples(data: pyvista.DataSetAttributes, order: Array, given: ArrayLike | None, word: str) -> ArrayLike | None:
    """One number per sample (h, w): of the array of a name, of an array in the order of the object, or as it is."""
    if isinstance(given, str):
        found = np.array(data[given]) if given in data else None
        return looked_up(given, word, (found, data.keys()))[order]
    values = np.asarray(given)
    return values[order] if values.shape == (order.size,) else given


def _scalars(image: pyvista.ImageData, channels: ArrayLike | None) -> tuple[pyvista.DataSetAttributes, str]:
    """The data (of points or cells) and the name of the array that moves."""
    if channels is not None and not isinstance(channels, str):
        raise InputError(f"channels: the name of an array of the ImageData expected, got {type(channels).__name__}")
    for data in (image.point_data, image.cell_data):
        if channels is not None and channels in data:
            return data, channels
    if channels is not None:
        raise InputError(f"channels={channels!r}: no such array; there are {', '.join(image.array_names) or 'none'}")
    for data in (image.point_data, image.cell_data):
        name = data.active_scalars_name or (data.keys()[0] if len(data) == 1 else None)
        if name is not None:
            return data, name
    raise InputError(
        f"ImageData without active scalars ({', '.join(image.array_names) or 'no arrays'}): say which array moves, "
        "channels='name'"
    )


def _to_image_data(
    image: pyvista.ImageData, cells: bool, name: str, order: Array, colors: bool, smoothed: HeightField | Image
) -> pyvista.ImageData:
    smooth = smoothed.z if isinstance(smoothed, HeightField) else smoothed.values
    new = image.copy(deep=True)
    data = new.cell_data if cells else new.point_data
    active = new.active_scalars_info
    values = np.empty((order.size, *smooth.shape[2:]), smooth.dtype)
    values[order] = smooth
    if colors or values.dtype == data[name].dtype:
        np.copyto(data[name], fitted(values, data[name].dtype))
    else:
        data[name] = values
        if active.name is not None:
            new.set_active_scalars(active.name, preference="cell" if active.association.name == "CELL" else "point")
    return new


def _to_structured_grid(grid: pyvista.StructuredGrid, order: Array, z: Array) -> pyvista.StructuredGrid:
    """The grid with other heights."""
    new = grid.copy(deep=True)
    points = np.array(new.points)
    points[order, 2] = z
    new.points = points
    return new


def _laid_out(points: Array, rows: int, columns: int) -> tuple[Array, tuple[float, float]] | None:
    """Where the points of a terrain stand, northmost row first: indices (h, w), and (dx, dy); None where they are not even."""
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
        return None
    return order, (float(dx), float(dy))
