"""Meshes of tetrahedra in files: VTU and VTK (which are read with the surfaces of VTK), and MSH of Gmsh (meshio)."""

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import FormatError, InputError, need
from meshflow.io.atomic_write import beside
from meshflow.io.document import Document, Imported, Source, WriteOptions
from meshflow.io.formats.vtk_writing import save_data
from meshflow.io.metadata import ReadOptions
from meshflow.surfaces.data import Data
from meshflow.surfaces.tet_mesh import TetMesh

if TYPE_CHECKING:
    import meshio
    import pyvista

__all__ = ["Body", "can_write", "read", "write"]

# What the reader raises for invalid files.
BROKEN = (
    OSError,
    ValueError,
    LookupError,
    AttributeError,
    AssertionError,
    TypeError,
    ArithmeticError,
    MemoryError,
    struct.error,
)
NAME: str = "a mesh of Gmsh"
READS: tuple[str, ...] = ("kind", "channels", "moves")
WRITES: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Body(Source):
    """A grid of VTK, or a mesh of meshio, that was read.

    :param imported: with the way back.
    :param version: of MSH: the name of its format in meshio, and whether it is binary.
    """

    imported: Imported
    version: tuple[str, bool] = ("gmsh", True)

    def samples(self, given: ArrayLike | None, word: str) -> ArrayLike | None:
        """An array of one number per vertex, unchanged, or by the name of an array of the points."""
        return self.imported.samples(given, word)


def read(path: Path, options: ReadOptions) -> Document:
    """Read a MSH: a body, of which an array of the points moves, or a surface of triangles.

    :param options: ``channels``, the name of point data; ``moves`` of a surface.
    :raises MissingPackage: without meshio.
    :raises FormatError: for a file that cannot be read.
    """
    meshio = need("meshio", "meshio")
    from meshflow.io.adapters.meshio import from_object

    try:
        begin = path.read_bytes()[:64].split()
        mesh = meshio.gmsh.read(str(path))
    except (meshio.ReadError, *BROKEN) as cause:
        reason = " ".join(str(cause).split())[:200] or type(cause).__name__
        raise FormatError(f"{path.name} cannot be read as MSH ({reason})") from cause
    version = ("gmsh22" if begin[1:2] and begin[1].startswith(b"2") else "gmsh", begin[2:3] == [b"1"])
    imported = from_object(mesh, options.without("kind"))
    return Document(imported.data, path, Body(imported, version), imported.notes)


def can_write(document: Document, suffix: str) -> bool:
    """Whether the document is a body, or a surface that came from such a file and goes to one."""
    return isinstance(document.data, TetMesh) or (suffix == ".msh" and isinstance(document.source, Body))


def write(document: Document, path: Path, options: WriteOptions) -> tuple[str, ...]:
    """Write a body with everything that its file held.

    :param options: tags are kept as field data (VTU, VTK).
    :returns: notes on what the format does not hold.
    :raises FormatError: when the file cannot be written.
    """
    source = document.source if isinstance(document.source, Body) else None
    made: Any = _of_values(document.data) if source is None else source.imported.to_object(document.data)
    with beside(path) as temporary:
        if path.suffix.lower() == ".msh":
            _save_msh(made, temporary, source.version if source else ("gmsh", True))
            return (f"{path.name}: MSH does not hold the parameters of the run",) if options.tags else ()
        save_data(_tagged(made, options.tags), temporary)
    return ()


def _tagged(made: "pyvista.DataSet | meshio.Mesh", tags: Mapping[str, str]) -> "pyvista.UnstructuredGrid":
    """A body for VTK, with tags as field data."""
    import pyvista

    grid = made if isinstance(made, pyvista.DataSet) else pyvista.from_meshio(made)
    if not isinstance(grid, pyvista.UnstructuredGrid):
        raise InputError(f"a body of cells expected for VTK, got a {type(grid).__name__}")
    for name, word in tags.items():
        grid.add_field_data([str(word)], name if name.startswith("meshflow:") else f"meshflow:{name}")
    return grid


def _save_msh(made: "pyvista.UnstructuredGrid | meshio.Mesh", path: Path, version: tuple[str, bool]) -> None:
    """Write a MSH by meshio.

    :raises FormatError: for data that it does not hold.
    """
    import pyvista

    meshio = need("meshio", "meshio")
    mesh = _as_meshio(made) if isinstance(made, pyvista.UnstructuredGrid) else made.copy()
    if "gmsh:physical" not in mesh.cell_data:  # the writer of MSH 4 asks for it beside these
        mesh.point_data.pop("gmsh:dim_tags", None)
        mesh.cell_data.pop("gmsh:geometrical", None)
    try:
        meshio.write(str(path), mesh, file_format=version[0], binary=version[1])
    except (meshio.WriteError, ValueError, LookupError) as cause:
        reason = " ".join(str(cause).split())[:200]
        raise FormatError(f"{path.name}: meshio does not write it as MSH ({reason}); write .vtu") from cause


def _as_meshio(grid: "pyvista.UnstructuredGrid") -> Any:
    """A grid of VTK as a mesh of meshio, with the arrays of its points."""
    meshio = need("meshio", "meshio")
    names = {
        10: "tetra",
        12: "hexahedron",
        13: "wedge",
        14: "pyramid",
        3: "line",
        5: "triangle",
        9: "quad",
        1: "vertex",
    }
    found = []
    for kind, corners in grid.cells_dict.items():
        corners = np.asarray(corners)[:, [0, 1, 3, 2, 4, 5, 7, 6]] if kind == 11 else corners
        name = names.get(12 if kind == 11 else int(kind))
        if name is None:
            raise FormatError(f"MSH: cells of kind {kind} of VTK are not written; write .vtu")
        found.append((name, corners))
    arrays = {name: np.array(values) for name, values in grid.point_data.items()}
    return meshio.Mesh(np.array(grid.points), found, point_data=arrays)


def _of_values(data: Data) -> "pyvista.UnstructuredGrid":
    """A grid of VTK with the values of a data object that came from no file.

    :raises InputError: for points outside of R^3.
    """
    import pyvista

    if not isinstance(data, TetMesh) or data.points.shape[1] != 3:
        raise InputError(f"tetrahedra with points in R^3 expected, got {data!r}; keep others as .npz")
    grid = pyvista.UnstructuredGrid({pyvista.CellType.TETRA: np.array(data.tetrahedra)}, np.array(data.points))
    grid.point_data["values"] = np.array(data.values)
    return grid
