"""Volumes in a DataArray of xarray: three dimensions, in the order of the array, and that of channels."""

from typing import TYPE_CHECKING

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array, nowhere
from meshflow.io.adapters.xarray_described import Described, as_data_array, regular, several, unscaled
from meshflow.io.document import Imported
from meshflow.io.formats.volume_arrays import must_be_no_labels
from meshflow.io.metadata import ReadOptions
from meshflow.surfaces.volume import Steps, Volume, steps_of

if TYPE_CHECKING:
    from xarray import DataArray

__all__ = ["described_volume", "volume_from"]


def volume_from(data: object, options: ReadOptions) -> Imported:
    """Import a DataArray as a volume; the result is a DataArray of floating point.

    :param options: ``spacing``, in the order of the dimensions; by default that of the coordinates. ``missing``, ``nodata``.
    :raises InputError: for labels, and other numbers of dimensions.
    """
    said = described_volume(as_data_array(data), options)
    must_be_no_labels(said.ordered.to_numpy().reshape(said.shape), "the DataArray")
    values = said.values()
    gone: Array = np.logical_not(np.isfinite(values))
    if said.nodata is not None:
        gone |= values == values.dtype.type(said.nodata)
    gone = gone if gone.ndim == 3 else np.any(gone, axis=3)
    more = options.missing_in(values)
    found = Volume(values, steps_of(said.spacing), nowhere(gone if more is None else gone | more), unit=said.unit)
    return Imported(found, lambda smoothed: said.holding(np.array(smoothed.values), bool(gone.any())), said.notes)


def described_volume(array: "DataArray", options: ReadOptions) -> Described:
    """What a DataArray says of its samples as a volume; none of them is read.

    :raises InputError: for other numbers of dimensions, and coordinates that are not regular.
    """
    options.must_belong("a DataArray", ("kind", "spacing", "missing", "nodata", "unit"))
    names, channel = several(array)
    axes = tuple(name for name in names if name != channel)
    if len(axes) != 3:
        raise InputError(
            f"volume: three dimensions expected beside channels, got {', '.join(map(str, axes)) or 'none'} with several entries; "
            "choose one of the others: array.isel(...)"
        )
    leading = tuple(name for name in array.dims if name not in names)
    ordered = array.transpose(*leading, *axes, *([] if channel is None else [channel]))
    placed = [array.coords[name] for name in axes if name in array.coords]
    units = {str(one.attrs.get("units", "")) for one in placed}
    unit = options.unit or (units.pop() if len(placed) == 3 and len(units) == 1 else "")
    notes: tuple[str, ...] = ()
    if options.spacing is not None:
        spacing: Steps = steps_of(options.spacing)
    elif len(placed) == 3:
        spacing = regular(placed[0]), regular(placed[1]), regular(placed[2])
    else:
        spacing, missing = (1.0, 1.0, 1.0), ", ".join(str(name) for name in axes if name not in array.coords)
        notes = (f"no coordinates along {missing}: the spacing is 1; give spacing=(dz, dy, dx)",)
    return Described(array, ordered, ordered.shape[len(leading) :], spacing, Volume, unit, notes + unscaled(array))
