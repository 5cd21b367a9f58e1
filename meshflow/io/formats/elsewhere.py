"""Formats that are read neither here nor by GDAL, each with advice on its conversion to a surface."""

from pathlib import Path

from meshflow.errors import FormatError
from meshflow.io.suffixes import suffix_of

__all__ = ["CLOUD", "must_be_known", "said_of"]

CLOUD = "a point cloud has no surface; reconstruct one first (open3d: create_from_point_cloud_poisson), or rasterize it (PDAL)"
_SCENE = "export it as .glb first (Blender)"
_CAD = "it contains curves and no triangles; mesh it first (FreeCAD, Gmsh), as .stl or .ply"
_MESHIO = "read it with meshio: meshflow.smooth(meshio.read(path))"
_PYVISTA = "read it with pyvista: meshflow.smooth(pyvista.read(path))"
_ARCHIVE = "unpack it first"
_KNOWN = {
    ".las": ("a lidar cloud", CLOUD),
    ".laz": ("a lidar cloud", CLOUD),
    ".pts": ("a point cloud", CLOUD),
    ".ptx": ("a point cloud", CLOUD),
    ".dae": ("a scene of COLLADA", _SCENE),
    ".fbx": ("a scene of FBX", _SCENE),
    ".blend": ("a scene of Blender", _SCENE),
    ".usd": ("a scene of USD", _SCENE),
    ".usdz": ("a scene of USD", _SCENE),
    ".step": ("a CAD model", _CAD),
    ".stp": ("a CAD model", _CAD),
    ".iges": ("a CAD model", _CAD),
    ".igs": ("a CAD model", _CAD),
    ".inp": ("a mesh of Abaqus", _MESHIO),
    ".xdmf": ("a mesh in XDMF", _MESHIO),
    ".vti": ("a grid of VTK", _PYVISTA),
    ".vts": ("a grid of VTK", _PYVISTA),
    ".vtr": ("a grid of VTK", _PYVISTA),
    ".pvtp": ("pieces of VTK", _PYVISTA),
    ".7z": ("an archive", _ARCHIVE),
    ".gz": ("an archive", _ARCHIVE),
}
# GDAL reads some of these: grids as lines of x, y, z.
_PERHAPS = {
    ".xyz": ("a point cloud, not a grid in rows", f"{CLOUD}; heights over x and y are read with kind='terrain'"),
    ".zip": ("an archive", _ARCHIVE),
}


def must_be_known(path: Path) -> None:
    """Refuse a file whose extension is that of an unsupported format.

    :raises FormatError: with the format and advice.
    """
    suffix = suffix_of(path)
    if suffix in _KNOWN:
        what, advice = _KNOWN[suffix]
        raise FormatError(f"{path.name}: {what}, which is not read; {advice}")


def said_of(path: Path) -> str:
    """Advice on a file that GDAL could not read either; empty if there is none."""
    what, advice = _PERHAPS.get(path.suffix.lower(), ("", ""))
    return f"{what}: {advice}" if what else ""
