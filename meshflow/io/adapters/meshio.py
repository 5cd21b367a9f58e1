"""Imports meshio.Mesh: triangles and quadrilaterals move, of solid cells the values; all blocks, data and sets are kept."""

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import Fact, InputError, need
from meshflow.geometry.splitting import CellKind, split
from meshflow.geometry.validation import Array
from meshflow.io.document import Imported
from meshflow.io.metadata import Found, ReadOptions, looked_up
from meshflow.io.vertex_merging import Skin, fitted, is_soup, normals_after
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.tet_mesh import TetMesh

if TYPE_CHECKING:
    import meshio

__all__ = ["from_object"]

# Blocks of lower dimension, which follow their points.
_FOLLOW = ("vertex", "line")
# Blocks of cells that fill space, and the names under which they are split.
_SOLID: Mapping[str, CellKind] = {
    "tetra": "tetrahedron",
    "hexahedron": "hexahedron",
    "wedge": "wedge",
    "pyramid": "pyramid",
}
_NORMALS = ("Normals", "normals")


def from_object(data: object, options: ReadOptions) -> Imported:
    """Import a meshio.Mesh; results are new ones with the same cells.

    Of tetrahedra, hexahedra, wedges and pyramids an array of the points moves; the points stay.

    The surface consists of the triangles, and of quadrilaterals as two triangles each; vertices and lines follow their points.
    Normals in the point data are recomputed.

    :param options: ``channels`` (n, k), or the name of point data, which is then updated; ``moves``.
    :raises InputError: for a point cloud, solid or curved cells, an unknown name, or an option that does not apply.
    """
    if options.kind != "tetrahedra":
        options.must_be_mesh("a meshio mesh")
    mesh = _mesh(data).copy()
    if any(block.type in _SOLID for block in mesh.cells):
        return _body(mesh, options)
    faces, quads = _triangles(mesh)
    name, values = options.attribute, options.channels
    if name is not None:
        values, there = _point_data(mesh, name)
        if values is None:
            raise InputError(f"channels={name!r}: no such point data; there are {', '.join(there) or 'none'}")
    split = any(word in mesh.point_data for word in _NORMALS) or is_soup(faces, len(mesh.points))
    skin = Skin.of(mesh.points, faces, split=split, channels=values, moves=options.moves)
    notes = (*skin.note, *((Fact(f"{quads} quadrilaterals are smoothed as two triangles each"),) if quads else ()))
    samples = partial(skin.samples, find=partial(_point_data, mesh))
    return Imported(skin.data, partial(_to_object, mesh, skin, name), notes, samples)


def _mesh(data: object) -> "meshio.Mesh":
    if isinstance(data, need("meshio", "meshio").Mesh):
        return cast("meshio.Mesh", data)
    raise InputError(f"meshio.{type(data).__name__}: a meshio.Mesh expected")


def _body(mesh: "meshio.Mesh", options: ReadOptions) -> Imported:
    """The import of values on solid cells; blocks of fewer dimensions follow their points.

    :raises InputError: for curved cells beside them, and if it is not clear which array moves.
    """
    others = [block.type for block in mesh.cells if block.type not in (*_SOLID, *_FOLLOW, "triangle", "quad")]
    if others:
        raise InputError(
            f"meshio.Mesh with cells {others[0]}: tetra, hexahedron, wedge and pyramid expected; make others linear"
        )
    options.must_belong("a meshio mesh of solid cells, of which an array of the points moves", ("kind", "channels"))
    there = {name: array for name, array in mesh.point_data.items() if np.asarray(array).dtype.kind == "f"}
    name = options.attribute or (next(iter(there)) if len(there) == 1 else None)
    if name is None or name not in mesh.point_data:
        raise InputError(
            f"channels={name or '...'!r}: the name of point data expected, which moves on solid cells; there are "
            f"{', '.join(mesh.point_data) or 'none'}. For the surface alone take "
            "pyvista.from_meshio(mesh).extract_surface().triangulate()"
        )
    cells = [split(_SOLID[block.type], np.asarray(block.data)) for block in mesh.cells if block.type in _SOLID]
    values = np.array(mesh.point_data[name])
    data = TetMesh(mesh.points, np.concatenate(cells), values[:, 0] if values.shape[1:] == (1,) else values)
    key = name

    def to_object(smoothed: TetMesh) -> "meshio.Mesh":
        """The mesh with another array."""
        new = mesh.copy()
        new.point_data[key] = np.array(smoothed.values).reshape(values.shape)
        return new

    def samples(given: ArrayLike | None, word: str) -> ArrayLike | None:
        """One number per vertex: the array of a name, or as it is."""
        return looked_up(given, word, _point_data(mesh, given)) if isinstance(given, str) else given

    return Imported(data, to_object, (), samples)


def _triangles(mesh: "meshio.Mesh") -> tuple[Array, int]:
    """Triangles (m, 3) of all surface blocks, and the number of quadrilaterals among them.

    :raises InputError: for blocks of solid, curved or many-sided cells.
    """
    faces, quads = [np.zeros((0, 3), np.int64)], 0
    for block in mesh.cells:
        if block.type == "triangle":
            faces.append(block.data)
        elif block.type == "quad":
            faces += [block.data[:, [0, 1, 2]], block.data[:, [0, 2, 3]]]
            quads += len(block.data)
        elif block.type not in _FOLLOW:
            raise InputError(
                f"meshio.Mesh with {len(block.data)} cells {block.type}: triangles and quadrilaterals expected; of solid, curved "
                "or many-sided cells take the surface: pyvista.from_meshio(mesh).extract_surface().triangulate()"
            )
    joined = np.concatenate(faces)
    if not len(joined):
        raise InputError(
            f"meshio.Mesh of {len(mesh.points)} points without triangles: a cloud has no surface, reconstruct one first "
            "(pyvista.wrap(points).reconstruct_surface())"
        )
    return joined, quads


def _point_data(mesh: "meshio.Mesh", name: str) -> Found:
    found = mesh.point_data.get(name)
    return (None if found is None else np.array(found)), mesh.point_data


def _to_object(mesh: "meshio.Mesh", skin: Skin, name: str | None, data: Mesh) -> "meshio.Mesh":
    new = mesh.copy()
    if skin.has_moved(data):
        new.points = skin.points_of(data)
        for word in _NORMALS:
            if word in new.point_data and new.points.shape[1] == 3:
                normals = np.asarray(new.point_data[word])
                new.point_data[word] = normals_after(new.points, skin.faces, skin.points, normals)
    values = skin.channels_of(data)
    if name is not None and values is not None:
        old = np.asarray(new.point_data[name])
        new.point_data[name] = fitted(values, old.dtype).reshape(old.shape)
    return new
