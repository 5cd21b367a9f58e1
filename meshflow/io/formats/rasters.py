"""Georeferenced rasters: reads whatever GDAL opens, writes GeoTIFF, ESRI ASCII, and what other drivers of GDAL store."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rasterio.enums import ColorInterp

from meshflow.errors import Fact, FormatError, InputError
from meshflow.geometry.validation import Array, Spacing, spacing_of
from meshflow.io.document import Document, WriteOptions, samples_of
from meshflow.io.formats.raster_bands import load, merged, save
from meshflow.io.formats.raster_encoding import DRIVERS, Encoding, driver_of, encoding_for, must_work
from meshflow.io.formats.raster_frame import Frame, Framed
from meshflow.io.formats.raster_place import PLACING, Place
from meshflow.io.metadata import ReadOptions
from meshflow.io.rounding import DTYPES, mark, rounded
from meshflow.io.spacing import between_samples, columns_of_a_turn, height_unit, said_of_turn, units_disagree
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image

__all__ = [
    "Raster", "can_write", "lossy", "marking", "must_suit", "notes_on", "read", "spacing_in", "type_for", "unlike_bands", "write",
]  # fmt: skip

NAME: str = "a raster"
READS: tuple[str, ...] = ("kind", "band", "nodata", "spacing", *PLACING, "allow_remote")
WRITES: tuple[str, ...] = ("dtype", "driver", "creation")

# Bands whose samples spread over ranges that differ by more are quantities of their own; samples that tell it.
_UNLIKE, _ENOUGH = 10.0, 100_000
_COLOURS = (ColorInterp.red, ColorInterp.green, ColorInterp.blue, ColorInterp.cyan, ColorInterp.palette)
# Degrees between samples below which a grid without a CRS is in another unit: a tenth of a metre of the Earth.
_FINEST = 1e-6


@dataclass(frozen=True, eq=False)
class Raster(Framed):
    """A raster that was read.

    :param unlike: the names of its bands, where they are quantities of their own, to be smoothed one by one; else empty.
    """

    unlike: tuple[str, ...] = ()

    @property
    def bands(self) -> tuple[str, ...]:
        """The names of its bands, where each is smoothed by itself."""
        return self.unlike


def read(path: Path, options: ReadOptions) -> Document:
    """Read a raster: one band is a terrain, several are an image.

    Scale and offset are applied. The horizontal unit is that of the CRS, metres where the CRS is in degrees, and pixels without
    georeference. Samples are missing where nodata, an internal mask or an alpha of 0 says so, and where they are NaN.

    :param options: ``kind``, ``terrain`` or ``image``, where the number of bands would mislead; ``band``, the one to read, from
        1; ``nodata``, in place of the value that the file declares; ``spacing``, in place of what the file says;
        ``window`` or ``bounds``, the part to read; ``crs`` and ``unit``, in place of what the file says; ``allow_remote``, so
        that a VRT may name what it likes.
    :raises FormatError: when GDAL cannot read the file.
    :raises InputError: for a band that is not there, several bands as one terrain, or a grid that is sheared.
    """
    kind, band = options.kind, options.band
    if kind not in (None, "terrain", "image"):
        raise InputError(f"{path.name}: a raster is a terrain or an image, got kind={kind!r}")
    bands = None if band is None else [band]
    where = Place.of(options)
    values, frame = load(
        path, bands=bands, nodata=options.nodata, remote=options.allow_remote, search=True, where=where
    )
    if kind == "terrain" and len(values) > 1:
        raise InputError(f"{path.name}: one band expected for a terrain, got {len(values)}; choose one: band=1")
    notes: tuple[str, ...] = ()
    unit = height_unit(frame.crs, frame.units[0])
    if options.spacing is None:
        spacing, notes = spacing_in(frame, unit, values.shape[1:])
    else:
        spacing = spacing_of(options.spacing, values.shape[1])
    period = period_of(frame, np.moveaxis(values, 0, 2))
    notes += said_of_turn(period) + notes_on(frame)
    missing: Array = np.any(frame.gone, axis=0)
    if len(values) == 1 and kind != "image":
        return Document(HeightField(values[0], spacing, missing, unit=unit, period=period), path, Raster(frame), notes)
    channels = values[0] if len(values) == 1 else np.moveaxis(values, 0, 2)
    unlike = unlike_bands(values, frame) if kind is None else ()
    if unlike:
        notes += (
            f"{len(unlike)} bands of different size or unit ({', '.join(unlike[:6])}): each is smoothed separately, with its "
            "own noise (kind='image' smooths them together)",
        )
    return Document(Image(channels, spacing, missing, period=period), path, Raster(frame, unlike), notes)


def can_write(document: Document, suffix: str) -> bool:
    """Whether it is a terrain or an image, and the extension one of a raster."""
    return isinstance(document.data, (HeightField, Image)) and suffix in DRIVERS


def must_fit(document: Document, path: Path, options: WriteOptions) -> None:
    """Refuse a number type that no raster holds, what ``.asc`` has no room for, and what GDAL does not store.

    :raises FormatError: for what does not fit.
    :raises InputError: for an unknown number type.
    """
    values, frame = merged(document.source, samples_of(document))
    kind, driver = type_for(options.dtype, frame, values.dtype), driver_of(path, options.driver)
    if driver == "AAIGrid":
        _fit_into_ascii(path, frame)
    must_suit(path, options, (frame, kind, len(values) + (frame.alpha is not None), values.shape[1:]))


def write(document: Document, path: Path, options: WriteOptions) -> tuple[str, ...]:
    """Write a terrain or an image as GeoTIFF, a terrain as ``.asc``, or either by another driver of GDAL.

    Grid, CRS, tags, units, descriptions, colours and missing samples are kept; samples are float32 or float64, so that nothing is
    quantized.

    :param options: tags are kept; ``dtype``: another type, or ``source`` for that of the file; integers are rounded and clipped,
        which is noted; ``driver`` and ``creation`` of GDAL.
    :returns: notes on rounding, on loss, and on what the format does not hold.
    :raises FormatError: when the file cannot be written or the format cannot hold the data.
    """
    values, frame = merged(document.source, samples_of(document))
    dtype = options.dtype
    kind = type_for(dtype, frame, values.dtype)
    notes: tuple[str, ...] = ()
    if frame.scaled and not (dtype == "source" and kind.kind in "iu"):
        frame = frame.without_scale()
        notes += ("scale and offset of the source were applied: the values are stored as they are",)
    driver = driver_of(path, options.driver)
    if driver == "AAIGrid":
        frame, note = _fit_into_ascii(path, frame)
        notes += note
    samples, clipped = rounded(frame.stored(values), frame.gone, kind)
    if kind.kind in "iu":
        step = frame.scales[0] if frame.scaled else 1
        notes += (
            f"rounded to {kind}: the result is quantised again, in steps of {step:g}; float32 keeps the smoothed values",
        )
    nodata = mark(samples, replace(frame, nodata=marking(frame.nodata, driver)), kind)
    if nodata is not None and frame.gone.any():
        samples = samples.copy() if np.shares_memory(samples, values) else samples
        samples[frame.gone] = nodata
    if nodata is not None and not _alike(nodata, frame.nodata):
        notes += (f"missing samples are marked by nodata {nodata:g}",)
    h, w = samples.shape[1:]
    encoding = encoding_for(driver, options.creation, nodata, samples.dtype, (h, w))
    save(samples, frame, path, encoding, options.tags)
    return notes + clipped + lossy(encoding)


def _alike(one: float, other: float | None) -> bool:
    """Whether two marks of missing samples are equal, with NaN equal to NaN."""
    return other is not None and bool(one == other or (np.isnan(one) and np.isnan(other)))


def spacing_in(frame: Frame, unit: str, shape: tuple[int, ...]) -> tuple[Spacing, tuple[str, ...]]:
    """(dx, dy) of a raster, and notes.

    :param unit: of the heights; ``shape``: (h, w).
    """
    if not frame.georeferenced:
        why = "ground control points only" if frame.gcps[0] else "no georeference"
        return (1.0, 1.0), (
            f"{why}: the spacing is 1, a pixel; give spacing=(dx, dy) in the unit of the heights, or kind='image'",
        )
    spacing, notes = between_samples(frame.crs, frame.transform, (shape[0], shape[1]))
    west, north = frame.transform.c, frame.transform.f
    if frame.crs is None and _FINEST < spacing[1] < 0.05 and abs(west) <= 360 and abs(north) <= 90:
        notes += (
            f"no CRS, and a grid that looks like degrees: the spacing of {spacing[1]:.4g} was taken as it is; "
            "give spacing=(dx, dy) in metres, or set the CRS (gdal_edit -a_srs EPSG:4326)",
        )
    return spacing, notes + units_disagree(frame.crs, unit)


def period_of(frame: Frame, values: Array) -> int:
    """The number of columns after which rows repeat; 0: they have two ends.

    :param values: (h, w, k), the samples.
    """
    _, b, _, d, _, _ = tuple(frame.transform)[:6]
    return 0 if b or d or not frame.georeferenced else columns_of_a_turn(frame.crs, frame.transform.a, values)


def notes_on(frame: Frame) -> tuple[str, ...]:
    """Notes on the samples of a raster."""
    notes = frame.notes
    if frame.scaled:
        notes += (Fact(f"scale {frame.scales[0]:g} and offset {frame.offsets[0]:g} of the file were applied"),)
    if frame.palette is not None:
        notes += ("the numbers of a colour table were taken as values, the table is not kept",)
    return notes


def unlike_bands(values: Array, frame: Frame) -> tuple[str, ...]:
    """The names of bands that are quantities of their own: of other units, or of ranges that differ tenfold; else none."""
    if len(values) < 2 or any(colour in _COLOURS for colour in frame.colours):
        return ()
    there = ~np.any(frame.gone, axis=0)
    if not there.any():
        return ()
    units = {unit for unit in frame.units if unit}
    ends = [np.percentile(band[there][:: max(1, int(there.sum()) // _ENOUGH)], (10, 90)) for band in values]
    spreads = [float(high - low) for low, high in ends if high > low]
    if len(units) < 2 and (len(spreads) < 2 or max(spreads) <= _UNLIKE * min(spreads)):
        return ()
    return tuple(name or f"band {i}" for i, name in enumerate(frame.descriptions, start=1))


def type_for(name: str | None, frame: Frame, dtype: np.dtype) -> np.dtype:
    """The number type in which samples are written.

    :param name: of the type, ``source``, or None for ``dtype``, the one of the values.
    :raises InputError: for one that no raster holds.
    """
    name = str(dtype) if name is None else frame.dtype if name == "source" else name
    if name not in DTYPES:
        raise InputError(f"dtype: source or one of {', '.join(DTYPES)} expected, got {name!r}")
    return np.dtype(name)


def _fit_into_ascii(path: Path, frame: Frame) -> tuple[Frame, tuple[str, ...]]:
    a, b, _, d, e, _ = tuple(frame.transform)[:6]
    if len(frame.gone) > 1 or frame.alpha is not None:
        raise FormatError(
            f"{path.name}: one band fits into .asc, got {len(frame.gone) + (frame.alpha is not None)}; write .tif"
        )
    if frame.georeferenced and (b or d or a < 0 or e > 0):
        raise FormatError(
            f"{path.name}: .asc holds rows from north to south and columns from west to east, got the transform "
            f"{(a, b, d, e)}; write .tif"
        )
    lost = frame.crs is not None or bool(frame.gcps[0])
    return frame.bare(), (".asc has no room for the CRS and the tags; .tif has",) if lost else ()


def must_suit(path: Path, options: WriteOptions, stored: tuple[Frame, np.dtype, int, tuple[int, ...]]) -> None:
    """Refuse a driver, and creation options, that GDAL does not take, before the work.

    A GeoTIFF or an ASCII grid without creation options is not tried.

    :param stored: frame, type and number of bands of what is stored, and its (h, w).
    :raises FormatError: with what GDAL says.
    """
    frame, kind, count, (h, w) = stored
    driver = driver_of(path, options.driver)
    if options.creation or driver not in ("GTiff", "AAIGrid"):
        encoding = encoding_for(driver, options.creation, marking(frame.nodata, driver), kind, (h, w))
        must_work(path, encoding, frame, count, kind)


def marking(nodata: float | None, driver: str) -> float | None:
    """The declared value of missing samples, where a driver stores it: a GeoPackage has no NaN."""
    return None if nodata is not None and np.isnan(nodata) and driver == "GPKG" else nodata


def lossy(encoding: Encoding) -> tuple[str, ...]:
    """A note where what is stored differs from the result, as the caller wanted it."""
    if not encoding.loses:
        return ()
    words = ", ".join(f"{name}={value}" for name, value in encoding.creation.items())
    return (f"{encoding.driver} ({words}) loses a part of the result: what is read differs from it",)
