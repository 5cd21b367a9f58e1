"""VTP, VTU and VTK: read and written by VTK through pyvista; arrays keep their types."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import FormatError
from meshflow.io.adapters.pyvista import from_object, triangulated
from meshflow.io.document import Document, Imported, MeshSource
from meshflow.io.formats.bodies import Body
from meshflow.io.formats.vtk_process import Other, read_apart
from meshflow.io.formats.vtk_writing import save_data
from meshflow.io.metadata import ReadOptions
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.tet_mesh import TetMesh

if TYPE_CHECKING:
    import pyvista
    import trimesh

__all__ = ["VtkFile", "read", "save_polydata", "scene_mesh"]


@dataclass(frozen=True, eq=False)
class VtkFile(MeshSource):
    """A polygonal mesh of VTK that was read."""

    imported: Imported

    def writes(self, suffix: str) -> bool:
        """Whether it is ``.vtp``, ``.vtu`` or ``.vtk``."""
        return suffix in (".vtp", ".vtu", ".vtk")

    def samples(self, given: ArrayLike | None, word: str) -> ArrayLike | None:
        """An array of one number per vertex, unchanged, or by the name of a point array."""
        return self.imported.samples(given, word)

    def save(self, data: Mesh, path: Path, target: Path, tags: Mapping[str, str]) -> tuple[str, ...]:
        """Write the mesh with all its arrays; tags become field data."""
        save_polydata(self.imported.to_object(data), path, tags)
        return ()

    def scene(self, data: Mesh) -> "trimesh.Scene":
        """The mesh as a scene of one part."""
        import trimesh

        return trimesh.Scene(scene_mesh(self.imported.to_object(data)))


def scene_mesh(poly: "pyvista.PolyData") -> "trimesh.Trimesh":
    """A PolyData as a ``trimesh.Trimesh``: point and cell data are attributes, RGB and RGBA colours."""
    import trimesh
    from trimesh.visual import TextureVisuals

    poly = poly if poly.is_all_triangles else triangulated(poly)
    mesh: Any = trimesh.Trimesh(np.array(poly.points), np.array(poly.regular_faces), process=False)
    uv = poly.active_texture_coordinates
    for name in poly.point_data:
        values = np.array(poly.point_data[name])
        if name == "Normals":
            mesh.vertex_normals = values
        elif name in ("RGB", "RGBA") and values.dtype == np.uint8:
            mesh.visual.vertex_colors = values
        elif uv is None or not np.array_equal(values, uv):
            mesh.vertex_attributes[name] = values
    for name in poly.cell_data:
        mesh.face_attributes[name] = np.array(poly.cell_data[name])
    if uv is not None:
        mesh.visual = TextureVisuals(uv=np.array(uv))
    return mesh


def save_polydata(poly: "pyvista.PolyData", path: Path, tags: Mapping[str, str]) -> None:
    """Write a PolyData, tags as field data; as ``.vtu`` it is an UnstructuredGrid."""
    for name, word in tags.items():
        poly.add_field_data([str(word)], f"meshflow:{name}")
    save_data(poly, path)


def read(path: Path, options: ReadOptions) -> Document:
    """Read a VTP, a VTU whose cells lie on a surface or fill a body, or a legacy VTK file.

    :raises FormatError: for a damaged file, and for data sets other than surfaces.
    :raises InputError: for channels that it does not have, or whatever the data object refuses.
    """
    found = read_apart(path, "is it complete, and is its extension right?")
    if isinstance(found, Other):
        why = f", {found.why}" if found.why else ""
        raise FormatError(
            f"{path.name}: polygons (PolyData) expected, got {found.kind}{why}; open it with pyvista.read and "
            "hand the object over, or take its surface: .extract_surface().triangulate().save('surface.vtp')"
        )
    imported = from_object(found, options.without("kind", "allow_remote"))
    if isinstance(imported.data, TetMesh):
        return Document(imported.data, path, Body(imported), imported.notes)
    return Document(imported.data, path, VtkFile(imported), imported.notes)
