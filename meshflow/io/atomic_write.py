"""Atomic writing: a file is written beside the old one and replaces it only when it is complete."""

import errno
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from shutil import copymode, disk_usage, rmtree
from uuid import uuid4

from meshflow.errors import FormatError

__all__ = ["beside", "folder_beside", "must_be_apart", "must_be_free", "must_have_room", "sides_of"]

# Files that GDAL keeps beside a raster (statistics, overviews, mask) describe the old file and are removed with it.
_SIDECARS = (".aux.xml", ".ovr", ".msk")


def must_be_free(path: Path, overwrite: bool) -> None:
    """Refuse to write where a file is, before any work is done for it.

    :raises FormatError: where one is there, and ``overwrite`` does not say that it is to be replaced; and for a device or a pipe,
        which cannot be.
    """
    if path.exists() and not path.is_file() and not path.is_dir():
        raise FormatError(
            f"{path} is a device or a pipe, and no file that can be replaced; the command writes to stdout as -"
        )
    if path.is_dir() and not overwrite:
        raise FormatError(
            f"{path} exists and is a folder; name a file in it (the command puts results into a folder with --output {path}), or "
            "overwrite the series or store that it is on purpose (overwrite=True)"
        )
    if path.exists() and not overwrite:
        raise FormatError(f"{path} exists; name another file, or overwrite it on purpose (overwrite=True)")


def must_have_room(folder: Path, size: int) -> None:
    """Refuse to go on where a disk is about to be full.

    :param size: bytes that must be free; not asked where the system does not know.
    :raises OSError: the one of a full disk.
    """
    disk = disk_usage(folder)
    if disk.total and disk.free < size:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@contextmanager
def beside(path: Path, *, several: bool = False) -> Iterator[Path]:
    """Give a temporary path in the folder of ``path``, with its extension; afterwards move the file written there to ``path``.

    On any failure, including an interruption by the user, the temporary file and its sidecars are removed and the old file is
    unchanged. A symbolic link stays a link: the file that it points to is replaced. Permissions are kept.

    :param several: the format has more than one file (a header, metadata): they are moved, too.
    :raises FormatError: for an OSError (no space, no permission), or when nothing was written.
    """
    path = path.resolve()
    token = f".meshflow-{uuid4().hex[:12]}"
    temporary = path.with_name(token + path.suffix)
    try:
        yield temporary
        if path.exists():
            copymode(path, temporary)
        os.replace(temporary, path)
        for sidecar in _SIDECARS:
            path.with_name(path.name + sidecar).unlink(missing_ok=True)
        for other in path.parent.glob(f"{token}*") if several else ():
            os.replace(other, path.with_name(path.stem + other.name.removeprefix(token)))
    except OSError as cause:
        reason = cause.strerror or cause.__cause__ or cause
        raise FormatError(
            f"{path} was not written ({reason}); an existing file is unchanged. {_way_out(cause)}"
        ) from cause
    finally:
        for left in path.parent.glob(f"{token}*"):
            left.unlink()


def _way_out(cause: OSError) -> str:
    """What to do where something was not written."""
    if cause.errno in (errno.ENOENT, errno.EACCES, errno.EPERM, errno.EROFS):
        return "Name a folder where writing is allowed"
    if cause.errno == errno.ENAMETOOLONG:
        return "Give it a shorter name"
    return "Make room, or name a folder where writing is allowed"


@contextmanager
def folder_beside(path: Path, suffix: str = "") -> Iterator[Path]:
    """Give the path of a temporary folder beside ``path``; afterwards the folder made there takes the place of ``path``.

    On any failure the temporary folder is removed and the old one is as it was.

    :param suffix: of the temporary folder.
    :raises FormatError: for an OSError (no space, no permission).
    """
    token = uuid4().hex[:12]
    temporary, old = (path.parent / f".meshflow-{token}{end}" for end in (suffix, ".old"))
    try:
        yield temporary
        if path.exists():
            path.rename(old)
        temporary.rename(path)
    except OSError as cause:
        raise FormatError(
            f"{path} was not written ({cause.strerror or cause}); an existing folder is unchanged. {_way_out(cause)}"
        ) from cause
    finally:
        if old.exists() and not path.exists():
            old.rename(path)
        for left in (temporary, old):
            if left.exists():
                rmtree(left)


def sides_of(removed: Path | None, uncertainty: Path | None) -> dict[str, Path]:
    """The rasters beside a result that are asked for, by what they hold."""
    every = (("removed", removed), ("expected error", uncertainty))
    return {word: path for word, path in every if path is not None}


def must_be_apart(target: Path, sides: Mapping[str, Path]) -> None:
    """Refuse two outputs of one name.

    :param target: where the result goes.
    :raises FormatError: it says so.
    """
    files = [path.resolve() for path in (target, *sides.values())]
    if len(set(files)) < len(files):
        raise FormatError(f"{target}: each output needs a name of its own")
