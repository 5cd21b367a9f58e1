"""OFF: faces are read by trimesh; only the lines of positions are rewritten, so that polygons and colours are kept."""

import io
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from meshflow.errors import FormatError, InputError
from meshflow.geometry.validation import Array
from meshflow.io.document import Document
from meshflow.io.formats import off_binary
from meshflow.io.formats.obj import rewritten
from meshflow.io.formats.off_source import OffSource, skin_of
from meshflow.io.metadata import ReadOptions
from meshflow.io.polygons import must_be_small
from meshflow.surfaces.mesh import Mesh

__all__ = ["Off", "read"]


@dataclass(frozen=True, eq=False)
class Off(OffSource):
    """An OFF file that was read.

    :param lines: its text, Latin-1.
    :param rows: the lines of the positions (n,).
    """

    lines: tuple[str, ...]
    rows: Array

    def save(self, data: Mesh, path: Path, target: Path, tags: Mapping[str, str]) -> tuple[str, ...]:
        """Write the same file with another mesh; tags become comments at its end."""
        path.write_bytes(self._encoded(data, tags))
        return ()

    def scene(self, data: Mesh) -> trimesh.Scene:
        """The mesh as a scene of one part."""
        return trimesh.load_scene(io.BytesIO(self._encoded(data, {})), file_type="off", process=False)

    def _encoded(self, data: Mesh, tags: Mapping[str, str]) -> bytes:
        lines = list(self.lines)
        points = self.skin.points_of(data)
        for i in np.flatnonzero((points != self.skin.points).any(axis=1)):
            lines[self.rows[i]] = rewritten(lines[self.rows[i]], 0, points[i])
        comments = [f"# meshflow:{name} {' '.join(str(word).split())}\n" for name, word in tags.items()]
        return ("\n".join(lines) + ("\n" if comments and lines[-1] else "") + "".join(comments)).encode(
            "latin-1", "replace"
        )


def read(path: Path, options: ReadOptions) -> Document:
    """Read an OFF file.

    :raises FormatError: when it is cut off or not an OFF.
    :raises InputError: for channels, which OFF does not have, or whatever the data object refuses.
    """
    if options.channels is not None:
        raise InputError(f"channels={options.channels!r}: an OFF file has no vertex attributes that are read")
    content = path.read_bytes()
    if off_binary.is_binary(content):
        return off_binary.read(path, content, options)
    # trimesh needs a space between keyword and numbers, and so do we; a byte order mark is removed
    content = re.sub(
        rb"^(?:\xef\xbb\xbf)?(\s*(?:#.*\n\s*)*(?:ST)?C?N?OFF)(?=\d)", rb"\1 ", content.removeprefix(b"\xef\xbb\xbf")
    )
    lines = content.decode("latin-1").split("\n")
    filled = [number for number, line in enumerate(lines) if line.split("#")[0].strip()]
    header = lines[filled[0]].split("#")[0].split() if filled else []
    if not header or not re.fullmatch("(ST)?C?N?OFF", header[0]):
        raise FormatError(f"{path.name}: the word OFF expected in the first line, got {' '.join(header)[:40]!r}")
    # the counts follow the word OFF, or are on the next line
    counts, first = (header[1:], 1) if len(header) > 1 else (lines[filled[1]].split() if len(filled) > 1 else [], 2)
    if len(counts) < 2 or not all(count.isdecimal() for count in counts[:2]):
        raise FormatError(f"{path.name}: numbers of vertices and faces expected, got {' '.join(counts)[:40]!r}")
    vertices, faces = int(counts[0]), int(counts[1])
    if len(filled) - first < vertices + faces:
        raise FormatError(
            f"{path.name}: cut off, {vertices} vertices and {faces} faces expected in {len(filled) - first} lines"
        )
    for row in filled[first + vertices : first + vertices + faces]:
        words = lines[row].split("#")[0].split()
        must_be_small(path.name, int(words[0]))
        if len(words) <= int(words[0]):
            raise FormatError(
                f"{path.name}, line {row + 1}: a face of {words[0]} corners expected, got {lines[row].strip()!r}"
            )
    scene = trimesh.load_scene(io.BytesIO(content), file_type="off", process=False)
    mesh: Any = next(iter(scene.geometry.values()), None)
    if mesh is None or not faces:
        raise FormatError(f"{path.name}: no faces in {vertices} vertices; a mesh with triangles expected")
    points, triangles = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    skin, notes = skin_of(points, triangles, faces, options)
    rows = np.array(filled[first : first + vertices])
    return Document(skin.data, path, Off(skin, tuple(lines), rows), notes)
