"""Mesh files: PLY, OBJ, STL, OFF, GLB, VTP, VTK, VTM.

A file of its own format is rewritten as sparingly as the format allows: of PLY, OBJ and OFF the very bytes are kept but
for positions, normals and the channel that moved; the others go through the library that reads them.
"""

import struct
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

from meshflow.errors import FormatError, InputError
from meshflow.geometry.validation import Array
from meshflow.io.atomic_write import beside
from meshflow.io.files import Document
from meshflow.surfaces.lift import Mesh

__all__ = ["Held", "read", "write"]

# The module of this room that holds each format. Never VTK for .ply: its reader ends the process (SIGSEGV) on 64-bit
# integers and on elements before the vertices.
_HOMES = {
    ".ply": "ply",
    ".obj": "obj",
    ".off": "off",
    ".vtp": "vtk",
    ".vtk": "vtk",
    ".vtm": "vtm",
    ".stl": "scenes",
    ".glb": "scenes",
    ".gltf": "scenes",
    ".3mf": "scenes",
}
_WRITTEN = (".ply", ".obj", ".stl", ".off", ".glb", ".vtp", ".vtk", ".vtm")

# What the readers raise on a file that is not what it claims to be; they share no class of their own.
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
)


class Held(Protocol):
    """A mesh file that was read: what its module keeps of it; ``sections`` are its meshes where it holds several."""

    noun: Mesh
    notes: tuple[str, ...]
    suffixes: tuple[str, ...]
    sections: tuple[tuple[str, Array], ...]

    def samples(self, given: Any, word: str) -> Any:
        """An array of one number per vertex of the noun, given by the name of an attribute or as it is (:class:`Adopted`)."""
        ...

    def save(self, noun: Mesh, path: Path, target: Path, tags: Mapping[str, str]) -> tuple[str, ...]:
        """Write the file again at ``path``, which then becomes ``target``, around another noun; one of its ``suffixes``."""
        ...

    def scene(self, noun: Mesh) -> Any:
        """The same as a ``trimesh.Scene``, for any other format."""
        ...


def read(path: Path, *, kind: str | None = None, channels: str | None = None, moves: str | None = None) -> Document:
    """Read a mesh file.

    :param channels: the name of a vertex attribute in the file, or ``"colors"``: it becomes the channels of the noun, and
        goes back to where it came from.
    :param moves: ``points | channels | all``; by default the channels where they are named.
    :raises FormatError: for a broken file, one without triangles, and a file with NaN; the message names the file.
    """
    if kind not in (None, "mesh"):
        raise FormatError(f"{path.name}: a mesh file holds a mesh; kind={kind!r} was asked for, leave it out")
    home = _HOMES.get(path.suffix.lower())
    if home is None:
        raise FormatError(f"{path.name}: not a mesh format that is read here; use {' '.join(sorted(_HOMES))}")
    try:
        held: Held = import_module(f"meshflow.io.formats.{home}").read(path, channels, moves)
    except FormatError:
        raise
    except InputError as cause:
        raise FormatError(f"{path.name}: {cause}") from cause
    except _BROKEN as cause:
        reason = str(cause).strip().splitlines()[0] if str(cause).strip() else type(cause).__name__
        raise FormatError(
            f"{path.name} cannot be read as {path.suffix.lower()[1:].upper()}: {reason}; "
            "is it whole, and does its extension tell the truth?"
        ) from cause
    return Document(held.noun, "mesh", path, held, "meshes", held.notes)


def write(document: Document, path: Path, *, tags: Mapping[str, str]) -> tuple[str, ...]:
    """Write a mesh in the format of the extension: its own, or another one.

    :param tags: kept as comments (PLY, OBJ, OFF) or field data (VTP, VTK); the other formats have no room for them.
    :returns: what the format could not hold.
    :raises FormatError: for a format that is only read, or cannot hold the mesh; nothing is then written.
    """
    tags = {name.removeprefix("meshflow:"): word for name, word in tags.items()}  # the formats below put it before each
    suffix = path.suffix.lower()
    if suffix not in _WRITTEN:
        raise FormatError(
            f"{path.name}: {suffix or 'a file without extension'} is not written; use {' '.join(_WRITTEN)}"
        )
    noun = document.noun
    if not isinstance(noun, Mesh) or noun.points.shape[1] != 3:
        raise InputError(
            f"{path.name}: a mesh of points in R^3 expected, got {type(noun).__name__}; keep others as .npz"
        )
    held: Held | None = document.about if document.family == "meshes" else None
    if suffix == ".vtm" and (held is None or suffix not in held.suffixes):
        raise FormatError(f"{path.name}: blocks are written of what came in blocks; use .vtp or .glb")
    with beside(path) as temporary:
        if held is not None and suffix in held.suffixes:
            return held.save(noun, temporary, path, tags)
        from meshflow.io.conversions import bare_scene, save

        return save(bare_scene(noun) if held is None else held.scene(noun), temporary, path, tags)
