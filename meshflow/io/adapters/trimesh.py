"""trimesh.Trimesh in, a new trimesh.Trimesh out."""

from functools import partial

import numpy as np
import trimesh
from trimesh.visual import ColorVisuals, TextureVisuals

from meshflow.errors import InputError
from meshflow.geometry.validation import Array
from meshflow.io.document import Imported
from meshflow.io.metadata import Found, ReadOptions
from meshflow.io.vertex_merging import Skin, fitted, is_soup, normals_after
from meshflow.surfaces.mesh import Mesh

__all__ = ["attribute_of", "carries", "channel_of", "from_object", "stored_normals", "with_changes"]


def from_object(data: object, options: ReadOptions) -> Imported:
    """Take a Trimesh in; what comes back is a new one with colours, attributes, texture and metadata of the first.

    :param options: ``channels`` (n, k), or the name of a vertex attribute, or ``"colors"``: a named one returns to where it was;
        ``moves``.
    :raises InputError: for a Scene or a PointCloud, an unknown name, or an option that does not belong.
    """
    options.must_be_mesh("a trimesh mesh")
    read = _trimesh(data)
    mesh = read.copy()
    normals = stored_normals(read)
    name = options.attribute
    values = channel_of(mesh, name) if name is not None else options.channels
    skin = Skin.of(mesh.vertices, mesh.faces, split=carries(mesh), channels=values, moves=options.moves)
    samples = partial(skin.samples, find=partial(attribute_of, mesh))
    return Imported(skin.data, partial(_to_object, mesh, normals, skin, name), skin.note, samples)


def carries(mesh: trimesh.Trimesh) -> bool:
    """Whether the mesh has vertices that are split: it carries texture coordinates, or is a soup of triangles.

    (Normals do not count here: trimesh makes them whenever somebody looks.)
    """
    return getattr(mesh.visual, "uv", None) is not None or is_soup(np.asarray(mesh.faces), len(mesh.vertices))


def stored_normals(mesh: trimesh.Trimesh) -> Array | None:
    """Vertex normals (n, 3) if the mesh has them now; the exporters of trimesh ask its cache in the same way."""
    return np.array(mesh.vertex_normals) if "vertex_normals" in mesh._cache.cache else None


def attribute_of(mesh: trimesh.Trimesh, name: str) -> Found:
    """A vertex attribute, or None, and the names of those that there are."""
    return mesh.vertex_attributes.get(name), mesh.vertex_attributes


def channel_of(mesh: trimesh.Trimesh, name: str) -> Array:
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


def with_changes(
    mesh: trimesh.Trimesh, points: Array | None, normals: Array | None, name: str | None, values: Array | None
) -> trimesh.Trimesh:
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
        colors = np.array(_colors(new))
        colors[:, :3] = fitted(values, colors.dtype)
        if isinstance(new.visual, TextureVisuals):
            new.visual.vertex_attributes["color"] = colors
        elif isinstance(new.visual, ColorVisuals):
            new.visual.vertex_colors = colors
    elif name is not None and values is not None:
        old = new.vertex_attributes[name]
        new.vertex_attributes[name] = fitted(values, old.dtype).reshape(old.shape)
    if normals is not None:
        new.vertex_normals = normals
    return new


def _colors(mesh: trimesh.Trimesh) -> Array | None:
    """Vertex colours, wherever trimesh keeps them: in the visual, or beside the texture coordinates."""
    visual = mesh.visual
    if isinstance(visual, TextureVisuals):
        return visual.vertex_attributes.get("color")
    return np.asarray(visual.vertex_colors) if isinstance(visual, ColorVisuals) and visual.kind == "vertex" else None


def _to_object(
    mesh: trimesh.Trimesh, normals: Array | None, skin: Skin, name: str | None, data: Mesh
) -> trimesh.Trimesh:
    points = skin.points_of(data) if skin.has_moved(data) else None
    return with_changes(mesh, points, normals, name, skin.channels_of(data))


def _trimesh(data: object) -> trimesh.Trimesh:
    """The mesh, or a word on what came instead."""
    if isinstance(data, trimesh.Scene):
        raise InputError(
            f"trimesh.Scene of {len(data.geometry)} parts: one trimesh.Trimesh expected here; meshflow.smooth takes scenes "
            "part by part, or all as one with scene.to_mesh()"
        )
    if isinstance(data, trimesh.PointCloud):
        raise InputError(
            f"trimesh.PointCloud of {len(data.vertices)} points: a mesh with triangles expected; a cloud has no "
            "surface, reconstruct one first (open3d: create_from_point_cloud_poisson)"
        )
    if not isinstance(data, trimesh.Trimesh):
        raise InputError(
            f"trimesh.{type(data).__name__}: a trimesh.Trimesh expected; a path or a voxel grid is no surface"
        )
    return data
