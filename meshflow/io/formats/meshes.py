"""Mesh files: PLY, OBJ, STL, OFF, GLB, VTP, VTU, VTK, VTM.

A file that is written in its own format changes as little as possible: PLY, OBJ and OFF keep all bytes except positions, normals
and the channel that moved, GLB all but positions, normals and tangents unless colours move; the other formats are written by the
library that reads them.
"""

import struct
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from zipfile import BadZipFile

from meshflow.errors import FormatError, InputError, MissingPackage
from meshflow.io.atomic_write import beside
from meshflow.io.document import Document, MeshSource, WriteOptions
from meshflow.io.metadata import ReadOptions
from meshflow.surfaces.mesh import Mesh

__all__ = ["can_write", "read", "write"]

NAME: str = "a mesh file"
READS: tuple[str, ...] = ("kind", "channels", "moves", "allow_remote")
WRITES: tuple[str, ...] = ()
_WRITTEN = (".ply", ".obj", ".stl", ".off", ".glb", ".gltf", ".3mf", ".vtp", ".vtu", ".vtk", ".vtm")

# What the readers raise for invalid files; they have no common exception.
_BROKEN = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    EOFError,
    ImportError,
    LookupError,
    MemoryError,
    NameError,
    OSError,
    RuntimeError,
    SyntaxError,
    TypeError,
    UserWarning,
    ValueError,
    struct.error,
    zlib.error,
    BadZipFile,
)


def _ply(path: Path, options: ReadOptions) -> Document:
    """Read a PLY; not by VTK, whose reader ends the process (SIGSEGV) on 64-bit integers and elements before the vertices."""
    from meshflow.io.formats import ply

    return ply.read(path, options)


def _obj(path: Path, options: ReadOptions) -> Document:
    from meshflow.io.formats import obj

    return obj.read(path, options)


def _off(path: Path, options: ReadOptions) -> Document:
    from meshflow.io.formats import off

    return off.read(path, options)


def _vtk(path: Path, options: ReadOptions) -> Document:
    from meshflow.io.formats import vtk

    return vtk.read(path, options)


def _vtm(path: Path, options: ReadOptions) -> Document:
    from meshflow.io.formats import vtm

    return vtm.read(path, options)


def _scene(path: Path, options: ReadOptions) -> Document:
    from meshflow.io.formats import scenes

    return scenes.read(path, options)


_READERS: Mapping[str, Callable[[Path, ReadOptions], Document]] = {
    ".ply": _ply,
    ".obj": _obj,
    ".off": _off,
    ".vtp": _vtk,
    ".vtu": _vtk,
    ".vtk": _vtk,
    ".vtm": _vtm,
    ".stl": _scene,
    ".glb": _scene,
    ".gltf": _scene,
    ".3mf": _scene,
}


def read(path: Path, options: ReadOptions) -> Document:
    """Read a mesh file.

    :param options: ``channels``, the name of a vertex attribute in the file, or ``"colors"``: it becomes the channels of the
        mesh and is updated in the result; ``moves``, ``points | channels | all``: by default the channels where they are named.
    :raises FormatError: for a damaged file, a file without triangles, or with NaN; the message names the file.
    """
    if options.kind not in (None, "mesh", *(("tetrahedra",) if path.suffix.lower() in (".vtu", ".vtk") else ())):
        raise FormatError(f"{path.name}: a mesh file holds a mesh; kind={options.kind!r} was asked for, leave it out")
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise FormatError(f"{path.name}: not a mesh format that is read here; use {' '.join(sorted(_READERS))}")
    if options.channels is not None and options.attribute is None:
        raise InputError(f"{path.name}: channels of a mesh file are named, got {type(options.channels).__name__}")
    try:
        return reader(path, options)
    except (FormatError, MissingPackage):
        raise
    except InputError as cause:
        raise FormatError(f"{path.name}: {cause}") from cause
    except _BROKEN as cause:
        if isinstance(cause, ImportError) and "map segment" in str(cause):
            raise MemoryError(str(cause)) from cause  # of a library that finds no room in the address space
        reason = str(cause).strip().splitlines()[0] if str(cause).strip() else type(cause).__name__
        raise FormatError(
            f"{path.name} cannot be read as {path.suffix.lower()[1:].upper()}: {reason}; "
            "is it complete, and is its extension right?"
        ) from cause


def can_write(document: Document, suffix: str) -> bool:
    """Whether it is a mesh; :func:`write` refuses formats that can only be read."""
    return isinstance(document.data, Mesh)


def write(document: Document, path: Path, options: WriteOptions) -> tuple[str, ...]:
    """Write a mesh in the format of the extension.

    :param options: tags are kept as comments (PLY, OBJ, OFF) or field data (VTP, VTU, VTK); other formats do not hold them.
    :returns: notes on what the format does not hold.
    :raises FormatError: for a format that can only be read, or cannot hold the mesh; nothing is then written.
    """
    tags = {
        name.removeprefix("meshflow:"): word for name, word in options.tags.items()
    }  # the formats add it before each
    suffix = path.suffix.lower()
    if suffix not in _WRITTEN:
        raise FormatError(
            f"{path.name}: {suffix or 'a file without extension'} is not written; use {' '.join(_WRITTEN)}"
        )
    data = document.data
    if not isinstance(data, Mesh) or data.points.shape[1] != 3:
        raise InputError(
            f"{path.name}: a mesh of points in R^3 expected, got {type(data).__name__}; keep others as .npz"
        )
    source = document.source if isinstance(document.source, MeshSource) else None
    if suffix == ".vtm" and (source is None or not source.writes(suffix)):
        raise FormatError(f"{path.name}: blocks are written of what came in blocks; use .vtp or .glb")
    with beside(path) as temporary:
        if source is not None and source.writes(suffix):
            return source.save(data, temporary, path, tags)
        from meshflow.io.conversions import bare_scene, save

        return save(bare_scene(data) if source is None else source.scene(data), temporary, path, tags)
