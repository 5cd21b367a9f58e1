"""The few errors of meshflow, and the one way to ask for an optional package."""

from importlib import import_module
from types import ModuleType

__all__ = ["FormatError", "InputError", "MissingPackage", "NotConverged", "NothingThere", "need"]


class InputError(ValueError):
    """What came in cannot be used: the message says what was expected, what came, and what to do."""


class FormatError(InputError):
    """A file cannot be read, or cannot hold what is to be written."""


class NothingThere(InputError):
    """Every sample is missing: a frame of many may be left out, a single one is refused."""


class MissingPackage(ImportError):
    """An optional package is not installed: the message is the line that installs it."""


class NotConverged(RuntimeError):
    """A solver or a flow did not get where it was to go: the message says how far it came."""


def need(package: str, extra: str) -> ModuleType:
    """Import an optional package, or say exactly how to install it.

    :param package: the module to import, for example ``"open3d"``.
    :param extra: the extra of meshflow that brings it, for example ``"scan"``.
    :raises MissingPackage: when it cannot be imported, with the install line and the cause.
    """
    try:
        return import_module(package)
    except (ImportError, OSError) as cause:  # OSError: a shared library of the system is absent
        hint = (
            f"{package} is needed here and could not be imported ({cause}). Install it: pip install 'meshflow[{extra}]'"
        )
        if package == "open3d":
            hint += " ; on a bare Debian also: apt-get install libegl1 libgl1 libusb-1.0-0"
        raise MissingPackage(hint) from cause
