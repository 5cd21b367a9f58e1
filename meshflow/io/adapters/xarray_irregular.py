"""DataArrays without even coordinates: curvilinear grids (coordinates of two dimensions) and unevenly spaced rows or columns."""

from collections.abc import Hashable
from typing import TYPE_CHECKING

import numpy as np

from meshflow.errors import Fact, InputError
from meshflow.geometry.validation import Array
from meshflow.surfaces.curvilinear import Curvilinear
from meshflow.surfaces.irregular import Irregular
from meshflow.surfaces.on_sphere import OnSphere

if TYPE_CHECKING:
    from xarray import DataArray

__all__ = ["irregular_of", "steps_of"]

# The names of coordinates along the rows and along the columns.
_X = ("lon", "longitude", "nav_lon", "xlong", "tlon", "ulon", "x", "xc")
_Y = ("lat", "latitude", "nav_lat", "xlat", "tlat", "ulat", "y", "yc")
# The mean radius of the Earth, metres (IUGG).
_EARTH = 6_371_008.8
# The largest difference of steps that are equal, as a share of their mean.
_UNEVEN = 1e-3


def irregular_of(
    array: "DataArray", plane: tuple[Hashable, Hashable], values: Array, missing: Array
) -> tuple[Irregular, Fact] | None:
    """The samples of a DataArray whose coordinates are not even, and a sentence on them; None where they are even.

    :param plane: its dimensions, rows and columns.
    :param values: (h, w) or (h, w, k), in that order.
    :param missing: (h, w).
    :raises InputError: for coordinates that are NaN everywhere.
    """
    found = _uneven(array, plane) if set(plane) <= set(array.coords) else _curved(array, plane)
    if found is None:
        return None
    x, y, degrees = found
    if not (np.isfinite(x) & np.isfinite(y if np.ndim(y) == 2 else y[:, None])).any():
        raise InputError(
            f"coordinates of {' and '.join(map(str, plane))}: no sample has a place, they are NaN; give them, or spacing="
        )
    if degrees:
        taken: Irregular = OnSphere(x, y, values, _EARTH, missing=missing)
    else:
        taken = Curvilinear(x, y, values, missing=missing)
    what = "curved rows and columns" if np.ndim(x) == 2 else "rows or columns of uneven spacing"
    return taken, Fact(f"{what}{' in degrees, lengths in metres' if degrees else ''}: smoothed as {taken.mesh!r}")


def steps_of(along: Array) -> tuple[float, bool]:
    """The mean step of a coordinate, and whether all are equal within 1e-3 and the rounding of its type."""
    rounding = 4 * float(np.finfo(along.dtype).eps) * float(np.abs(along).max()) if along.dtype.kind == "f" else 0.0
    steps = np.diff(along.astype(np.float64))
    step = float(steps.mean())
    worst = float(np.abs(steps - step).max())
    return step, bool(step) and worst <= _UNEVEN * abs(step) + rounding


def _curved(array: "DataArray", plane: tuple[Hashable, Hashable]) -> tuple[Array, Array, bool] | None:
    """Coordinates (h, w), and whether they are degrees; None where there are none of two dimensions, and for a raster that lies
    turned on its map, whose transform says so.
    """
    if any("GeoTransform" in one.attrs for one in array.coords.values()):
        return None
    own = {str(name).lower(): one for name, one in array.coords.items() if set(one.dims) == set(plane)}
    for names in zip(_X, _Y, strict=True):
        if set(names) <= own.keys():
            x, y = (own[name].transpose(*plane) for name in names)
            return x.to_numpy(), y.to_numpy(), _is_degrees(x, names[0])
    return None


def _uneven(array: "DataArray", plane: tuple[Hashable, Hashable]) -> tuple[Array, Array, bool] | None:
    """Coordinates (w,) and (h,), one of them uneven, and whether they are degrees; None where both are even, or no numbers."""
    y, x = (array.coords[name].to_numpy() for name in plane)
    if any(
        along.dtype.kind not in "fiu" or along.size < 2 or not np.diff(along.astype(float)).any() for along in (x, y)
    ):
        return None
    if steps_of(x)[1] and steps_of(y)[1]:
        return None
    return x, y, _is_degrees(array.coords[plane[1]], str(plane[1]).lower())


def _is_degrees(coordinate: "DataArray", name: str) -> bool:
    """Whether a coordinate along the rows is a longitude."""
    unit = str(coordinate.attrs.get("units", "")).lower()
    return unit.startswith("degree") or (not unit and "lon" in name)
