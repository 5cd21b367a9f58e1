"""Hints of the caller about an object: which belong to it, and what they name."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array, truth_of

__all__ = ["MASKS", "PER_SAMPLE", "Found", "as_given", "belong", "looked_up", "must_be_mesh"]

# Words of the front door that hold one number per sample, which may be the name of an array of the thing itself.
PER_SAMPLE = ("fixed", "mask", "mobility", "data_weights", "max_change")
MASKS = ("fixed", "mask")
# The array of a name, and the names that there are.
Found = tuple[Any, Iterable[str]]


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


def as_given(given: Any, word: str) -> Any:
    """What a thing without names makes of a word that holds one number per sample: the array as it is.

    :raises InputError: for a name.
    """
    if isinstance(given, str):
        raise InputError(
            f"{word}: {'' if word in MASKS else 'a number or '}an array expected, got {given!r}; names are "
            "those of arrays in the object or the file itself (a mesh of trimesh, pyvista, open3d or meshio, an ImageData)"
        )
    return given


def looked_up(name: str, word: str, found: Found) -> Array:
    """The numbers of a named array, of masks whether they are other than zero.

    :param found: the array (n,) of that name, None where there is none, and the names that there are.
    :raises InputError: for a name that is not there, or an array that holds no number per sample.
    """
    array, there = found
    if array is None:
        raise InputError(f"{word}={name!r}: no such array; there are {', '.join(map(str, there)) or 'none'}")
    values = np.asarray(array)
    values = values[:, 0] if values.ndim == 2 and values.shape[1] == 1 else values
    if values.ndim != 1 or values.dtype.kind not in "biuf":
        raise InputError(f"{word}={name!r}: one number per vertex expected, got shape {values.shape} of {values.dtype}")
    return truth_of(values) if word in MASKS else values
