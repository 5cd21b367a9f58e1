"""trimesh.Trimesh in, a new trimesh.Trimesh out."""

from functools import partial
from typing import Any

import numpy as np
import trimesh

from meshflow.errors import InputError
from meshflow.geometry.validation import Array
from meshflow.io.metadata import Found, belong, must_be_mesh
from meshflow.io.objects import Adopted
from meshflow.io.vertex_merging import Skin, fitted, is_soup, normals_after
from meshflow.surfaces.lift import Mesh

__all__ = ["adopt", "attribute_of", "carries", "channel_of", "stored_normals", "with_changes"]


def adopt(
    thing: Any, *, channels: Any = None, moves: Any = None, fixed: Any = None, kind: Any = None, **other: Any
) -> Adopted:
    """Take a Trimesh in; what comes back is a new one with colours, attributes, texture and metadata of the first.

    :param channels: (n, k), or the name of a vertex attribute, or ``"colors"``; a named one returns to where it was.
    :param moves: ``points | channels | all``.
    :param fixed: (n,), vertices that stay.
    :raises InputError: for a Scene or a PointCloud, an unknown name, or a hint that does not belong.
    """
    belong(other, "a trimesh mesh", ("channels", "moves", "fixed"))
    must_be_mesh(kind, "a trimesh mesh")
    _must_be_trimesh(thing)
    mesh = thing.copy()
    normals = stored_normals(thing)
    name = channels if isinstance(channels, str) else None
    values: Any = channel_of(mesh, name) if name is not None else channels
    skin = Skin.of(mesh.vertices, mesh.faces, split=carries(mesh), channels=values, moves=moves, fixed=fixed)
    samples = partial(skin.samples, find=partial(attribute_of, mesh))
    return Adopted(skin.noun, partial(_restored, mesh, normals, skin, name), skin.note, samples)


def carries(mesh: Any) -> bool:
    """Whether the mesh has vertices that are split: it carries texture coordinates, or is a soup of triangles.

    (Normals do not count here: trimesh makes them whenever somebody looks.)
    """
    return getattr(mesh.visual, "uv", None) is not None or is_soup(np.asarray(mesh.faces), len(mesh.vertices))


def stored_normals(mesh: Any) -> Array | None:
    """Vertex normals (n, 3) if the mesh has them now; the exporters of trimesh ask its cache in the same way."""
    return np.array(mesh.vertex_normals) if "vertex_normals" in mesh._cache.cache else None


def attribute_of(mesh: Any, name: str) -> Found:
    """A vertex attribute, or None, and the names of those that there are."""
    return mesh.vertex_attributes.get(name), mesh.vertex_attributes


def channel_of(mesh: Any, name: str) -> Array:
    """A vertex attribute by its name, or the colours (n, 3) as ``"colors"``.

    :raises InputError: when the mesh has no such attribute; the message names those that it has.
    """
    if name == "colors":
        colors = _colors(mesh)
        if colors is not None:
            return np.array(colors[:, :3])
    elif name in mesh.vertex_attributes:
        return np.array(mesh.vertex_attributes[name])
    there = [*mesh.vertex_attributes, *(["colors"] if _colors(mesh) is not None else [])]
    raise InputError(
        f"channels={name!r}: the mesh has no such vertex attribute; it has {', '.join(map(str, there)) or 'none'}"
    )


def with_changes(mesh: Any, points: Array | None, normals: Array | None, name: str | None, values: Array | None) -> Any:
    """A copy with other positions, and other values of a named channel; whatever else it has is copied.

    :param points: (n, 3), or None where they stay.
    :param normals: those that the mesh had, recomputed if the points are given.
    :param values: (n, k) of the channel ``name``; colours are rounded and clipped, alpha stays.
    """
    new = mesh.copy()
    if points is not None:
        new.vertices = points
        if normals is not None:
            normals = normals_after(points, np.asarray(mesh.faces), np.asarray(mesh.vertices), normals)
    if name == "colors" and values is not None:
        colors = _colors(new)
        assert colors is not None
        colors = np.array(colors)
        colors[:, :3] = fitted(values, colors.dtype)
        if new.visual.kind == "texture":
            new.visual.vertex_attributes["color"] = colors
        else:
            new.visual.vertex_colors = colors
    elif name is not None and values is not None:
        old = new.vertex_attributes[name]
        new.vertex_attributes[name] = fitted(values, old.dtype).reshape(old.shape)
    if normals is not None:
        new.vertex_normals = normals
    return new


def _colors(mesh: Any) -> Array | None:
    """Vertex colours, wherever trimesh keeps them: in the visual, or beside the texture coordinates."""
    if mesh.visual.kind == "vertex":
        return np.asarray(mesh.visual.vertex_colors)
    if mesh.visual.kind == "texture":
        return mesh.visual.vertex_attributes.get("color")
    return None


def _restored(mesh: Any, normals: Array | None, skin: Skin, name: str | None, noun: Mesh) -> Any:
    points = skin.points_of(noun) if skin.has_moved(noun) else None
    return with_changes(mesh, points, normals, name, skin.channels_of(noun))


def _must_be_trimesh(thing: Any) -> None:
    if isinstance(thing, trimesh.Scene):
        raise InputError(
            f"trimesh.Scene of {len(thing.geometry)} parts: one trimesh.Trimesh expected here; meshflow.smooth takes scenes "
            "part by part, or all as one with scene.to_mesh()"
        )
    if isinstance(thing, trimesh.PointCloud):
        raise InputError(
            f"trimesh.PointCloud of {len(thing.vertices)} points: a mesh with triangles expected; a cloud has no "
            "surface, reconstruct one first (open3d: create_from_point_cloud_poisson)"
        )
    if not isinstance(thing, trimesh.Trimesh):
        raise InputError(
            f"trimesh.{type(thing).__name__}: a trimesh.Trimesh expected; a path or a voxel grid is no surface"
        )
