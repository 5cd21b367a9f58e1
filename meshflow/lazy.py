"""Public names that are imported on first use, so that importing a package takes almost no time."""

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module

__all__ = ["lazily"]


def lazily(
    room: str, homes: Mapping[str, Sequence[str]], rooms: Sequence[str] = ()
) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """``__getattr__`` and ``__dir__`` of a package whose public names are defined in its modules (PEP 562).

    :param room: the name of the package, ``__name__``.
    :param homes: maps each module, relative to the package, to its public names.
    :param rooms: subpackages that are public as a whole.
    """
    found_in = {name: home for home, names in homes.items() for name in names}

    def get(name: str) -> object:
        """Import a public name from its module."""
        if name in rooms:
            return import_module(f"{room}.{name}")
        if name not in found_in:
            names = ", ".join(sorted([*found_in, *rooms]))
            raise AttributeError(f"module {room!r} has no attribute {name!r}; it has {names}")
        return getattr(import_module(f"{room}.{found_in[name]}"), name)

    return get, lambda: sorted([*found_in, *rooms])
