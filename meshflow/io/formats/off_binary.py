"""Binary OFF of Geomview: big-endian numbers, written with the same bytes around new positions."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

from meshflow.errors import FormatError
from meshflow.geometry.validation import Array
from meshflow.io.document import Document
from meshflow.io.formats.off_source import OffSource, skin_of
from meshflow.io.metadata import ReadOptions
from meshflow.io.polygons import must_be_small
from meshflow.surfaces.mesh import Mesh

__all__ = ["is_binary", "read"]

_BEGIN = re.compile(rb"\s*(ST)?(C)?(N)?OFF[ \t]+BINARY[ \t]*\r?\n")
_WORD, _FLOAT = np.dtype(">i4"), np.dtype(">f4")


@dataclass(frozen=True, eq=False)
class BinaryOff(OffSource):
    """A binary OFF that was read.

    :param content: its bytes; ``start``: of the positions; ``width``: floats per vertex.
    """

    content: bytes
    start: int
    width: int

    def save(self, data: Mesh, path: Path, target: Path, tags: Mapping[str, str]) -> tuple[str, ...]:
        """Write the same file with another mesh; a binary OFF has no room for tags."""
        rows = np.frombuffer(self.content, _FLOAT, len(self.skin.points) * self.width, self.start).copy()
        rows.reshape(-1, self.width)[:, :3] = self.skin.points_of(data)
        path.write_bytes(self.content[: self.start] + rows.tobytes() + self.content[self.start + rows.nbytes :])
        return ()

    def scene(self, data: Mesh) -> trimesh.Scene:
        """The mesh as a scene of one part."""
        return trimesh.Scene(trimesh.Trimesh(self.skin.points_of(data), self.skin.faces, process=False))


def is_binary(content: bytes) -> bool:
    """Whether the first line says so."""
    return _BEGIN.match(content) is not None


def read(path: Path, content: bytes, options: ReadOptions) -> Document:
    """Read a binary OFF: positions, and polygons as triangles; normals, colours and texture coordinates stay in the file.

    :raises FormatError: when it is cut off, or a polygon names a vertex that is not there.
    """
    begin = _BEGIN.match(content)
    if begin is None:
        raise FormatError(f"{path.name}: the words OFF BINARY expected in the first line")
    texture, colours, normals = (group is not None for group in begin.groups())
    if len(content) < begin.end() + 12:
        raise FormatError(f"{path.name}: cut off after its first line; get the whole file")
    vertices, count = (int(n) for n in np.frombuffer(content, _WORD, 2, begin.end()))
    width, start = 3 + 3 * normals + 4 * colours + 2 * texture, begin.end() + 12
    at = start + 4 * width * vertices
    if vertices < 0 or count < 0 or len(content) < at + 8 * count:
        raise FormatError(
            f"{path.name}: cut off, {vertices} vertices and {count} faces expected in {len(content) - start} bytes"
        )
    if not count:
        raise FormatError(f"{path.name}: no faces in {vertices} vertices; a mesh with triangles expected")
    faces = _triangles(path, content, at, count)
    points = np.frombuffer(content, _FLOAT, width * vertices, start).reshape(-1, width)[:, :3].astype(np.float32)
    skin, notes = skin_of(points, faces, count, options)
    return Document(skin.data, path, BinaryOff(skin, content, start, width), notes)


def _triangles(path: Path, content: bytes, at: int, count: int) -> Array:
    """Triangles (m, 3) of the polygons from a byte on: each with its size, corners, the number of its colours, and these."""
    words = np.frombuffer(content, _WORD, (len(content) - at) // 4, at)
    made, place = [], 0
    for number in range(count):
        size = int(words[place]) if place < len(words) else 0
        if 0 < size < len(words) - place:
            must_be_small(path.name, size)
            colours = int(words[place + 1 + size])
            corners = words[place + 1 : place + 1 + size].astype(np.int64)
            place += 2 + size + colours
            made.append(np.column_stack([np.full(max(size - 2, 0), corners[0]), corners[1:-1], corners[2:]]))
            if 0 <= colours <= 4 and place <= len(words):
                continue
        raise FormatError(f"{path.name}: face {number + 1} of {count} does not fit into the file; get the whole file")
    return np.concatenate(made)
