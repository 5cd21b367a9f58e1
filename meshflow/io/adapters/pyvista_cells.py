"""Bodies of pyvista: UnstructuredGrid with cells that fill space, RectilinearGrid, and StructuredGrid of three axes."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
import pyvista
from numpy.typing import ArrayLike

from meshflow.errors import Fact, InputError
from meshflow.geometry.splitting import CellKind, split
from meshflow.geometry.validation import Array, nowhere
from meshflow.io.document import Imported
from meshflow.io.metadata import ReadOptions, looked_up
from meshflow.surfaces.curvilinear import Curvilinear
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.tet_mesh import TetMesh

__all__ = ["from_curved_grid", "from_rectilinear_grid", "from_unstructured_grid"]

# The cells of VTK that are split, by their numbers; the corners of a voxel are in the order of rows.
_SOLID: Mapping[int, CellKind] = {10: "tetrahedron", 11: "hexahedron", 12: "hexahedron", 13: "wedge", 14: "pyramid"}
_VOXEL, _OF_VOXEL = 11, (0, 1, 3, 2, 4, 5, 7, 6)
# Cells of fewer dimensions, which follow their points.
_FOLLOW = range(1, 10)


def from_unstructured_grid(grid: pyvista.UnstructuredGrid, options: ReadOptions) -> Imported:
    """Import the values on the points of a grid of tetrahedra, voxels, hexahedra, wedges and pyramids.

    The result is a new grid with the same cells and all arrays; the smoothed one is of floating point.

    :param options: ``channels``, the name of the array of the points that moves; by default the active one, or the only one;
        ``nodata``.
    :raises InputError: for a grid without such cells, curved cells, and an array that is not there.
    """
    options.must_belong("an UnstructuredGrid, of which an array moves", ("kind", "channels", "nodata"))
    if options.kind not in (None, "tetrahedra"):
        raise InputError(
            f"kind={options.kind!r}: an UnstructuredGrid of solid cells is of tetrahedra; leave the kind out"
        )
    cells, kinds = [], []
    for kind, found in grid.cells_dict.items():
        number, corners = int(kind), np.asarray(found)
        if number in _FOLLOW:
            continue
        if number not in _SOLID:
            raise InputError(
                f"UnstructuredGrid with {len(corners)} cells {pyvista.CellType(number).name}: tetrahedra, voxels, hexahedra, "
                "wedges and pyramids expected; cut others first: .triangulate(), curved ones: .linear_copy()"
            )
        ordered = corners[:, _OF_VOXEL] if number == _VOXEL else corners
        cells.append(split(_SOLID[number], ordered))
        kinds.append(f"{len(corners)} {_SOLID[number]}s")
    if not cells:
        raise InputError(
            "UnstructuredGrid: cells that fill space expected, got none; of flat ones take the surface: "
            ".extract_surface().triangulate()"
        )
    name = array_of_points(grid.point_data, options, "an UnstructuredGrid")
    values = np.array(grid.point_data[name])
    data = TetMesh(np.array(grid.points), np.concatenate(cells), values, nowhere(_marked(values, options)))
    whole = all(kind.endswith("tetrahedrons") for kind in kinds)
    notes = _of_several(grid.point_data, options, name)
    if not whole:
        notes += (Fact(f"{' and '.join(kinds)} are smoothed as {len(data.tetrahedra)} tetrahedra"),)
    kept = grid.copy(deep=True)

    def to_object(smoothed: TetMesh) -> pyvista.UnstructuredGrid:
        """The grid with another array."""
        new = kept.copy(deep=True)
        put_back(new, new.point_data, name, smoothed.values)
        return new

    return Imported(data, to_object, notes, partial(_samples, kept.point_data))


def from_rectilinear_grid(grid: pyvista.RectilinearGrid, options: ReadOptions) -> Imported:
    """Import an array of a RectilinearGrid: of a flat one on a mesh of triangles, of others on tetrahedra.

    :param options: ``channels``, the name of the array; by default the active one, or the only one; ``nodata``.
    :raises InputError: for a single row, and an array that is not there.
    """
    options.must_belong("a RectilinearGrid, of which an array moves", ("channels", "nodata"))
    asked = options.attribute
    of_cells = not len(grid.point_data) if asked is None else asked in grid.cell_data and asked not in grid.point_data
    place = grid.cell_data if of_cells else grid.point_data
    name = array_of_points(place, options, "a RectilinearGrid")
    values = np.array(place[name])
    along = [np.array(one, np.float64) for one in (grid.x, grid.y, grid.z)]
    if of_cells:  # their middles
        along = [one if len(one) == 1 else (one[1:] + one[:-1]) / 2 for one in along]
    long = [axis for axis in range(3) if len(along[axis]) > 1]
    kept, marked = grid.copy(deep=True), _marked(values, options)

    def holding(found: Array) -> pyvista.RectilinearGrid:
        """The grid with another array."""
        new = kept.copy(deep=True)
        put_back(new, new.cell_data if of_cells else new.point_data, name, found)
        return new

    if len(long) == 2:
        flat = _flat([along[axis] for axis in long], values, marked, holding, place)
        return replace(flat, notes=(*_of_several(place, options, name), *flat.notes))
    if len(long) < 2:
        raise InputError(
            f"RectilinearGrid of dimensions {tuple(grid.dimensions)}: two dimensions above 1 expected, or three"
        )
    x, y, z = along
    points = np.stack(np.meshgrid(z, y, x, indexing="ij")[::-1], axis=-1).reshape(-1, 3)
    block = _block((len(z), len(y), len(x)), points, values, marked, holding, place)
    return replace(block, notes=(*_of_several(place, options, name), *block.notes))


def from_curved_grid(grid: pyvista.StructuredGrid, options: ReadOptions) -> Imported:
    """Import an array of the points of a StructuredGrid of three axes, which moves on tetrahedra; the points stay.

    :param options: ``channels``, the name of the array; by default the active one, or the only one; ``nodata``.
    :raises InputError: for an array that is not there.
    """
    options.must_belong("a StructuredGrid of three axes, of which an array moves", ("channels", "nodata"))
    name = array_of_points(grid.point_data, options, "a StructuredGrid")
    values, kept = np.array(grid.point_data[name]), grid.copy(deep=True)

    def holding(found: Array) -> pyvista.StructuredGrid:
        """The grid with another array."""
        new = kept.copy(deep=True)
        put_back(new, new.point_data, name, found)
        return new

    w, h, d = grid.dimensions
    block = _block((d, h, w), np.array(grid.points), values, _marked(values, options), holding, grid.point_data)
    return replace(block, notes=(*_of_several(grid.point_data, options, name), *block.notes))


def _block(
    shape: tuple[int, int, int],
    points: Array,
    values: Array,
    marked: Array | None,
    holding: Callable[[Array], pyvista.DataSet],
    place: pyvista.DataSetAttributes,
) -> Imported:
    """The import of values on points (n, 3) in rows, rows in layers, as tetrahedra; the shape is (layers, rows, columns)."""
    data = TetMesh(points, split("hexahedron", _boxes(*shape)), values, nowhere(marked))
    d, h, w = shape
    note = Fact(f"{w} x {h} x {d} samples are smoothed on {len(data.tetrahedra)} tetrahedra")

    def to_object(smoothed: TetMesh) -> pyvista.DataSet:
        """The grid with another array."""
        return holding(smoothed.values)

    return Imported(data, to_object, (note,), partial(_samples, place))


def _flat(
    along: list[Array],
    values: Array,
    marked: Array | None,
    holding: Callable[[Array], pyvista.RectilinearGrid],
    place: pyvista.DataSetAttributes,
) -> Imported:
    """The import of a flat grid, whose values move on a mesh."""
    x, y = along
    shape = len(y), len(x)
    missing = nowhere(None if marked is None else marked.reshape(shape))
    data = Curvilinear(x, y, values.reshape(*shape, *values.shape[1:]), missing=missing)

    def to_object(mesh: Mesh) -> pyvista.RectilinearGrid:
        """The grid with another array."""
        return holding(data.holding(mesh).columns.reshape(values.shape))

    def samples(given: ArrayLike | None, word: str) -> ArrayLike | None:
        """One number per vertex."""
        found = _samples(place, given, word)
        whole = None if found is None else np.asarray(found)
        return data.aligned(found if whole is None or whole.size != np.prod(shape) else whole.reshape(shape))

    return Imported(data.mesh, to_object, (Fact("rows or columns of uneven spacing: smoothed on a mesh"),), samples)


def array_of_points(data: pyvista.DataSetAttributes, options: ReadOptions, what: str) -> str:
    """The name of the array that moves.

    :raises InputError: for a name that is not there, and if there are several and none is active.
    """
    there = ", ".join(data.keys()) or "none"
    if options.channels is not None:
        if options.attribute is None or options.attribute not in data:
            raise InputError(
                f"channels={options.attribute or '...'!r}: the name of an array of the points expected; there are {there}"
            )
        return options.attribute
    name = data.active_scalars_name or (data.keys()[0] if len(data) == 1 else None)
    if name is None or name not in data:
        raise InputError(
            f"{what}: say which array of the points moves, channels='name'; there are {there}. Arrays of the cells become ones "
            "of the points by .cell_data_to_point_data()"
        )
    return name


def _of_several(data: pyvista.DataSetAttributes, options: ReadOptions, name: str) -> tuple[Fact, ...]:
    """A note on which array moves, where there are several and the caller names none."""
    others = [other for other in list(data.keys()) if other != name]
    if options.channels is not None or not others:
        return ()
    return (
        Fact(f"the active array {name!r} moves; for another one give channels={others[0]!r} ({', '.join(others)})"),
    )


def put_back(new: pyvista.DataSet, place: pyvista.DataSetAttributes, name: str, values: Array) -> None:
    """Another array of a name, which stays active if it was."""
    active = new.active_scalars_info
    if place[name].dtype == values.dtype:
        np.copyto(place[name], values)
        return
    place[name] = np.array(values)
    if active.name is not None:
        new.set_active_scalars(active.name, preference="cell" if active.association.name == "CELL" else "point")


def _marked(values: Array, options: ReadOptions) -> Array | None:
    """The points (n,) that ``nodata`` declares missing."""
    if options.nodata is None:
        return None
    return (values == options.nodata).reshape(len(values), -1).any(axis=1)


def _boxes(d: int, h: int, w: int) -> Array:
    """The corners (m, 8) of the cells of a grid whose samples are numbered along x, then y, then z."""
    number = np.arange(d * h * w).reshape(d, h, w)
    ends = [
        number[z : d - 1 + z, y : h - 1 + y, x : w - 1 + x].ravel()
        for z in (0, 1)
        for y, x in ((0, 0), (0, 1), (1, 1), (1, 0))
    ]
    return np.stack(ends, axis=1)


def _samples(data: pyvista.DataSetAttributes, given: ArrayLike | None, word: str) -> ArrayLike | None:
    """One number per vertex: the array of a name, or as it is."""
    if not isinstance(given, str):
        return given
    return looked_up(given, word, (np.array(data[given]) if given in data else None, data.keys()))
