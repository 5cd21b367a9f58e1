"""``pyvista.read`` of a PLY file, found by the entry point ``pyvista.readers.override``.

Files that VTK reads completely are left to VTK. Its reader ends the process (SIGSEGV, vtk 9.4 to 9.7) where an element precedes
the vertices or an integer has 64 bits; it rounds positions of double precision to single, and drops properties whose names it
does not know. Such files are read by trimesh, into the arrays that VTK would have made and one for each other property.
"""

import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from meshflow.errors import FormatError
from meshflow.geometry.validation import Array
from meshflow.io.formats.ply import KNOWN, TEXTURE, Elements, elements_of, has, stacked, values_of

__all__ = ["read_ply"]

_NAMED = KNOWN | {"vertex_indices", "vertex_index", "texcoord", "texnumber"}
_WIDE = {"int64", "uint64", "longlong", "ulonglong"}


def read_ply(path: str) -> Any:
    """Read a PLY file of a mesh or a cloud.

    :param path: of the file; a remote one is fetched by pyvista first.
    :returns: a ``pyvista.PolyData``: polygons (of a cloud one vertex cell per point), positions in the precision that is
        stored, ``RGB`` or ``RGBA`` (uint8), ``Normals``, ``TCoords`` (n, 2), and the other properties of vertices and faces
        under their own names.
    :raises FormatError: when neither VTK nor trimesh can read it: it is cut off, or mixes polygons in binary.
    """
    import pyvista

    if "://" in path:
        raise pyvista.LocalFileRequiredError
    rest = tuple(_beyond_vtk(Path(path)))
    if not rest:
        return pyvista.PLYReader(path).read()
    fatal = [why for why, ends in rest if ends]
    try:
        elements = elements_of(Path(path))
    except FormatError as cause:
        if fatal:
            raise
        lost = ", ".join(why for why, _ in rest)
        warnings.warn(f"read by VTK, which loses {lost}: {cause}", stacklevel=3)
        return pyvista.PLYReader(path).read()
    return _polydata(elements, Path(path))


def _beyond_vtk(path: Path) -> Iterator[tuple[str, bool]]:
    """What VTK would lose of the file, and whether it would end the process."""
    with path.open("rb") as file:
        lines = []
        for line in file:
            lines.append(line.decode("utf-8", "replace").split())
            if lines[-1] == ["end_header"] or len(lines) > 10_000:
                break
    element = None
    for words in lines:
        match words:
            case ["element", name, _]:
                if element is None and name != "vertex":
                    yield f"element {name} before the vertices", True
                element = name
            case ["property", *kinds, name]:
                if _WIDE & set(kinds):
                    yield f"{name} of 64 bits", True
                elif element == "vertex" and name in ("x", "y", "z") and {"double", "float64"} & set(kinds):
                    yield f"the digits of {name}", False
                elif element in ("vertex", "face") and name not in _NAMED and "list" not in kinds:
                    yield f"{name} of {element}", False


def _polydata(elements: Elements, path: Path) -> Any:
    import pyvista

    faces = _cells(elements, path)
    points = stacked(elements, ("x", "y", "z"))
    poly = pyvista.PolyData(points) if faces is None else pyvista.PolyData(points, faces=faces)
    _fill(poly.point_data, elements, "vertex")
    if has(elements, "nx", "ny", "nz"):
        poly.point_data["Normals"] = stacked(elements, ("nx", "ny", "nz"))
        poly.point_data.active_normals_name = "Normals"
    for pair in TEXTURE:
        if has(elements, *pair):
            poly.point_data["TCoords"] = stacked(elements, pair)
            poly.point_data.active_texture_coordinates_name = "TCoords"
            break
    if faces is not None:
        _fill(poly.cell_data, elements, "face")
        if "texcoord" in elements["face"]["properties"]:
            warnings.warn(f"{path.name}: texture coordinates of faces are left out", stacklevel=4)
    return poly


def _cells(elements: Elements, path: Path) -> Array | None:
    """The polygons as in pyvista, each preceded by its length; None for a point cloud."""
    face = elements.get("face")
    if face is None or not face["length"]:
        return None
    name = next((name for name in face["properties"] if re.fullmatch("vertex_ind(ex|ices)", name)), None)
    if name is None:
        raise FormatError(f"{path.name}: faces without vertex_indices; is it a mesh?")
    if face["data"][name].dtype == object:  # ASCII, polygons of different length
        return np.concatenate([np.r_[len(polygon), polygon] for polygon in face["data"][name]])
    found = values_of(elements, "face", name)
    return np.insert(found.astype(np.int64), 0, found.shape[1], axis=1).ravel()


def _fill(data: Any, elements: Elements, element: str) -> None:
    """Add colours under the names of VTK, and every other numeric property."""
    kinds = elements[element]["properties"]
    for names in (("red", "green", "blue", "alpha"), ("red", "green", "blue")):
        if all(name in kinds for name in names):
            colours = np.column_stack([values_of(elements, element, name) for name in names])
            data["RGB" if len(names) == 3 else "RGBA"] = colours
            break
    for name, kind in kinds.items():
        if "LIST" not in kind and "(" not in kind and name not in KNOWN:
            data[name] = values_of(elements, element, name)
    if colour := next((name for name in ("RGB", "RGBA") if name in data), None):
        data.active_scalars_name = colour
