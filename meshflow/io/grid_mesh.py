"""A height field or an image as an explicit triangle mesh."""

import numpy as np

from meshflow.errors import Fact, InputError
from meshflow.geometry.validation import Array, whole
from meshflow.io.document import Document, Source
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh

__all__ = ["as_mesh_document", "mesh_of_grid"]


def mesh_of_grid(data: HeightField | Image, every: int = 1) -> Mesh:
    """The triangles between the samples that are present, one diagonal per cell; samples without a triangle are left out.

    :param data: of a height field the points are (x, y, z), x to the east and y to the north from the first sample, in the
        horizontal unit; of an image (x, y, 0), with its channels as channels.
    :param every: coarsening: keep every n-th row and column, 1 or more.
    :raises InputError: where no triangle is left.
    """
    values, missing, spacing = _thinned(data, whole(every, "every", 1))
    heights = values if isinstance(data, HeightField) else np.where(missing, np.nan, 0.0)
    if min(missing.shape) < 2:
        raise InputError(
            f"every={every}: two samples or more on each side expected, {missing.shape} are left; take fewer"
        )
    surface = HeightField(heights, spacing, missing).lifted(Lift(diagonals="forward"))
    used, corners = np.unique(surface.triangulations[0], return_inverse=True)
    if not len(used):
        raise InputError("no triangle between the samples that are present: too much is missing")
    channels = None if isinstance(data, HeightField) else values.reshape(missing.size, -1)[used]
    return Mesh(surface.points[used], corners.reshape(-1, 3), channels, "points")


def as_mesh_document(document: Document, every: int = 1) -> Document:
    """A document of a terrain or an image as one of a mesh, to be written as such.

    :raises InputError: for other data, and as :func:`mesh_of_grid`.
    """
    data = document.data
    if not isinstance(data, (HeightField, Image)):
        raise InputError(f"convert: a terrain or an image expected, got {type(data).__name__}")
    return Document(mesh_of_grid(data, every), document.path, Source(), (*document.notes, *_origin(document.source)))


def _origin(source: Source) -> tuple[Fact, ...]:
    """A sentence about the place on the map from which positions count: single precision, as most formats have it, holds no
    map coordinates to less than half a metre.
    """
    places = source.places((slice(0, 1), slice(0, 1)))
    if places is None:
        return ()
    east, north = (float(place[0, 0]) for place in places)
    place, unit = f"({east:.9g}, {north:.10g} on the map)", source.ground_unit or "map units"
    return (Fact(f"positions count from the first sample {place}, to east and north in {unit}"),)


def _thinned(data: HeightField | Image, every: int) -> tuple[Array, Array, tuple[Array | float, float]]:
    """Values, missing samples (h, w), and the spacing, of every so manieth sample."""
    values = data.z if isinstance(data, HeightField) else data.values
    dx, dy = data.spacing
    wide = np.asarray(dx)[::every] * every if np.ndim(dx) else float(np.mean(dx)) * every
    return values[::every, ::every], data.missing[::every, ::every], (wide, float(dy) * every)
