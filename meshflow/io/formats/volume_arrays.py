"""numpy arrays of three axes, and of three axes and channels, as volumes."""

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array, nowhere
from meshflow.io.document import Imported
from meshflow.io.metadata import ReadOptions
from meshflow.surfaces.volume import Volume, steps_of

__all__ = ["TAKES", "must_be_no_labels", "volume_from"]

# The options of an array that is a volume.
TAKES = ("kind", "spacing", "missing", "nodata", "unit")
# Whole numbers are labels where there are at most so many of them, and so large a share of the neighbours that are not both
# zero are equal.
DISTINCT, EQUAL = 256, 0.9


def volume_from(data: Array, options: ReadOptions) -> Imported:
    """Import an array (d, h, w) or (d, h, w, k) as a volume; the result is an array of floating point, with its mask.

    :param options: ``spacing``, (dz, dy, dx); ``missing``, ``nodata``, ``unit`` of lengths.
    :raises InputError: for labels, masks, a single slice, and other numbers of axes.
    """
    options.must_belong("a volume", TAKES)
    must_be_no_labels(np.ma.getdata(data), "the array")
    spacing = steps_of(1.0 if options.spacing is None else options.spacing)
    volume = Volume(data, spacing, nowhere(options.missing_in(data)), unit=options.unit or "")

    def to_object(smoothed: Volume) -> Array:
        """The smoothed array."""
        values = np.array(smoothed.values)
        return np.ma.MaskedArray(values, mask=np.ma.getmask(data)) if isinstance(data, np.ma.MaskedArray) else values

    return Imported(volume, to_object)


def must_be_no_labels(values: Array, name: str) -> None:
    """Refuse numbers that name regions.

    :raises InputError: with the way out.
    """
    if values.dtype.kind not in "iu" or values.ndim < 3 or values.shape[-1] < 2:
        return
    one, other = values[..., 1:], values[..., :-1]
    some = (one != 0) | (other != 0)
    if not some.any() or float((one == other)[some].mean()) < EQUAL or len(np.unique(values)) > DISTINCT:
        return
    raise InputError(
        f"{name} holds {len(np.unique(values))} whole numbers in regions of one number, as labels do, which have no noise: "
        "smooth the probability of a label (labels == i as float), or its surface as a mesh; or give the values as floating point"
    )
