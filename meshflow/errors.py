"""The errors of meshflow, and the import of optional packages."""

from importlib import import_module
from types import ModuleType

__all__ = ["FormatError", "InputError", "MissingPackage", "NotConverged", "NothingThere", "need"]


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


def need(package: str, extra: str) -> ModuleType:
    """Import an optional package, or say how to install it.

    :param package: the module to import, for example ``"open3d"``.
    :param extra: the extra of meshflow that brings it, for example ``"scan"``.
    :raises MissingPackage: when it cannot be imported; the message names the cause and the command that installs it.
    """
    try:
        return import_module(package)
    except (ImportError, OSError) as cause:  # OSError: a shared library of the system is missing
        hint = (
            f"{package} is needed here and could not be imported ({cause}). Install it: pip install 'meshflow[{extra}]'"
        )
        if package == "open3d":
            hint += " ; on a bare Debian also: apt-get install libegl1 libgl1 libusb-1.0-0"
        raise MissingPackage(hint) from cause
