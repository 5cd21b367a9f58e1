"""VTM: blocks of VTK, an index with a folder of data beside it; read and written through pyvista. Each surface is a section."""

import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import FormatError, InputError
from meshflow.geometry.validation import Array
from meshflow.io.adapters.pyvista_blocks import from_blocks
from meshflow.io.document import Document, MeshSource, Multipart, Section
from meshflow.io.formats.vtk import scene_mesh
from meshflow.io.formats.vtk_process import Other, read_apart
from meshflow.io.formats.vtk_writing import save_blocks
from meshflow.io.metadata import ReadOptions
from meshflow.io.own_folder import must_stay_inside
from meshflow.io.vertex_merging import said_of
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.multipart import together

if TYPE_CHECKING:
    import pyvista
    import trimesh

__all__ = ["VtkBlocks", "read"]


@dataclass(frozen=True, eq=False)
class VtkBlocks(MeshSource):
    """Blocks that were read; the mesh of the document contains all their surfaces in order.

    :param meshes: the surface of each block.
    """

    path: Path
    blocks: Multipart
    meshes: tuple[Mesh, ...]

    def writes(self, suffix: str) -> bool:
        """Whether it is ``.vtm``."""
        return suffix == ".vtm"

    @property
    def sections(self) -> tuple[Section, ...]:
        """The blocks, if there are several."""
        names = [name for name, _ in self.blocks.parts]
        return tuple(zip(names, self._rows, strict=True)) if len(names) > 1 else ()

    @property
    def _rows(self) -> list[Array]:
        """The vertices of each block in the mesh of the document."""
        sizes = np.cumsum([0, *(len(data.points) for data in self.meshes)])
        return [np.arange(start, stop) for start, stop in zip(sizes[:-1], sizes[1:], strict=True)]

    def samples(self, given: ArrayLike | None, word: str) -> ArrayLike | None:
        """An array of one number per vertex, all blocks one after the other, as it is or by the name of an array of all."""
        if not isinstance(given, str):
            return given
        return np.concatenate([np.asarray(part.samples(given, word)) for _, part in self.blocks.parts])

    def _back(self, data: Mesh) -> "pyvista.MultiBlock":
        """The blocks with the points and channels of a mesh."""
        made: list[Mesh] = []
        for rows, one in zip(self._rows, self.meshes, strict=True):
            points = data.points[rows].astype(one.points.dtype)
            channels = one.channels if one.channels is None or data.channels is None else data.channels[rows]
            made.append(replace(one, points=points, channels=channels))
        return self.blocks.to_object(made)

    def save(self, data: Mesh, path: Path, target: Path, tags: Mapping[str, str]) -> tuple[str, ...]:
        """Write the index, and the blocks into a folder beside it; other files in that folder are kept."""
        blocks, folder = self._back(data), target.with_suffix("")
        if folder.exists() and not folder.is_dir():
            raise FormatError(f"{folder} is there, and where the blocks of {target.name} would go; name another file")
        for name, word in tags.items():
            blocks.add_field_data([str(word)], f"meshflow:{name}")
        written = path.with_suffix("")
        try:
            save_blocks(blocks, path)
            path.write_text(path.read_text().replace(written.name, escape(folder.name, {'"': "&quot;"})))
            folder.mkdir(exist_ok=True)
            for file in written.iterdir():
                file.replace(folder / file.name.replace(written.name, folder.name))
        finally:
            shutil.rmtree(written, ignore_errors=True)
        return (f"written beside {target.name}: the folder {folder.name}",)

    def scene(self, data: Mesh) -> "trimesh.Scene":
        """The surfaces as a scene of as many parts."""
        import trimesh

        scene = trimesh.Scene()
        for (name, _), poly in zip(self.blocks.parts, _leaves(self._back(data)), strict=True):
            scene.add_geometry(scene_mesh(poly), geom_name=name, node_name=name)
        return scene


def _leaves(blocks: "pyvista.MultiBlock") -> Iterator["pyvista.PolyData"]:
    import pyvista

    for block in blocks:
        if isinstance(block, pyvista.MultiBlock):
            yield from _leaves(block)
        elif block is not None:
            yield block


def read(path: Path, options: ReadOptions) -> Document:
    """Read a VTM file with the files that it names.

    :raises FormatError: for a broken file, one that names files that are not there, or blocks that are no surfaces.
    :raises InputError: for channels that a block does not have, or whatever a data object refuses.
    """
    if not options.allow_remote:
        must_stay_inside(path, _named(path), "a VTM", "move its blocks there, or allow_remote=True")
    blocks = read_apart(path, "are the files beside it that it names?")
    import pyvista

    if isinstance(blocks, Other) or not isinstance(blocks, pyvista.MultiBlock):
        kind = blocks.kind if isinstance(blocks, Other) else type(blocks).__name__
        raise FormatError(f"{path.name}: blocks expected, got {kind}")
    found = from_blocks(blocks, options.without("kind", "allow_remote"))
    parts = found.parts
    meshes = tuple(part.data for _, part in parts if isinstance(part.data, Mesh))
    if len(meshes) < len(parts):
        flat = [name for name, part in parts if not isinstance(part.data, Mesh)]
        raise InputError(f"block {flat[0]}: a surface of polygons expected, got a grid; smooth it in Python")
    notes = [type(note)(f"{name}: {note}") for name, part in parts for note in part.notes]
    source = VtkBlocks(path, found, meshes)
    return Document(together(meshes), path, source, (*notes, *said_of(source.sections)))


def _named(path: Path) -> Iterator[str]:
    """The files that the index names.

    :raises FormatError: when it is no XML.
    """
    try:
        for element in ElementTree.fromstring(path.read_bytes()).iter():
            if name := element.get("file"):
                yield name
    except ElementTree.ParseError as cause:
        raise FormatError(f"{path.name} cannot be read: no index of blocks in XML ({cause}); is it whole?") from cause
