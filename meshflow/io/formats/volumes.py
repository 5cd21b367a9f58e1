"""Volumes in files: NIfTI (nibabel) and NRRD (pynrrd); affine, units, number type and everything else of the header is kept."""

import zlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from meshflow.errors import Fact, FormatError, InputError, need, said_by
from meshflow.geometry.validation import Array, nowhere
from meshflow.io.document import Document, WriteOptions
from meshflow.io.formats.volume_arrays import must_be_no_labels
from meshflow.io.formats.volume_storage import Layout, Scan, as_nifti, as_nrrd, volume_written
from meshflow.io.metadata import ReadOptions
from meshflow.io.rounding import rounded
from meshflow.io.suffixes import suffix_of
from meshflow.surfaces.volume import Steps, Volume, steps_of

__all__ = [
    "NIFTI", "broken", "can_write", "layout_of", "nifti_opened", "placed_by_header", "read", "spacing_along", "stored",
    "stored_type", "three", "write",
]  # fmt: skip

NAME: str = "a volume"
READS: tuple[str, ...] = ("kind", "spacing", "nodata", "unit")
WRITES: tuple[str, ...] = ("dtype",)
NIFTI, NRRD = (".nii", ".nii.gz"), (".nrrd",)
# The least cosine between two axes that counts as shear.
SHEAR = 1e-3


def read(path: Path, options: ReadOptions) -> Document:
    """Read a volume, its axes in the order in which the file has them.

    :param options: ``nodata``, a value that marks missing samples; ``spacing`` along the axes, in place of that of the file;
        ``unit`` of lengths.
    :raises MissingPackage: without nibabel or pynrrd.
    :raises FormatError: for a file that cannot be read.
    :raises InputError: for a series, a single slice, labels, and axes that are not at right angles.
    """
    options = replace(options, kind=options.kind or "volume")
    if options.kind != "volume":
        raise InputError(f"{path.name}: a volume is read as one, got kind={options.kind!r}; leave it out")
    values, affine, source = _nifti(path) if suffix_of(path) in NIFTI else _nrrd(path)
    if values.dtype.kind == "c":
        raise InputError(
            f"{path.name}: real numbers expected, got complex ones; smooth the magnitude (numpy.abs), or the real and the "
            "imaginary part as two channels of an array (d, h, w, 2)"
        )
    must_be_no_labels(values, path.name)
    spacing = spacing_along(path, affine) if options.spacing is None else steps_of(options.spacing)
    given = options.missing_in(values)
    floating = values if values.dtype.kind == "f" else values.astype(np.float32 if values.itemsize <= 2 else np.float64)
    data = Volume(np.ascontiguousarray(floating), spacing, nowhere(given), unit=options.unit or source.unit)
    return Document(data, path, source)


def stored(path: Path) -> Array:
    """The numbers of a file (d, h, w) in the order of :func:`read`, whatever they mean: masks and labels, too.

    :raises FormatError: for a file that cannot be read.
    """
    return (_nifti(path) if suffix_of(path) in NIFTI else _nrrd(path))[0]


def can_write(document: Document, suffix: str) -> bool:
    """Whether the document is a volume."""
    return isinstance(document.data, Volume)


def write(document: Document, path: Path, options: WriteOptions) -> tuple[str, ...]:
    """Write a volume; what its file held is kept.

    Numbers of floating point keep their type, whole numbers become float32, because rounding would undo the smoothing.

    :param options: ``dtype``: another number type; ``source``: that of the file. Tags are kept as a comment.
    :returns: notes on rounding.
    :raises FormatError: when the file cannot be written.
    """
    if not isinstance(document.data, Volume):
        raise FormatError(f"{path.name}: a volume expected, got a {document.kind}")
    source = document.source if isinstance(document.source, Scan) else Scan()
    data = document.data
    kind, notes = stored_type(path, source, options)
    layout = layout_of(path, data.values.shape, kind, (data.spacing, data.unit), source, options.tags)
    values, clipped = rounded(data.values, np.broadcast_to(~np.isfinite(data.values), data.values.shape), kind)
    with volume_written(path, layout) as writer:
        writer.write((), values)
    return (*notes, *clipped)


def stored_type(path: Path, source: Scan, options: WriteOptions) -> tuple[np.dtype, tuple[str, ...]]:
    """The number type of a volume that is written, and notes on it."""
    kept = source.dtype if np.dtype(source.dtype).kind == "f" else "float32"
    kind = np.dtype(source.dtype if options.dtype == "source" else options.dtype or kept)
    notes: tuple[str, ...] = ()
    if kind.kind in "iu":
        notes = (f"{path.name}: rounded to {kind}, which adds an error of up to half a step",)
    elif source.dtype != str(kind) and options.dtype is None:
        notes = (Fact(f"{path.name}: written as {kind}; dtype='source' rounds to the {source.dtype} of the file"),)
    if source.header and suffix_of(path) in NIFTI:
        notes += (f"{path.name}: the spacing is kept, the place of the NRRD in space is not",)
    return kind, notes


def layout_of(
    path: Path,
    shape: tuple[int, ...],
    dtype: np.dtype,
    placed: tuple[Steps, str],
    source: Scan,
    tags: Mapping[str, str],
) -> Layout:
    """How the samples of a volume are stored in a file of this name; six parameters say all of it.

    :param placed: spacing and its unit, for a source without a header.
    """
    if suffix_of(path) not in NIFTI:
        return as_nrrd(shape, dtype, placed, source, tags)
    layout = as_nifti(shape, dtype, placed, source, tags)
    return replace(layout, packed="all") if suffix_of(path) == ".nii.gz" else layout


def _nifti(path: Path) -> tuple[Array, Array, Scan]:
    """Samples, the affine (3, 3) and the rest of a NIfTI file."""
    samples, affine, source = nifti_opened(path)
    try:
        raw = np.asanyarray(samples)
    except (OSError, EOFError, ValueError, zlib.error) as cause:
        raise broken(path, cause) from cause
    return three(path, raw), affine, source


def nifti_opened(path: Path) -> tuple[Any, Array, Scan]:
    """The samples of a NIfTI file as nibabel reads them when they are asked for, the affine (3, 3) and the rest.

    :raises FormatError: for a file that cannot be read.
    """
    nibabel = need("nibabel", "volumes")
    try:
        image = nibabel.load(str(path))
    except (nibabel.filebasedimages.ImageFileError, OSError, EOFError, ValueError, zlib.error) as cause:
        raise broken(path, cause) from cause
    word = image.header.get_xyzt_units()[0]
    unit = str({"unknown": "", "meter": "m", "micron": "µm"}.get(word, word))
    return image.dataobj, image.affine[:3, :3], Scan(image, dtype=str(image.header.get_data_dtype()), unit=unit)


def _nrrd(path: Path) -> tuple[Array, Array, Scan]:
    """Samples, the affine (3, 3) and the rest of a NRRD file."""
    nrrd = need("nrrd", "volumes")
    try:
        raw, header = nrrd.read(str(path))
    except (nrrd.NRRDError, OSError, EOFError, ValueError, zlib.error) as cause:
        raise broken(path, cause) from cause
    source = Scan(header=header, dtype=str(raw.dtype))
    return three(path, raw), *placed_by_header(source)


def placed_by_header(source: Scan) -> tuple[Array, Scan]:
    """The affine (3, 3) of a NRRD file by its header, and what the file contains, with its unit."""
    header = source.header or {}
    directions = header.get("space directions")
    if directions is None:
        directions = np.diag(np.nan_to_num(np.asarray(header.get("spacings", (1.0, 1.0, 1.0)), float)[:3], nan=1.0))
    units = header.get("space units") or header.get("units") or ("",)
    return np.asarray(directions, float)[:3].T, replace(source, unit=units[0])


def broken(path: Path, cause: Exception) -> FormatError:
    """The refusal of a file that cannot be read."""
    return FormatError(f"{path.name} cannot be read ({said_by(cause)})")


def three(path: Path, values: Array) -> Array:
    """Samples of three axes; a fourth one of length 1 is dropped.

    :raises InputError: for a series, and for a picture.
    """
    values = values[..., 0] if values.ndim == 4 and values.shape[-1] == 1 else values
    if values.ndim < 3:
        raise InputError(
            f"{path.name} has shape {values.shape}: a volume of three axes expected; a single slice is an image: give its array "
            "(h, w) as one"
        )
    if values.ndim > 3:
        raise InputError(
            f"{path.name} has shape {values.shape}: a volume of three axes expected. Which axis is what? Split a series into its "
            "volumes (nibabel.four_to_three) and smooth each; channels that belong together are smoothed as an array (d, h, w, k)"
        )
    return values


def spacing_along(path: Path, affine: Array) -> Steps:
    """The distances along the axes, from the columns of the affine.

    :raises InputError: for axes that are not at right angles.
    """
    lengths = np.linalg.norm(affine, axis=0)
    if not (np.isfinite(lengths).all() and (lengths > 0).all()):
        raise InputError(f"{path.name}: its affine gives the distances {lengths} of samples; give spacing=(dz, dy, dx)")
    cosines = np.abs((affine / lengths).T @ (affine / lengths) - np.eye(3))
    if cosines.max() > SHEAR:
        angle = float(np.degrees(np.arccos(cosines.max())))
        raise InputError(
            f"{path.name}: its axes meet at {angle:.1f} degrees (a sheared affine), right angles expected; resample it first, as "
            "with nibabel.processing.conform, or give spacing= for the samples as they lie"
        )
    return float(lengths[0]), float(lengths[1]), float(lengths[2])
