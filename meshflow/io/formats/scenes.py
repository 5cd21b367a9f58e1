"""STL, GLB, glTF and 3MF: scenes of named parts, read and written by trimesh; one data object with sections."""

import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from zipfile import is_zipfile

import numpy as np
import trimesh
from numpy.typing import ArrayLike
from trimesh.exchange.stl import export_stl_ascii
from trimesh.resolvers import FilePathResolver

from meshflow.errors import Fact, FormatError, InputError
from meshflow.geometry.validation import Array
from meshflow.io.adapters.trimesh import attribute_of, carries, channel_of, stored_normals, with_changes
from meshflow.io.document import Document, Imported, MeshSource, Section
from meshflow.io.formats.glb_bytes import GlbBytes
from meshflow.io.formats.gltf import lost, named
from meshflow.io.formats.scene_bytes import STL_HEAD, marked_stl, need_3mf, written
from meshflow.io.metadata import Found, ReadOptions
from meshflow.io.own_folder import must_stay_inside
from meshflow.io.vertex_merging import Skin, joined, said_of
from meshflow.surfaces.data import Data
from meshflow.surfaces.mesh import Mesh

__all__ = ["Parts", "read", "taken_apart"]


@dataclass(frozen=True, eq=False)
class Part:
    """One mesh of a scene.

    :param name: of its geometry.
    :param frame: (4, 4), from its coordinates to those of the scene; that of its first node if it has several.
    :param family: parts of the same family are connected: the primitives of one glTF mesh.
    """

    name: str
    frame: Array
    family: int
    mesh: trimesh.Trimesh
    normals: Array | None

    @property
    def points(self) -> Array:
        """Positions (n, 3) in the coordinates of the scene."""
        with np.errstate(invalid="ignore", over="ignore"):  # refused afterwards, with the name of the file
            return np.asarray(self.mesh.vertices) @ self.frame[:3, :3].T + self.frame[:3, 3]


@dataclass(frozen=True, eq=False)
class Parts(MeshSource):
    """A file of one or several meshes; the mesh of the document contains them all, in the coordinates of the scene.

    :param channels: the name of the channels that move.
    :param suffix: of its format; empty for a scene in memory.
    :param ascii: whether it is a text STL.
    :param head: the first bytes of a binary STL.
    :param glb: the content of a GLB of which only the positions change.
    """

    scene_read: trimesh.Scene
    parts: tuple[Part, ...]
    skin: Skin
    channels: str | None
    suffix: str = ""
    ascii: bool = False
    head: bytes = b""
    glb: GlbBytes | None = None

    def writes(self, suffix: str) -> bool:
        """Whether it is the extension of the file."""
        return suffix == self.suffix

    @property
    def sections(self) -> tuple[Section, ...]:
        """Names and vertices of its meshes; the primitives of one glTF mesh are one."""
        names: dict[int, list[str]] = {}
        for part in self.parts:
            names.setdefault(part.family, []).append(part.name)
        if len(names) < 2:
            return ()
        stored = np.concatenate([np.full(len(part.mesh.vertices), part.family) for part in self.parts])
        family = stored[self.skin.first]
        return tuple((", ".join(own), np.flatnonzero(family == one)) for one, own in names.items())

    def samples(self, given: ArrayLike | None, word: str) -> ArrayLike | None:
        """An array of one number per vertex of all parts in order, unchanged, or by the name of an attribute of all parts."""
        return self.skin.samples(given, word, self._attribute)

    def _attribute(self, name: str) -> Found:
        found = [attribute_of(part.mesh, name) for part in self.parts]
        columns = [values for values, _ in found if values is not None]
        there = [word for word in found[0][1] if all(word in names for _, names in found)]
        return (np.concatenate(columns) if len(columns) == len(found) else None), there

    def scene(self, data: Mesh) -> trimesh.Scene:
        """The scene with moved parts; names, transforms and materials are kept."""
        scene: trimesh.Scene = self.scene_read.copy()
        self.put(scene, data)
        return scene

    def put(self, scene: trimesh.Scene, data: Mesh) -> None:
        """Put the moved parts into a copy of the scene."""
        points = self.skin.points_of(data)
        values, start = self.skin.channels_of(data), 0
        for part in self.parts:
            rows = slice(start, start + len(part.mesh.vertices))
            start = rows.stop
            shift = (points - self.skin.points)[rows] @ np.linalg.inv(part.frame[:3, :3]).T
            moved = (
                part.mesh.vertices + shift if shift.any() else None
            )  # added, so that points that stay keep their bits
            part_values = None if values is None else values[rows]
            scene.geometry[part.name] = with_changes(part.mesh, moved, part.normals, self.channels, part_values)

    def save(self, data: Mesh, path: Path, target: Path, tags: Mapping[str, str]) -> tuple[str, ...]:
        """Write the scene in its own format."""
        scene = self.scene(data)
        if self.ascii:
            path.write_text("".join(export_stl_ascii(scene.geometry[part.name]) for part in self.parts))
            return ()
        if self.glb is not None:
            path.write_bytes(self.glb.with_parts([_as_stored(scene.geometry[part.name], part) for part in self.parts]))
            return ()
        content = written(scene, self.suffix)
        if self.head:
            content = marked_stl(content, self.head, self.parts[0].mesh.face_attributes["stl"])
        path.write_bytes(content)
        return ()


def read(path: Path, options: ReadOptions) -> Document:
    """Read all meshes of a scene as one mesh.

    :raises FormatError: when it has no triangles, is compressed in an unsupported way, or is cut off.
    :raises InputError: for channels that a part does not have, or whatever the data object refuses.
    """
    suffix = path.suffix.lower()
    missed = list(lost(path)) if suffix in (".glb", ".gltf") else []
    is_ascii = suffix == ".stl" and _is_ascii_stl(path)
    head = _head_of_whole(path) if suffix == ".stl" and not is_ascii else b""
    if suffix in (".gltf", ".glb") and not options.allow_remote:
        advice = "move it there, or allow_remote=True"
        must_stay_inside(path, named(path), f"a {suffix[1:].upper()}", advice)
    if suffix == ".3mf":
        if not is_zipfile(path):
            raise FormatError(
                f"{path.name}: not a 3MF, which is a zip; check that it is complete and has the right extension"
            )
        need_3mf()
    near = FilePathResolver(str(path), allow_anywhere=options.allow_remote)
    scene = trimesh.load_scene(path, file_type=suffix[1:], process=False, resolver=near)
    for mesh in scene.geometry.values():
        _round_colours(mesh)
    parts = _parts_of(path.name, scene, suffix)
    moved = suffix == ".glb" and options.attribute is None  # and no colours
    glb = GlbBytes.of(path, [np.asarray(part.mesh.vertices) for part in parts]) if moved else None
    notes = missed if glb is None else []
    others = len(scene.geometry) - len(parts)
    if others:
        notes.append(f"{others} parts without triangles (points, lines) stay as they are")
    points, faces, family, values = _one_after_the_other(parts, options.attribute)
    skin = Skin.of(points, faces, split=family, channels=values, moves=options.moves)
    if suffix == ".stl":
        notes.append(_apart(3 * len(faces), skin))
    source = Parts(scene, parts, skin, options.attribute, suffix, is_ascii, head, glb)
    joined_here = () if suffix == ".stl" else skin.note
    return Document(skin.data, path, source, (*joined_here, *notes, *said_of(source.sections)))


def taken_apart(
    scene: trimesh.Scene, options: ReadOptions
) -> tuple[tuple[tuple[str, Imported], ...], Callable[[Sequence[Data]], trimesh.Scene]]:
    """The parts of a ``trimesh.Scene``, and the conversion of their data back to a scene; all else is kept.

    :param options: ``channels``, the name of a vertex attribute of every part, or ``"colors"``; ``moves``.
    :raises InputError: for a scene without triangles, arrays where names are expected, or options that do not apply.
    """
    options.must_be_mesh("a trimesh scene")
    if options.channels is not None and not isinstance(options.channels, str):
        kind = type(options.channels).__name__
        raise InputError(f"channels: of several parts the name of an attribute expected, got {kind}")
    copy: trimesh.Scene = scene.copy()
    made: list[Parts] = []
    parts = _parts_of("trimesh.Scene", copy, "")
    families: dict[int, list[Part]] = {}
    for part in parts:
        families.setdefault(part.family, []).append(part)
    for mine in families.values():
        points, faces, _, values = _one_after_the_other(tuple(mine), options.attribute)
        split = len(mine) > 1 or carries(mine[0].mesh)
        skin = Skin.of(points, faces, split=split, channels=values, moves=options.moves)
        made.append(Parts(copy, tuple(mine), skin, options.attribute))

    def to_object(surfaces: Sequence[Data]) -> trimesh.Scene:
        """The scene with the smoothed parts."""
        new: trimesh.Scene = copy.copy()
        for one, data in zip(made, surfaces, strict=True):
            if not isinstance(data, Mesh):
                raise InputError(f"a scene is made of meshes, got a {type(data).__name__}")
            one.put(new, data)
        return new

    imported = (
        (", ".join(p.name for p in one.parts), Imported(one.skin.data, one.scene, one.skin.note, one.samples))
        for one in made
    )
    return tuple(imported), to_object


def _as_stored(mesh: object, part: Part) -> tuple[Array, Array | None]:
    """Positions (n, 3) of a moved part, and its normals (n, 3) if they changed with them."""
    if not isinstance(mesh, trimesh.Trimesh):
        raise InputError(f"{part.name}: a mesh expected, got {type(mesh).__name__}")
    points = np.asarray(mesh.vertices)
    if part.normals is None or np.array_equal(points, part.mesh.vertices):
        return points, None
    normals = np.asarray(mesh.vertex_normals)
    return points, np.where(np.any(normals, axis=1, keepdims=True), normals, part.normals)


def _apart(corners: int, skin: Skin) -> str:
    """A note on the vertices of an STL."""
    said = (
        f"STL stores every corner apart: {corners} corners at bit-identical positions are {len(skin.points)} vertices"
    )
    if not skin.note:
        return Fact(said)
    return type(skin.note[0])(f"{said}; {skin.note[0]}")


def _head_of_whole(path: Path) -> bytes:
    """The first 80 bytes of a binary STL.

    :raises FormatError: if it is shorter than its number of triangles says, by as much as a file that was cut off is. It says
        how many are expected. What begins otherwise is refused by its reader.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(84)
    count = int.from_bytes(head[80:84], "little")
    text = head.lstrip()[:5].lower() == b"solid"
    if len(head) == 84 and size < 84 + 50 * count and (not text or 84 + 50 * count < 1000 * size):
        raise FormatError(f"{path.name}: cut off, {count} triangles expected in {size} bytes; get the whole file")
    if len(head) == 84 and count == 0 and size > 84 and not text:
        raise FormatError(
            f"{path.name}: it says that it has no triangle, but {size - 84} bytes follow; export it again"
        )
    return head[:STL_HEAD]


def _parts_of(title: str, scene: trimesh.Scene, suffix: str) -> tuple[Part, ...]:
    nodes: dict[str, str] = {}
    for node in scene.graph.nodes_geometry:
        nodes.setdefault(str(scene.graph[node][1]), str(node))
    parts, families = [], {}
    for name, mesh in scene.geometry.items():
        if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
            continue
        frame = np.array(scene.graph[nodes[name]][0]) if name in nodes else np.eye(4)
        if abs(np.linalg.det(frame[:3, :3])) < 1e-30:
            raise FormatError(
                f"{title}: part {name} is flattened by a transform without inverse; apply its transforms first"
            )
        parent = scene.graph.transforms.parents.get(nodes.get(name))
        family = str(parent or name) if mesh.metadata.get("from_gltf_primitive") else str(name)
        mesh = _without_copies(mesh) if suffix == ".stl" else mesh
        parts.append(Part(name, frame, families.setdefault(family, len(families)), mesh, stored_normals(mesh)))
    if not parts:
        raise FormatError(
            f"{title}: no triangles in it{f' (is it a {suffix[1:].upper()}?)' if suffix else ''}; a mesh expected, "
            "a point cloud has no surface"
        )
    return tuple(parts)


def _one_after_the_other(parts: tuple[Part, ...], channels: str | None) -> tuple[Array, Array, Array, Array | None]:
    """Points, faces, the family of each point, and channels."""
    faces, start = [], 0
    for part in parts:
        faces.append(np.asarray(part.mesh.faces) + start)
        start += len(part.mesh.vertices)
    points = np.concatenate([part.points for part in parts])
    family = np.concatenate([np.full(len(part.mesh.vertices), part.family) for part in parts])
    values = np.concatenate([channel_of(part.mesh, channels) for part in parts]) if channels is not None else None
    return points, np.concatenate(faces), family, values


def _round_colours(mesh: object) -> None:
    """Convert vertex colours beside a texture to 256 levels, because trimesh writes the stored values as integers."""
    beside = getattr(getattr(mesh, "visual", None), "vertex_attributes", {})
    colours = np.asarray(beside["color"]) if "color" in beside else None
    if colours is None or colours.dtype == np.uint8:
        return
    most = 1.0 if colours.dtype.kind == "f" else float(np.iinfo(colours.dtype).max)
    beside["color"] = np.rint(np.clip(colours / most, 0, 1) * 255).astype(np.uint8)


def _without_copies(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """The mesh of an STL, with corners at bit-identical positions joined."""
    first, home = joined(np.asarray(mesh.vertices))
    return trimesh.Trimesh(
        np.asarray(mesh.vertices)[first],
        home[mesh.faces],
        process=False,
        metadata=mesh.metadata,
        face_attributes=mesh.face_attributes,
    )


def _is_ascii_stl(path: Path) -> bool:
    """Whether an STL is text; trimesh silently drops a last solid that is cut off.

    :raises FormatError: when it is text and cut off.
    """
    content = path.read_bytes()
    binary = len(content) >= 84 and len(content) == 84 + 50 * struct.unpack_from("<I", content, 80)[0]
    if binary or not content.lstrip().lower().startswith(b"solid"):
        return False
    lines = content.strip().lower().splitlines()
    if not lines[-1].strip().startswith(b"endsolid"):
        last = lines[-1].decode("latin-1")[:40]
        raise FormatError(f"{path.name}: cut off, an ASCII STL ends with endsolid, this one with {last!r}")
    return True
