"""Writes surfaces and bodies to VTK files. They are made in memory first, because the writers of VTK crash on a full disk."""

import errno
import os
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pyvista

__all__ = ["save_blocks", "save_data"]

# The largest ratio of bytes written to bytes in memory, for uncompressed numbers in base 64.
_GROWTH = 1.5


def save_data(poly: "pyvista.PolyData | pyvista.UnstructuredGrid", path: Path) -> None:
    """Write a PolyData as ``.vtp`` or ``.vtk``, or as the UnstructuredGrid of a ``.vtu``; a body as ``.vtk`` or ``.vtu``.

    :raises OSError: when the disk is full.
    """
    from vtkmodules.vtkIOLegacy import vtkPolyDataWriter, vtkUnstructuredGridWriter
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter, vtkXMLUnstructuredGridWriter

    suffix = path.suffix.lower()
    writer: Any
    if suffix == ".vtk":
        writer = vtkPolyDataWriter() if poly.IsA("vtkPolyData") else vtkUnstructuredGridWriter()
        writer.SetFileTypeToBinary()
    else:
        writer = vtkXMLUnstructuredGridWriter() if suffix == ".vtu" else vtkXMLPolyDataWriter()
        writer.SetDataModeToBinary()
    writer.SetInputDataObject(poly.cast_to_unstructured_grid() if suffix == ".vtu" else poly)
    writer.WriteToOutputStringOn()
    writer.Write()
    text = writer.GetOutputStdString() if suffix == ".vtk" else writer.GetOutputString()
    path.write_bytes(text if isinstance(text, bytes) else text.encode())


def save_blocks(blocks: "pyvista.MultiBlock", path: Path) -> None:
    """Write a ``.vtm`` and the folder beside it that holds its blocks, without its suffix.

    VTK writes to the folder for temporary files, if there is room; from there they are copied.

    :raises OSError: when a disk is full.
    """
    with TemporaryDirectory(prefix="meshflow-") as place:
        needed = _GROWTH * 1024 * blocks.GetActualMemorySize()
        if shutil.disk_usage(place).free < needed:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), place)
        draft = Path(place) / path.name
        blocks.save(str(draft))
        shutil.copytree(draft.with_suffix(""), path.with_suffix(""))
        shutil.copyfile(draft, path)
