"""Imports objects of pyvista: PolyData here, grids in :mod:`meshflow.io.adapters.pyvista_grids`."""

from functools import partial

import numpy as np
import pyvista

from meshflow.errors import Fact, InputError
from meshflow.geometry.validation import Array
from meshflow.io.adapters.pyvista_cells import from_rectilinear_grid, from_unstructured_grid
from meshflow.io.adapters.pyvista_grids import from_image_data, from_structured_grid
from meshflow.io.document import Imported
from meshflow.io.metadata import Found, ReadOptions
from meshflow.io.vertex_merging import Skin, fitted, is_soup, normals_after
from meshflow.surfaces.mesh import Mesh

__all__ = ["from_object", "triangulated"]

# Classes that are refused, and what to do instead.
_ELSEWHERE = {
    "MultiBlock": "meshflow.smooth takes its blocks one by one; here .combine().extract_surface().triangulate()",
    "ExplicitStructuredGrid": "take its surface: .extract_surface().triangulate()",
    "PointSet": "a cloud has no surface; reconstruct one: .cast_to_polydata().reconstruct_surface()",
}


def from_object(data: object, options: ReadOptions) -> Imported:
    """Import a PolyData, an ImageData, a terrain (StructuredGrid), a RectilinearGrid or a body (UnstructuredGrid).

    Results are new ones with all arrays.

    Polygons and strips are smoothed as triangles, and kept. Arrays keep their types; normals are recomputed.

    :param options: for PolyData ``channels`` ((n, k), the name of a point array, or ``"colors"``), ``moves``;
        for grids ``kind`` (``terrain | image``), ``spacing``, ``channels`` (the name of an array).
    :raises InputError: for other data sets, with what to do instead, and for options that do not apply.
    """
    if isinstance(data, pyvista.PolyData):
        return _from_polydata(data, options)
    if isinstance(data, pyvista.ImageData):
        return from_image_data(data, options)
    if isinstance(data, pyvista.StructuredGrid):
        return from_structured_grid(data, options)
    if isinstance(data, pyvista.UnstructuredGrid):
        return from_unstructured_grid(data, options)
    if isinstance(data, pyvista.RectilinearGrid):
        return from_rectilinear_grid(data, options)
    name = type(data).__name__
    advice = _ELSEWHERE.get(name, "hand over a PolyData, an ImageData, a StructuredGrid or an UnstructuredGrid")
    raise InputError(
        f"pyvista.{name}: a surface, a grid or a body expected (PolyData, ImageData, StructuredGrid, UnstructuredGrid); "
        f"{advice}"
    )


def _from_polydata(data: pyvista.PolyData, options: ReadOptions) -> Imported:
    options.must_be_mesh("a PolyData")
    faces, source, notes = _triangles(data)
    poly = data.copy(deep=True)
    name = None if options.attribute is None else _array_name(poly, options.attribute)
    values = options.channels if name is None else np.array(poly.point_data[name])
    if name is not None and options.attribute == "colors":
        values = np.asarray(values)[:, :3]
    split = (
        poly.active_texture_coordinates is not None
        or _normals_name(poly.point_data) is not None
        or is_soup(faces, poly.n_points)
    )
    skin = Skin.of(poly.points, faces, split=split, channels=values, moves=options.moves)
    samples = partial(skin.samples, find=partial(_point_array, poly))
    return Imported(skin.data, partial(_to_object, poly, (faces, source), skin, name), (*skin.note, *notes), samples)


def _triangles(data: pyvista.PolyData) -> tuple[Array, Array, tuple[str, ...]]:
    """Triangles (m, 3), the polygon or strip of each, and notes."""
    if not data.GetNumberOfPolys() and not data.n_strips:
        raise InputError(
            f"PolyData: polygons expected, got {data.n_points} points, {data.n_lines} lines and none; a cloud has "
            "no surface, reconstruct one first: .reconstruct_surface() or .delaunay_2d()"
        )
    others = [f"{count} {word}" for count, word in ((data.n_verts, "vertex cells"), (data.n_lines, "lines")) if count]
    notes = (f"{' and '.join(others)} stay, and follow their points",) if others else ()
    faces, source = _as_triangles(data)
    sizes = np.diff(pyvista.convert_array(data.GetPolys().GetOffsetsArray()))
    many = int((sizes != 3).sum())
    kinds = [f"{count} {word}" for count, word in ((many, "polygons"), (data.n_strips, "strips")) if count]
    if kinds:
        count = len(faces) - int((sizes == 3).sum())
        notes += (Fact(f"{' and '.join(kinds)} are smoothed as {count} triangles; the result keeps them"),)
    return faces, source, notes


def triangulated(data: pyvista.PolyData) -> pyvista.PolyData:
    """A deep copy with triangles instead of polygons and strips; each triangle has the cell data of its polygon or strip."""
    first = data.n_verts + data.n_lines  # the order of cells in VTK: vertices, lines, polygons, strips
    faces, came = _as_triangles(data)
    source = np.concatenate([np.arange(first), first + came])
    poly = data.copy(deep=True)
    columns: dict[str, Array] = {name: np.array(values)[source] for name, values in poly.cell_data.items()}
    actives = poly.cell_data.active_scalars_name, poly.cell_data.active_normals_name
    poly.cell_data.clear()
    poly.strips = np.zeros(0, int)
    poly.faces = np.column_stack([np.full(len(faces), 3), faces]).ravel()
    poly.cell_data.update(columns)
    poly.cell_data.active_scalars_name, poly.cell_data.active_normals_name = actives
    return poly


def _as_triangles(data: pyvista.PolyData) -> tuple[Array, Array]:
    """Triangles (m, 3), and the polygon or strip of each, numbered from 0, in their order.

    Quads are cut from their first corner, as other readers do, and not along the shorter diagonal as VTK does: which one is
    shorter depends on the noise, and makes it look smaller than it is. Larger polygons and strips are cut by VTK.
    """
    polygons = data.GetPolys()
    ends = pyvista.convert_array(polygons.GetOffsetsArray()).astype(np.int64)
    corners = pyvista.convert_array(polygons.GetConnectivityArray()).astype(np.int64)
    sizes, each = np.diff(ends), np.arange(len(ends) - 1)
    three, four = each[sizes == 3], each[sizes == 4]
    quads = corners[ends[four][:, None] + np.arange(4)]
    halves = _halves(np.asarray(data.points, np.float64), quads)
    found = [corners[ends[three][:, None] + np.arange(3)], *halves]
    came = [three, four, four]
    others = each[sizes > 4]
    if len(others) or data.n_strips:
        rest = pyvista.PolyData(np.array(data.points))
        rest.verts = np.zeros(0, int)
        listed = [np.concatenate([[sizes[k]], corners[ends[k] : ends[k + 1]]]) for k in others]
        rest.faces, rest.strips = np.concatenate([*listed, np.zeros(0, int)]).astype(int), np.array(data.strips)
        rest.cell_data["came from"] = np.concatenate([others, len(each) + np.arange(data.n_strips)])
        cut = rest.triangulate()
        found.append(cut.faces.reshape(-1, 4)[:, 1:])
        came.append(np.asarray(cut.cell_data["came from"]))
    source = np.concatenate(came)
    order = np.argsort(source, kind="stable")
    return np.concatenate(found)[order], source[order]


def _halves(points: Array, quads: Array) -> tuple[Array, Array]:
    """Two triangles (m, 3) of each quad (m, 4): from its first corner, or from the second where the quad has a corner inwards."""
    one, two = quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]
    turned = np.einsum("ij,ij->i", *(_cross(points[half]) for half in (one, two))) < 0
    one, two = one.copy(), two.copy()
    one[turned], two[turned] = quads[turned][:, [0, 1, 3]], quads[turned][:, [1, 2, 3]]
    return one, two


def _cross(corners: Array) -> Array:
    """Twice the area of triangles (m, 3, 3), along their normals (m, 3)."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def _array_name(poly: pyvista.PolyData, name: str) -> str:
    if name == "colors":
        name = next((word for word in ("RGB", "RGBA") if word in poly.point_data), name)
    if name in poly.point_data:
        return name
    if name in poly.cell_data:
        raise InputError(
            f"channels={name!r}: an array of the cells; channels stand at points, take .cell_data_to_point_data()"
        )
    raise InputError(f"channels={name!r}: no such point array; there are {', '.join(poly.point_data.keys()) or 'none'}")


def _point_array(poly: pyvista.PolyData, name: str) -> Found:
    return (np.array(poly.point_data[name]) if name in poly.point_data else None), poly.point_data.keys()


def _normals_name(data: pyvista.DataSetAttributes) -> str | None:
    return data.active_normals_name or ("Normals" if "Normals" in data else None)


def _to_object(
    poly: pyvista.PolyData, triangles: tuple[Array, Array], skin: Skin, name: str | None, data: Mesh
) -> pyvista.PolyData:
    new = poly.copy(deep=True)
    points = skin.points_of(data)
    if skin.has_moved(data):
        new.points = points
        _renew_normals(new, *triangles, skin.points)
    values = skin.channels_of(data)
    if name is not None and values is not None:
        array = new.point_data[name]  # in place, so that the active array stays active
        array.reshape(len(array), -1)[:, : values.shape[1]] = fitted(values, array.dtype)
    return new


def _renew_normals(poly: pyvista.PolyData, faces: Array, source: Array, before: Array) -> None:
    """Recompute normals of points and cells, where the object has them; those of a polygon are the mean of its triangles.

    :param faces: (m, 3), triangles; ``source`` (m,), the polygon or strip of each.
    """
    name = _normals_name(poly.point_data)
    if name is not None:
        normals = poly.point_data[name]
        np.copyto(normals, normals_after(np.asarray(poly.points), faces, before, np.array(normals)))
    name = _normals_name(poly.cell_data)
    if name is not None:
        first = poly.n_verts + poly.n_lines
        rows = poly.cell_data[name][first:]
        cross = np.zeros((len(rows), 3))
        np.add.at(cross, source, _cross(np.asarray(poly.points, np.float64)[faces]))
        length = np.linalg.norm(cross, axis=1, keepdims=True)
        rows[:] = np.where(length > 0, cross / np.where(length > 0, length, 1), rows)
