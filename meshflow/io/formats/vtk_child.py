"""What VTK reads, as bytes: the work of the process that reads a file of VTK, and may end of it (:mod:`vtk_process`).

The readers of VTK trust the counts of a file: where these lie, they allocate without bound or read beyond their memory, and the
process ends by a signal. So it is not the caller's. Of VTK it imports the readers alone, which is quick.
"""

import json
import os
import struct
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkOutputWindow, vtkPoints, vtkStringOutputWindow
from vtkmodules.vtkCommonDataModel import (
    vtkCellArray,
    vtkCompositeDataSet,
    vtkDataObject,
    vtkMultiBlockDataSet,
    vtkPolyData,
    vtkUnstructuredGrid,
)
from vtkmodules.vtkIOLegacy import vtkDataSetReader
from vtkmodules.vtkIOXML import (
    vtkXMLMultiBlockDataReader,
    vtkXMLPolyDataReader,
    vtkXMLPolyDataWriter,
    vtkXMLUnstructuredGridReader,
)

__all__ = ["Header", "Tree", "answer", "encoded", "main"]

# The kinds of cells (VTK_VERTEX to VTK_QUAD) of an UnstructuredGrid that is a surface, as a PolyData has them, in its order; all
# others fill space.
_CELLS = {"Verts": (1, 2), "Lines": (3, 4), "Polys": (5, 7, 8, 9), "Strips": (6,)}
_PIXEL = 8
# What pyvista calls it.
_NAMES = {"StructuredPoints": "ImageData"}
_READERS = {".vtp": vtkXMLPolyDataReader, ".vtu": vtkXMLUnstructuredGridReader}


class Tree(TypedDict):
    """What a file holds; surfaces stand behind the header, as VTP.

    :ivar other: the type of a data set that is no surface, else empty; ``why``: more words on it.
    :ivar blocks: names and trees, where it holds blocks.
    :ivar size: bytes of a surface, or of a PolyData with the field data of the blocks.
    """

    other: str
    why: str
    blocks: "list[tuple[str, Tree | None]] | None"
    size: int


class Header(TypedDict):
    """What stands before the surfaces: ``wrong``, what VTK said, is empty where it was ``found``."""

    wrong: str
    found: Tree | None


class _LyingError(Exception):
    """The counts of a data set are not those of its arrays."""


def main() -> None:
    """Answer on stdout, each answer behind its length, for each path in a line of stdin, until that ends.

    No more memory is taken than the last argument allows (bytes).
    """
    _limit(int(sys.argv[-1]))
    for line in sys.stdin.buffer:
        content = answer(Path(os.fsdecode(line.removesuffix(b"\n").replace(b"\0", b"\n"))))
        sys.stdout.buffer.write(struct.pack("<Q", len(content)) + content)
        sys.stdout.buffer.flush()


def answer(path: Path) -> bytes:
    """A file as bytes: the length of a header, the header in JSON, and each surface as a VTP.

    The header is a :class:`Header`.
    """
    with _listened() as heard:
        found = _read(path)
    if heard:  # a file that is cut off comes back as a mesh of whatever is in memory, with no more than a warning
        return _packed(Header(wrong=heard[0], found=None), [])
    if found is None:
        return _packed(Header(wrong="there is no data set in it", found=None), [])
    blobs: list[bytes] = []
    try:
        tree = _tree(found, blobs)
    except _LyingError as cause:
        return _packed(Header(wrong=str(cause), found=None), [])
    return _packed(Header(wrong="", found=tree), blobs)


def _packed(header: Header, blobs: list[bytes]) -> bytes:
    words = json.dumps(header).encode()
    return b"".join([struct.pack("<Q", len(words)), words, *blobs])


def _read(path: Path) -> Any:
    """What VTK makes of a file. Its bytes are read here: VTK cannot open every name."""
    suffix = path.suffix.lower()
    if suffix == ".vtm":
        blocks = vtkXMLMultiBlockDataReader()
        blocks.SetFileName(str(path))
        blocks.Update()
        return blocks.GetOutput()
    reader: Any = _READERS.get(suffix, vtkDataSetReader)()
    reader.ReadFromInputStringOn()
    reader.SetInputString(path.read_bytes())
    if isinstance(reader, vtkDataSetReader):
        for kind in ("Scalars", "ColorScalars", "Normals", "TCoords", "Vectors", "Fields", "Tensors"):
            getattr(reader, f"ReadAll{kind}On")()
    reader.Update()
    return reader.GetOutput()


def _tree(data: vtkDataObject | None, blobs: list[bytes]) -> "Tree | None":
    """The tree of a data set, its surfaces behind the others."""
    if data is None:
        return None
    if isinstance(data, vtkMultiBlockDataSet):
        blocks: list[tuple[str, Tree | None]] = []
        for i in range(data.GetNumberOfBlocks()):
            told = data.GetMetaData(i).Get(vtkCompositeDataSet.NAME()) if data.HasMetaData(i) else None
            blocks.append((told or str(i), _tree(data.GetBlock(i), blobs)))
        fields = vtkPolyData()
        fields.SetFieldData(data.GetFieldData())
        blobs.append(encoded(fields))
        return Tree(other="", why="", blocks=blocks, size=len(blobs[-1]))
    if isinstance(data, vtkUnstructuredGrid):
        kinds = _kinds(data)
        if not np.isin(kinds, sum(_CELLS.values(), ())).all():
            return Tree(other="UnstructuredGrid", why="whose cells fill space", blocks=None, size=0)
        data = _as_surface(data, kinds)
    if not isinstance(data, vtkPolyData):
        name = data.GetClassName().removeprefix("vtk")
        return Tree(other=_NAMES.get(name, name), why="", blocks=None, size=0)
    _must_be_consistent(data)
    blobs.append(encoded(data))
    return Tree(other="", why="", blocks=None, size=len(blobs[-1]))


def encoded(poly: vtkPolyData) -> bytes:
    """A PolyData as a VTP, all arrays as they are, in their order."""
    writer = vtkXMLPolyDataWriter()
    writer.SetInputDataObject(poly)
    writer.SetCompressorTypeToNone()
    writer.SetHeaderTypeToUInt64()
    writer.SetDataModeToAppended()
    writer.EncodeAppendedDataOff()
    writer.WriteToOutputStringOn()
    writer.Write()
    text: Any = writer.GetOutputString()
    return text if isinstance(text, bytes) else text.encode()


def _kinds(grid: vtkUnstructuredGrid) -> np.ndarray:
    """The kind of each cell."""
    kinds = [grid.GetCellType(i) for i in range(grid.GetNumberOfCells())]
    return np.array(kinds, dtype=np.int64)


def _as_surface(grid: vtkUnstructuredGrid, kinds: np.ndarray) -> vtkPolyData:
    """The cells of a grid that is a surface as vertices, lines, polygons and strips; points and arrays as they are."""
    _must_be_cells(grid.GetCells(), grid.GetNumberOfPoints())
    ends, corners = _parts(grid.GetCells())
    surface = vtkPolyData()
    surface.SetPoints(grid.GetPoints() or vtkPoints())
    order = []
    for name, own in _CELLS.items():
        rows = np.flatnonzero(np.isin(kinds, own))
        order.append(rows)
        cells = [corners[ends[row] : ends[row + 1]] for row in rows]
        cells = [cell[[0, 1, 3, 2]] if kinds[row] == _PIXEL else cell for row, cell in zip(rows, cells, strict=True)]
        made = vtkCellArray()
        sizes = np.cumsum([0, *(len(cell) for cell in cells)])
        joined = np.concatenate(cells) if cells else np.zeros(0, np.int64)
        made.SetData(numpy_to_vtkIdTypeArray(sizes, 1), numpy_to_vtkIdTypeArray(joined.astype(np.int64), 1))
        getattr(surface, f"Set{name}")(made)
    surface.GetPointData().ShallowCopy(grid.GetPointData())
    surface.SetFieldData(grid.GetFieldData())
    cell_data, by_kind = grid.GetCellData(), np.concatenate(order)
    for i in range(cell_data.GetNumberOfArrays()):
        array = cell_data.GetArray(i)
        if array is not None and array.GetNumberOfTuples() == len(kinds):
            sorted_ = numpy_to_vtk(vtk_to_numpy(array)[by_kind], 1)
            sorted_.SetName(array.GetName())
            surface.GetCellData().AddArray(sorted_)
    for attribute in range(surface.GetCellData().NUM_ATTRIBUTES):
        active = cell_data.GetAbstractAttribute(attribute)
        if active is not None:
            surface.GetCellData().SetActiveAttribute(active.GetName(), attribute)
    return surface


def _parts(cells: vtkCellArray) -> tuple[np.ndarray, np.ndarray]:
    """Where the corners of each cell begin and end, and the corners."""
    return vtk_to_numpy(cells.GetOffsetsArray()), vtk_to_numpy(cells.GetConnectivityArray())


def _must_be_cells(cells: vtkCellArray, points: int) -> None:
    """Refuse cells with other corners than they say, or of points that are not there.

    :raises _LyingError: with what is wrong.
    """
    ends, corners = _parts(cells)
    if len(ends) and (ends[0] != 0 or ends[-1] != len(corners) or (np.diff(ends) < 0).any()):
        raise _LyingError(f"the sizes of its cells do not add up to the {len(corners)} corners that are there")
    if len(corners) and not 0 <= corners.min() <= corners.max() < points:
        wrong = corners.min() if corners.min() < 0 else corners.max()
        raise _LyingError(f"a cell names point {wrong}, and there are {points} points")


def _must_be_consistent(poly: vtkPolyData) -> None:
    """Refuse cells and arrays whose counts are not those of the data set: what reads them trusts these numbers.

    :raises _LyingError: with what is wrong.
    """
    points = poly.GetNumberOfPoints()
    for cells in (poly.GetVerts(), poly.GetLines(), poly.GetPolys(), poly.GetStrips()):
        _must_be_cells(cells, points)
    for data, count, what in (
        (poly.GetPointData(), points, "points"),
        (poly.GetCellData(), poly.GetNumberOfCells(), "cells"),
    ):
        for i in range(data.GetNumberOfArrays()):
            array = data.GetAbstractArray(i)
            if array.GetNumberOfTuples() != count:
                raise _LyingError(f"{array.GetNumberOfTuples()} values of {array.GetName()} for {count} {what}")


def _limit(memory: int) -> None:
    """No more memory than that, where the system can say so, and no picture of it on the disk when the process ends."""
    try:
        import resource
    except ImportError:  # Windows
        return
    for kind, wanted in ((resource.RLIMIT_AS, memory), (resource.RLIMIT_CORE, 0)):
        hard = resource.getrlimit(kind)[1]
        resource.setrlimit(kind, (wanted if hard == resource.RLIM_INFINITY else min(wanted, hard), hard))


@contextmanager
def _listened() -> Iterator[list[str]]:
    """What VTK has to say while it reads, a sentence for each message."""
    heard: list[str] = []
    before, window = vtkOutputWindow.GetInstance(), vtkStringOutputWindow()
    vtkOutputWindow.SetInstance(window)
    try:
        yield heard
    finally:
        vtkOutputWindow.SetInstance(before)
    for message in window.GetOutput().split("\n\n"):
        if words := " ".join(message.split()):
            heard.append(words.rpartition("): ")[2])
