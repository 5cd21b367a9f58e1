"""Reads files of VTK in a child process, which they may crash (:mod:`vtk_child`), and decodes its answers."""

import atexit
import json
import os
import struct
import subprocess
import sys
import threading
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from meshflow.errors import FormatError
from meshflow.io.formats.vtk_child import Header, Tree, answer

if TYPE_CHECKING:
    import pyvista

__all__ = ["Other", "read_apart"]

# The share of the machine's memory that reading may take; 4 GB where the memory is not known.
_SHARE, _USUAL = 0.5, 4 << 30
_CODE = (
    "import sys, json; sys.path[:] = json.loads(sys.argv[1]); from meshflow.io.formats.vtk_child import main; main()"
)


@dataclass(frozen=True)
class Other:
    """A data set that is no surface.

    :param kind: its type, as VTK names it.
    :param why: an explanation; may be empty.
    """

    kind: str
    why: str


def read_apart(path: Path, advice: str) -> "pyvista.PolyData | pyvista.UnstructuredGrid | pyvista.MultiBlock | Other":
    """Read a file of VTK in a child process.

    The child starts while pyvista is imported here, and is kept for the next file.

    :param advice: the end of a refusal, which says what may be wrong with the file.
    :returns: a surface, a body, blocks of surfaces, or another data set.
    :raises FormatError: with the message of VTK, when the child crashed, or for a block that is no surface.
    """
    header, body = _answered(path, advice)
    if header["wrong"]:
        raise FormatError(f"{path.name} cannot be read: {header['wrong']}; {advice}")
    found, rest = _unpacked(path, header["found"], body, "")
    if rest:
        raise FormatError(f"{path.name} cannot be read: {len(rest)} bytes too many; {advice}")
    return found


def _answered(path: Path, advice: str) -> tuple[Header, memoryview]:
    """The header of an answer, and the bytes after it."""
    if not sys.executable:  # Python embedded in another program: no child can be started
        content = answer(path)
    else:
        try:
            content = _reader().answer(path)
        except _EndedError as cause:
            raise FormatError(
                f"{path.name} cannot be read: VTK does not survive what it says of itself ({cause}); {advice}"
            ) from cause
    (size,) = struct.unpack_from("<Q", content)
    return json.loads(content[8 : 8 + size]), memoryview(content)[8 + size :]


class _EndedError(Exception):
    """The child process has ended."""


class _Reader:
    """The child process, which reads one file after the other; it ends with its stdin, at the latest with this process."""

    def __init__(self) -> None:
        words = [sys.executable, "-c", _CODE, json.dumps(sys.path), str(_memory())]
        self._lock = threading.Lock()
        self._process = subprocess.Popen(
            words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        )
        atexit.register(self.end)

    @property
    def lives(self) -> bool:
        """Whether the child is running."""
        return self._process.poll() is None

    def answer(self, path: Path) -> bytes:
        """The answer of :func:`vtk_child.answer` for a file.

        :raises _EndedError: when the child ends; the message says how.
        """
        asked, answered = self._process.stdin, self._process.stdout
        with self._lock:
            try:
                if asked is None or answered is None:
                    raise _EndedError("it was not started")
                asked.write(os.fsencode(path.absolute()).replace(b"\n", b"\0") + b"\n")
                asked.flush()
                import pyvista  # noqa: F401 - while it reads

                head = answered.read(8)
                content = answered.read(struct.unpack("<Q", head)[0]) if len(head) == 8 else b""
                if not content:
                    raise _EndedError(self._how())
                return content
            except BrokenPipeError as cause:
                raise _EndedError(self._how()) from cause
            except BaseException:
                self.end()
                raise

    def _how(self) -> str:
        status = self._process.wait()
        return f"its reader ended by signal {-status}" if status < 0 else f"its reader ended with {status}"

    def end(self) -> None:
        """End the child, and close its pipes."""
        atexit.unregister(self.end)
        self._process.kill()
        self._process.communicate()


def _reader() -> _Reader:
    """The running reader of this process."""
    if not _started(os.getpid()).lives:
        _started.cache_clear()
    return _started(os.getpid())


@lru_cache(maxsize=1)
def _started(process: int) -> _Reader:
    """Start the reader of a process; a forked process starts its own."""
    return _Reader()


def _memory() -> int:
    """The memory limit in bytes."""
    if not hasattr(os, "sysconf"):
        return _USUAL
    return int(_SHARE * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))


def _unpacked(path: Path, tree: Tree | None, body: memoryview, name: str) -> tuple[Any, memoryview]:
    """The data of a tree, and the bytes after it."""
    import pyvista

    if tree is None:
        return None, body
    if tree["other"]:
        return Other(tree["other"], tree["why"]), body
    if tree["blocks"] is None:
        return _decoded(body[: tree["size"]], tree["solid"]), body[tree["size"] :]
    blocks = pyvista.MultiBlock()
    for own, inner in tree["blocks"]:
        block, body = _unpacked(path, inner, body, f"{name}/{own}" if name else own)
        if isinstance(block, pyvista.UnstructuredGrid):
            block = Other("UnstructuredGrid", "whose cells fill space")
        if isinstance(block, Other):
            where = f"{name}/{own}" if name else own
            raise FormatError(
                f"{path.name}: block {where} is {_with_article(block.kind)}, and a surface of polygons is expected; "
                "smooth it in Python"
            )
        blocks.append(block, own)
    fields = _decoded(body[: tree["size"]]).field_data
    for field in fields:
        blocks.field_data[field] = fields[field]
    return blocks, body[tree["size"] :]


def _with_article(kind: str) -> str:
    return f"{'an' if kind[0] in 'AEIOU' else 'a'} {kind}"


def _decoded(content: memoryview, solid: bool = False) -> Any:
    """A PolyData from a VTP, or an UnstructuredGrid from a VTU, that the child has checked and written."""
    import pyvista
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLUnstructuredGridReader

    reader: Any = vtkXMLUnstructuredGridReader() if solid else vtkXMLPolyDataReader()
    reader.ReadFromInputStringOn()
    reader.SetInputString(bytes(content))
    reader.Update()
    return (pyvista.UnstructuredGrid if solid else pyvista.PolyData)(reader.GetOutput())
