"""numpy arrays as vectors and symmetric tensors."""

from typing import Any

import numpy as np

from meshflow.geometry.validation import Array, mask_of
from meshflow.io.document import Imported
from meshflow.io.metadata import ReadOptions
from meshflow.surfaces.image import Image
from meshflow.surfaces.tensors import Tensors, grid_of
from meshflow.surfaces.vectors import Vectors
from meshflow.surfaces.volume import Volume

__all__ = ["Field", "field_from", "field_of"]

Field = Vectors | Tensors


def field_from(data: Array, options: ReadOptions) -> Imported:
    """Import an array of vectors or tensors, as ``kind`` says; the result is an array with its mask.

    :param options: ``spacing``; ``nodata``, ``missing``; ``unit`` of vectors.
    :raises InputError: as :class:`Vectors` and :class:`Tensors` do.
    """
    options.must_belong(f"an array of {options.kind}", ("kind", "spacing", "missing", "nodata", "unit"))
    field = field_of(data, options)

    def to_object(smoothed: Image | Volume) -> Array:
        """The smoothed array."""
        values = np.array(field.holding(smoothed).values)
        return np.ma.MaskedArray(values, mask=np.ma.getmask(data)) if isinstance(data, np.ma.MaskedArray) else values

    return Imported(field.image, to_object)


def field_of(values: Array, options: ReadOptions) -> Field:
    """The vectors or tensors of an array (h, w, ...) or (d, h, w, ...), as ``kind`` says."""
    kind = Vectors if options.kind == "vectors" else Tensors
    shape = values.shape[:-1] if kind is Vectors else grid_of(values.shape)
    whole = np.asarray(np.ma.filled(values.astype(np.float64) if values.dtype.kind in "iu" else values, np.nan))
    missing = mask_of(options.missing, shape, "missing")
    if options.nodata is not None:
        missing = missing | (whole == options.nodata).reshape(*shape, -1).any(axis=-1)
    spacing: Any = 1.0 if options.spacing is None else options.spacing
    return kind(whole, spacing, missing, unit=options.unit or "")
