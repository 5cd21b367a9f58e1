"""E57: scans of rows and columns are range images, read and written by pye57; each point moves along its line of sight."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from meshflow.errors import Fact, FormatError, InputError, need
from meshflow.geometry.validation import Array, number, whole
from meshflow.io.atomic_write import beside
from meshflow.io.document import Document, Source, WriteOptions, depths_of
from meshflow.io.formats.elsewhere import CLOUD
from meshflow.io.formats.scan_points import range_image_of
from meshflow.io.metadata import ReadOptions

__all__ = ["can_write", "read", "write"]

NAME: str = "scans in E57"
READS: tuple[str, ...] = ("kind", "band", "viewpoint", "jump", "time_unit")
WRITES: tuple[str, ...] = ()

_AXES = ("cartesianX", "cartesianY", "cartesianZ")
_INVALID = ("cartesianInvalidState", "sphericalInvalidState")
# Points that one byte of a file may stand for.
_DENSEST = 1000


@dataclass(frozen=True, eq=False)
class Scans(Source):
    """An E57 that was read.

    :param path: of the file, whose other scans are copied when it is written.
    :param scan: the number of the scan, from 0.
    :param index: (h, w), the point of each sample, -1 where there is none.
    :param start: (h, w), the values as they were read.
    :param cartesian: whether points are stored as x, y, z.
    """

    path: Path
    scan: int
    index: Array
    start: Array
    cartesian: bool


def read(path: Path, options: ReadOptions) -> Document:
    """Read a scan as a range image of a :class:`.Scanner`, in the frame of the scanner and the unit of the file (metres).

    :param options: ``band``, the number of the scan, from 1, where there are several; ``viewpoint`` (x, y, z), where the scanner
        stood in this frame, by default its origin; ``jump`` and ``time_unit`` as in :class:`.RangeImage`.
    :raises FormatError: for a damaged file, and a scan without rows and columns.
    :raises InputError: for another kind, or a scan that is not there.
    :raises MissingPackage: without pye57.
    """
    if options.kind not in (None, "depth"):
        raise InputError(f"{path.name}: a scan is a depth image, got kind={options.kind!r}; leave it out")
    raw, scan, count = _scan(path, options.band)
    if not {"rowIndex", "columnIndex"} <= set(raw):
        raise FormatError(f"{path.name}: points without rows and columns (rowIndex, columnIndex): {CLOUD}")
    points = _points(path, raw)
    valid = np.isfinite(points).all(axis=1) & (points != 0).any(axis=1)
    for name in _INVALID:
        valid &= raw.get(name, np.zeros(len(points))) == 0
    rows, columns = (raw[name].astype(np.int64)[valid] for name in ("rowIndex", "columnIndex"))
    if not valid.any() or len(np.unique(rows * (columns.max() + 1) + columns)) < len(rows):
        raise FormatError(f"{path.name}: one point in each row and column expected, got {len(rows)} points: {CLOUD}")
    rows, columns = rows - rows.min(), columns - columns.min()
    index = np.full((int(rows.max()) + 1, int(columns.max()) + 1), -1, np.int64)
    if min(index.shape) < 2:
        raise FormatError(f"{path.name}: {len(rows)} points in {index.shape[0]} x {index.shape[1]} cells: {CLOUD}")
    index[rows, columns] = np.flatnonzero(valid)
    grid = np.where((index >= 0)[..., None], points[index], np.nan)
    eye = np.zeros(3) if options.viewpoint is None else np.array([number(x, "viewpoint") for x in options.viewpoint])
    if eye.shape != (3,):
        raise InputError(f"viewpoint of three numbers x, y, z expected, got {tuple(eye.tolist())}")
    data = range_image_of(grid, eye, options, path.name)
    note = Fact(f"scan {scan + 1} of {count}, in the frame of its scanner: points move along their rays")
    return Document(data, path, Scans(path, scan, index, data.depth, _AXES[0] in raw), (note,))


def can_write(document: Document, suffix: str) -> bool:
    """Whether it came from such a file, with points as x, y, z."""
    return isinstance(document.source, Scans) and document.source.cartesian and suffix == ".e57"


def write(document: Document, path: Path, options: WriteOptions) -> tuple[str, ...]:
    """Write all scans anew, one of them with new positions.

    :returns: a note on what pye57 does not write.
    :raises FormatError: when the file cannot be written, or the data came from another format.
    """
    source, data = document.source, depths_of(document)
    if not isinstance(source, Scans):
        raise FormatError(f"{path.name}: an E57 is written of what came from one; use .ply")
    pye57 = need("pye57", "e57")
    moved = ~np.asarray(data.missing) & (data.depth != source.start)
    with beside(path) as temporary, pye57.E57(str(source.path)) as old, pye57.E57(str(temporary), mode="w") as new:
        for scan in range(old.scan_count):
            raw, header = old.read_scan_raw(scan, ignore_unsupported_fields=True), old.get_header(scan)
            if scan == source.scan:
                for axis, column in zip(_AXES, data.cloud[moved].T, strict=True):
                    raw[axis][source.index[moved]] = column
            pose = {"rotation": header.rotation, "translation": header.translation} if header.has_pose() else {}
            new.write_scan_raw(raw, name=f"scan {scan + 1}", **pose)
    return ("pictures, names of scans, and fields that pye57 does not know are not written again",)


def _scan(path: Path, band: int | None) -> tuple[Mapping[str, Array], int, int]:
    """The fields of the points of a scan, its number from 0, and the number of scans."""
    pye57 = need("pye57", "e57")
    try:
        file: Any = pye57.E57(str(path))
    except Exception as cause:  # the library has no exception of its own that can be named without it
        raise FormatError(f"{path.name} cannot be read ({str(cause).splitlines()[0]}); get the whole file") from cause
    with file:
        count = int(file.scan_count)
        if band is None and count != 1:
            raise InputError(f"{path.name}: one scan is smoothed at a time, it has {count}; choose one: band=1")
        scan = 0 if band is None else whole(band, "band", 1) - 1
        if scan >= count:
            raise InputError(f"band: 1 to {count} expected in {path.name}, got {band}")
        points = int(file.get_header(scan).point_count)
        if points > _DENSEST * path.stat().st_size:
            raise FormatError(
                f"{path.name}: {points} points are promised in {path.stat().st_size} bytes; is it cut off?"
            )
        try:
            return file.read_scan_raw(scan, ignore_unsupported_fields=True), scan, count
        except Exception as cause:
            raise FormatError(
                f"{path.name} cannot be read ({str(cause).splitlines()[0]}); get the whole file"
            ) from cause


def _points(path: Path, raw: Mapping[str, Array]) -> Array:
    """Positions (n, 3) in the frame of the scanner."""
    if set(_AXES) <= set(raw):
        return np.stack([raw[axis] for axis in _AXES], axis=-1).astype(np.float64)
    angles = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
    if not set(angles) <= set(raw):
        raise FormatError(f"{path.name}: points as x, y, z or as ranges and angles expected, got {', '.join(raw)}")
    r, a, e = (raw[name].astype(np.float64) for name in angles)
    return np.stack([r * np.cos(e) * np.cos(a), r * np.cos(e) * np.sin(a), r * np.sin(e)], axis=-1)
