"""Volumes as stacks of TIFF: pages of one size, one for each slice."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image as Picture
from PIL import ImageSequence

from meshflow.errors import Fact, FormatError, InputError
from meshflow.geometry.validation import Array, nowhere
from meshflow.io.document import Document, Source, WriteOptions
from meshflow.io.formats.volume_arrays import must_be_no_labels
from meshflow.io.formats.volume_storage import as_pages, volume_written
from meshflow.io.metadata import ReadOptions
from meshflow.surfaces.volume import Volume, steps_of

__all__ = ["can_write", "read", "stored", "write"]

NAME: str = "a TIFF stack"
READS: tuple[str, ...] = ("kind", "spacing", "nodata", "unit")
WRITES: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Pages(Source):
    """What a stack contains besides the samples.

    :param dtype: in which they were stored.
    """

    dtype: str = "float32"

    @property
    def stored_as(self) -> str:
        """The type in which the samples were stored."""
        return self.dtype


def read(path: Path, options: ReadOptions) -> Document:
    """Read a stack of pages (h, w) as a volume (d, h, w); ``kind="volume"`` says that it is one.

    :param options: ``spacing``, (dz, dy, dx), voxels by default; ``nodata``; ``unit`` of lengths.
    :raises FormatError: for a file that cannot be read.
    :raises InputError: for pages of several sizes or with colours, a single page, and labels.
    """
    values = stored(path)
    must_be_no_labels(values, path.name)
    spacing = steps_of(1.0 if options.spacing is None else options.spacing)
    data = Volume(values, spacing, nowhere(options.missing_in(values)), unit=options.unit or "")
    return Document(data, path, Pages(str(values.dtype)))


def stored(path: Path) -> Array:
    """The numbers (d, h, w) of a stack, whatever they mean: masks and labels, too.

    :raises FormatError: for a file that cannot be read.
    :raises InputError: for pages of several sizes or with colours.
    """
    try:
        with Picture.open(path) as opened:
            pages = [np.array(page) for page in ImageSequence.Iterator(opened)]
    except (OSError, ValueError, SyntaxError) as cause:
        raise FormatError(f"{path.name} cannot be read ({' '.join(str(cause).split())[:200]})") from cause
    if len({page.shape for page in pages}) != 1 or pages[0].ndim != 2:
        shapes = ", ".join(sorted({str(page.shape) for page in pages}))
        raise InputError(f"{path.name}: pages of one size and one channel expected, got {shapes}")
    return np.stack(pages)


def can_write(document: Document, suffix: str) -> bool:
    """Whether the document is a volume of one channel."""
    return isinstance(document.data, Volume) and document.data.values.ndim == 3


def write(document: Document, path: Path, options: WriteOptions) -> tuple[str, ...]:
    """Write a volume as a stack of float32, slice by slice.

    :param options: tags cannot be stored.
    :returns: notes on what the stack does not hold.
    :raises FormatError: when the file cannot be written.
    """
    if not isinstance(document.data, Volume):
        raise FormatError(f"{path.name}: a volume expected, got a {document.kind}")
    with volume_written(path, as_pages(document.data.values.shape)) as writer:
        writer.write((), document.data.values)
    return (Fact(f"{path.name}: float32; a TIFF stack does not hold the spacing"),)
