"""Converts a mesh to another format, with a note on everything that the other format does not hold."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import trimesh
from trimesh.exchange.obj import export_obj
from trimesh.exchange.off import export_off

from meshflow.errors import FormatError
from meshflow.geometry.validation import Array
from meshflow.io.adapters.trimesh import carries, stored_normals
from meshflow.io.formats.scene_bytes import written
from meshflow.io.formats.vtk import save_polydata
from meshflow.io.vertex_merging import joined
from meshflow.surfaces.mesh import Mesh

if TYPE_CHECKING:
    import pyvista

__all__ = ["bare_scene", "save"]

# What the writer of each format keeps of a trimesh.Trimesh.
_HOLDS = {
    ".ply": {
        "vertex colours",
        "face colours",
        "texture coordinates",
        "vertex attributes",
        "face attributes",
        "vertex normals",
    },
    ".obj": {"vertex colours", "texture coordinates", "texture image", "materials", "vertex normals", "parts"},
    ".stl": set(),
    ".off": set(),
    ".glb": {
        "vertex colours",
        "texture coordinates",
        "texture image",
        "materials",
        "vertex attributes",
        "vertex normals",
        "parts",
    },
    ".vtp": {
        "vertex colours",
        "face colours",
        "texture coordinates",
        "vertex attributes",
        "face attributes",
        "vertex normals",
    },
}
_HOLDS[".gltf"], _HOLDS[".3mf"] = _HOLDS[".glb"], {"parts"}
_HOLDS[".vtk"] = _HOLDS[".vtu"] = _HOLDS[".vtp"]


def save(scene: trimesh.Scene, path: Path, target: Path, tags: Mapping[str, str]) -> tuple[str, ...]:
    """Write a scene at ``path``, which then becomes ``target``.

    :returns: notes on what is lost.
    :raises FormatError: when one OBJ would mix parts with and without texture, or existing files beside it differ.
    """
    suffix = target.suffix.lower()
    meshes = [mesh for mesh in scene.geometry.values() if isinstance(mesh, trimesh.Trimesh)]
    notes = list(_lost(meshes, suffix))
    if suffix in (".ply", ".stl", ".glb", ".gltf"):
        notes.extend(_rounded(meshes, suffix))
    if suffix == ".obj":
        notes.extend(_save_obj(scene, meshes, path, target))
        return tuple(notes)
    if suffix in (".glb", ".gltf", ".3mf"):
        path.write_bytes(written(scene, suffix))
        return tuple(notes)
    one = meshes[0] if len(meshes) == 1 and np.allclose(_frame(scene), np.eye(4), atol=0) else scene.to_mesh()
    if suffix == ".off" and carries(one):
        notes.append(
            f"{len(one.vertices)} vertices, split at seams that OFF does not hold, are joined again where they coincide"
        )
        first, home = joined(np.asarray(one.vertices))
        one = trimesh.Trimesh(np.asarray(one.vertices)[first], home[one.faces], process=False)
    if suffix in (".vtp", ".vtu", ".vtk"):
        save_polydata(_polydata(one), path, tags)
    elif suffix == ".off":
        path.write_text(export_off(one, digits=16))
    else:
        if suffix == ".ply":
            notes.extend(_prepare_ply(one))
        one.export(str(path), file_type=suffix[1:])
    return tuple(notes)


def bare_scene(data: Mesh) -> trimesh.Scene:
    """The scene of a mesh that was not read from a file, with its channels as the vertex attribute ``channels``."""
    channels: Any = {} if data.channels is None else {"channels": np.array(data.channels)}
    return trimesh.Scene(
        trimesh.Trimesh(np.array(data.points), np.array(data.faces), process=False, vertex_attributes=channels)
    )


def _frame(scene: trimesh.Scene) -> Array:
    nodes = scene.graph.nodes_geometry
    return scene.graph[nodes[0]][0] if len(nodes) else np.eye(4)


def _lost(meshes: list[Any], suffix: str) -> Iterator[str]:
    there: dict[str, None] = {}
    for mesh in meshes:
        material = getattr(mesh.visual, "material", None)
        image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
        blank = image is None or image.size == (2, 2)  # the placeholder of trimesh where there is no image
        features = {
            "vertex colours": mesh.visual.kind == "vertex" or "color" in getattr(mesh.visual, "vertex_attributes", {}),
            "face colours": mesh.visual.kind == "face",
            "texture coordinates": getattr(mesh.visual, "uv", None) is not None,
            "texture image": not blank,
            "materials": bool(getattr(material, "name", None))
            or getattr(material, "baseColorFactor", None) is not None,
            "vertex attributes": bool(mesh.vertex_attributes),
            "face attributes": bool(set(mesh.face_attributes) - {"stl"}),
            "vertex normals": stored_normals(mesh) is not None,
            "parts": len(meshes) > 1,
        }
        there |= dict.fromkeys(name for name, is_there in features.items() if is_there)
        # a mesh has one visual in trimesh: with texture coordinates, only GLB also gets vertex colours
        if features["texture coordinates"] and features["vertex colours"] and suffix not in (".glb", ".gltf"):
            yield f"{suffix[1:].upper()}: texture coordinates are written, the vertex colours beside them are not"
    lost = [name for name in there if name not in _HOLDS[suffix]]
    if lost:
        names = [f"{name} ({len(meshes)}, now one)" if name == "parts" else name for name in lost]
        yield f"{suffix[1:].upper()} does not hold: {', '.join(names)}"


def _rounded(meshes: list[trimesh.Trimesh], suffix: str) -> Iterator[str]:
    points = np.concatenate([mesh.vertices for mesh in meshes])
    error = float(np.abs(points.astype(np.float32) - points).max())
    if error:
        yield f"positions are rounded to float32 on the way to {suffix[1:].upper()}, by up to {error:.1g}; VTP keeps them"


def _prepare_ply(mesh: trimesh.Trimesh) -> Iterator[str]:
    """Replace names and types of attributes by those that the PLY writer of trimesh supports; the mesh is a copy."""
    for attributes in (mesh.vertex_attributes, mesh.face_attributes):
        for name in list(attributes):
            values = np.asarray(attributes.pop(name))
            word = "_".join(str(name).split()) or "unnamed"
            if values.dtype.kind not in "fiub" or values.ndim > 2 or values.dtype.itemsize > 8:
                yield f"PLY does not hold attribute {name} of type {values.dtype} and shape {values.shape}"
                continue
            if word != name:
                yield f"attribute {name!r} is called {word} in PLY"
            attributes[word] = values.astype(np.uint8) if values.dtype == bool else values


def _save_obj(scene: trimesh.Scene, meshes: list[trimesh.Trimesh], path: Path, target: Path) -> Iterator[str]:
    """Write an OBJ with its materials and images beside it; trimesh indexes all corners by their vertices."""
    uv = {getattr(mesh.visual, "uv", None) is not None for mesh in meshes}
    if len(uv) > 1:
        raise FormatError(
            f"{target.name}: parts with and without texture coordinates do not go into one OBJ; write .glb"
        )
    normals = all(stored_normals(mesh) is not None for mesh in meshes)
    text, files = export_obj(
        scene,
        include_normals=normals,
        digits=16,
        return_texture=True,
        write_texture=False,
        mtl_name=f"{target.stem}.mtl",
    )
    for name, content in files.items():
        beside = target.parent / name
        content = content if isinstance(content, bytes) else str(content).encode()
        if beside.exists() and beside.read_bytes() != content:
            raise FormatError(
                f"{beside} exists and differs from what belongs to {target.name}; write to another folder"
            )
        beside.write_bytes(content)
    path.write_text(text)
    if files:
        yield f"written beside {target.name}: {', '.join(files)}"


def _polydata(mesh: Any) -> "pyvista.PolyData":
    import pyvista

    poly = pyvista.PolyData.from_regular_faces(np.array(mesh.vertices), np.array(mesh.faces))
    for name, values in mesh.vertex_attributes.items():
        poly.point_data[name] = np.array(values)
    for name, values in mesh.face_attributes.items():
        poly.cell_data[name] = np.array(values)
    if mesh.visual.kind == "vertex":
        poly.point_data["RGBA"] = np.array(mesh.visual.vertex_colors)
    elif mesh.visual.kind == "face":
        poly.cell_data["RGBA"] = np.array(mesh.visual.face_colors)
    if getattr(mesh.visual, "uv", None) is not None:
        poly.active_texture_coordinates = np.array(mesh.visual.uv)
    normals = stored_normals(mesh)
    if normals is not None:
        poly.point_data["Normals"] = normals
    return poly
