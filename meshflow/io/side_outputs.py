"""Rasters that are written beside a result: what was removed, and the expected error."""

from dataclasses import replace

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array
from meshflow.io.document import Document
from meshflow.io.formats.raster_bands import framed
from meshflow.io.formats.raster_frame import Frame, Framed
from meshflow.io.formats.rasters import Raster
from meshflow.surfaces.data import array_of
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.surfaces.tet_mesh import TetMesh
from meshflow.surfaces.volume import Volume

__all__ = ["difference_of", "document_of", "must_be_on_a_grid", "side_frame"]


def difference_of(before: Document, after: Document) -> Document:
    """What was removed, before minus after in double precision, as a document of its own on the grid of the file.

    :raises InputError: for a mesh.
    """
    one, two = must_be_on_a_grid(before, "removed"), must_be_on_a_grid(after, "removed")
    return document_of(before, array_of(one).astype(np.float64) - array_of(two), "removed")


def document_of(document: Document, values: Array, word: str) -> Document:
    """Other numbers (h, w) or (h, w, k) on the grid of a document; samples that are missing there are marked by NaN.

    :param word: what the numbers are; it becomes the description of the bands.
    :raises InputError: for a mesh.
    """
    data = must_be_on_a_grid(document, word)
    values = values.astype(array_of(data).dtype)
    spacing = (1.0, 1.0) if isinstance(data, RangeImage) else data.spacing
    missing = np.asarray(data.missing) | ~np.isfinite(values.reshape(*values.shape[:2], -1)).all(axis=2)
    made = HeightField(values, spacing, missing) if values.ndim == 2 else Image(values, spacing, missing)
    frame = document.source.frame if isinstance(document.source, Framed) else framed(data, document.source.stored_as)
    return Document(made, document.path, Raster(side_frame(frame, str(values.dtype), word)))


def side_frame(frame: Frame, dtype: str, word: str) -> Frame:
    """The frame of a raster beside a result: the place and the units of the file, and nothing that is said of its samples.

    :param dtype: of the samples; ``word``: what they are.
    """
    return replace(
        frame,
        dtype=dtype,
        alpha=None,
        nodata=float("nan"),
        scales=(),
        offsets=(),
        descriptions=tuple(f"{word} ({name})" if name else word for name in frame.descriptions),
        colours=(),
        palette=None,
        band_tags=(),
        overviews=(),
    )


def must_be_on_a_grid(document: Document, word: str) -> HeightField | Image | RangeImage:
    """The data of a document.

    :param word: the option that needs it.
    :raises InputError: for a mesh.
    """
    if isinstance(document.data, Mesh):
        raise InputError(f"{word}: of samples on a grid only, got a mesh; compare shows what changed")
    if isinstance(document.data, (TetMesh, Volume)):
        raise InputError(f"{word}: of grids of two axes only, got a volume")
    return document.data
