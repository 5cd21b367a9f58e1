"""Imports trimesh.Trimesh; results are new ones."""

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
    """Import a Trimesh; results are new ones with its colours, attributes, texture and metadata.

    :param options: ``channels`` (n, k), or the name of a vertex attribute, or ``"colors"``: a named one is then updated;
        ``moves``.
    :raises InputError: for a Scene or a PointCloud, an unknown name, or an option that does not apply.
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
    """Whether the mesh has split vertices: it has texture coordinates, or its triangles are not connected.

    Normals do not count, because trimesh computes them on access.
    """
    return getattr(mesh.visual, "uv", None) is not None or is_soup(np.asarray(mesh.faces), len(mesh.vertices))


def stored_normals(mesh: trimesh.Trimesh) -> Array | None:
    """Vertex normals (n, 3) if they are in the cache of the mesh, which the exporters of trimesh also look at."""
    return np.array(mesh.vertex_normals) if "vertex_normals" in mesh._cache.cache else None


def attribute_of(mesh: trimesh.Trimesh, name: str) -> Found:
    """A vertex attribute or None, and the existing names."""
    return mesh.vertex_attributes.get(name), mesh.vertex_attributes


def channel_of(mesh: trimesh.Trimesh, name: str) -> Array:
    """A vertex attribute by its name, or the colours (n, 3) as ``"colors"``.

    :raises InputError: when the mesh has no such attribute; the message lists the existing ones.
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
    """A copy with other positions and other values of a named channel.

    :param points: (n, 3), or None where they do not change.
    :param normals: those of the mesh, recomputed if points are given.
    :param values: (n, k) of the channel ``name``; colours are rounded and clipped, alpha is kept.
    """
    new = mesh.copy()
    if isinstance(mesh.visual, TextureVisuals) and isinstance(new.visual, TextureVisuals):
        for word, beside in mesh.visual.vertex_attributes.items():  # which its copy leaves out
            if word != "uv":
                new.visual.vertex_attributes[word] = np.array(beside)
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
    """Vertex colours, from the visual or from the attributes beside texture coordinates."""
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
    """Check that an object is a Trimesh."""
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
