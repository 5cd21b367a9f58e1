"""Organised clouds of PCL (``.pcd``): points in rows and columns are a range image; each moves along its line of sight."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshflow.errors import Fact, FormatError, InputError
from meshflow.geometry.validation import Array, number
from meshflow.io.atomic_write import beside
from meshflow.io.document import Document, Source, WriteOptions, depths_of
from meshflow.io.formats.elsewhere import CLOUD
from meshflow.io.formats.pcd_layout import PcdBytes, loaded
from meshflow.io.formats.scan_points import range_image_of
from meshflow.io.metadata import ReadOptions

__all__ = ["can_write", "read", "write"]

NAME: str = "an organised cloud of PCL"
READS: tuple[str, ...] = ("kind", "viewpoint", "jump", "time_unit")
WRITES: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Organised(Source):
    """A PCD that was read.

    :param file: its bytes.
    :param start: (h, w), the values as they were read.
    """

    file: PcdBytes
    start: Array


def read(path: Path, options: ReadOptions) -> Document:
    """Read an organised cloud as a range image of a :class:`.Scanner`, in the unit of the points.

    A sample is missing where its point is NaN, 0 0 0, or where the scanner stood.

    :param options: ``viewpoint`` (x, y, z), the position of the scanner in the frame of the points, instead of the one in the
        file; ``jump`` and ``time_unit`` as in :class:`.RangeImage`.
    :raises FormatError: for a damaged file, and a cloud without rows and columns.
    :raises InputError: for another kind, or a viewpoint that is not finite.
    """
    if options.kind not in (None, "depth"):
        raise InputError(f"{path.name}: an organised cloud is a depth image, got kind={options.kind!r}; leave it out")
    file = loaded(path)
    h, w = file.shape
    if h < 2 or w < 2:
        raise FormatError(f"{path.name}: {h * w} points without rows and columns (HEIGHT {h}, WIDTH {w}): {CLOUD}")
    eye = file.eye if options.viewpoint is None else np.array([number(x, "viewpoint") for x in options.viewpoint])
    if eye.shape != (3,):
        raise InputError(f"viewpoint of three numbers x, y, z expected, got {tuple(eye.tolist())}")
    points = file.points.reshape(h, w, 3)
    nowhere = ~np.isfinite(points).all(axis=2) | (points == 0).all(axis=2) | (points == eye).all(axis=2)
    if nowhere.all():
        raise FormatError(f"{path.name}: none of its {h * w} points is there (NaN, or 0 0 0)")
    data = range_image_of(np.where(nowhere[..., None], np.nan, points), eye, options, path.name)
    note = Fact("seen from ({:g}, {:g}, {:g}): points move along their rays".format(*eye))
    return Document(data, path, Organised(file, data.depth), (note,))


def can_write(document: Document, suffix: str) -> bool:
    """Whether it came from such a file."""
    return isinstance(document.source, Organised) and suffix == ".pcd"


def write(document: Document, path: Path, options: WriteOptions) -> tuple[str, ...]:
    """Write the file that was read, with the same bytes around new positions.

    :raises FormatError: when the file cannot be written, or the data came from another format.
    """
    source, data = document.source, depths_of(document)
    if not isinstance(source, Organised):
        raise FormatError(f"{path.name}: a PCD is written of what came from one; use .ply")
    points = source.file.points
    moved = (~np.asarray(data.missing) & (data.depth != source.start)).ravel()
    points[moved] = data.cloud.reshape(-1, 3)[moved]
    with beside(path) as temporary:
        temporary.write_bytes(source.file.holding(points))
    normals = {"normal_x", "normal_y", "normal_z"} & set(source.file.rows.dtype.names or ())
    return ("its normals are those from before; compute them again",) if normals else ()
