"""Volumes in files that are read by windows: .npy, NIfTI, NRRD, stacks of TIFF."""

import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from tempfile import mkdtemp
from typing import Any, Literal, Protocol

import numpy as np
from PIL import Image as Picture

from meshflow.errors import Fact, FormatError, InputError, need
from meshflow.geometry.validation import Array, real
from meshflow.io.document import WriteOptions
from meshflow.io.formats.volume_arrays import must_be_no_labels
from meshflow.io.formats.volume_storage import Layout, Scan, as_array, as_pages, inflated
from meshflow.io.formats.volumes import (
    broken,
    layout_of,
    nifti_opened,
    placed_by_header,
    spacing_along,
    stored_type,
    three,
)
from meshflow.io.metadata import ReadOptions
from meshflow.io.suffixes import suffix_of
from meshflow.surfaces.volume import Steps, Volume, steps_of

__all__ = ["BY_WINDOWS", "VolumeReader", "stored_like", "volume_read", "volume_shape"]

# The extensions of volumes that are read and written by windows.
BY_WINDOWS = (".npy", ".nii", ".nii.gz", ".nrrd", ".tif", ".tiff")
# The side of the cube that is looked at for labels.
LOOKED_AT = 96


class Samples(Protocol):
    """The samples of a volume in a file."""

    @property
    def shape(self) -> tuple[int, ...]:
        """(d, h, w) or (d, h, w, k)."""
        ...

    @property
    def dtype(self) -> np.dtype:
        """In which they are read."""
        ...

    def __getitem__(self, window: tuple[slice, ...]) -> Array:
        """Those of a window, as they are stored."""
        ...


@dataclass(frozen=True, eq=False)
class _Mapped:
    """Samples that lie in a file as in memory; it is opened for each window, so that none of it stays in memory."""

    path: Path
    dtype: np.dtype
    begin: int
    shape: tuple[int, ...]
    order: Literal["C", "F"]

    def __getitem__(self, window: tuple[slice, ...]) -> Array:
        mapped = np.memmap(self.path, self.dtype, "r", self.begin, self.shape, self.order)
        return np.array(mapped[window], order="C")


@dataclass(frozen=True, eq=False)
class _Scaled:
    """Samples of nibabel, which applies the scale of the file; axes of length 1 behind the third are dropped."""

    samples: Any
    shape: tuple[int, ...]

    @property
    def dtype(self) -> np.dtype:
        """In which they are read: that of the file, or a wider one where they are scaled."""
        return self[(slice(0, 1),) * 3].dtype

    def __getitem__(self, window: tuple[slice, ...]) -> Array:
        found = np.asanyarray(self.samples[(*window, *(0,) * (self.samples.ndim - len(window)))])
        return np.ascontiguousarray(found)


@dataclass(frozen=True, eq=False)
class _Pages:
    """Samples of the pages of a TIFF."""

    picture: Picture.Image
    shape: tuple[int, ...]

    @property
    def dtype(self) -> np.dtype:
        """That of the first page."""
        return self[(slice(0, 1),) * 3].dtype

    def __getitem__(self, window: tuple[slice, ...]) -> Array:
        pages, *part = window
        found = []
        for page in range(pages.start, pages.stop):
            self.picture.seek(page)
            whole = np.array(self.picture)
            if whole.shape != self.shape[1:]:
                raise InputError(
                    f"pages of one size and one channel expected, got {self.shape[1:]} and, page {page}, {whole.shape}"
                )
            found.append(whole[tuple(part)])
        return np.stack(found)


@dataclass(frozen=True, eq=False)
class VolumeReader:
    """A volume in a file.

    :ivar path: of the file.
    :ivar samples: of the file.
    :ivar shape: (d, h, w).
    :ivar channels: their number; None: samples are numbers.
    :ivar dtype: float32 or float64, of the values.
    :ivar spacing: (dz, dy, dx); ``unit``: of lengths.
    :ivar source: what the file contains besides; that of a file of samples alone has nothing.
    """

    path: Path
    samples: Samples = field(repr=False)
    dtype: np.dtype
    spacing: Steps
    unit: str
    source: Scan
    options: ReadOptions

    @property
    def shape(self) -> tuple[int, ...]:
        """(d, h, w)."""
        return self.samples.shape[:3]

    @property
    def channels(self) -> int | None:
        """Their number; None: samples are numbers."""
        return self.samples.shape[3] if len(self.samples.shape) == 4 else None

    def read(self, window: tuple[slice, ...]) -> tuple[Array, Array]:
        """Values (s, r, c) or (s, r, c, k) of a window, and those (s, r, c) that are missing."""
        stored = self.samples[window]
        values, given = real(stored, "volume"), self.options.missing_in(stored)
        gone = np.logical_not(np.isfinite(values))
        gone = gone if gone.ndim == 3 else np.logical_or.reduce(gone, axis=3)
        return values, gone if given is None else np.logical_or(gone, given)


@contextmanager
def volume_read(path: Path, options: ReadOptions, folder: Path) -> Iterator[VolumeReader]:
    """Open a volume; a compressed file is first decompressed beside the result.

    :param options: as of the formats: ``kind``, ``spacing``, ``nodata``, ``unit``.
    :param folder: of the result.
    :raises FormatError: for a file that cannot be read so.
    :raises InputError: for labels, series, single slices.
    """
    with ExitStack() as stack:
        samples, affine, source = _opened(stack, path, folder)
        middle = tuple(
            slice(max(0, (size - LOOKED_AT) // 2), min(size, (size + LOOKED_AT) // 2)) for size in samples.shape[:3]
        )
        must_be_no_labels(samples[middle], path.name)
        spacing, unit = _distances(path, affine, options), options.unit or source.unit
        dtype, options = _number_type(samples), replace(options, kind="volume")
        yield VolumeReader(path, samples, dtype, spacing, unit, source, options)


def volume_shape(path: Path) -> tuple[tuple[int, ...], np.dtype]:
    """The shape of a volume in a file, (d, h, w) or (d, h, w, k), and the type of its values; nothing is decompressed.

    :raises FormatError: for a file that cannot be read by windows.
    """
    with ExitStack() as stack:
        samples = _opened(stack, path, None)[0]
        return samples.shape, _number_type(samples)


def _number_type(samples: Samples) -> np.dtype:
    """float32 or float64.

    :raises InputError: for booleans and complex numbers.
    """
    return Volume(np.zeros((2, 2, 2, *samples.shape[3:]), samples.dtype)).values.dtype


def _distances(path: Path, affine: Array | None, options: ReadOptions) -> Steps:
    """(dz, dy, dx) as given, or as the file says."""
    if options.spacing is not None:
        return steps_of(options.spacing)
    return (1.0, 1.0, 1.0) if affine is None else spacing_along(path, affine)


def _opened(stack: ExitStack, path: Path, folder: Path | None) -> tuple[Samples, Array | None, Scan]:
    """The samples of a file, its affine, and what else it contains.

    :param folder: in which it is decompressed; None: only what it is is asked for.
    :raises InputError: for a shape that is no volume's.
    """
    samples, affine, source = _found(stack, path, folder)
    shape = samples.shape
    if len(shape) not in (3, 4) or min(shape[:3]) < 2:
        raise InputError(
            f"{path.name}: a volume (d, h, w) or (d, h, w, k) of at least 2 x 2 x 2 samples expected, got shape {shape}"
        )
    return samples, affine, source


def _found(stack: ExitStack, path: Path, folder: Path | None) -> tuple[Samples, Array | None, Scan]:
    """The samples of a file, whatever their shape, its affine, and what else it contains."""
    suffix = suffix_of(path)
    if suffix == ".npy":
        return _array(path), None, Scan()
    if suffix in (".nii", ".nii.gz"):
        plain = path if suffix == ".nii" or folder is None else _whole(stack, path, folder)
        samples, affine, source = nifti_opened(plain)
        three(path, np.broadcast_to(np.zeros(()), samples.shape))
        return _Scaled(samples, samples.shape[:3]), affine, source
    if suffix == ".nrrd":
        return _nrrd(stack, path, folder)
    try:
        picture = stack.enter_context(Picture.open(path))
        return _Pages(picture, (getattr(picture, "n_frames", 1), *np.array(picture).shape)), None, Scan()
    except (OSError, ValueError, SyntaxError) as cause:
        raise broken(path, cause) from cause


def _array(path: Path) -> Samples:
    try:
        mapped = np.load(path, "r", allow_pickle=False)
    except (OSError, ValueError, EOFError) as cause:
        raise broken(path, cause) from cause
    return _Mapped(path, mapped.dtype, mapped.offset, mapped.shape, "C" if mapped.flags.c_contiguous else "F")


def _nrrd(stack: ExitStack, path: Path, folder: Path | None) -> tuple[Samples, Array, Scan]:
    """The samples of a NRRD file, its affine, and its header.

    :raises FormatError: where its samples are not in the file itself, as bytes or compressed by gzip.
    """
    nrrd = need("nrrd", "volumes")
    try:
        with path.open("rb") as file:
            header = nrrd.read_header(file)
            begin = file.tell()
        one = {name: header[name] for name in ("type", "endian", "dimension") if name in header}
        one |= {"encoding": "raw", "sizes": np.ones(len(header["sizes"]), int)}
        dtype = nrrd.read_data(one, BytesIO(bytes(16))).dtype  # of one sample that is made up
    except (nrrd.NRRDError, OSError, EOFError, ValueError, KeyError) as cause:
        raise broken(path, cause) from cause
    encoding = header["encoding"].lower()
    skips = [
        name for name in ("data file", "datafile", "lineskip", "line skip", "byteskip", "byte skip") if name in header
    ]
    if encoding not in ("raw", "gzip", "gz") or skips:
        raise FormatError(
            f"{path.name}: by windows a NRRD in one file, raw or compressed by gzip, is read; this one has encoding {encoding}"
            f"{''.join(f', {name}' for name in skips)}; write it anew, or give more --memory"
        )
    affine, source = placed_by_header(Scan(header=header, dtype=str(dtype)))
    shape = tuple(int(size) for size in header["sizes"])
    shape = shape[:3] if shape[3:] == (1,) else shape
    three(path, np.broadcast_to(np.zeros(()), shape))
    if encoding != "raw" and folder is not None:
        path, begin = _whole(stack, path, folder, begin), 0
    return _Mapped(path, dtype, begin, shape, "F"), affine, source


def _whole(stack: ExitStack, path: Path, folder: Path, begin: int = 0) -> Path:
    """A file decompressed into a folder of its own beside the result, which is deleted with the stack."""
    try:
        made = Path(mkdtemp(prefix=".meshflow-", dir=folder))
        stack.callback(shutil.rmtree, made, ignore_errors=True)
        inflated(path, made / f"samples{'.nii' if suffix_of(path) == '.nii.gz' else ''}", begin)
    except (OSError, EOFError) as cause:
        raise broken(path, cause) from cause
    return next(made.iterdir())


def stored_like(reader: VolumeReader, path: Path, options: WriteOptions) -> tuple[Layout, tuple[str, ...]]:
    """How a result is stored in a file of this name, and notes; nothing is written.

    :raises FormatError: for a format that does not hold it.
    """
    shape, suffix = reader.samples.shape, suffix_of(path)
    if suffix == ".npy":
        return as_array(shape, reader.dtype), ()
    if suffix in (".tif", ".tiff"):
        if reader.channels is not None:
            raise FormatError(
                f"{path.name}: a stack of TIFF holds one channel, got {reader.channels}; write .nii or .npy"
            )
        return as_pages(shape), (Fact(f"{path.name}: float32; a TIFF stack does not hold the spacing"),)
    kind, notes = stored_type(path, reader.source, options)
    return layout_of(path, shape, kind, (reader.spacing, reader.unit), reader.source, options.tags), notes
