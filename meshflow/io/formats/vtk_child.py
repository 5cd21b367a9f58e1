"""The work of the child process that reads files of VTK and may crash (:mod:`vtk_process`).

The readers of VTK trust the counts in a file: if these are wrong, they allocate without bound or read beyond their memory, and
the process ends by a signal. Therefore it is not the process of the caller. It imports only the readers of VTK, which is fast.
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
    vtkXMLUnstructuredGridWriter,
)

__all__ = ["Header", "Tree", "answer", "encoded", "main"]

# The cell types (VTK_VERTEX to VTK_QUAD) of an UnstructuredGrid that is a surface, in the order of PolyData; others fill space.
_CELLS = {"Verts": (1, 2), "Lines": (3, 4), "Polys": (5, 7, 8, 9), "Strips": (6,)}
_PIXEL = 8
# The name in pyvista.
_NAMES = {"StructuredPoints": "ImageData"}
_READERS = {".vtp": vtkXMLPolyDataReader, ".vtu": vtkXMLUnstructuredGridReader}


class Tree(TypedDict):
    """The contents of a file; surfaces follow the header as VTP, bodies as VTU.

    :ivar other: the type of a data set that is no surface, else empty; ``why``: an explanation.
    :ivar solid: whether it is a body: an UnstructuredGrid whose cells fill space.
    :ivar blocks: names and trees, if it contains blocks.
    :ivar size: bytes of a surface, or of a PolyData with the field data of the blocks.
    """

    other: str
    why: str
    solid: bool
    blocks: "list[tuple[str, Tree | None]] | None"
    size: int


class Header(TypedDict):
    """The header before the surfaces: ``wrong`` is the message of VTK, empty where something was ``found``."""

    wrong: str
    found: Tree | None


class _LyingError(Exception):
    """The counts of a data set contradict its arrays."""


def main() -> None:
    """For each path on a line of stdin, write an answer, preceded by its length, to stdout.

    The last argument limits the memory, in bytes.
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
    if heard:  # a file that is cut off is read as a mesh with undefined contents and a warning
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
    """Read a file with VTK. Its bytes are read here, because VTK cannot open every name."""
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
    """The tree of a data set; its surfaces are appended to ``blobs``."""
    if data is None:
        return None
    if isinstance(data, vtkMultiBlockDataSet):
        blocks: list[tuple[str, Tree | None]] = []
        for i in range(data.GetNumberOfBlocks()):
            name = data.GetMetaData(i).Get(vtkCompositeDataSet.NAME()) if data.HasMetaData(i) else None
            blocks.append((name or str(i), _tree(data.GetBlock(i), blobs)))
        fields = vtkPolyData()
        fields.SetFieldData(data.GetFieldData())
        blobs.append(encoded(fields))
        return Tree(other="", why="", solid=False, blocks=blocks, size=len(blobs[-1]))
    if isinstance(data, vtkUnstructuredGrid):
        kinds = _kinds(data)
        if not np.isin(kinds, sum(_CELLS.values(), ())).all():
            _must_be_cells(data.GetCells(), data.GetNumberOfPoints())
            _must_have_counts(data)
            blobs.append(encoded(data))
            return Tree(other="", why="", solid=True, blocks=None, size=len(blobs[-1]))
        data = _as_surface(data, kinds)
    if not isinstance(data, vtkPolyData):
        name = data.GetClassName().removeprefix("vtk")
        return Tree(other=_NAMES.get(name, name), why="", solid=False, blocks=None, size=0)
    _must_be_consistent(data)
    blobs.append(encoded(data))
    return Tree(other="", why="", solid=False, blocks=None, size=len(blobs[-1]))


def encoded(data: vtkPolyData | vtkUnstructuredGrid) -> bytes:
    """A PolyData as a VTP, a body as a VTU, with all arrays in their order."""
    writer: Any = vtkXMLPolyDataWriter() if isinstance(data, vtkPolyData) else vtkXMLUnstructuredGridWriter()
    writer.SetInputDataObject(data)
    writer.SetCompressorTypeToNone()
    writer.SetHeaderTypeToUInt64()
    writer.SetDataModeToAppended()
    writer.EncodeAppendedDataOff()
    writer.WriteToOutputStringOn()
    writer.Write()
    text: Any = writer.GetOutputString()
    return text if isinstance(text, bytes) else text.encode()


def _kinds(grid: vtkUnstructuredGrid) -> np.ndarray:
    """The type of each cell."""
    kinds = [grid.GetCellType(i) for i in range(grid.GetNumberOfCells())]
    return np.array(kinds, dtype=np.int64)


def _as_surface(grid: vtkUnstructuredGrid, kinds: np.ndarray) -> vtkPolyData:
    """A grid that is a surface as PolyData: vertices, lines, polygons and strips, with all points and arrays."""
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
    """The offsets of the cells, and their corners."""
    return vtk_to_numpy(cells.GetOffsetsArray()), vtk_to_numpy(cells.GetConnectivityArray())


def _must_be_cells(cells: vtkCellArray, points: int) -> None:
    """Refuse cells with wrong numbers of corners, or indices of points out of range.

    :raises _LyingError: with the reason.
    """
    ends, corners = _parts(cells)
    if len(ends) and (ends[0] != 0 or ends[-1] != len(corners) or (np.diff(ends) < 0).any()):
        raise _LyingError(f"the sizes of its cells do not add up to the {len(corners)} corners that are there")
    if len(corners) and not 0 <= corners.min() <= corners.max() < points:
        wrong = corners.min() if corners.min() < 0 else corners.max()
        raise _LyingError(f"a cell names point {wrong}, and there are {points} points")


def _must_be_consistent(poly: vtkPolyData) -> None:
    """Refuse cells and arrays whose counts contradict the data set, because later readers trust these counts.

    :raises _LyingError: with the reason.
    """
    points = poly.GetNumberOfPoints()
    for cells in (poly.GetVerts(), poly.GetLines(), poly.GetPolys(), poly.GetStrips()):
        _must_be_cells(cells, points)
    _must_have_counts(poly)


def _must_have_counts(whole: vtkPolyData | vtkUnstructuredGrid) -> None:
    """Refuse arrays whose counts contradict the data set.

    :raises _LyingError: with the reason.
    """
    for data, count, what in (
        (whole.GetPointData(), whole.GetNumberOfPoints(), "points"),
        (whole.GetCellData(), whole.GetNumberOfCells(), "cells"),
    ):
        for i in range(data.GetNumberOfArrays()):
            array = data.GetAbstractArray(i)
            if array.GetNumberOfTuples() != count:
                raise _LyingError(f"{array.GetNumberOfTuples()} values of {array.GetName()} for {count} {what}")


def _limit(memory: int) -> None:
    """Limit the memory of the process, where the system supports it, and disable core dumps."""
    try:
        import resource
    except ImportError:  # Windows
        return
    for kind, wanted in ((resource.RLIMIT_AS, memory), (resource.RLIMIT_CORE, 0)):
        hard = resource.getrlimit(kind)[1]
        resource.setrlimit(kind, (wanted if hard == resource.RLIM_INFINITY else min(wanted, hard), hard))


@contextmanager
def _listened() -> Iterator[list[str]]:
    """Collect the messages of VTK while it reads."""
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
