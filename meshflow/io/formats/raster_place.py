"""The part of a raster that is read, and what the caller says of its georeference in place of the file."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from rasterio.control import GroundControlPoint
from rasterio.crs import CRS
from rasterio.errors import CRSError
from rasterio.io import DatasetReader
from rasterio.rpc import RPC
from rasterio.transform import Affine
from rasterio.windows import Window

from meshflow.errors import InputError
from meshflow.io.formats.raster_frame import Frame
from meshflow.io.metadata import ReadOptions

__all__ = ["PLACING", "WHOLE", "Part", "Place", "as_window", "shape_of"]

# Rows and columns.
Part = tuple[slice, slice]
# The options of readers that are meant here.
PLACING: tuple[str, ...] = ("window", "bounds", "crs", "unit")


@dataclass(frozen=True)
class Place:
    """What the caller says of the place of a raster.

    :ivar window: (column, row, width, height), samples; ``bounds``: (left, bottom, right, top), in the CRS. None: the whole.
    :ivar crs: instead of that of the file.
    :ivar unit: of the heights, instead of that of the file.
    """

    window: tuple[int, int, int, int] | None = None
    bounds: tuple[float, float, float, float] | None = None
    crs: CRS | None = None
    unit: str | None = None

    @classmethod
    def of(cls, options: ReadOptions) -> "Place":
        """What options of a reader say.

        :raises InputError: for two parts at once, and a CRS that nobody knows.
        """
        if options.window is not None and options.bounds is not None:
            raise InputError("window, bounds: they name the same part in two ways; leave one of them out")
        window = None if options.window is None else _four(options.window, "window", "column, row, width, height")
        bounds = None if options.bounds is None else _four(options.bounds, "bounds", "left, bottom, right, top")
        return cls(
            window=None if window is None else _whole(window),
            bounds=bounds,
            crs=None if options.crs is None else _crs(options.crs),
            unit=options.unit,
        )

    def part(self, source: DatasetReader) -> Part:
        """The rows and columns of a raster that are meant.

        :raises InputError: where they are not in it.
        """
        h, w = source.height, source.width
        if self.window is not None:
            column, row, width, height = self.window
            if column < 0 or row < 0 or width < 1 or height < 1 or column + width > w or row + height > h:
                raise InputError(
                    f"window: column, row, width, height inside {w} x {h} samples expected, got {self.window}"
                )
            return slice(row, row + height), slice(column, column + width)
        return (slice(0, h), slice(0, w)) if self.bounds is None else _inside(source, self.bounds)

    def placed(self, frame: Frame, part: Part) -> Frame:
        """The frame of a part of a raster, with what the caller says."""
        top, left = part[0].start, part[1].start
        if top or left:
            points, crs = frame.gcps
            frame = replace(
                frame,
                transform=frame.transform * Affine.translation(left, top) if frame.georeferenced else frame.transform,
                gcps=([_moved(point, top, left) for point in points], crs),
                rpcs=None if frame.rpcs is None else _shifted(frame.rpcs, top, left),
            )
        if self.crs is not None:
            frame = replace(frame, crs=self.crs, gcps=(frame.gcps[0], self.crs))
        return frame if self.unit is None else replace(frame, units=(self.unit,) * len(frame.units))


WHOLE = Place()


def as_window(part: Part) -> Window:
    """A part as rasterio has it."""
    rows, columns = part
    return Window(columns.start, rows.start, columns.stop - columns.start, rows.stop - rows.start)  # type: ignore[call-arg]


def shape_of(part: Part) -> tuple[int, int]:
    """(h, w)."""
    rows, columns = part
    return rows.stop - rows.start, columns.stop - columns.start


def _inside(source: DatasetReader, bounds: tuple[float, float, float, float]) -> Part:
    """The samples whose centres lie inside bounds."""
    left, bottom, right, top = bounds
    place = source.transform
    if place.is_identity:
        raise InputError("bounds: the file has no georeference; give window=(column, row, width, height)")
    if place.b or place.d:
        raise InputError(
            "bounds: a grid along the axes of its CRS expected, got a turned one; give window=(column, row, width, height)"
        )
    if not (left < right and bottom < top):
        raise InputError(f"bounds: left below right and bottom below top expected, got {bounds}")
    corners = np.array([~place * corner for corner in ((left, top), (right, bottom))])
    ends = np.sort(corners, axis=0)
    size = np.array([source.width, source.height])
    first, last = (np.clip(np.ceil(end - 0.5 - 1e-6), 0, size).astype(int) for end in ends)
    if (last <= first).any():
        west, south, east, north = source.bounds
        raise InputError(f"bounds: a part of {west:g} {south:g} {east:g} {north:g} expected, got {bounds}")
    return slice(int(first[1]), int(last[1])), slice(int(first[0]), int(last[0]))


def _four(given: Sequence[float], word: str, meant: str) -> tuple[float, float, float, float]:
    try:
        a, b, c, d = (float(number) for number in given)
    except (TypeError, ValueError) as cause:
        raise InputError(f"{word}: four numbers, {meant}, expected, got {given!r}") from cause
    if not np.isfinite([a, b, c, d]).all():
        raise InputError(f"{word}: four finite numbers, {meant}, expected, got {given!r}")
    return a, b, c, d


def _whole(window: tuple[float, float, float, float]) -> tuple[int, int, int, int]:
    if any(number != int(number) for number in window):
        raise InputError(f"window: whole numbers of samples expected, got {window}")
    column, row, width, height = map(int, window)
    return column, row, width, height


def _crs(word: str) -> CRS:
    try:
        return CRS.from_user_input(word)
    except CRSError as cause:
        raise InputError(
            f"crs: an EPSG code such as EPSG:25832, a PROJ string or WKT expected, got {word[:80]!r}"
        ) from cause


def _moved(point: GroundControlPoint, top: int, left: int) -> GroundControlPoint:
    row, col = (point.row or 0.0) - top, (point.col or 0.0) - left
    return GroundControlPoint(row, col, point.x, point.y, point.z, point.id, point.info)


def _shifted(rpcs: RPC, top: int, left: int) -> RPC:
    words = rpcs.to_dict()
    return RPC(**{**words, "line_off": (rpcs.line_off or 0.0) - top, "samp_off": (rpcs.samp_off or 0.0) - left})
