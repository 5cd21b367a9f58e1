"""Imports xarray.DataArray; results keep dimensions, coordinates, attributes and CRS."""

from collections.abc import Hashable
from dataclasses import dataclass
from functools import partial
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import InputError
from meshflow.geometry.validation import Array, Spacing, mask_of, real, spacing_of
from meshflow.io.adapters.xarray_described import Described, as_data_array, regular, several, unscaled
from meshflow.io.adapters.xarray_irregular import irregular_of
from meshflow.io.adapters.xarray_volumes import described_volume, volume_from
from meshflow.io.document import Imported
from meshflow.io.metadata import ReadOptions, as_given
from meshflow.io.spacing import (
    between_samples,
    columns_of_a_turn,
    height_unit,
    is_cylindrical,
    on_ellipsoid,
    on_ground,
    said_of_turn,
    units_disagree,
)  # fmt: skip
from meshflow.surfaces.data import array_of
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.irregular import Irregular
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.volume import in_plane

if TYPE_CHECKING:
    from rasterio.crs import CRS
    from xarray import DataArray

__all__ = ["Described", "described", "from_object", "further_dimensions"]

_NAMES = (("y", "x"), ("lat", "lon"), ("latitude", "longitude"))


@dataclass(frozen=True)
class _Layout:
    """The roles of the dimensions; ``leading`` ones have one entry each."""

    y: Hashable
    x: Hashable
    channel: Hashable | None
    leading: tuple[Hashable, ...]

    @property
    def order(self) -> tuple[Hashable, ...]:
        """The dimensions in the order in which samples are read."""
        return (*self.leading, self.y, self.x, *((self.channel,) if self.channel else ()))


def from_object(data: object, options: ReadOptions) -> Imported:
    """Import a DataArray: a height field over its last two dimensions, or an image of its bands.

    Rows and columns are the y and x of rioxarray, else dimensions named y and x, lat and lon, latitude and longitude, else
    the last two. A dimension named band, channel or rgb holds the channels of an image; any other must have one entry. The
    spacing is that of the coordinates; for degrees it is in metres and per row. NaN and declared nodata are missing.

    Results are new DataArrays of float32 or float64, with a nodata value in the encoding, so that ``to_raster`` and
    ``to_netcdf`` neither quantize them nor lose missing samples.

    Without even coordinates (two dimensions of lon and lat; uneven spacing) the samples are a mesh of which the values move.

    A volume (``kind="volume"``) has three dimensions beside that of its channels, in the order of the array.

    :param options: ``kind`` (``terrain``, ``image`` or ``volume``), ``spacing``, ``missing``, ``nodata``.
    :raises InputError: for a Dataset, other dimensions with several entries, or other options.
    """
    if options.kind == "volume":
        return volume_from(data, options)
    uneven = _uneven(data, options)
    if uneven is not None:
        return uneven
    said = described(data, options)
    values = said.values()
    gone = _gone(said.array, values)
    missing = gone | mask_of(options.missing_in(values), gone.shape, "missing")
    period = 0 if options.spacing is not None else _period(said, values)
    spacing = in_plane(said.spacing)
    if said.kind is Image:
        found: HeightField | Image = Image(values, spacing, missing, period=period)
    else:
        found = HeightField(values, spacing, missing, unit=said.unit, period=period)
    notes = said.notes + said_of_turn(period)
    return Imported(found, lambda smoothed: said.holding(np.array(array_of(smoothed)), bool(gone.any())), notes)


def _uneven(data: object, options: ReadOptions) -> Imported | None:
    """The import of a DataArray without even coordinates; None where they are even, or the spacing is given."""
    array = as_data_array(data)
    if options.spacing is not None or array.ndim < 2:
        return None
    layout = _layout(array)
    ordered = array.transpose(*layout.order)
    shape = ordered.shape[len(layout.leading) :]
    values = real(ordered.to_numpy(), str(array.name or "DataArray")).reshape(shape)
    gone = _gone(array, values)
    more = options.missing_in(values)
    found = irregular_of(array, (layout.y, layout.x), values, gone if more is None else gone | more)
    if found is None:
        return None
    options.must_belong("a DataArray without even coordinates", ("kind", "missing", "nodata"))
    taken, note = found
    said = Described(array, ordered, shape, (1.0, 1.0), Image, "", ())

    def to_object(mesh: Mesh) -> "DataArray":
        """The DataArray with the values of the mesh."""
        return said.holding(taken.holding(mesh).columns.reshape(shape), bool(gone.any()))

    return Imported(taken.mesh, to_object, (note, *unscaled(array)), partial(_aligned, taken))


def _aligned(taken: Irregular, given: ArrayLike | None, word: str) -> ArrayLike | None:
    """An option of one number per sample, in the order of the vertices."""
    return taken.aligned(as_given(given, word))


def described(data: object, options: ReadOptions) -> Described:
    """What a DataArray says of its samples.

    :raises InputError: as :func:`from_object`.
    """
    array = as_data_array(data)
    if options.kind == "volume":
        return described_volume(array, options)
    options.must_belong("a DataArray", ("kind", "spacing", "missing", "nodata"))
    layout = _layout(array)
    _check_kind(options.kind, array, layout)
    ordered = array.transpose(*layout.order)
    shape, notes = ordered.shape[len(layout.leading) :], unscaled(array)
    if options.spacing is None:
        spacing, more = _spacing(array, layout)
        notes += more
    else:
        spacing = spacing_of(options.spacing, shape[0])
    if layout.channel or options.kind == "image":
        return Described(array, ordered, shape, spacing, Image, "", notes)
    unit = height_unit(_crs(array), array.attrs.get("units"))
    return Described(array, ordered, shape, spacing, HeightField, unit, notes + units_disagree(_crs(array), unit))


def _check_kind(kind: str | None, array: "DataArray", layout: _Layout) -> None:
    if kind not in (None, "terrain", "image"):
        raise InputError(
            f"kind: terrain, image or volume expected for a DataArray, got {kind!r}; give depths as an array with a camera"
        )
    if kind == "terrain" and layout.channel:
        raise InputError(
            f"dimension {layout.channel}: one entry expected for a terrain, got {array.sizes[layout.channel]}; "
            f"choose one: array.isel({layout.channel}=0)"
        )


def _layout(array: "DataArray") -> _Layout:
    if array.ndim < 2:
        raise InputError(f"a DataArray of at least two dimensions expected, got {array.dims} of shape {array.shape}")
    y, x = _plane(array)
    _, channel = several(array, (y, x))
    for name in further_dimensions(array):
        raise InputError(
            f"dimension {name}: one entry expected beside {y} and {x}, got {array.sizes[name]}; slices='each' smooths each slice "
            "by its own choice, slices='alike' all by one; or rename it to band if these are channels of an image"
        )
    return _Layout(y, x, channel, tuple(name for name in array.dims if name not in (y, x, channel)))


def further_dimensions(array: "DataArray") -> tuple[Hashable, ...]:
    """The dimensions with several entries beside rows, columns and channels."""
    y, x = _plane(array)
    found, channel = several(array, (y, x))
    return tuple(name for name in found if name != channel)


def _plane(array: "DataArray") -> tuple[Hashable, Hashable]:
    rioxarray = _rioxarray()
    if rioxarray is not None:
        try:
            return array.rio.y_dim, array.rio.x_dim
        except rioxarray.exceptions.MissingSpatialDimensionError:
            pass  # not named as rioxarray expects: try the names below
    return next((pair for pair in _NAMES if set(pair) <= set(array.dims)), (array.dims[-2], array.dims[-1]))


def _rioxarray() -> ModuleType | None:
    """Import rioxarray if it is installed; it registers ``.rio``, which knows more conventions than this module."""
    try:
        import rioxarray
        import rioxarray.exceptions
    except ImportError:
        return None
    return rioxarray


def _crs(array: "DataArray") -> "CRS | None":
    from rasterio.crs import CRS

    if _rioxarray() is not None:
        return array.rio.crs
    words = (coordinate.attrs.get("crs_wkt") for coordinate in array.coords.values())
    return next((CRS.from_wkt(wkt) for wkt in words if wkt), None)


def _spacing(array: "DataArray", layout: _Layout) -> tuple[Spacing, tuple[str, ...]]:
    crs, shape = _crs(array), (array.sizes[layout.y], array.sizes[layout.x])
    if layout.y not in array.coords or layout.x not in array.coords:
        turned = array.rio.transform() if _rioxarray() is not None else None
        if turned is not None and not turned.is_identity:
            return between_samples(crs, turned, shape)
        return (1.0, 1.0), (f"no coordinates along {layout.y} and {layout.x}: the spacing is 1; give spacing=(dx, dy)",)
    rows, columns = array.coords[layout.y], array.coords[layout.x]
    dy, dx = regular(rows), regular(columns)
    if crs is not None and is_cylindrical(crs):
        return on_ground(crs, float(columns.mean()), rows.to_numpy().astype(np.float64), dx, dy)
    if crs is not None and not crs.is_geographic:
        return (dx, dy), ()
    in_degrees = (layout.y, layout.x) in _NAMES[1:] or str(rows.attrs.get("units", "")).startswith("degree")
    if crs is None and not in_degrees:
        return (dx, dy), ()
    return on_ellipsoid(crs if crs is not None else _wgs84(), rows.to_numpy().astype(np.float64), dx, dy)


def _period(said: "Described", values: Array) -> int:
    """The number of columns after which the rows of samples (h, w, ...) repeat; 0: they have two ends."""
    layout, crs = _layout(said.array), _crs(said.array)
    if layout.x not in said.array.coords or np.ndim(said.spacing[0]) == 0:
        return 0
    return columns_of_a_turn(crs if crs is not None else _wgs84(), regular(said.array.coords[layout.x]), values)


def _wgs84() -> "CRS":
    from rasterio.crs import CRS

    return CRS.from_epsg(4326)


def _gone(array: "DataArray", values: Array) -> Array:
    """Missing samples (h, w): not finite, or the nodata value in the attributes of an array opened without masking."""
    declared = array.attrs.get("_FillValue", array.attrs.get("nodata"))
    gone: Array = np.logical_not(np.isfinite(values))
    if declared is not None:
        gone |= values == values.dtype.type(declared)
    return gone if gone.ndim == 2 else np.any(gone, axis=2)
