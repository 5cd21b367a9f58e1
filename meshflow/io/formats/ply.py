"""PLY: read by trimesh, and written with the same bytes except for what moved.

Every property keeps its type and order; custom scalars, other elements (a camera, a range grid), comments and polygons are kept.
"""

import io
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
import trimesh
from numpy.typing import ArrayLike
from trimesh.resolvers import FilePathResolver

from meshflow.errors import FormatError, InputError
from meshflow.geometry.validation import Array
from meshflow.io.document import Document, MeshSource
from meshflow.io.formats.ply_layout import must_hold
from meshflow.io.metadata import Found, ReadOptions
from meshflow.io.polygons import must_be_small
from meshflow.io.vertex_merging import Skin, fitted, is_soup, normals_after
from meshflow.surfaces.mesh import Mesh

__all__ = ["KNOWN", "TEXTURE", "Ply", "elements_of", "has", "read", "stacked", "values_of"]


class Element(TypedDict):
    """An element as trimesh reads it: its count, the types of its properties by name, and the columns by name."""

    length: int
    properties: Mapping[str, str]
    data: Any


Elements = Mapping[str, Element]
COLORS = ("red", "green", "blue")
TEXTURE = (("texture_u", "texture_v"), ("u", "v"), ("s", "t"))
KNOWN = {"x", "y", "z", "nx", "ny", "nz", *COLORS, "alpha", *(name for pair in TEXTURE for name in pair)}


@dataclass(frozen=True, eq=False)
class Ply(MeshSource):
    """A PLY file that was read.

    :param header: its bytes up to and including ``end_header``.
    :param body: the bytes after it.
    :param elements: as trimesh has read them: name -> length, properties, data.
    :param names: the vertex properties of the channels.
    """

    path: Path
    header: bytes
    body: bytes
    elements: Elements
    skin: Skin
    names: tuple[str, ...]

    def writes(self, suffix: str) -> bool:
        """Whether it is ``.ply``."""
        return suffix == ".ply"

    def samples(self, given: ArrayLike | None, word: str) -> ArrayLike | None:
        """An array of one number per vertex, as it is or by the name of a vertex property."""
        return self.skin.samples(given, word, self._property)

    def _property(self, name: str) -> Found:
        there = [word for word in self.elements["vertex"]["properties"] if word not in KNOWN]
        return (values_of(self.elements, "vertex", name) if name in there else None), there

    def save(self, data: Mesh, path: Path, target: Path, tags: Mapping[str, str]) -> tuple[str, ...]:
        """Write the same file with another mesh."""
        path.write_bytes(self._encoded(data, tags))
        return ()

    def scene(self, data: Mesh) -> trimesh.Scene:
        """The mesh with its texture as a scene of one part; custom scalars are vertex attributes."""
        # texture coordinates of faces split vertices along seams; those of vertices must not renumber them
        seams = "texcoord" in self.elements["face"]["properties"]
        scene: Any = trimesh.load_scene(
            io.BytesIO(self._encoded(data, {})),
            file_type="ply",
            process=False,
            fix_texture=seams,
            resolver=FilePathResolver(str(self.path)),
        )
        (mesh,) = scene.geometry.values()
        elements = mesh.metadata.pop("_ply_raw")
        names = [name for name in elements["vertex"]["properties"] if name not in KNOWN]
        if names and len(mesh.vertices) != len(self.skin.points):
            raise FormatError(
                f"{self.path.name}: texture coordinates of faces split its vertices, and {', '.join(names)} would "
                "be lost in another format; write .ply"
            )
        for name in names:
            mesh.vertex_attributes[name] = values_of(elements, "vertex", name)
        if elements["face"]["length"] == len(mesh.faces):
            for name, kind in elements["face"]["properties"].items():
                if "(" not in kind and name not in KNOWN:  # a list has its length in brackets
                    mesh.face_attributes[name] = values_of(elements, "face", name)
        return scene

    def _encoded(self, data: Mesh, tags: Mapping[str, str]) -> bytes:
        """The file with new vertex columns where they changed."""
        columns: dict[str, Array] = {}
        points = self.skin.points_of(data)
        if self.skin.has_moved(data):
            columns.update(zip("xyz", points.T, strict=True))
            if has(self.elements, "nx", "ny", "nz"):
                old = stacked(self.elements, ("nx", "ny", "nz"))
                new = normals_after(points, self.skin.faces, self.skin.points, old)
                columns.update(zip(("nx", "ny", "nz"), new.T, strict=True))
        channels = self.skin.channels_of(data)
        if channels is not None:
            for name, values in zip(self.names, channels.T, strict=True):
                columns[name] = fitted(values, values_of(self.elements, "vertex", name).dtype)
        body = self._ascii(columns) if b"ascii" in self.header.split(b"\n")[1] else self._binary(columns)
        return _tagged(self.header, tags) + body

    def _binary(self, columns: Mapping[str, Array]) -> bytes:
        blocks = []
        for name, element in self.elements.items():
            data = element["data"]
            if name == "vertex":
                data = data.copy()
                for column, values in columns.items():
                    data[column] = values
            blocks.append(data.tobytes())
        return b"".join(blocks)

    def _ascii(self, columns: Mapping[str, Array]) -> bytes:
        if not columns:
            return self.body
        lines = self.body.decode("utf-8").splitlines()
        start = 0
        for name, element in self.elements.items():
            if name == "vertex":
                break
            start += element["length"]
        places = _places(self.elements["vertex"])
        for row in range(self.elements["vertex"]["length"]):
            words = lines[start + row].split()
            for column, values in columns.items():
                words[places[column]] = str(values[row])
            lines[start + row] = " ".join(words)
        return ("\n".join(lines) + "\n").encode("utf-8")


def read(path: Path, options: ReadOptions) -> Document:
    """Read a PLY file.

    :raises FormatError: when it holds no faces, is cut off, or mixes polygons in binary.
    :raises InputError: for channels that it does not have, or whatever the data object refuses.
    """
    content = path.read_bytes()
    mesh: Any = _loaded(path, content)
    if not isinstance(mesh, trimesh.Trimesh):
        if mesh is None or not len(mesh.vertices):
            raise FormatError(
                f"{path.name}: a mesh with triangles expected, got none, not even a vertex; is the file whole?"
            )
        raise FormatError(
            f"{path.name}: a mesh with triangles expected, got a point cloud; a cloud has no surface, "
            "reconstruct one first (open3d: create_from_point_cloud_poisson)"
        )
    elements = mesh.metadata["_ply_raw"]
    _must_be_whole(path, elements)
    if b"ascii" in content.split(b"\n", 2)[1]:
        _must_end_whole(path, content, elements)
    must_be_small(path.name, _corners(elements))
    points = stacked(elements, ("x", "y", "z"))
    if points.dtype.kind != "f":
        raise FormatError(
            f"{path.name}: positions stored as {points.dtype} would round what is smoothed; store them as float"
        )
    textured = any(has(elements, *pair) for pair in TEXTURE) or "texcoord" in elements["face"]["properties"]
    split = textured or has(elements, "nx", "ny", "nz") or is_soup(np.asarray(mesh.faces), len(points))
    names = _named(elements, options.attribute)
    values = stacked(elements, names) if names else None
    skin = Skin.of(points, np.asarray(mesh.faces), split=split, channels=values, moves=options.moves)
    notes = (*skin.note, *_polygons(elements, len(mesh.faces)))
    end = content.index(b"\n", content.index(b"end_header")) + 1
    return Document(skin.data, path, Ply(path, content[:end], content[end:], elements, skin, names), notes)


def elements_of(path: Path) -> Elements:
    """All elements of a PLY file of a mesh or a point cloud: name -> length, properties, data.

    :raises FormatError: when it is cut off, mixes polygons in binary, or has no vertices.
    """
    found: Any = _loaded(path, path.read_bytes())
    if found is None:
        raise FormatError(f"{path.name}: no vertices; is the file whole?")
    _must_be_whole(path, found.metadata["_ply_raw"])
    return found.metadata["_ply_raw"]


def _loaded(path: Path, content: bytes) -> Any:
    """The file as trimesh reads it, with vertices as stored."""
    header, _, body = content.partition(b"end_header")
    must_hold(path, header, len(body))
    with warnings.catch_warnings():  # older numpy stops at a word that is no number, with a warning only
        warnings.filterwarnings("error", message="string or file could not be read", category=DeprecationWarning)
        try:
            scene = trimesh.load_scene(
                io.BytesIO(content), file_type="ply", process=False, fix_texture=False, skip_materials=True
            )
        except (DeprecationWarning, ValueError) as cause:
            if "string or file could not be read" in str(cause):
                raise FormatError(f"{path.name}: a word that is no number where the PLY header promises one") from cause
            if "unexpected length" not in str(cause):
                raise
            raise FormatError(
                f"{path.name}: its length differs from its PLY header; it is cut off, or mixes polygons of "
                "different size in a binary file: then triangulate it first, or save it as ASCII"
            ) from cause
    return next(iter(scene.geometry.values()), None)


def _must_be_whole(path: Path, elements: Elements) -> None:
    """Refuse files that trimesh reads wrongly: ASCII files that are cut off, and binary lists of different lengths."""
    for name, element in elements.items():
        data, length = element.get("data"), element["length"]
        columns = data.values() if isinstance(data, dict) else [data]
        if length and any(column is None or len(column) != length for column in columns):
            raise FormatError(f"{path.name}: cut off, {length} of element {name} expected; get the whole file")
        for column in data.dtype.names if isinstance(data, np.ndarray) and data.dtype.names else ():
            sizes = data[column]["f0"] if data[column].dtype.names else np.zeros(1)
            if len(np.unique(sizes)) > 1:
                raise FormatError(
                    f"{path.name}: binary PLY with lists of different length in {name}.{column}; "
                    "triangulate it first, or save it as ASCII"
                )


def _must_end_whole(path: Path, content: bytes, elements: Elements) -> None:
    """Refuse a truncated last line, which trimesh would read as a smaller polygon.

    :raises FormatError: for a last line with fewer words than its list requires.
    """
    last = next((element for element in reversed(list(elements.values())) if element["length"]), None)
    words = content.rstrip().rpartition(b"\n")[2].split()
    at = 0
    for kind in last["properties"].values() if last is not None else ():
        count = int(words[at]) if "LIST" in kind and at < len(words) and words[at].isdigit() else 0
        at += 1 + count
    if at > len(words):
        raise FormatError(
            f"{path.name}: cut off, {at} numbers expected in its last line, got {len(words)}; get the whole file"
        )


def _named(elements: Elements, channels: str | None) -> tuple[str, ...]:
    """The vertex properties of a name of channels."""
    if channels is None:
        return ()
    names = COLORS if channels == "colors" else (channels,)
    there = elements["vertex"]["properties"]
    if all(name in there for name in names):
        if any(values_of(elements, "vertex", name).ndim > 1 for name in names):
            raise InputError(f"channels={channels!r}: a list for each vertex; a number for each vertex is expected")
        return names
    rest = [name for name in there if name not in KNOWN] + (["colors"] if has(elements, *COLORS) else [])
    raise InputError(f"channels={channels!r}: no such vertex property; the file has {', '.join(rest) or 'none'}")


def has(elements: Elements, *names: str) -> bool:
    """Whether the vertices have all these properties."""
    return all(name in elements["vertex"]["properties"] for name in names)


def values_of(elements: Elements, element: str, name: str) -> Array:
    """A property of vertices or faces (n,) or, of a list, (n, k), in native byte order."""
    column = elements[element]["data"][name]
    if column.dtype.names:
        column = column["f1"]
    column = column.astype(column.dtype.newbyteorder("="))
    return column[:, 0] if column.ndim == 2 and column.shape[1] == 1 else column


def stacked(elements: Elements, names: tuple[str, ...]) -> Array:
    """Properties of the vertices (n, k)."""
    return np.column_stack([values_of(elements, "vertex", name) for name in names])


def _places(vertex: Element) -> dict[str, int]:
    """The index of the word of each vertex property in an ASCII line."""
    places, at = {}, 0
    for name, kind in vertex["properties"].items():
        places[name] = at
        column = vertex["data"][name]
        at += 1 + (column.shape[1] if column.ndim == 2 else 1) if "LIST" in kind else 1
    return places


def _corners(elements: Elements) -> int:
    """The number of corners of the largest polygon."""
    for name in elements["face"]["properties"]:
        if re.fullmatch("vertex_ind(ex|ices)", name):
            column = elements["face"]["data"][name]
            if column.dtype == object:  # ASCII, polygons of different length
                return max(map(len, column))
            return values_of(elements, "face", name)[0].size
    return 0


def _polygons(elements: Elements, triangles: int) -> tuple[str, ...]:
    polygons = elements["face"]["length"]
    if polygons == triangles:
        return ()
    return (
        f"{polygons} polygons are smoothed as {triangles} triangles; a PLY written again keeps the polygons, "
        "another format gets the triangles without what was stored for each polygon",
    )


def _tagged(header: bytes, tags: Mapping[str, str]) -> bytes:
    """The header with tags as comments after its second line, the format."""
    first, kind, rest = header.split(b"\n", 2)
    comments = [f"comment meshflow:{name} {' '.join(str(word).split())}".encode() for name, word in tags.items()]
    return b"\n".join([first, kind, *comments, rest])
