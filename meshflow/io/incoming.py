"""Files that cannot be read in place: pipes, stdin, and names that libraries cannot open. They are replaced by a copy or a
link.
"""

import atexit
import os
import re
import shutil
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp

from meshflow.errors import FormatError

__all__ = ["STDIN", "absent", "plainly_named", "set_down", "temporary"]

STDIN = Path("-")
_STDIN = (STDIN, Path("/dev/stdin"), Path("/dev/fd/0"))
# A name that is an address in a network; as a path it has one slash.
_ADDRESS = re.compile(r"(?i)(https?|ftp|s3|gs|az|file):/")
# The first bytes of formats that can be recognised by them, for files without an extension.
_BEGINS = (
    (b"ply", ".ply"),
    (b"glTF", ".glb"),
    (b"# vtk", ".vtk"),
    (b"OFF", ".off"),
    (b"solid", ".stl"),
    (b"\x93NUMPY", ".npy"),
    (b"PK\x03\x04", ".npz"),
    (b"\x89PNG", ".png"),
    (b"\xff\xd8\xff", ".jpg"),
    (b"II*\0", ".tif"),
    (b"MM\0*", ".tif"),
    (b"II+\0", ".tif"),
    (b"ncols", ".asc"),
    (b"v ", ".obj"),
    (b"# ", ".obj"),
)


@lru_cache(maxsize=1)
def temporary(process: int) -> Path:
    """A temporary folder of this process; it is deleted when the process ends."""
    folder = mkdtemp(prefix="meshflow-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def absent(path: Path) -> FormatError:
    """The refusal of a path at which no file is."""
    if _ADDRESS.match(str(path)):
        return FormatError(f"{path}: a file expected, got an address; download it first")
    if path.is_symlink():
        return FormatError(f"{path}: a link to {os.readlink(path)}, which leads to no file; name the file itself")
    return FormatError(f"{path}: no such file")


def set_down(path: Path) -> Path:
    """The path of a regular file unchanged; the content of ``-`` (stdin), a pipe or a device as a file with the right extension.

    :raises FormatError: if the content is empty, or has no extension and cannot be recognised by its first bytes.
    """
    if path != STDIN and (not path.exists() or path.is_dir() or stat.S_ISREG(path.stat().st_mode)):
        return path
    name = "stdin" if path in _STDIN else path.name
    if path == STDIN and sys.stdin is None:
        raise FormatError("stdin is closed; send the content of a file to it, or name the file")
    content = sys.stdin.buffer.read() if path == STDIN else path.read_bytes()
    if not content:
        raise FormatError(f"{name if path in _STDIN else path} is empty (0 bytes)")
    suffix = path.suffix if path != STDIN else ""
    suffix = suffix or next((suffix for begin, suffix in _BEGINS if content.startswith(begin)), "")
    if not suffix and len(content) >= 84 and len(content) == 84 + 50 * int.from_bytes(content[80:84], "little"):
        suffix = ".stl"
    if not suffix:
        raise FormatError(
            f"{name}: a file that says what it is expected (PLY, TIFF, PNG, ...), got {content[:16]!r}...; name it"
        )
    target = temporary(os.getpid()) / f"{Path(name).stem}{suffix}"
    target.write_bytes(content)
    return target


@contextmanager
def plainly_named(path: Path) -> Iterator[Path]:
    """A path that libraries can open: if the name is not UTF-8, a temporary link to it."""
    try:
        str(path).encode("utf-8")
    except UnicodeEncodeError:
        with TemporaryDirectory(prefix="meshflow-") as folder:
            name = os.fsencode(path.name).decode("ascii", "replace").replace("\ufffd", "_")
            link = Path(folder) / name
            link.symlink_to(path.absolute())
            yield link
    else:
        yield path
