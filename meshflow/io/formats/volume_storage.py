"""How the samples of a volume lie in a file, and a writer of their parts: NIfTI, NRRD, .npy, stacks of TIFF."""

import gzip
import json
import os
import struct
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from io import BytesIO
from math import prod
from pathlib import Path
from typing import Any, Literal

import numpy as np

from meshflow.errors import need
from meshflow.geometry.validation import Array
from meshflow.io.atomic_write import beside
from meshflow.io.document import Source
from meshflow.surfaces.volume import Steps

__all__ = [
    "Layout",
    "Scan",
    "VolumeWriter",
    "as_array",
    "as_nifti",
    "as_nrrd",
    "as_pages",
    "inflated",
    "volume_written",
]

# The code of a comment in NIfTI.
COMMENT = 6
# Bytes that are compressed at a time, and how hard; bytes of samples above which a TIFF is a BigTIFF.
AT_ONCE, HARD, BIG = 1 << 24, 6, 4_000_000_000


@dataclass(frozen=True, eq=False)
class Scan(Source):
    """What a file of NIfTI or NRRD contains besides the samples.

    :param image: the image of nibabel, for NIfTI; else None.
    :param header: of NRRD.
    :param dtype: in which the samples were stored.
    :param unit: of lengths; empty where the file does not say it.
    """

    image: Any = None
    header: Mapping[str, Any] | None = None
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


@dataclass(frozen=True, eq=False)
class Layout:
    """A file of samples.

    :ivar shape: (d, h, w) or (d, h, w, k).
    :ivar dtype: of the samples.
    :ivar head: the bytes before them.
    :ivar order: of their axes: ``C``, the last axis is the fastest, or ``F``, the first one is.
    :ivar packed: what is compressed: nothing, the ``samples``, or ``all`` of the file.
    """

    shape: tuple[int, ...]
    dtype: np.dtype
    head: bytes = b""
    order: Literal["C", "F"] = "C"
    packed: Literal["", "samples", "all"] = ""


@dataclass(frozen=True, eq=False)
class VolumeWriter:
    """A volume that is being written.

    :ivar path: of the samples, as they lie when they are not compressed.
    """

    path: Path
    layout: Layout

    def write(self, window: tuple[slice, ...], values: Array) -> None:
        """Write the samples of a window; the file is opened for them alone, so that they take no memory afterwards."""
        layout = self.layout
        mapped = np.memmap(self.path, layout.dtype, "r+", len(layout.head), layout.shape, layout.order)
        mapped[window] = values
        mapped.flush()


@contextmanager
def volume_written(path: Path, layout: Layout) -> Iterator[VolumeWriter]:
    """A writer of the parts of a volume; the file is complete, or as it was before, when the context ends.

    :raises FormatError: where there is no room for it, and where it may not be written.
    """
    with beside(path) as temporary:
        raw = temporary if not layout.packed else temporary.with_name(f"{temporary.name}.raw")
        bare = layout if layout.packed != "samples" else replace(layout, head=b"")
        _reserved(raw, bare)
        yield VolumeWriter(raw, bare)
        if layout.packed:
            _compressed(raw, temporary, layout.head if layout.packed == "samples" else b"")


def _reserved(path: Path, layout: Layout) -> None:
    """Make the file with its head; room for all samples is taken at once, because a full disk ends a process that maps it."""
    size = prod(layout.shape) * layout.dtype.itemsize
    with path.open("wb") as file:
        file.write(layout.head)
        file.flush()
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(file.fileno(), len(layout.head), size)
            return
        for begin in range(0, size, AT_ONCE):
            file.write(bytes(min(AT_ONCE, size - begin)))


def _compressed(raw: Path, path: Path, head: bytes) -> None:
    """Compress a file as gzip does, behind a head that is not compressed."""
    with raw.open("rb") as source, path.open("wb") as target:
        target.write(head)
        packer = zlib.compressobj(HARD, zlib.DEFLATED, zlib.MAX_WBITS | 16)
        while part := source.read(AT_ONCE):
            target.write(packer.compress(part))
        target.write(packer.flush())


def as_array(shape: tuple[int, ...], dtype: np.dtype) -> Layout:
    """The layout of a .npy file."""
    head = BytesIO()
    np.lib.format.write_array_header_1_0(
        head, {"shape": shape, "fortran_order": False, "descr": np.lib.format.dtype_to_descr(dtype)}
    )
    return Layout(shape, dtype, head.getvalue())


def as_nifti(
    shape: tuple[int, ...], dtype: np.dtype, placed: tuple[Steps, str], source: Scan, tags: Mapping[str, str]
) -> Layout:
    """The layout of a NIfTI file; the header is that of the source, where it is one.

    :param placed: spacing and its unit, for a source without a header of NIfTI.
    """
    nibabel, nothing = need("nibabel", "volumes"), np.broadcast_to(np.zeros((), dtype), shape)
    spacing, unit = placed
    if source.image is None:
        made = nibabel.Nifti1Image(nothing, np.diag([*spacing, 1.0]))
        made.header.set_xyzt_units({"m": "meter", "µm": "micron", "mm": "mm"}.get(unit, "unknown"))
    else:
        header = source.image.header.copy()
        header.set_data_dtype(dtype)
        made = type(source.image)(nothing, source.image.affine, header)
    header = made.header
    header.set_slope_inter(1.0, 0.0)
    if tags:
        header.extensions.append(nibabel.nifti1.Nifti1Extension(COMMENT, json.dumps(dict(tags)).encode()))
    made.update_header()
    header["vox_offset"] = 0  # counted anew, with the comment
    head = BytesIO()
    header.write_to(head)
    begin = head.getvalue().ljust(int(header.get_data_offset()), b"\0")
    return Layout(shape, header.get_data_dtype(), begin, "F")


def as_nrrd(
    shape: tuple[int, ...], dtype: np.dtype, placed: tuple[Steps, str], source: Scan, tags: Mapping[str, str]
) -> Layout:
    """The layout of a NRRD file; the header is that of the source, where it is one.

    :param placed: spacing and its unit, for a source without a header.
    """
    nrrd = need("nrrd", "volumes")
    spacing, unit = placed
    words = {name.replace(":", "_"): word for name, word in tags.items()}
    own: dict[str, Any] = {"encoding": "gzip", "spacings": list(spacing), **({"units": [unit] * 3} if unit else {})}
    if source.image is not None:  # NIfTI counts to the right, the front and the top
        affine = source.image.affine
        own = {"encoding": "gzip", "space": "right-anterior-superior", "space directions": affine[:3, :3].T}
        own |= {"space origin": affine[:3, 3], **({"space units": [unit] * 3} if unit else {})}
    header = {**(dict(source.header or {}) or own), **words}
    for name in ("type", "endian", "sizes", "dimension", "data file", "datafile"):
        header.pop(name, None)
    if header.get("encoding", "raw") not in ("raw", "gzip", "gz"):
        header["encoding"] = "gzip"
    made = BytesIO()
    few = np.zeros((1,) * len(shape), dtype)
    nrrd.write(made, few, header, custom_field_map=dict.fromkeys(words, "string"))
    head = made.getvalue()
    head = head[: head.index(b"\n\n") + 2]
    sizes = f"sizes: {' '.join(map(str, shape))}\n".encode()
    head = head.replace(f"sizes: {' '.join('1' * len(shape))}\n".encode(), sizes)
    return Layout(shape, dtype, head, "F", "" if header.get("encoding") == "raw" else "samples")


def as_pages(shape: tuple[int, ...]) -> Layout:
    """The layout of a stack of TIFF: all directories of pages, of one strip of float32 each, then the samples.

    :param shape: (d, h, w).
    """
    pages, high, wide = shape
    size = 4 * high * wide
    big = pages * size > BIG
    number, count = ("Q", "Q") if big else ("I", "H")
    begin, entries = (16, 10) if big else (8, 10)
    entry = struct.calcsize(f"<HH{number}{number}")
    each = struct.calcsize(f"<{count}") + entries * entry + struct.calcsize(f"<{number}")
    first = begin + pages * each
    first += -first % 16
    head = struct.pack("<2sHHHQ", b"II", 43, 8, 0, begin) if big else struct.pack("<2sHI", b"II", 42, begin)
    for page in range(pages):
        # Width, length, bits, no compression, black is zero, where the strip lies, samples, rows and bytes of it, floating point.
        tags = (
            (256, wide), (257, high), (258, 32), (259, 1), (262, 1), (273, first + page * size), (277, 1), (278, high),
            (279, size), (339, 3),
        )  # fmt: skip
        head += struct.pack(f"<{count}", entries)
        for tag, value in tags:
            wider = tag in (256, 257, 273, 278, 279)
            kind, form = (16 if big and tag in (273, 279) else 4, number) if wider else (3, "H")
            if wider and kind == 4:
                form = "I"
            packed = struct.pack(f"<{form}", value).ljust(struct.calcsize(f"<{number}"), b"\0")
            head += struct.pack(f"<HH{number}", tag, kind, 1) + packed
        following = begin + (page + 1) * each if page + 1 < pages else 0
        head += struct.pack(f"<{number}", following)
    return Layout(shape, np.dtype("<f4"), head.ljust(first, b"\0"))


def inflated(path: Path, to: Path, begin: int = 0) -> None:
    """Decompress a file of gzip, or what follows its first bytes.

    :raises OSError: for content that is no gzip, and where there is no room.
    """
    with path.open("rb") as file:
        file.seek(begin)
        with gzip.GzipFile(fileobj=file) as source, to.open("wb") as target:
            while part := source.read(AT_ONCE):
                target.write(part)
