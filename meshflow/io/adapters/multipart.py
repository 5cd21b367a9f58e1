"""Data of several parts: scenes of trimesh, blocks of pyvista, files of several meshes."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import InputError
from meshflow.geometry.validation import Array
from meshflow.io.document import Document, Imported, Multipart, distinct_names
from meshflow.io.metadata import ReadOptions
from meshflow.io.objects import taken_in
from meshflow.surfaces.data import Data
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.vectors import Vectors
from meshflow.surfaces.volume import Volume

if TYPE_CHECKING:
    pass

__all__ = ["multipart"]


def multipart(data: object, options: ReadOptions) -> Multipart | None:
    """The parts of a ``trimesh.Scene``, a ``pyvista.MultiBlock`` or a :class:`Document` of several; None for anything else.

    In a scene the primitives of one glTF mesh form one part, and each part is smoothed in the frame of its first node.

    :raises InputError: for a part that is no surface, and for a scene without surfaces.
    """
    if isinstance(data, Vectors) and data.smoothed != "whole":
        return _apart(data, options)
    if isinstance(data, Document):
        return _bands(data, options) if data.source.bands else _sections(data, options)
    for kind in type(data).__mro__:
        home = kind.__module__.partition(".")[0], kind.__name__
        if home == ("trimesh", "Scene"):
            return _scene(data, options)
        if home == ("pyvista", "MultiBlock"):
            return _multi_block(data, options)
    return None


def _apart(data: Vectors, options: ReadOptions) -> Multipart:
    """Directions and magnitudes of a vector field.

    :raises InputError: for options, since the field says all of its samples.
    """
    taken_in(data, options)

    def to_object(parts: Sequence[Data]) -> Vectors:
        """The vectors of both."""
        direction, magnitude = parts
        if not isinstance(direction, (Image, Volume)) or not isinstance(magnitude, (HeightField, Volume)):
            raise InputError(f"vectors: directions and magnitudes expected, got {direction!r} and {magnitude!r}")
        return data.holding_parts(direction, magnitude)

    return Multipart(tuple((name, Imported(one, lambda same: same)) for name, one in data.parts), to_object, whole=True)


def _scene(data: object, options: ReadOptions) -> Multipart | None:
    import trimesh

    from meshflow.io.formats.scenes import taken_apart

    if not isinstance(data, trimesh.Scene):
        return None
    parts, to_object = taken_apart(data, options)
    return Multipart(distinct_names(parts), to_object)


def _multi_block(data: object, options: ReadOptions) -> Multipart | None:
    import pyvista

    from meshflow.io.adapters.pyvista_blocks import from_blocks

    return from_blocks(data, options) if isinstance(data, pyvista.MultiBlock) else None


def _sections(document: Document, options: ReadOptions) -> Multipart | None:
    """The meshes of a file; None for a file with fewer than two.

    :raises InputError: as :func:`from_object`, for options that belong to reading.
    """
    if len(document.sections) < 2:
        return None
    data = taken_in(document, options).data
    if not isinstance(data, Mesh):
        return None
    document = document.holding(data)

    def to_object(surfaces: Sequence[Data]) -> Document:
        """The document with the smoothed parts."""
        meshes = [one for one in surfaces if isinstance(one, Mesh)]
        points = np.array(data.points, dtype=np.result_type(*(one.points for one in meshes)))
        channels = None
        if data.channels is not None:
            kinds = (one.channels for one in meshes if one.channels is not None)
            channels = np.array(data.channels, dtype=np.result_type(*kinds))
        for (_, rows), one in zip(document.sections, meshes, strict=True):
            points[rows] = one.points
            if channels is not None:
                channels[rows] = one.channels
        return document.holding(replace(data, points=points, channels=channels))

    parts = ((name, _section(document, data, rows)) for name, rows in document.sections)
    return Multipart(distinct_names(parts), to_object, whole=True)


def _bands(document: Document, options: ReadOptions) -> Multipart | None:
    """The bands of a raster, each a height field of its own; missing and fixed samples are those of all.

    :raises InputError: as :func:`from_object`, for options that a file says itself.
    """
    image = taken_in(document, options).data
    if not isinstance(image, Image) or image.values.ndim != 3:
        return None

    def to_object(surfaces: Sequence[Data]) -> Document:
        """The document around the smoothed bands."""
        bands = [one.z for one in surfaces if isinstance(one, HeightField)]
        return document.holding(replace(image, values=np.stack(bands, axis=2)))

    bands = [
        HeightField(image.values[:, :, i], image.spacing, image.missing, image.fixed, period=image.period)
        for i in range(image.values.shape[2])
    ]
    parts = ((name, Imported(band, lambda one: one)) for name, band in zip(document.source.bands, bands, strict=False))
    return Multipart(distinct_names(parts), to_object, whole=True)


def _section(document: Document, data: Mesh, rows: Array) -> Imported:
    """The mesh of some vertices of a file and the triangles between them, in the same order."""
    at = np.full(len(data.points), -1)
    at[rows] = np.arange(len(rows))
    faces = at[data.faces]
    part = replace(
        data,
        points=data.points[rows],
        faces=faces[(faces >= 0).all(axis=1)],
        channels=None if data.channels is None else data.channels[rows],
        fixed=np.asarray(data.fixed)[rows],
    )

    def samples(given: ArrayLike | None, word: str) -> ArrayLike | None:
        """One number per sample of this part."""
        found = document.samples(given, word)
        values = np.asarray(found)
        if values.ndim == 0:
            return found
        if len(values) != len(at):
            raise InputError(f"{word}: one number per vertex of the file, {len(at)}, expected, got {len(values)}")
        return values[rows]

    return Imported(part, lambda one: one, (), samples)
