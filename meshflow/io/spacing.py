"""How far apart the samples of a raster are, in metres where its grid is in degrees."""

import re
from typing import TYPE_CHECKING

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array, Spacing

if TYPE_CHECKING:
    from affine import Affine
    from rasterio.crs import CRS

__all__ = ["between_samples", "height_unit", "linear_unit", "on_ellipsoid", "units_disagree"]

_METRES = {
    "m": 1.0,
    "metre": 1.0,
    "meter": 1.0,
    "ft": 0.3048,
    "foot": 0.3048,
    "feet": 0.3048,
    "us-ft": 1200 / 3937,
    "us survey foot": 1200 / 3937,
    "us survey feet": 1200 / 3937,
    "cm": 0.01,
    "km": 1000.0,
}


def between_samples(crs: "CRS | None", transform: "Affine", shape: tuple[int, int]) -> tuple[Spacing, tuple[str, ...]]:
    """(dx, dy) of a grid of h x w samples, and notes for the user.

    A projected or unknown CRS: the lengths of the two columns of the transform, in the linear unit of the CRS; a turned grid
    is as good as an upright one. A geographic CRS: metres, one dx per row.

    :param crs: a ``rasterio.crs.CRS`` or None.
    :param transform: column, row to x, y, of corners of pixels.
    :raises InputError: for a sheared grid, a turned one in degrees, or a latitude beyond the poles.
    """
    a, b, c, d, e, f = tuple(transform)[:6]
    dx, dy = float(np.hypot(a, d)), float(np.hypot(b, e))
    if abs(a * b + d * e) > 1e-6 * dx * dy:
        raise InputError(
            f"rows and columns at right angles expected, got the sheared transform {(a, b, c, d, e, f)}; "
            "resample it first: gdalwarp in.tif out.tif"
        )
    if crs is None or not crs.is_geographic:
        return (dx, dy), ()
    if b or d:
        raise InputError(
            f"a grid in degrees along the meridians expected, got the turned transform {(a, b, c, d, e, f)}; "
            "resample it first: gdalwarp in.tif out.tif"
        )
    return on_ellipsoid(crs, f + (np.arange(shape[0]) + 0.5) * e, dx, dy)


def on_ellipsoid(crs: "CRS", latitudes: Array, dlon: float, dlat: float) -> tuple[Spacing, tuple[str, ...]]:
    """(dx, dy) in metres of a grid in degrees (or the angular unit of the CRS), and a note.

    dx_i = N(phi_i) cos(phi_i) dlon, one per row, with N = a / sqrt(1 - e^2 sin^2 phi) the radius of curvature in the prime
    vertical; dy = M dlat, one number, with M = a (1 - e^2) / (1 - e^2 sin^2 phi)^(3/2) of the meridian at the mean latitude
    (on the Earth it changes by 1 % from equator to pole). a and e are those of the ellipsoid of the CRS, the Earth's or not.

    :param latitudes: (h,), of the centres of the rows, in any order.
    :raises InputError: for a row on a pole, where all meridians meet, or beyond.
    """
    radius, flattening = _ellipsoid(crs)
    phi = latitudes * crs.units_factor[1]
    if np.abs(phi).max() > np.pi / 2 - 1e-9:
        worst = latitudes[np.abs(phi).argmax()]
        raise InputError(
            f"latitudes of pixel centres between the poles expected, got {worst:g}; crop that row "
            "(gdal_translate -srcwin), or reproject (gdalwarp -t_srs)"
        )
    e2 = flattening * (2 - flattening)
    widths = radius / np.sqrt(1 - e2 * np.sin(phi) ** 2) * np.cos(phi) * dlon * crs.units_factor[1]
    middle = 1 - e2 * np.sin(phi.mean()) ** 2
    dy = float(radius * (1 - e2) / middle**1.5 * dlat * crs.units_factor[1])
    note = (
        f"degrees became metres on an ellipsoid of {radius:.0f} m: dx {widths.min():.4g} to {widths.max():.4g} m by row, "
        f"dy {dy:.4g} m"
    )
    return (widths, dy), (note,)


def height_unit(crs: "CRS | None", declared: str | None) -> str:
    """The name of the unit of heights: what the band declares, else what a vertical CRS says, else ``""``."""
    if declared or crs is None:
        return declared or ""
    vertical = re.search(r'VERTCRS\[.*?LENGTHUNIT\["([^"]+)"', crs.to_wkt(version="WKT2_2019"), re.DOTALL)
    return vertical.group(1) if vertical else ""


def units_disagree(crs: "CRS | None", unit: str) -> tuple[str, ...]:
    """A note where heights and grid are known to be in different units: slopes would be wrong by their ratio."""
    if crs is None:
        return ()
    name, across = linear_unit(crs)
    up = _METRES.get(unit.lower().removesuffix("s"))
    if not name or up is None or abs(up / across - 1) < 1e-3:
        return ()
    return (
        f"heights in {unit} above a grid in {name}: slopes are wrong by {across / up:.4g}; nothing was converted, "
        f"contrast={up / across:.5g} makes up for it",
    )


def linear_unit(crs: "CRS") -> tuple[str, float]:
    """The name of the unit of lengths on the ground and its metres: the metre where the grid is in degrees, as it is measured in
    metres; ``("", 1.0)`` of a CRS that has none.
    """
    if crs.is_geographic:
        return "metre", 1.0
    return crs.linear_units_factor if crs.is_projected else ("", 1.0)


def _ellipsoid(crs: "CRS") -> tuple[float, float]:
    """Semi-major axis in metres and flattening (0 of a sphere)."""
    wkt = crs.to_wkt(version="WKT2_2019")
    found = re.search(r'ELLIPSOID\["[^"]*",\s*([\d.eE+-]+),\s*([\d.eE+-]+)', wkt)
    if found is None:
        raise InputError(f"a CRS with an ellipsoid expected, got {wkt[:80]}...; give spacing=(dx, dy) in metres")
    radius, inverse = map(float, found.groups())
    return radius, 1 / inverse if inverse else 0.0
