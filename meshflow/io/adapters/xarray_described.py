"""What a DataArray of xarray says of its samples."""

from collections.abc import Hashable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, cast

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array, Spacing, real
from meshflow.io.adapters.xarray_irregular import steps_of
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.volume import Steps, Volume

if TYPE_CHECKING:
    from xarray import DataArray

__all__ = ["CHANNELS", "Described", "as_data_array", "regular", "several", "unscaled"]

# The names of dimensions that hold channels.
CHANNELS = ("band", "bands", "channel", "channels", "rgb")
# How the file was packed. If it were kept, rioxarray would silently write smoothed heights as integers.
_PACKING = (
    "dtype",
    "rasterio_dtype",
    "scale_factor",
    "add_offset",
    "_FillValue",
    "missing_value",
    "source",
    "preferred_chunks",
    "chunksizes",
)
_NODATA = -9999.0


class Shaped(Protocol):
    """An array of numpy or of dask."""

    @property
    def dtype(self) -> np.dtype:
        """Its number type."""
        ...

    def reshape(self, shape: tuple[int, ...], /) -> object:
        """It in another shape."""
        ...


@dataclass(frozen=True, eq=False)
class Described:
    """What a DataArray says of its samples; none of them is read.

    :ivar array: as it came.
    :ivar ordered: its dimensions in the order in which samples are read.
    :ivar shape: (h, w) or (h, w, k), of a volume (d, h, w) or (d, h, w, k).
    :ivar spacing: (dx, dy), of a volume (dz, dy, dx).
    :ivar kind: the class of its data.
    :ivar unit: of heights, of a volume of lengths.
    :ivar notes: sentences for the user.
    """

    array: "DataArray"
    ordered: "DataArray"
    shape: tuple[int, ...]
    spacing: Spacing | Steps
    kind: type[HeightField | Image | Volume]
    unit: str
    notes: tuple[str, ...]

    def values(self) -> Array:
        """The samples, as float32 or float64."""
        return real(self.ordered.to_numpy(), str(self.array.name or "DataArray")).reshape(self.shape)

    @property
    def nodata(self) -> object:
        """The declared value of missing samples of an array that was opened without masking; None: there is none."""
        return self.array.attrs.get("_FillValue", self.array.attrs.get("nodata"))

    def holding(self, values: Shaped, anything_missing: bool) -> "DataArray":
        """The DataArray with other values of that shape, of numpy or of dask."""
        array = self.array
        smoothed = self.ordered.copy(data=values.reshape(self.ordered.shape)).transpose(*array.dims)
        smoothed.encoding = {key: value for key, value in array.encoding.items() if key not in _PACKING}
        declared = array.encoding.get("_FillValue", _NODATA if anything_missing else None)
        if declared is not None and "_FillValue" not in array.attrs:
            fits = np.isnan(declared) or abs(float(declared)) <= np.finfo(values.dtype).max
            smoothed.encoding["_FillValue"] = values.dtype.type(declared if fits else _NODATA)
        return smoothed


def as_data_array(data: object) -> "DataArray":
    """A DataArray as such.

    :raises InputError: for a Dataset, and anything else.
    """
    if not hasattr(data, "dims") or not hasattr(data, "encoding") or hasattr(data, "data_vars"):
        names = ", ".join(map(str, getattr(data, "data_vars", ())))
        raise InputError(
            f"an xarray.DataArray expected, got {type(data).__name__}; choose one of its variables: {names or '(none)'}"
        )
    return cast("DataArray", data)


def unscaled(array: "DataArray") -> tuple[str, ...]:
    """A sentence where a scale or an offset is in the attributes."""
    scale, offset = array.attrs.get("scale_factor", 1), array.attrs.get("add_offset", 0)
    if (scale, offset) == (1, 0):
        return ()
    return (
        f"scale_factor {scale:g} and add_offset {offset:g} are in the attributes and were not applied; "
        "open with mask_and_scale=True to smooth true values",
    )


def regular(coordinate: "DataArray") -> float:
    """The step of a coordinate, ascending or descending, whose steps are equal within 1e-3."""
    along = np.asarray(coordinate)
    name = coordinate.name
    if along.dtype.kind not in "fiu" or along.size < 2:
        raise InputError(f"{name}: at least two numbers expected along it, got {along.size} of {along.dtype}")
    step, even = steps_of(along)
    if not even:
        steps = np.diff(along.astype(np.float64))
        raise InputError(
            f"{name}: regular coordinates expected, got steps of {steps.min():g} to {steps.max():g}; load it first "
            f"(array.load()), resample it: array.interp({name}=numpy.linspace(...)), or give spacing=(dx, dy)"
        )
    return abs(step)


def several(array: "DataArray", but: tuple[Hashable, ...] = ()) -> tuple[list[Hashable], Hashable | None]:
    """The dimensions with several entries, and the one of them that holds channels.

    :param but: those that are not asked for.
    """
    found = [name for name in array.dims if name not in but and array.sizes[name] > 1]
    channel = next((name for name in found if str(name).lower() in CHANNELS), None)
    return found, channel
