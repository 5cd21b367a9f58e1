"""Volumes in files: NIfTI (nibabel) and NRRD (pynrrd); affine, units, number type and everything else of the header is kept."""

import gzip
import json
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from meshflow.errors import Fact, FormatError, InputError, need
from meshflow.geometry.validation import Array, nowhere
from meshflow.io.atomic_write import beside
from meshflow.io.document import Document, Source, WriteOptions
from meshflow.io.formats.volume_arrays import must_be_no_labels
from meshflow.io.metadata import ReadOptions
from meshflow.io.rounding import rounded
from meshflow.io.suffixes import suffix_of
from meshflow.surfaces.volume import Steps, Volume, steps_of

__all__ = ["can_write", "read", "write"]

NAME: str = "a volume"
READS: tuple[str, ...] = ("kind", "spacing", "nodata", "unit")
WRITES: tuple[str, ...] = ("dtype",)
NIFTI, NRRD = (".nii", ".nii.gz"), (".nrrd",)
# The least cosine between two axes that counts as shear; the code of a comment in NIfTI.
SHEAR, COMMENT = 1e-3, 6


@dataclass(frozen=True, eq=False)
class Scan(Source):
    """What a file contains besides the samples.

    :param image: the image of nibabel, for NIfTI; else None.
    :param header: of NRRD.
    :param dtype: in which the samples were stored.
    :param unit: of lengths; empty where the file does not say it.
    """

    image: Any = None
    header: Mapping[str, Any] = field(default_factory=dict)
    dtype: str = "float32"
    unit: str = ""

    @property
    def ground_unit(self) -> str:
        """The unit of the lengths between samples."""
        return self.unit

    @property
    def stored_as(self) -> str:
        """The type in which the samples were stored."""
        return self.dtype


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
    must_be_no_labels(values, path.name)
    spacing = _spacing(path, affine) if options.spacing is None else steps_of(options.spacing)
    given = options.missing_in(values)
    floating = values if values.dtype.kind == "f" else values.astype(np.float32 if values.itemsize <= 2 else np.float64)
    data = Volume(np.ascontiguousarray(floating), spacing, nowhere(given), unit=options.unit or source.unit)
    return Document(data, path, source)


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
    data, kept = document.data, source.dtype if np.dtype(source.dtype).kind == "f" else "float32"
    kind = np.dtype(source.dtype if options.dtype == "source" else options.dtype or kept)
    notes: tuple[str, ...] = ()
    values = np.array(data.values)
    if kind.kind in "iu":
        values, clipped = rounded(values, np.broadcast_to(~np.isfinite(values), values.shape), kind)
        notes = (f"{path.name}: rounded to {kind}, which puts back an error of up to half a step", *clipped)
    elif source.dtype != str(kind) and options.dtype is None:
        notes = (Fact(f"{path.name}: written as {kind}; dtype='source' rounds to the {source.dtype} of the file"),)
    if source.header and suffix_of(path) in NIFTI:
        notes += (f"{path.name}: the spacing is kept, the place of the NRRD in space is not",)
    content = (_as_nifti if suffix_of(path) in NIFTI else _as_nrrd)(values.astype(kind), data, source, options.tags)
    if suffix_of(path) == ".nii.gz":
        content = gzip.compress(content, 6, mtime=0)
    with beside(path) as temporary:
        temporary.write_bytes(content)
    return notes


def _nifti(path: Path) -> tuple[Array, Array, Scan]:
    """Samples, the affine (3, 3) and the rest of a NIfTI file."""
    nibabel = need("nibabel", "volumes")
    try:
        image: Any = nibabel.load(str(path))
        raw = np.asanyarray(image.dataobj)
    except (nibabel.filebasedimages.ImageFileError, OSError, EOFError, ValueError, zlib.error) as cause:
        raise _broken(path, cause) from cause
    word = image.header.get_xyzt_units()[0]
    unit = str({"unknown": "", "meter": "m", "micron": "µm"}.get(word, word))
    stored = image.header.get_data_dtype()
    return _three(path, raw), image.affine[:3, :3], Scan(image, dtype=str(stored), unit=unit)


def _nrrd(path: Path) -> tuple[Array, Array, Scan]:
    """Samples, the affine (3, 3) and the rest of a NRRD file."""
    nrrd = need("nrrd", "volumes")
    try:
        raw, header = nrrd.read(str(path))
    except (nrrd.NRRDError, OSError, EOFError, ValueError, zlib.error) as cause:
        raise _broken(path, cause) from cause
    directions = header.get("space directions")
    if directions is None:
        directions = np.diag(np.nan_to_num(np.asarray(header.get("spacings", (1.0, 1.0, 1.0)), float)[:3], nan=1.0))
    units = header.get("space units") or header.get("units") or ("",)
    values = _three(path, raw)
    return values, np.asarray(directions, float)[:3].T, Scan(header=header, dtype=str(raw.dtype), unit=units[0])


def _broken(path: Path, cause: Exception) -> FormatError:
    reason = " ".join(str(cause).split())[:200] or type(cause).__name__
    return FormatError(f"{path.name} cannot be read ({reason})")


def _three(path: Path, values: Array) -> Array:
    """Samples of three axes; a fourth one of length 1 is dropped.

    :raises InputError: for a series.
    """
    values = values[..., 0] if values.ndim == 4 and values.shape[-1] == 1 else values
    if values.ndim != 3:
        raise InputError(
            f"{path.name} has shape {values.shape}: a volume of three axes expected. Which axis is what? Of a series smooth each "
            "volume, smooth(array[..., i], kind='volume', spacing=...); channels that belong together in one go, smooth(array, "
            "kind='volume')"
        )
    return values


def _spacing(path: Path, affine: Array) -> Steps:
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


def _as_nifti(values: Array, data: Volume, source: Scan, tags: Mapping[str, str]) -> bytes:
    """The bytes of a NIfTI file."""
    nibabel = need("nibabel", "volumes")
    if source.image is None:
        made = nibabel.Nifti1Image(values, np.diag([*data.spacing, 1.0]))
        made.header.set_xyzt_units({"m": "meter", "µm": "micron", "mm": "mm"}.get(data.unit, "unknown"))
    else:
        header = source.image.header.copy()
        header.set_data_dtype(values.dtype)
        header.set_slope_inter(1.0, 0.0)
        made = type(source.image)(values, source.image.affine, header)
    if tags:
        made.header.extensions.append(nibabel.nifti1.Nifti1Extension(COMMENT, json.dumps(dict(tags)).encode()))
    return made.to_bytes()


def _as_nrrd(values: Array, data: Volume, source: Scan, tags: Mapping[str, str]) -> bytes:
    """The bytes of a NRRD file."""
    from tempfile import TemporaryDirectory

    nrrd = need("nrrd", "volumes")
    units, words = [data.unit] * 3, {name.replace(":", "_"): word for name, word in tags.items()}
    own: dict[str, Any] = {
        "encoding": "gzip",
        "spacings": list(data.spacing),
        **({"units": units} if data.unit else {}),
    }
    if source.image is not None:  # NIfTI counts to the right, the front and the top
        affine = source.image.affine
        own = {"encoding": "gzip", "space": "right-anterior-superior", "space directions": affine[:3, :3].T}
        own |= {"space origin": affine[:3, 3], **({"space units": units} if data.unit else {})}
    header = {**(dict(source.header) or own), **words}
    for name in ("type", "endian", "sizes", "dimension", "data file", "datafile"):
        header.pop(name, None)
    with TemporaryDirectory() as folder:
        inside = Path(folder) / "volume.nrrd"
        nrrd.write(str(inside), values, header, custom_field_map=dict.fromkeys(words, "string"))
        return inside.read_bytes()
