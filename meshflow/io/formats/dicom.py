"""Series of DICOM: a folder of slices is a volume with its spacing in mm; it is written as NIfTI or NRRD, or as a new series."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from meshflow.errors import Fact, FormatError, InputError, need
from meshflow.geometry.validation import Array, nowhere
from meshflow.io.atomic_write import folder_beside
from meshflow.io.document import Document, WriteOptions
from meshflow.io.formats.volume_storage import Scan
from meshflow.io.metadata import ReadOptions
from meshflow.surfaces.volume import Volume, steps_of

if TYPE_CHECKING:
    from pydicom import Dataset

__all__ = ["can_write", "holds_series", "is_dicom", "read", "write"]

NAME: str = "a series of DICOM"
READS: tuple[str, ...] = ("kind", "spacing", "nodata", "unit")
WRITES: tuple[str, ...] = ()
# Four bytes behind a preamble of 128; extensions of files that may lack them.
MAGIC, AT, SUFFIXES = b"DICM", 128, (".dcm", ".dicom", ".ima")
# The largest differences of positions and directions that are rounding: mm per slice over their distance, and cosines.
UNEVEN, TURNED = 0.01, 1e-3


@dataclass(frozen=True, eq=False)
class Series(Scan):
    """The slices of a series, from one end to the other; ``image`` has their place in space.

    :param slices: the datasets of pydicom.
    """

    slices: "tuple[Dataset, ...]" = ()


def is_dicom(path: Path) -> bool:
    """Whether a file is of DICOM, by its extension or its first bytes."""
    if path.suffix.lower() in SUFFIXES:
        return True
    if path.suffix or not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(AT + 4)[AT:] == MAGIC


def holds_series(folder: Path) -> bool:
    """Whether a folder holds files of DICOM."""
    return folder.is_dir() and any(is_dicom(path) for path in sorted(folder.iterdir()))


def read(path: Path, options: ReadOptions) -> Document:
    """Read a folder that holds one series as a volume (slices, rows, columns), in the unit of its rescaled values.

    :param options: ``spacing`` (dz, dy, dx) in place of that of the series, ``nodata``, ``unit``.
    :raises MissingPackage: without pydicom, or without nibabel, which holds the place in space.
    :raises FormatError: for a file that cannot be read.
    :raises InputError: for several series, slices that do not fit together, colours, and files that are no slices.
    """
    options = replace(options, kind=options.kind or "volume")
    if options.kind != "volume":
        raise InputError(f"{path.name}: a series of DICOM is a volume, got kind={options.kind!r}; leave it out")
    if not path.is_dir():
        raise InputError(
            f"{path.name}: one file of DICOM; give the folder that holds the slices of a series. A file of several frames is "
            "converted first (dcm2niix); a single picture is pydicom.dcmread(path).pixel_array with kind='image'"
        )
    slices, others = _slices(path)
    affine, steps = _placed(path, slices)
    values = np.stack([_values(path, one) for one in slices])
    image = need("nibabel", "dicom").Nifti1Image(np.zeros((1, 1, 1), np.float32), affine)
    image.header.set_xyzt_units("mm")
    spacing = steps if options.spacing is None else steps_of(options.spacing)
    data = Volume(values, spacing, nowhere(options.missing_in(values)), unit=options.unit or "mm")
    notes = (Fact(f"{others} files in the folder are no slices of DICOM"),) if others else ()
    return Document(data, path, Series(image=image, dtype="float32", unit="mm", slices=tuple(slices)), notes)


def can_write(document: Document, suffix: str) -> bool:
    """Whether it is a volume from a series, which can become another one."""
    return isinstance(document.data, Volume) and isinstance(document.source, Series)


def write(document: Document, path: Path, options: WriteOptions) -> tuple[str, ...]:
    """Write a folder with a new series, derived from the one that was read: everything in its slices but the values is kept.

    Values are rounded to the steps in which the slices store them.

    :param options: tags become the description of the derivation.
    :raises FormatError: when the folder cannot be written.
    """
    source, data = document.source, document.data
    if not isinstance(source, Series) or not isinstance(data, Volume):
        raise FormatError(f"{path.name}: a volume from a series of DICOM expected; write .nii.gz")
    _must_be_replaceable(path)
    own = need("pydicom", "dicom").uid.generate_uid()
    with folder_beside(path) as draft:
        draft.mkdir()
        for number, (one, values) in enumerate(zip(source.slices, data.values, strict=True), 1):
            _derived(one, values, own, options.tags).save_as(draft / f"{number:05d}.dcm", enforce_file_format=True)
    step = float(getattr(source.slices[0], "RescaleSlope", 1.0))
    return (f"{path.name}: a new series of {len(source.slices)} slices; values are rounded to steps of {step:g}",)


def _slices(folder: Path) -> "tuple[list[Dataset], int]":
    """The slices of the one series in a folder, and how many other files there are.

    :raises InputError: for several series, and for none.
    """
    pydicom = need("pydicom", "dicom")
    found: dict[str, list[Dataset]] = {}
    others = 0
    for path in sorted(one for one in folder.iterdir() if one.is_file()):
        try:
            one = pydicom.dcmread(path)
        except (pydicom.errors.InvalidDicomError, OSError, ValueError, EOFError):
            others += 1
            continue
        if "PixelData" in one:
            found.setdefault(str(one.get("SeriesInstanceUID", "")), []).append(one)
        else:
            others += 1
    if len(found) != 1:
        listed = "; ".join(
            f"{len(series)} slices of {series[0].get('SeriesDescription', '') or uid}" for uid, series in found.items()
        )
        raise InputError(
            f"{folder.name}: one series of DICOM expected, got {listed or 'none'}; give each a folder of its own"
        )
    return next(iter(found.values())), others


def _placed(folder: Path, slices: "list[Dataset]") -> tuple[Array, tuple[float, float, float]]:
    """The affine (4, 4) of (slice, row, column) to the right, the front and the top in mm, and the spacing; slices are sorted.

    :raises InputError: for slices that do not say where they are, differ in size or direction, or lie at uneven distances.
    """
    lacking = [
        word
        for word in ("ImagePositionPatient", "ImageOrientationPatient", "PixelSpacing")
        if any(word not in one for one in slices)
    ]
    if lacking:
        raise InputError(
            f"{folder.name}: its slices do not say {', '.join(lacking)}, and so not their places; convert them (dcm2niix)"
        )
    turn = np.array([one.ImageOrientationPatient for one in slices], float)
    size = np.array([[one.Rows, one.Columns, *one.PixelSpacing, one.get("NumberOfFrames", 1)] for one in slices], float)
    if np.abs(turn - turn[0]).max() > TURNED or np.abs(size - size[0]).max() > 1e-4 * size[0].max() or size[0, 4] != 1:
        raise InputError(
            f"{folder.name}: slices of one size and one direction expected, one frame each; convert them (dcm2niix)"
        )
    along, down = turn[0, :3], turn[0, 3:]
    across = np.cross(along, down)
    places = np.array([one.ImagePositionPatient for one in slices], float)
    order = np.argsort(places @ across, kind="stable")
    slices[:] = [slices[i] for i in order]
    if len(slices) < 2:
        raise InputError(
            f"{folder.name}: one slice; a single slice is an image: pydicom.dcmread(path).pixel_array, kind='image'"
        )
    gaps = np.diff(places[order] @ across)
    step = float(gaps.mean())
    if not step > 0 or np.abs(gaps - step).max() > UNEVEN * step:
        raise InputError(
            f"{folder.name}: slices at even distances expected, got {gaps.min():.3g} to {gaps.max():.3g} mm; is one missing, or "
            "are there several volumes (a series in time) in the folder?"
        )
    dy, dx = map(float, slices[0].PixelSpacing)
    move = (places[order[-1]] - places[order[0]]) / (len(slices) - 1)
    if np.abs(move / step - across).max() > UNEVEN:
        raise InputError(
            f"{folder.name}: its slices are shifted against each other (a tilted gantry); straighten them (dcm2niix)"
        )
    affine = np.eye(4)
    affine[:3] = np.column_stack([move, down * dy, along * dx, places[order[0]]])
    return np.diag([-1.0, -1.0, 1.0, 1.0]) @ affine, (step, dy, dx)  # DICOM counts to the left and to the back


def _values(folder: Path, one: "Dataset") -> Array:
    """The values (rows, columns) of a slice, rescaled.

    :raises InputError: for colours; FormatError: for samples that cannot be decompressed.
    """
    if int(one.get("SamplesPerPixel", 1)) != 1:
        raise InputError(f"{folder.name}: slices of one channel expected, got {one.SamplesPerPixel}")
    try:
        stored = one.pixel_array
    except (AttributeError, NotImplementedError, RuntimeError, ValueError) as cause:
        reason = " ".join(str(cause).split())[:200]
        raise FormatError(
            f"{folder.name}: its samples cannot be decompressed ({reason}); install pylibjpeg-libjpeg, or convert it"
        ) from cause
    return stored.astype(np.float32) * np.float32(one.get("RescaleSlope", 1.0)) + np.float32(
        one.get("RescaleIntercept", 0.0)
    )


def _must_be_replaceable(path: Path) -> None:
    """Refuse a file, and a folder that holds anything but slices, in place of which a series would come.

    :raises FormatError: it names one thing that would be lost.
    """
    if path.exists() and not path.is_dir():
        raise FormatError(f"{path.name}: a file is there, and a series of DICOM is a folder; name another one")
    others = [one.name for one in sorted(path.iterdir()) if one.suffix.lower() != ".dcm"] if path.exists() else []
    if others:
        raise FormatError(
            f"{path.name}: the folder holds {others[0]}, which a new series in its place would remove; name another folder"
        )


def _derived(one: "Dataset", values: Array, series: str, tags: Mapping[str, str]) -> "Dataset":
    """A slice of another series with these values."""
    pydicom = need("pydicom", "dicom")
    made = (
        pydicom.dcmread(one.filename) if getattr(one, "filename", None) and Path(one.filename).exists() else one.copy()
    )
    kind = np.dtype(f"{'i' if made.PixelRepresentation else 'u'}{int(made.BitsAllocated) // 8}")
    slope, intercept = float(made.get("RescaleSlope", 1.0)), float(made.get("RescaleIntercept", 0.0))
    bits = int(made.BitsStored)
    low, high = (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if made.PixelRepresentation else (0, (1 << bits) - 1)
    stored = np.clip(np.rint((values.astype(np.float64) - intercept) / slope), low, high).astype(kind)
    made.PixelData = stored.tobytes()
    made["PixelData"].VR = "OW"
    made.file_meta.TransferSyntaxUID = pydicom.uid.ExplicitVRLittleEndian
    made.SOPInstanceUID = made.file_meta.MediaStorageSOPInstanceUID = pydicom.uid.generate_uid()
    made.SeriesInstanceUID = series
    made.SeriesDescription = f"{made.get('SeriesDescription', '')} smoothed"[:64].strip()
    made.ImageType = ["DERIVED", "SECONDARY", *list(made.get("ImageType", []))[2:]]
    words = ", ".join(f"{name.removeprefix('meshflow:')} {word}" for name, word in tags.items())
    made.DerivationDescription = f"meshflow {words}"[:1024]
    for word in ("SmallestImagePixelValue", "LargestImagePixelValue", "NumberOfFrames"):
        if word in made:
            del made[word]
    return made
