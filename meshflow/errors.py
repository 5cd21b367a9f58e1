"""The errors and warnings of meshflow, and the import of optional packages."""

import inspect
import os
import warnings
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from types import ModuleType

__all__ = [
    "Fact",
    "FormatError",
    "InputError",
    "MeshflowWarning",
    "MissingPackage",
    "NotConverged",
    "NothingThere",
    "attention",
    "need",
    "said_by",
    "warn",
]

# The files of this package, as the frames of a call name them.
_PACKAGE = f"{Path(__file__).parent}{os.sep}"


# Advice of libraries that would have a file run code, and what is said instead.
_UNSAFE = {
    "pickle": "it holds Python objects, which are not read, or no array",
    "VRT_ENABLE_PYTHON": "it contains a pixel function in Python, which is not run; if you trust it, gdal_translate it to .tif",
}


def said_by(cause: BaseException) -> str:
    """What a library says of a failure, in one line of at most 300 characters, without advice to run code of a file."""
    words = " ".join(str(cause).split())
    instead = next((words_of_ours for sign, words_of_ours in _UNSAFE.items() if sign in words), "")
    return (instead or words or type(cause).__name__)[:300]


class InputError(ValueError):
    """The input cannot be used. The message says what was expected, what was given, and what to do."""


class FormatError(InputError):
    """A file cannot be read, or cannot hold what is to be written."""


class NothingThere(InputError):
    """Every sample is missing. One frame of many is then left out; a single one is refused."""


class MissingPackage(ImportError):
    """An optional package is not installed. The message contains the command that installs it."""


class NotConverged(RuntimeError):
    """A solver did not converge, or a flow did not reach its end. The message says how far it came."""


class MeshflowWarning(UserWarning):
    """Something about a run that you should know and may not expect. With ``result=True`` it is in the Result."""


class Fact(str):
    """A sentence on what was done that needs no attention: the command prints it, and it is no warning."""


def attention(sentences: Iterable[str]) -> tuple[str, ...]:
    """The sentences that need attention: all that are no :class:`Fact`."""
    return tuple(sentence for sentence in sentences if not isinstance(sentence, Fact))


def warn(sentences: Iterable[str]) -> None:
    """Issue sentences as :class:`MeshflowWarning`, for the line outside of this package that called it."""
    level, frame = 1, inspect.currentframe()
    while frame is not None and frame.f_code.co_filename.startswith(_PACKAGE):
        level, frame = level + 1, frame.f_back
    for sentence in attention(sentences):
        warnings.warn(sentence, MeshflowWarning, stacklevel=level)


def need(package: str, extra: str) -> ModuleType:
    """Import an optional package, or say how to install it.

    :param package: the module to import, for example ``"open3d"``.
    :param extra: the extra of meshflow that brings it, for example ``"scan"``.
    :raises MissingPackage: when it cannot be imported; the message names the cause and the command that installs it.
    """
    try:
        return import_module(package)
    except (ImportError, OSError) as cause:  # OSError: a shared library of the system is missing
        if "failed to map segment" in str(cause):
            raise MemoryError(f"{package}: {cause}") from cause
        hint = (
            f"{package} is needed here and could not be imported ({cause}). Install it: pip install 'meshflow[{extra}]'"
        )
        if package == "open3d":
            hint += " ; on a bare Debian also: apt-get install libegl1 libgl1 libusb-1.0-0"
        raise MissingPackage(hint) from cause
