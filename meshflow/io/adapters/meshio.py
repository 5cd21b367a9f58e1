"""meshio.Mesh in, a new one out: triangles and quadrilaterals move, all its blocks, data and sets stay."""

from functools import partial
from typing import Any

import numpy as np

from meshflow.errors import InputError, need
from meshflow.geometry.validation import Array
from meshflow.io.metadata import Found, belong, must_be_mesh
from meshflow.io.objects import Adopted
from meshflow.io.vertex_merging import Skin, fitted, is_soup, normals_after
from meshflow.surfaces.lift import Mesh

__all__ = ["adopt"]

# Blocks that are no surface and have no inside: they follow their points.
_FOLLOW = ("vertex", "line")
_NORMALS = ("Normals", "normals")


def adopt(
    thing: Any, *, channels: Any = None, moves: Any = None, fixed: Any = None, kind: Any = None, **other: Any
) -> Adopted:
    """Take a meshio.Mesh in; what comes back is a new one, whose cells are as they were.

    Triangles, and quadrilaterals as two of them each, span the surface; vertices and lines follow their points. Normals among the
    point data are recomputed.

    :param channels: (n, k), or the name of point data, which returns to where it was.
    :param moves: ``points | channels | all``.
    :param fixed: (n,), vertices that stay.
    :raises InputError: for a cloud, solid or curved cells, with the way out, an unknown name, or a hint that does not belong.
    """
    belong(other, "a meshio mesh", ("channels", "moves", "fixed"))
    must_be_mesh(kind, "a meshio mesh")
    if not isinstance(thing, need("meshio", "meshio").Mesh):
        raise InputError(f"meshio.{type(thing).__name__}: a meshio.Mesh expected")
    mesh = thing.copy()
    faces, quads = _triangles(mesh)
    name = channels if isinstance(channels, str) else None
    values: Any = channels
    if name is not None:
        values, there = _point_data(mesh, name)
        if values is None:
            raise InputError(f"channels={name!r}: no such point data; there are {', '.join(there) or 'none'}")
    split = any(word in mesh.point_data for word in _NORMALS) or is_soup(faces, len(mesh.points))
    skin = Skin.of(mesh.points, faces, split=split, channels=values, moves=moves, fixed=fixed)
    notes = (*skin.note, *((f"{quads} quadrilaterals are smoothed as two triangles each",) if quads else ()))
    samples = partial(skin.samples, find=partial(_point_data, mesh))
    return Adopted(skin.noun, partial(_restored, mesh, skin, name), notes, samples)


def _triangles(mesh: Any) -> tuple[Array, int]:
    """Triangles (m, 3) of all blocks that are a surface, and how many quadrilaterals are among them.

    :raises InputError: for blocks that are neither a surface nor follow one.
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


def _point_data(mesh: Any, name: str) -> Found:
    found = mesh.point_data.get(name)
    return (None if found is None else np.array(found)), mesh.point_data


def _restored(mesh: Any, skin: Skin, name: str | None, noun: Mesh) -> Any:
    new = mesh.copy()
    if skin.has_moved(noun):
        new.points = skin.points_of(noun)
        for word in _NORMALS:
            if word in new.point_data and new.points.shape[1] == 3:
                normals = np.asarray(new.point_data[word])
                new.point_data[word] = normals_after(new.points, skin.faces, skin.points, normals)
    values = skin.channels_of(noun)
    if name is not None and values is not None:
        old = np.asarray(new.point_data[name])
        new.point_data[name] = fitted(values, old.dtype).reshape(old.shape)
    return new
