"""OBJ: only the lines of positions, colours and normals are rewritten; groups, materials, polygons and texture are kept.

Other readers renumber vertices along texture seams and drop groups. An OBJ has no seams itself, since each corner refers to
position, texture and normal separately. Therefore the relevant lines are parsed here.
"""

import codecs
import io
import re
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np
import scipy.sparse as sparse
import trimesh
from numpy.typing import ArrayLike
from scipy.sparse.csgraph import connected_components
from trimesh.geometry import triangulate_quads
from trimesh.resolvers import FilePathResolver

from meshflow.errors import Fact, FormatError, InputError
from meshflow.geometry.validation import Array
from meshflow.io.document import Document, MeshSource, Section
from meshflow.io.metadata import ReadOptions
from meshflow.io.polygons import must_be_small
from meshflow.io.vertex_merging import Skin, is_soup, said_of
from meshflow.surfaces.mesh import Mesh

__all__ = ["Obj", "read"]


@dataclass(frozen=True, eq=False)
class Obj(MeshSource):
    """An OBJ file that was read.

    :param lines: its text in Latin-1, in which every byte is a character.
    :param rows: the lines of the positions (n,).
    :param normal_rows: the lines of the normals.
    :param corners: (m, 3), the normal of each corner of each triangle, -1 for none.
    :param parts: names and vertices of its objects or groups; empty where there is only one.
    """

    path: Path
    lines: tuple[str, ...]
    rows: Array
    normal_rows: Array
    corners: Array
    skin: Skin
    parts: tuple[Section, ...]

    @property
    def sections(self) -> tuple[Section, ...]:
        """Its objects, or its groups if it has one object."""
        return self.parts

    def writes(self, suffix: str) -> bool:
        """Whether it is ``.obj``."""
        return suffix == ".obj"

    def samples(self, given: ArrayLike | None, word: str) -> ArrayLike | None:
        """An array of one number per vertex; an OBJ has no named attributes."""
        return self.skin.samples(given, word, lambda name: (None, ()))

    def save(self, data: Mesh, path: Path, target: Path, tags: Mapping[str, str]) -> tuple[str, ...]:
        """Write the same file with another mesh; its materials and images are copied next to it."""
        path.write_bytes(self._encoded(data, tags))
        return tuple(self._companions(target))

    def scene(self, data: Mesh) -> trimesh.Scene:
        """The mesh with materials and texture as trimesh reads them, one part per material."""
        return trimesh.load_scene(
            io.BytesIO(self._encoded(data, {})),
            file_type="obj",
            process=False,
            resolver=FilePathResolver(str(self.path)),
        )

    def _encoded(self, data: Mesh, tags: Mapping[str, str]) -> bytes:
        lines = list(self.lines)
        points = self.skin.points_of(data)
        for i in np.flatnonzero((points != self.skin.points).any(axis=1)):
            lines[self.rows[i]] = rewritten(lines[self.rows[i]], 1, points[i])
        channels = self.skin.channels_of(data)
        if channels is not None and self.skin.channels is not None:
            for i in np.flatnonzero((channels != self.skin.channels).any(axis=1)):
                lines[self.rows[i]] = rewritten(lines[self.rows[i]], 4, channels[i])
        if len(self.normal_rows) and self.skin.has_moved(data):
            self._renew_normals(lines, points)
        comments = [f"# meshflow:{name} {' '.join(str(word).split())}" for name, word in tags.items()]
        return "\n".join([*comments, *lines]).encode("latin-1", "replace")

    def _renew_normals(self, lines: list[str], points: Array) -> None:
        """Recompute each stored normal from all triangles whose corners refer to it, weighted by area; hard edges stay hard."""
        a, b, c = (points[self.skin.faces[:, k]] for k in range(3))
        total = np.zeros((len(self.normal_rows), 3))
        named = self.corners >= 0
        np.add.at(
            total, self.corners[named], np.broadcast_to(np.cross(b - a, c - a)[:, None], (*named.shape, 3))[named]
        )
        length = np.linalg.norm(total, axis=1)
        for i in np.flatnonzero(length > 0):
            lines[self.normal_rows[i]] = rewritten(lines[self.normal_rows[i]], 1, total[i] / length[i])

    def _companions(self, target: Path) -> Iterator[str]:
        """Copy material files and images to where the new file looks for them; notes on those that could not be copied."""
        if target.parent.resolve() == self.path.parent.resolve():
            return
        words = [line.split(None, 1) for line in self.lines if line.startswith("mtllib ")]
        names = [parts[1].strip() for parts in words if len(parts) == 2]
        for name in names:
            yield from _copied(name, self.path.parent, target.parent)
            library = self.path.parent / name
            if library.is_file():
                images = re.findall(
                    r"^\s*(?:map_\w+|bump|disp|norm)\s+(.+?)\s*$", library.read_text("latin-1"), re.M | re.I
                )
                for image in dict.fromkeys(images):
                    yield from _copied(image, self.path.parent, target.parent)


def read(path: Path, options: ReadOptions) -> Document:
    """Read an OBJ file as one mesh.

    Its objects (``o``), or where there is one object its groups (``g``), are sections; those that share vertices are one section.

    :raises FormatError: for lines that are not OBJ, or without faces.
    :raises InputError: for channels that it does not have, or whatever the data object refuses.
    """
    lines = _text(path.read_bytes()).split("\n")
    rows, normal_rows, polygons, normals, labels = _parsed(path, lines)
    if not polygons:
        raise FormatError(f"{path.name}: no faces in {len(rows)} vertices; a mesh with triangles expected")
    must_be_small(path.name, max(map(len, polygons)))
    words = [lines[row].split() for row in rows]
    channels = options.attribute
    points = np.array([word[1:4] for word in words], dtype=np.float64)
    if channels not in (None, "colors"):
        raise InputError(f"channels={channels!r}: an OBJ has no vertex attributes but colors")
    colored = all(len(word) >= 7 for word in words)
    if channels is not None and not colored:
        raise InputError("channels='colors': the vertices of this OBJ have no colours")
    colors = np.array([word[4:7] for word in words], dtype=np.float64) if channels is not None else None
    faces, corners = np.asarray(triangulate_quads(polygons)), np.asarray(triangulate_quads(normals))
    objects = _linked(labels["o"], polygons, np.arange(len(points)))
    split = is_soup(faces, len(points)) or bool(len(normal_rows)) or any(line.startswith("vt ") for line in lines)
    skin = Skin.of(
        points, faces, split=_numbered(objects, len(points)) if split else False, channels=colors, moves=options.moves
    )
    named = _linked(labels["o" if len(objects) > 1 else "g"], polygons, skin.home)
    sections = named if len(named) > 1 else ()
    notes = (*skin.note, *said_of(sections))
    if len(polygons) != len(faces):
        notes += (
            Fact(
                f"{len(polygons)} polygons are smoothed as {len(faces)} triangles; an OBJ written again keeps the polygons"
            ),
        )
    at = np.array(normal_rows, dtype=np.int64)
    return Document(skin.data, path, Obj(path, tuple(lines), np.array(rows), at, corners, skin, sections), notes)


def _text(content: bytes) -> str:
    """The bytes of an OBJ decoded as Latin-1, without byte order mark; UTF-16 is converted to UTF-8 first."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        content = content.decode("utf-16").encode()
    return content.removeprefix(codecs.BOM_UTF8).decode("latin-1")


def _linked(names: list[str], polygons: list[list[int]], home: Array) -> tuple[Section, ...]:
    """Sections: polygons of one name, or of several names that share vertices; name and vertices, in order of appearance.

    :param home: (n,), the joined vertex of each stored vertex.
    """
    labels = {name: k for k, name in enumerate(dict.fromkeys(names))}
    own = np.repeat([labels[name] for name in names], [len(polygon) for polygon in polygons])
    # An index out of range is refused later, when the mesh is made.
    vertices = home.take(np.concatenate([np.asarray(polygon) for polygon in polygons]), mode="clip")
    shape = (len(labels), int(home.max(initial=0)) + 1)
    used = sparse.csr_matrix((np.ones(len(own), np.int32), (own, vertices)), shape=shape)
    count, part = connected_components(used @ used.T, directed=False)
    found = []
    for one in range(count):
        mine = [name for name, k in labels.items() if part[k] == one]
        found.append((", ".join(name or "unnamed" for name in mine), np.unique(vertices[part[own] == one])))
    return tuple(found)


def _numbered(objects: tuple[Section, ...], n: int) -> Array:
    """The number (n,) of the object of each vertex."""
    found = np.zeros(n, np.int64)
    for k, (_, rows) in enumerate(objects):
        found[rows] = k
    return found


def rewritten(line: str, at: int, values: Array) -> str:
    """A line with numbers replaced from a word on; each number is read back exactly."""
    words = line.split()
    words[at : at + len(values)] = [repr(float(value)) for value in values]
    return " ".join(words) + ("\r" if line.endswith("\r") else "")


def _parsed(
    path: Path, lines: list[str]
) -> tuple[list[int], list[int], list[list[int]], list[list[int]], dict[str, list[str]]]:
    """Lines of positions and of normals, and for each polygon its vertices, normals or -1, object (``o``) and group (``g``).

    The names of object and group are empty before the first.
    """
    now: dict[str, str] = {"o": "", "g": ""}
    names: dict[str, list[str]] = {"o": [], "g": []}
    rows: list[int] = []
    normal_rows: list[int] = []
    polygons: list[list[int]] = []
    normals: list[list[int]] = []
    start = ""
    for number, line in enumerate(lines):
        whole, start = start + line.split("#")[0].rstrip(), ""
        if whole.endswith("\\"):
            if whole.lstrip().startswith("v"):
                raise FormatError(f"{path.name}, line {number + 1}: a vertex on several lines is not read; join them")
            start = whole[:-1] + " "
            continue
        key, *words = whole.split() or [""]
        if key == "v":
            rows.append(number)
        elif key in now:
            now[key] = " ".join(words)
        elif key == "vn":
            normal_rows.append(number)
        elif key == "f":
            corners = [(word + "//").split("/") for word in words]
            if len(corners) < 3:
                raise FormatError(
                    f"{path.name}, line {number + 1}: a face of three corners expected, got {line.strip()!r}"
                )
            polygons.append([_index(corner[0], len(rows)) for corner in corners])
            if min(polygons[-1]) < 0:
                raise FormatError(
                    f"{path.name}, line {number + 1}: vertices count from 1, or back from -1, of {len(rows)} so far; got "
                    f"{line.strip()!r}"
                )
            normals.append([_index(corner[2], len(normal_rows)) if corner[2] else -1 for corner in corners])
            for kind, name in now.items():
                names[kind].append(name)
    for what, used, there in (("vertex", polygons, len(rows)), ("normal", normals, len(normal_rows))):
        highest = max((max(polygon) for polygon in used), default=-1)
        if highest >= there:
            raise FormatError(f"{path.name}: a face names {what} {highest + 1} of {there}; is the file whole?")
    return rows, normal_rows, polygons, normals, names


def _index(word: str, count: int) -> int:
    """The index of a word: OBJ counts from one; negative numbers count back from the current line."""
    number = int(word)
    return number - 1 if number > 0 else count + number if number else -1


def _copied(name: str, source: Path, target: Path) -> Iterator[str]:
    """Copy a companion file under the same name; an existing file is never replaced."""
    parts = PurePosixPath(name.replace("\\", "/"))
    here, there = source / parts, target / parts
    if parts.is_absolute() or ".." in parts.parts:
        yield f"{name}, which the OBJ names, lies outside its folder and is not copied"
    elif not here.is_file():
        yield f"{name}, which the OBJ names, is not beside it"
    elif there.exists() and there.read_bytes() != here.read_bytes():
        yield f"{there} exists and differs from the one beside {source.name}; it is left unchanged"
    elif not there.exists():
        there.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(here, there)
