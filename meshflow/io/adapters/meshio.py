"""Imports meshio.Mesh: triangles and quadrilaterals move; all blocks, data and sets are kept."""

from functools import partial
from typing import TYPE_CHECKING, cast

import numpy as np

from meshflow.errors import Fact, InputError, need
from meshflow.geometry.validation import Array
from meshflow.io.document import Imported
from meshflow.io.metadata import Found, ReadOptions
from meshflow.io.vertex_merging import Skin, fitted, is_soup, normals_after
from meshflow.surfaces.mesh import Mesh

if TYPE_CHECKING:
    import meshio

__all__ = ["from_object"]

# Blocks of lower dimension, which follow their points.
_FOLLOW = ("vertex", "line")
_NORMALS = ("Normals", "normals")


def from_object(data: object, options: ReadOptions) -> Imported:
    """Import a meshio.Mesh; results are new ones with the same cells.

    The surface consists of the triangles, and of quadrilaterals as two triangles each; vertices and lines follow their points.
    Normals in the point data are recomputed.

    :param options: ``channels`` (n, k), or the name of point data, which is then updated; ``moves``.
    :raises InputError: for a point cloud, solid or curved cells, an unknown name, or an option that does not apply.
    """
    options.must_be_mesh("a meshio mesh")
    mesh = _mesh(data).copy()
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
