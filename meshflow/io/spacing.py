"""The spacing of the samples of a raster, in metres where its grid is in degrees."""

import re
from typing import TYPE_CHECKING

import numpy as np

from meshflow.errors import Fact, InputError
from meshflow.geometry.validation import Array, Spacing

if TYPE_CHECKING:
    from affine import Affine
    from rasterio.crs import CRS

__all__ = [
    "between_samples", "columns_of_a_turn", "height_unit", "is_cylindrical", "linear_unit", "on_ellipsoid", "on_ground",
    "said_of_turn", "units_disagree",
]  # fmt: skip

# As GDAL names them in WKT 1.
_CYLINDRICAL = frozenset(
    {
        "mercator_1sp",
        "mercator_2sp",
        "mercator",
        "mercator_auxiliary_sphere",
        "equirectangular",
        "cylindrical_equal_area",
    }
)
_TOLD = "lengths on this map, which grow with latitude,"

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

    For a projected or unknown CRS: the lengths of the two columns of the transform, in the linear unit of the CRS; the grid may
    be rotated. For a geographic CRS: metres, one dx per row.

    :param crs: a ``rasterio.crs.CRS`` or None.
    :param transform: from column, row to x, y of the corners of pixels.
    :raises InputError: for a sheared grid, a rotated grid in degrees, or a latitude beyond the poles.
    """
    a, b, c, d, e, f = tuple(transform)[:6]
    dx, dy = float(np.hypot(a, d)), float(np.hypot(b, e))
    if abs(a * b + d * e) > 1e-6 * dx * dy:
        raise InputError(
            f"rows and columns at right angles expected, got the sheared transform {(a, b, c, d, e, f)}; "
            "resample it first: gdalwarp in.tif out.tif"
        )
    if crs is None or not (crs.is_geographic or is_cylindrical(crs)):
        return (dx, dy), ()
    if not crs.is_geographic:
        if b or d:
            return (dx, dy), (
                f"{_TOLD} of a turned grid are not corrected: resample it first (gdalwarp in.tif out.tif)",
            )
        return on_ground(crs, c + shape[1] / 2 * a, f + (np.arange(shape[0]) + 0.5) * e, dx, dy)
    if b or d:
        raise InputError(
            f"a grid in degrees along the meridians expected, got the turned transform {(a, b, c, d, e, f)}; "
            "resample it first: gdalwarp in.tif out.tif"
        )
    return on_ellipsoid(crs, f + (np.arange(shape[0]) + 0.5) * e, dx, dy)


def columns_of_a_turn(crs: "CRS | None", step: float, values: Array) -> int:
    """The number of columns of a grid in degrees after which its rows repeat; 0: they have two ends.

    It is the number of all columns; or of all but the last one, where that is the first once more, with the same values.

    :param step: from column to column, degrees or the angular unit of the CRS.
    :param values: (h, w, ...), the samples.
    """
    width = values.shape[1]
    if crs is None or not crs.is_geographic or width < 4:
        return 0
    turn = 2 * np.pi / (abs(step) * crs.units_factor[1])
    if abs(turn - width) < 1e-3 * max(1.0, 0.01 * width):
        return width
    again = abs(turn - (width - 1)) < 1e-3 * max(1.0, 0.01 * width)
    return width - 1 if again and np.array_equal(values[:, 0], values[:, -1], equal_nan=True) else 0


def said_of_turn(period: int, together: bool = True) -> tuple[str, ...]:
    """A note on rows that end where they begin.

    :param together: whether their ends are smoothed together.
    """
    if not period:
        return ()
    if together:
        return (Fact("the two ends of each row meet, and are smoothed together"),)
    return ("the two ends of each row meet; by windows they are smoothed apart from each other",)


def is_cylindrical(crs: "CRS") -> bool:
    """Whether a map stretches lengths with latitude: Mercator (not the transverse ones), and the other plain cylinders."""
    if not crs.is_projected:
        return False
    found = re.search(r'PROJECTION\["([^"]+)"', crs.to_wkt(version="WKT1_GDAL"))
    return found is not None and found.group(1).lower() in _CYLINDRICAL


def on_ground(crs: "CRS", x: float, y: Array, dx: float, dy: float) -> tuple[Spacing, tuple[str, ...]]:
    """(dx, dy) on the ground of a grid on a cylindrical map, in the unit of its CRS, and a note.

    The lengths of small steps along x and y at the middle of each row, on the ellipsoid: dx by row, dy that of the middle
    row, since a spacing has one.

    :param x: of the middle of the rows; y (h,), of their centres.
    """
    from rasterio.warp import transform

    radius, flattening = _ellipsoid(crs)
    base = _geographic(crs)
    h = len(y)
    steps = np.array([[-0.5 * dx, 0.5 * dx, 0, 0], [0, 0, -0.5 * dy, 0.5 * dy]])
    lon, lat = transform(
        crs, base, (x + np.tile(steps[0], h)).tolist(), (np.repeat(y, 4) + np.tile(steps[1], h)).tolist()
    )[:2]
    unit = np.pi / 180 if base.units_factor[1] == 0 else base.units_factor[1]
    lon, lat = (np.reshape(part, (h, 4)) * unit for part in (lon, lat))
    e2 = flattening * (2 - flattening)
    root = 1 - e2 * np.sin(lat.mean(axis=1)) ** 2
    across = radius / np.sqrt(root) * np.cos(lat[:, :2].mean(axis=1)) * np.abs(lon[:, 1] - lon[:, 0])
    along = radius * (1 - e2) / root**1.5 * np.abs(lat[:, 3] - lat[:, 2])
    across, along = across / linear_unit(crs)[1], along / linear_unit(crs)[1]
    if not (np.isfinite(across).all() and np.isfinite(along).all() and across.min() > 0 and along.min() > 0):
        return (dx, dy), (f"{_TOLD} were not corrected: it reaches beyond the map",)
    low, high = across.min() / dx, across.max() / dx
    note = f"{_TOLD} became those on the ground, {low:.4g} to {high:.4g} of them, depending on the row"
    if along.max() <= 1.1 * along.min():
        return (across, float(along[h // 2])), (Fact(note),)
    note += (
        f"; between rows the {along[h // 2] / dy:.4g} of the middle row counts for all: gdalwarp -t_srs to a local map"
    )
    return (across, float(along[h // 2])), (note,)


def _geographic(crs: "CRS") -> "CRS":
    """The geographic CRS that a projected one is made of."""
    from rasterio.crs import CRS

    wkt = crs.to_wkt(version="WKT1_GDAL")
    start = wkt.index("GEOGCS[")
    depth = 0
    for at in range(start, len(wkt)):
        depth += (wkt[at] == "[") - (wkt[at] == "]")
        if depth == 0 and wkt[at] == "]":
            return CRS.from_wkt(wkt[start : at + 1])
    raise InputError(f"a CRS with a geographic one inside expected, got {wkt[:80]}...; give spacing=(dx, dy)")


def on_ellipsoid(crs: "CRS", latitudes: Array, dlon: float, dlat: float) -> tuple[Spacing, tuple[str, ...]]:
    """(dx, dy) in metres of a grid in degrees (or the angular unit of the CRS), and a note.

    dx_i = N(phi_i) cos(phi_i) dlon, one per row, with N = a / sqrt(1 - e^2 sin^2 phi) the radius of curvature in the prime
    vertical; dy = M dlat, one number, with M = a (1 - e^2) / (1 - e^2 sin^2 phi)^(3/2) of the meridian at the mean latitude
    (on the Earth it changes by 1 % from equator to pole). a and e are those of the ellipsoid of the CRS, on any planet.

    :param latitudes: (h,), of the centres of the rows, in any order.
    :raises InputError: for a row beyond a pole.
    """
    radius, flattening = _ellipsoid(crs)
    phi = latitudes * crs.units_factor[1]
    beyond = np.abs(phi) - np.pi / 2
    if beyond.max() > 1e-6 * abs(dlat * crs.units_factor[1]):
        worst = latitudes[np.abs(phi).argmax()]
        raise InputError(
            f"latitudes of pixel centres from pole to pole expected, got {worst:g}; crop that row "
            "(gdal_translate -srcwin), or reproject (gdalwarp -t_srs)"
        )
    # On a pole all samples of a row are one point: it is taken as wide as the circle a quarter of a row away.
    at_pole = beyond > -1e-3 * abs(dlat * crs.units_factor[1])
    phi = np.where(at_pole, np.sign(phi) * (np.pi / 2 - 0.25 * abs(dlat * crs.units_factor[1])), phi)
    e2 = flattening * (2 - flattening)
    widths = radius / np.sqrt(1 - e2 * np.sin(phi) ** 2) * np.cos(phi) * dlon * crs.units_factor[1]
    middle = 1 - e2 * np.sin(phi.mean()) ** 2
    dy = float(radius * (1 - e2) / middle**1.5 * dlat * crs.units_factor[1])
    note = (
        f"degrees became metres on an ellipsoid of {radius:.0f} m: dx {widths.min():.4g} to {widths.max():.4g} m by row, "
        f"dy {dy:.4g} m"
    )
    if at_pole.any():
        note += "; on a pole, where the samples of a row are one point, a quarter of a row away from it"
    return (widths, dy), (Fact(note),)


def height_unit(crs: "CRS | None", declared: str | None) -> str:
    """The name of the unit of heights: declared by the band, else by a vertical CRS, else ``""``."""
    if declared or crs is None:
        return declared or ""
    vertical = re.search(r'VERTCRS\[.*?LENGTHUNIT\["([^"]+)"', crs.to_wkt(version="WKT2_2019"), re.DOTALL)
    return vertical.group(1) if vertical else ""


def units_disagree(crs: "CRS | None", unit: str) -> tuple[str, ...]:
    """A note where heights and grid have different units, so that slopes are wrong by their ratio."""
    if crs is None:
        return ()
    name, across = linear_unit(crs)
    up = _METRES.get(unit.lower().removesuffix("s"))
    if not name or up is None or abs(up / across - 1) < 1e-3:
        return ()
    return (
        Fact(
            f"heights in {unit} above a grid in {name}: nothing is to be set for smoothing, the contrast is found from the "
            "noise; but areas and slopes that are reported, and a mesh made of it (convert), mix the two units"
        ),
    )


def linear_unit(crs: "CRS") -> tuple[str, float]:
    """The name of the horizontal unit and its length in metres.

    It is the metre where the grid is in degrees, whose spacing is in metres; ``("", 1.0)`` where the CRS defines none.
    """
    if crs.is_geographic:
        return "metre", 1.0
    return crs.linear_units_factor if crs.is_projected else ("", 1.0)


def _ellipsoid(crs: "CRS") -> tuple[float, float]:
    """Semi-major axis in metres, and flattening (0 for a sphere)."""
    wkt = crs.to_wkt(version="WKT2_2019")
    found = re.search(r'ELLIPSOID\["[^"]*",\s*([\d.eE+-]+),\s*([\d.eE+-]+)', wkt)
    if found is None:
        raise InputError(f"a CRS with an ellipsoid expected, got {wkt[:80]}...; give spacing=(dx, dy) in metres")
    radius, inverse = map(float, found.groups())
    return radius, 1 / inverse if inverse else 0.0
