"""The layout of a PLY file with a range grid, which is written with the same bytes around new points.

It is read here and not by trimesh, which takes the length of all lists of a binary element from the first (in a range grid it is
0 or 1), nor by VTK, which crashes on an element before the vertices.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshflow.errors import FormatError
from meshflow.geometry.validation import Array

__all__ = ["Element", "PlyBytes", "has_grid", "loaded", "must_hold"]

_TYPES = {
    name: code
    for code, names in {
        "i1": ("char", "int8"),
        "u1": ("uchar", "uint8"),
        "i2": ("short", "int16"),
        "u2": ("ushort", "uint16"),
        "i4": ("int", "int32"),
        "u4": ("uint", "uint32"),
        "f4": ("float", "float32"),
        "f8": ("double", "float64"),
    }.items()
    for name in names
}
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}


@dataclass(frozen=True)
class Element:
    """An element of the header.

    :param columns: name and number type of its properties; of a list, the types of its length and of its entries.
    """

    name: str
    length: int
    columns: tuple[tuple[str, str], ...]

    @property
    def has_lists(self) -> bool:
        """Whether a property is a list."""
        return any(" " in kind for _, kind in self.columns)

    def dtype(self, order: str) -> np.dtype[np.void]:
        """The type of one entry in a binary file without lists."""
        return np.dtype([(name, order + kind) for name, kind in self.columns])


@dataclass(frozen=True, eq=False)
class PlyBytes:
    """A PLY file.

    :param header: its bytes up to and including ``end_header``; ``before``, ``between``, ``after``: the bytes of the body before
        the vertices, of the vertices, and after them.
    :param order: byte order, ``<`` or ``>``, empty for ASCII.
    :param info: the text of ``obj_info`` and comments, by the first word.
    :param vertices: as they are stored, a structured array.
    :param camera: properties of the element ``camera``, if there is one.
    :param grid: (cells,), the vertex of each cell of the element ``range_grid``, -1 where there is none; None without one.
    """

    header: bytes
    before: bytes
    between: bytes
    after: bytes
    order: str
    info: Mapping[str, str]
    vertices: Array
    camera: Mapping[str, float]
    grid: Array | None

    @property
    def points(self) -> Array:
        """(n, 3), float64."""
        with np.errstate(invalid="ignore"):  # signalling NaN
            return np.stack([self.vertices[axis] for axis in "xyz"], axis=-1).astype(np.float64)

    def holding(self, points: Array, tags: Mapping[str, str]) -> bytes:
        """The file with new points (n, 3); points that did not move keep their bits."""
        new = self.vertices.copy()
        for axis, column in zip("xyz", points.T, strict=True):
            moved = column != self.vertices[axis].astype(np.float64)
            new[axis][moved] = column[moved]
        first, kind, rest = self.header.split(b"\n", 2)
        comments = [f"comment meshflow:{name} {' '.join(str(word).split())}".encode() for name, word in tags.items()]
        header = b"\n".join([first, kind, *comments, rest])
        if self.order:
            return header + self.before + new.tobytes() + self.after
        lines = self.between.decode().splitlines()
        for row in np.flatnonzero(new != self.vertices):
            words = lines[row].split()
            for axis in "xyz":
                words[(new.dtype.names or ()).index(axis)] = str(new[axis][row])
            lines[row] = " ".join(words)
        return header + self.before + "\n".join([*lines, ""]).encode() + self.after


def has_grid(path: Path) -> bool:
    """Whether the header of a PLY names a range grid."""
    with path.open("rb") as file:
        return b"element range_grid" in file.read(65536).partition(b"end_header")[0]


def must_hold(path: Path, header: bytes, body: int) -> None:
    """Refuse a header that claims more than the file can contain, before memory is allocated.

    :param header: the bytes of the header.
    :param body: the number of bytes after it; each element needs at least one.
    :raises FormatError: with the element and both numbers.
    """
    for name, count in re.findall(rb"(?m)^[ \t]*element[ \t]+(\S+)[ \t]+(\S+)", header):
        if not count.isdigit() or int(count) > body:
            raise FormatError(
                f"{path.name}: {count.decode('latin-1')[:20]} of element {name.decode('latin-1')[:40]} promised in {body} bytes; "
                "is it cut off? Get the whole file"
            )


def loaded(path: Path) -> PlyBytes:
    """Read a PLY file.

    :raises FormatError: for a file that is no PLY, is cut off, has no vertices with x, y, z, or has lists before them.
    """
    content = path.read_bytes()
    end = re.search(rb"end_header[ \t]*\r?\n", content)
    if not content.startswith(b"ply") or end is None:
        raise FormatError(
            f"{path.name}: no PLY header (ply ... end_header); is it complete, and is its extension right?"
        )
    header, body = content[: end.end()], content[end.end() :]
    must_hold(path, header, len(body))
    order, info, elements = _header(header.decode("utf-8", "replace"), path)
    vertex = next((i for i, element in enumerate(elements) if element.name == "vertex"), None)
    names = [name for name, _ in elements[vertex].columns] if vertex is not None else []
    if (
        vertex is None
        or not {"x", "y", "z"} <= set(names)
        or any(element.has_lists for element in elements[: vertex + 1])
    ):
        raise FormatError(
            f"{path.name}: vertices with x, y, z, and no lists before them, expected, got {', '.join(names) or 'none'}"
        )
    if not all(kind.startswith("f") for name, kind in elements[vertex].columns if name in "xyz"):
        raise FormatError(
            f"{path.name}: positions stored as whole numbers would round what is smoothed; store them as float"
        )
    reads = _binary if order else _ascii
    try:
        found, at, behind = {}, 0, 0
        for element in elements[: vertex + 1]:
            at = behind
            found[element.name], behind = reads(body, at, element, order)
        grid, on = None, behind
        for element in elements[vertex + 1 :]:
            if element.name == "range_grid":
                grid, on = (_binary_lists if order else _ascii_lists)(body, on, element, order)
                break
            if element.has_lists and order:
                break
            on = reads(body, on, element, order)[1]
    except (ValueError, IndexError) as cause:
        raise FormatError(f"{path.name}: cut off, or a word that is no number ({cause}); get the whole file") from cause
    vertices = found["vertex"]
    if grid is not None and len(grid) and not -1 <= grid.min() <= grid.max() < len(vertices):
        raise FormatError(
            f"{path.name}: range_grid names vertex {grid.max()}, there are {len(vertices)}; get the whole file"
        )
    camera = found.get("camera")
    seen = {} if camera is None or len(camera) == 0 else {name: float(camera[name][0]) for name in camera.dtype.names}
    return PlyBytes(header, body[:at], body[at:behind], body[behind:], order, info, vertices, seen, grid)


def _header(text: str, path: Path) -> tuple[str, dict[str, str], list[Element]]:
    order, info, elements = None, {}, []
    for line in text.splitlines()[1:]:
        words = line.split()
        match words:
            case ["format", kind, *_]:
                order = _ORDERS.get(kind)
            case ["obj_info" | "comment", first, *rest]:
                info.setdefault(first, " ".join(rest))
            case ["element", name, length]:
                elements.append(Element(name, int(length), ()))
            case ["property", *kinds, name] if elements and all(k in _TYPES for k in kinds if k != "list"):
                kind = " ".join(_TYPES[k] for k in kinds if k != "list")
                last = elements[-1]
                elements[-1] = Element(last.name, last.length, (*last.columns, (name, kind)))
            case [] | ["end_header"] | ["obj_info" | "comment"]:
                pass
            case _:
                raise FormatError(f"{path.name}: {line.strip()!r} is no line of a PLY header")
    if order is None:
        raise FormatError(
            f"{path.name}: format ascii, binary_little_endian or binary_big_endian expected in the PLY header"
        )
    return order, info, elements


def _binary(body: bytes, at: int, element: Element, order: str) -> tuple[Array, int]:
    if element.has_lists:
        raise ValueError(f"lists in element {element.name}")
    kind = element.dtype(order)
    return np.frombuffer(body, kind, element.length, at), at + kind.itemsize * element.length


def _line_ends(body: bytes, at: int, count: int) -> int:
    """The end of ``count`` lines from ``at``."""
    for _ in range(count):
        at = body.find(b"\n", at) + 1 or len(body)
    return at


def _ascii(body: bytes, at: int, element: Element, order: str) -> tuple[Array, int]:
    end = _line_ends(body, at, element.length)
    rows = [line.split() for line in body[at:end].decode().splitlines()]
    if element.has_lists:
        return np.zeros(0), end
    if len(rows) != element.length or any(len(row) != len(element.columns) for row in rows):
        raise ValueError(f"{element.length} lines of element {element.name} expected")
    made = np.empty(len(rows), element.dtype("="))
    for (name, kind), words in zip(element.columns, zip(*rows, strict=True), strict=False):
        made[name] = np.array(words, dtype=np.float64 if kind[0] == "f" else np.int64)
    return made, end


def _binary_lists(body: bytes, at: int, element: Element, order: str) -> tuple[Array, int]:
    (_, kinds), *more = element.columns
    if more or " " not in kinds:
        raise ValueError("range_grid: one list of vertex indices expected")
    many, entry = (np.dtype(order + kind) for kind in kinds.split())
    found = np.full(element.length, -1, np.int64)
    for i in range(element.length):
        count = int(np.frombuffer(body, many, 1, at)[0]) if many.itemsize > 1 else body[at]
        at += many.itemsize
        if count:
            found[i] = np.frombuffer(body, entry, 1, at)[0]
            at += count * entry.itemsize
    return found, at


def _ascii_lists(body: bytes, at: int, element: Element, order: str) -> tuple[Array, int]:
    end = _line_ends(body, at, element.length)
    rows = [line.split() for line in body[at:end].decode().splitlines()]
    if len(rows) != element.length:
        raise ValueError(f"{element.length} cells of range_grid expected")
    return np.array([int(row[1]) if int(row[0]) else -1 for row in rows], dtype=np.int64), end
