"""A GLB of which only positions, normals and tangents change: skins, animations, textures and extensions keep their bytes."""

import copy
import json
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from meshflow.geometry.validation import Array

__all__ = ["GlbBytes"]

_MAGIC, _VERSION, _JSON, _BINARY = b"glTF", 2, b"JSON", b"BIN\0"
_FLOAT, _TRIANGLES, _STRIP = 5126, 4, 5
_WIDTHS = {"VEC3": 3, "VEC4": 4}
# The attributes that follow the positions.
_FOLLOW = ("POSITION", "NORMAL", "TANGENT")


@dataclass(frozen=True, eq=False)
class GlbBytes:
    """The chunks of a GLB.

    :ivar header: its JSON.
    :ivar binary: the buffer of the file itself.
    :ivar rest: chunks that follow, with their heads.
    :ivar places: of each triangle primitive in order, its attributes by the number of their accessor.
    """

    header: dict[str, Any]
    binary: bytes
    rest: bytes
    places: tuple[Mapping[str, int], ...]

    @classmethod
    def of(cls, path: Path, parts: Sequence[Array]) -> "GlbBytes | None":
        """The chunks of a file; None if its primitives are not these parts, or not stored as plain single precision numbers.

        :param parts: positions (n, 3) of its meshes as they were read.
        """
        content = path.read_bytes()
        chunks = dict(_chunks(content))
        if _JSON not in chunks or _BINARY not in chunks:
            return None
        header = json.loads(content[slice(*chunks[_JSON])])
        start, end = chunks[_BINARY]
        binary = content[start:end]
        primitives = (primitive for mesh in header.get("meshes", ()) for primitive in mesh["primitives"])
        places = tuple(p["attributes"] for p in primitives if p.get("mode", _TRIANGLES) in (_TRIANGLES, _STRIP))
        made = cls(header, binary, content[end + -end % 4 :], places)
        return made if made._holds(parts) else None

    def _holds(self, parts: Sequence[Array]) -> bool:
        """Whether the positions of the parts are those of the primitives, and all that follows them can be written."""
        if len(parts) != len(self.places):
            return False
        buffer = np.frombuffer(self.binary, np.uint8)
        for points, place in zip(parts, self.places, strict=True):
            rows = {name: self._rows(buffer, place[name]) for name in _FOLLOW if name in place}
            stored = rows.get("POSITION")
            if any(found is None or len(found) != len(points) for found in rows.values()):
                return False
            if stored is None or not np.array_equal(stored, points.astype(np.float32)):
                return False
        return True

    def _rows(self, buffer: Array, number: int) -> Array | None:
        """The values (n, 3 or 4) of an accessor as a view of the buffer; None where they are stored otherwise."""
        accessor = self.header["accessors"][number]
        width = _WIDTHS.get(accessor["type"])
        if accessor["componentType"] != _FLOAT or width is None or "sparse" in accessor or "bufferView" not in accessor:
            return None
        view = self.header["bufferViews"][accessor["bufferView"]]
        if view["buffer"] != 0 or "uri" in self.header["buffers"][0] or "extensions" in view:
            return None
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        strides = view.get("byteStride", 4 * width), 4
        if start + strides[0] * (accessor["count"] - 1) + 4 * width > len(buffer):
            return None
        return np.ndarray((accessor["count"], width), "<f4", buffer.data, start, strides)

    def with_parts(self, parts: Sequence[tuple[Array, Array | None]]) -> bytes:
        """The file with other positions.

        :param parts: positions (n, 3) of each primitive, and its normals (n, 3) if they change.
        """
        header, binary = copy.deepcopy(self.header), bytearray(self.binary)
        buffer = np.frombuffer(binary, np.uint8)
        for (points, normals), place in zip(parts, self.places, strict=True):
            stored, turned, along = (self._rows(buffer, place[n]) if n in place else None for n in _FOLLOW)
            if stored is not None:
                stored[:] = points
                accessor = header["accessors"][place["POSITION"]]
                accessor["min"], accessor["max"] = (
                    end(axis=0).astype(float).tolist() for end in (stored.min, stored.max)
                )
            if normals is not None and turned is not None:
                turned[:] = normals
                if along is not None:
                    along[:, :3] = _across(along[:, :3], normals)
        words = json.dumps(header, ensure_ascii=False, separators=(",", ":")).encode()
        chunks = _chunk(_JSON, words, b" ") + _chunk(_BINARY, bytes(binary), b"\0") + self.rest
        return struct.pack("<4sII", _MAGIC, _VERSION, 12 + len(chunks)) + chunks


def _chunks(content: bytes) -> Iterator[tuple[bytes, tuple[int, int]]]:
    """The first two chunks of a GLB: their kind, and where they start and end."""
    at = 12
    for _ in range(2):
        if len(content) < at + 8:
            return
        length, kind = struct.unpack_from("<I4s", content, at)
        yield kind, (at + 8, at + 8 + length)
        at += 8 + length


def _chunk(kind: bytes, content: bytes, filler: bytes) -> bytes:
    """A chunk, filled up to a multiple of four bytes."""
    content += filler * (-len(content) % 4)
    return struct.pack("<I4s", len(content), kind) + content


def _across(along: Array, normals: Array) -> Array:
    """Unit tangents (n, 3) at right angles to the normals (n, 3); those that would vanish stay."""
    new = along - np.einsum("ij,ij->i", along, normals)[:, None] * normals
    length = np.linalg.norm(new, axis=1, keepdims=True)
    return np.where(length > 1e-6, new / np.maximum(length, 1e-6), along)
