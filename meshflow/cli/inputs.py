"""Files to what a command needs of them."""

from pathlib import Path
from typing import Any

import numpy as np

from meshflow.cli import options as words
from meshflow.errors import InputError, NothingThere
from meshflow.geometry.validation import Array, truth_of
from meshflow.io.files import Document, read
from meshflow.surfaces.lift import Mesh, data_of

__all__ = ["HELD", "INPUTS", "frame", "limit", "mask", "opened", "per_sample", "samples"]


def opened(
    path: Path,
    kind: words.Kind | None,
    camera: str | None,
    depth_scale: float | None,
    measure: words.Measure | None,
    band: int | None,
    nodata: float | None,
    spacing: float | None,
    channels: str | None,
    moves: words.Moves | None = None,
    pace: words.Pace | None = None,
    viewpoint: tuple[float, float, float] | None = None,
) -> Document:
    """Read a file with the options that were given, and no others."""
    given = {
        "camera": camera,
        "depth_scale": depth_scale,
        "measure": measure,
        "band": band,
        "nodata": nodata,
        "spacing": spacing,
        "channels": channels,
        "moves": moves,
        "time_unit": pace,
        "viewpoint": viewpoint,
    }
    return read(path, kind=kind, **{name: value for name, value in given.items() if value is not None})


def frame(path: Path, camera: str | None, depth_scale: float | None, measure: words.Measure | None) -> Document | None:
    """Read one of several depth images; None where not a single depth is there."""
    try:
        return opened(path, "depth", camera, depth_scale, measure, None, None, None, None)
    except NothingThere:
        return None


def samples(path: Path | None) -> Array | None:
    """The samples of a raster, a picture or an array file: weights, limits."""
    if path is None:
        return None
    column = _column(path)
    return data_of(read(path).noun) if column is None else column


def limit(word: str | None) -> float | Array | str | None:
    """A number, the samples of a file, or ``step``."""
    if word is None or word == "step":
        return word
    return float(word) if _is_number(word) else samples(Path(word))


def mask(path: Path | None) -> Array | None:
    """Where the samples of a file are there and not zero, in any channel."""
    if path is None:
        return None
    column = _column(path)
    if column is not None:
        return truth_of(column)
    noun = read(path).noun
    if isinstance(noun, Mesh) or noun.missing is None:
        raise InputError(f"{path}: a raster, a picture or an array is a mask, a mesh is none")
    there = truth_of(data_of(noun))
    return (there if there.ndim == 2 else there.any(axis=2)) & ~noun.missing


def _column(path: Path) -> Array | None:
    """The numbers (n,) of an array file with one for each vertex of a mesh; None for anything else.

    :raises InputError: for a file that is not there, or holds no array of numbers.
    """
    if path.suffix.lower() != ".npy" or not path.exists():
        return None
    try:
        values = np.load(path, allow_pickle=False)
    except ValueError as cause:
        raise InputError(f"{path}: an array of numbers expected; {cause}") from cause
    return values if values.ndim == 1 and values.dtype.kind in "biuf" else None


def per_sample(document: Document, word: str, given: str | None) -> Any:
    """What an option says of each sample: of a file of numbers, or of an attribute of the mesh by its name.

    :raises InputError: for what is neither.
    """
    if given is None or (word in NUMBERS and _is_number(given)) or (word == "limit" and given == "step"):
        return limit(given)
    if Path(given).is_file():
        numbers = (mask if word in ("only", "fixed") else samples)(Path(given))
        return document.samples(numbers, word)
    try:
        return document.samples(given, word)
    except InputError as cause:
        raise InputError(f"{cause}; nor is there a file {given}") from cause


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


INPUTS = (
    "kind",
    "camera",
    "depth_scale",
    "measure",
    "band",
    "nodata",
    "spacing",
    "channels",
    "moves",
    "pace",
    "viewpoint",
)
# Words of which one number is said of all samples.
NUMBERS = ("limit", "confidence", "speed")
HELD = ("limit", "confidence", "only", "speed", "fixed")
