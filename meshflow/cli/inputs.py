"""Reads the files of a command."""

from os.path import isfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from meshflow.cli.flags import Given
from meshflow.cli.regions import is_region, region
from meshflow.errors import InputError, NothingThere, said_by
from meshflow.geometry.validation import Array, truth_of
from meshflow.io.adapters.xarray import further_dimensions
from meshflow.io.files import Document, read
from meshflow.io.formats import stacks, volumes
from meshflow.io.metadata import ReadOptions
from meshflow.io.objects import taken_in
from meshflow.io.stores import in_store, opened_variable, readable
from meshflow.io.suffixes import suffix_of
from meshflow.surfaces.data import array_of
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.volume import Volume

if TYPE_CHECKING:
    from xarray import DataArray

__all__ = ["frame", "mask", "opened", "per_sample", "plain_sample", "read_options", "samples"]

# An array (h, w, k) of so many channels k or fewer is an image; of more it is a volume.
COLOURS = 4


def opened(path: Path, given: Given) -> Document:
    """Read a file, or a variable of a Zarr store as a whole, with the given options."""
    place = in_store(path)
    if place is None:
        return read(path, **read_options(given))
    with readable(place.store):
        variable, notes = _one_slice(opened_variable(place), given)
        variable = variable.load()
    found = taken_in(variable, ReadOptions.of(read_options(given)))
    return Document(found.data, path, notes=(*notes, *found.notes))


def _one_slice(variable: "DataArray", given: Given) -> tuple["DataArray", tuple[str, ...]]:
    """The first slice of a variable with further dimensions, such as time, and a note."""
    further = () if given.get("kind") == "volume" else further_dimensions(variable)
    if not further:
        return variable, ()
    many = " x ".join(f"{variable.sizes[name]} along {name}" for name in further)
    note = f"{variable.name} has several slices, {many}: only the first of them is taken here; smooth takes all, with --slices"
    return variable.isel(dict.fromkeys(further, 0)), (note,)


def read_options(given: Given) -> Given:
    """The options of a reader that were given; ``--spacing DX,DY`` as a pair, DZ,DY,DX as three.

    :raises InputError: for a spacing that is no number, and no two or three.
    """
    found = {name: value for name, value in given.items() if value is not None}
    if isinstance(found.get("spacing"), str):
        word = found["spacing"]
        parts = word.split(",")
        if len(parts) > 3 or not all(map(_is_number, parts)):
            raise InputError(
                f"spacing: a number, two as DX,DY, or three as DZ,DY,DX of a volume, expected, got {word!r}"
            )
        found["spacing"] = float(word) if len(parts) == 1 else tuple(map(float, parts))
    return found


def frame(path: Path, given: Given) -> Document | None:
    """Read one of several depth images; None where it has no depths."""
    try:
        return opened(path, {"kind": "depth", **given})
    except NothingThere:
        return None


def samples(path: Path | None) -> Array | None:
    """The samples of a raster, a picture or an array file, as weights or limits."""
    if path is None:
        return None
    plain = _plain_numbers(path)
    return array_of(read(path).data) if plain is None else plain


def mask(path: Path | None) -> Array | None:
    """True where a sample of a file exists and is not zero in any channel."""
    if path is None:
        return None
    plain = _plain_numbers(path)
    if plain is not None:
        return truth_of(plain)
    data = read(path).data
    if isinstance(data, Mesh) or data.missing is None:
        raise InputError(f"{path}: a mask is a raster, a picture or an array; got a mesh")
    there = truth_of(array_of(data))
    return (there if there.ndim == data.missing.ndim else there.any(axis=-1)) & ~data.missing


def _plain_numbers(path: Path) -> Array | None:
    """The numbers of a file with one for each vertex of a mesh (n,) or each sample of a volume (d, h, w); None for anything else.

    :raises InputError: for a file that is not there, or holds no array of numbers.
    """
    if path.exists() and suffix_of(path) in (*volumes.NIFTI, *volumes.NRRD):
        return volumes.stored(path)
    if path.suffix.lower() != ".npy" or not path.exists():
        return None
    try:
        values = np.load(path, allow_pickle=False)
    except ValueError as cause:
        raise InputError(f"{path}: an array of numbers expected ({said_by(cause)})") from cause
    of_samples = values.ndim == 1 or (values.ndim == 3 and values.shape[-1] > COLOURS)
    return values if of_samples and values.dtype.kind in "biuf" else None


def per_sample(document: Document, word: str, given: str) -> Any:
    """The numbers per sample of an option: from a file, or from the attribute of a mesh by its name.

    :raises InputError: for text that names neither.
    """
    if isinstance(document.data, Volume) and Path(given).suffix.lower() in (".tif", ".tiff") and isfile(given):
        values = stacks.stored(Path(given))
        return truth_of(values) if word in ("mask", "fixed") else values
    if _is_plain(word, given) or isfile(given):
        return plain_sample(word, given)
    if word in ("mask", "fixed") and is_region(given):
        return region(document, given, word)
    if document.kind != "mesh":
        return plain_sample(word, given)
    try:
        document.samples(given, word)
    except InputError as cause:
        raise InputError(f"{cause}; nor is there a file of that name") from cause
    return given


def plain_sample(word: str, given: str) -> Any:
    """The numbers per sample of an option for data without named arrays: a number, ``step``, or the numbers of a file.

    :raises InputError: for anything else.
    """
    if word == "max_change" and given == "step":
        return given
    if _is_plain(word, given):
        return float(given)
    if not isfile(given) and word in ("mask", "fixed") and is_region(given):
        raise InputError(
            f"{word}: an expression is for one raster, picture, mesh or image of depths, and not here; give a mask as a file, "
            f"non-zero where {given!r} is true"
        )
    if not isfile(given):
        others = {"max_change": "a number, step, or ", "fixed": "", "mask": ""}.get(word, "a number or ")
        raise InputError(f"{word}: {others}a file expected, and there is no file {given}")
    return (mask if word in ("mask", "fixed") else samples)(Path(given))


def _is_plain(word: str, given: str) -> bool:
    """Whether what is given is no file: a number, or ``step``."""
    return (word in NUMBERS and _is_number(given)) or (word == "max_change" and given == "step")


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


# Options that may be one number for all samples.
NUMBERS = ("max_change", "data_weights", "mobility")
