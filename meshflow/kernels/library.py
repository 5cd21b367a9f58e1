"""The library of kernels for the instruction set of this machine, and its number of threads.

In a source tree it is compiled into ``_lib`` beside the sources when it is first loaded, and again when a source has changed. An
installed package contains it and never compiles.
"""

import ctypes
import hashlib
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from meshflow.kernels import compiler

__all__ = [
    "Environment",
    "KernelsMissing",
    "built",
    "default_threads",
    "environment",
    "library",
    "loaded",
    "using_threads",
]

PLACE = Path(__file__).parent / "_lib"
_USED: ContextVar[int | None] = ContextVar("threads", default=None)
KEPT = 86400.0  # seconds after which objects and libraries of other sources are removed, when another one is made


class KernelsMissing(ImportError):
    """The compiled kernels are missing, or not for this machine. The message says what is missing."""


@dataclass(frozen=True)
class Environment:
    """What the kernels run with.

    :ivar instruction_set: "v3" or "v2" of x86-64; "baseline" elsewhere.
    :ivar compiler: that compiled them.
    :ivar threads: the default number of threads.
    :ivar path: the library.
    """

    instruction_set: str
    compiler: str
    threads: int
    path: Path


def environment() -> Environment:
    """The instruction set in use, the compiler of the kernels, and the default number of threads."""
    lib, level, path = loaded()
    lib.machine_compiler.restype = ctypes.c_char_p
    return Environment(level, lib.machine_compiler().decode(), default_threads(), path)


def default_threads() -> int:
    """How many threads kernels use where the caller names none: those of :func:`using_threads`, else ``MESHFLOW_NUM_THREADS``, or
    the processors of this process.

    :raises ValueError: where the variable is no positive number.
    """
    used = _USED.get()
    if used is not None:
        return used
    text = os.environ.get("MESHFLOW_NUM_THREADS", "")
    if text:
        if not text.isdecimal() or int(text) < 1:
            raise ValueError(f"MESHFLOW_NUM_THREADS={text!r}: a number of threads expected, 1 or more")
        return int(text)
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def using_threads(threads: int | None) -> Iterator[None]:
    """Context: kernels called in it use this number of threads by default; None changes nothing.

    It does not affect calls from other threads.
    """
    before = _USED.set(_USED.get() if threads is None else threads)
    try:
        yield
    finally:
        _USED.reset(before)


def library() -> ctypes.CDLL:
    """The library for this machine."""
    return loaded()[0]


@cache
def loaded() -> tuple[ctypes.CDLL, str, Path]:
    """The library for this machine, its instruction set, and its file.

    :raises KernelsMissing: where the machine supports none of the instruction sets, or ``MESHFLOW_ISA`` names a missing one.
    :raises compiler.BuildError: in a source tree, where it cannot be compiled.
    """
    levels = compiler.Target.here().instruction_sets
    forced = os.environ.get("MESHFLOW_ISA", "")
    if forced and forced not in levels:
        raise KernelsMissing(f"MESHFLOW_ISA={forced!r}: one of {', '.join(levels)} expected on this kind of machine")
    lacking = []
    for level in [forced] if forced else levels:
        lib, path = opened(level)
        if not (missing := lib.machine_missing().decode()):
            return lib, level, path
        lacking.append(f"{level} needs {missing}")
    raise KernelsMissing(
        f"this machine cannot run the kernels of meshflow, it lacks what they need: {'; '.join(lacking)}"
    )


@cache
def opened(level: str) -> tuple[ctypes.CDLL, Path]:
    """The library for one instruction set, and its file; only ``machine_missing`` may be called before the machine is checked.

    :raises KernelsMissing: where it is missing, or the system cannot load it.
    """
    path = built(level) if compiler.sources() else PLACE / f"meshflow-{level}{compiler.Target.here().suffix}"
    try:
        lib = ctypes.CDLL(str(path))
    except OSError as cause:
        raise KernelsMissing(f"the kernels of meshflow cannot be loaded ({cause}): install the package anew") from cause
    lib.machine_missing.restype = ctypes.c_char_p
    return lib, path


def built(level: str) -> Path:
    """The library of a source tree for one instruction set, compiled where it is missing or a source has changed.

    :raises compiler.BuildError: where it cannot be compiled.
    """
    flags = [word for word in compiler.flags() if not word.startswith("-W") or "," in word]  # warnings change nothing
    words = (level, os.environ.get("CXX", ""), *flags)
    made = hashlib.sha256("".join(compiler.digest(source, *words) for source in compiler.sources()).encode())
    path = PLACE / f"meshflow-{level}-{made.hexdigest()[:16]}{compiler.Target.here().suffix}"
    if not path.exists():
        PLACE.mkdir(exist_ok=True)
        with _alone(PLACE / "lock"):
            if not path.exists():
                compiler.build(compiler.found(), level, path, PLACE / "objects")
                swept()
    return path


def swept() -> None:
    """Remove files that were compiled from other sources more than a day ago; files in use are kept."""
    for path in [*PLACE.glob("meshflow-*"), *PLACE.glob("objects/*")]:
        try:
            if path.is_file() and path.stat().st_mtime < time.time() - KEPT:
                path.unlink()
        except OSError:
            continue


@contextmanager
def _alone(path: Path) -> Iterator[None]:
    """A lock between processes, which is released when its process ends."""
    with path.open("a+b") as file:
        if os.name == "nt":
            import msvcrt

            file.seek(0)
            while True:
                try:
                    msvcrt.locking(file.fileno(), msvcrt.LK_LOCK, 1)
                    break
                except OSError:  # the lock times out after ten seconds
                    continue
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX)
        yield
