"""Hints of the caller about an object: which belong to it, and what they name."""

from collections.abc import Mapping
from typing import Any

from meshflow.errors import InputError

__all__ = ["belong", "must_be_mesh"]


def belong(other: Mapping[str, object], thing: str, known: tuple[str, ...]) -> None:
    """Refuse the hints that are left over when a thing has taken those that it knows.

    :raises InputError: naming them, and those that would belong.
    """
    if other:
        raise InputError(f"{', '.join(sorted(other))}: no hint for {thing}; it takes {', '.join(known)}")


def must_be_mesh(kind: Any, thing: str) -> None:
    """Refuse a ``kind`` that is not ``mesh``.

    :raises InputError: otherwise.
    """
    if kind not in (None, "mesh"):
        raise InputError(f"kind={kind!r}: {thing} is a mesh and nothing else; leave the hint out")
