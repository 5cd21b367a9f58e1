"""Rasters that are read and written by windows, so that they need not fit in memory."""

import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import rasterio
from rasterio._err import CPLE_BaseError  # errors of GDAL for which rasterio has no public name
from rasterio.enums import ColorInterp, Resampling
from rasterio.errors import CRSError, RasterioError
from rasterio.io import DatasetReader, DatasetWriter
from rasterio.windows import Window

from meshflow.errors import FormatError
from meshflow.geometry.validation import Array, real
from meshflow.io.atomic_write import beside, must_have_room
from meshflow.io.formats.raster_bands import (
    frame_of,
    gone_in,
    must_have_bands,
    quiet,
    unreadable,
)
from meshflow.io.formats.raster_drivers import allowed_drivers
from meshflow.io.formats.raster_encoding import TILE, Encoding, copied_to, encoding_for, reason_of
from meshflow.io.formats.raster_frame import Frame, alpha_as, describe, place
from meshflow.io.formats.raster_place import Part, Place, as_window, shape_of
from meshflow.io.incoming import plainly_named
from meshflow.io.metadata import ReadOptions

__all__ = ["Layout", "RasterReader", "RasterWriter", "raster_read", "raster_written", "tags_of_run"]

# Bytes of decoded blocks that GDAL keeps.
CACHE = 64 << 20
# The share of what is written next that a disk must have room for: blocks that are still being compressed count, too. And bytes
# below which it is full.
AHEAD, FULL = 2, 1 << 20
# What the names of the tags of a run begin with in a file of a driver that copies a GeoTIFF.
COPIED = "meshflow_"


@dataclass(frozen=True)
class Layout:
    """The bands of a raster, and its size.

    :ivar count: the number of bands, an alpha band left out.
    :ivar shape: (h, w).
    :ivar alpha: whether there is one.
    """

    count: int
    shape: tuple[int, int]
    alpha: bool = False


@dataclass(frozen=True, eq=False)
class RasterReader:
    """A raster that is read by windows.

    :ivar path: of the file.
    :ivar source: of GDAL.
    :ivar frame: the content besides the samples; it has no mask of those that are missing.
    :ivar part: of the file that is read; windows are relative to it.
    :ivar chosen: the numbers of its bands, from 1.
    :ivar alpha: the number of its alpha band; None: it has none.
    :ivar nodata: instead of the declared value.
    :ivar marks: further stored values that mark missing samples.
    """

    path: Path
    source: DatasetReader
    frame: Frame
    part: Part
    chosen: tuple[int, ...]
    alpha: int | None = None
    nodata: float | None = None
    marks: tuple[float, ...] = ()

    @property
    def shape(self) -> tuple[int, int]:
        """(h, w)."""
        return shape_of(self.part)

    @property
    def layout(self) -> Layout:
        """Its bands and its size."""
        return Layout(len(self.chosen), self.shape, self.alpha is not None)

    @property
    def dtype(self) -> np.dtype:
        """float32 or float64, of the values."""
        return real(np.zeros(1, self.frame.dtype), self.path.name).dtype

    @property
    def block(self) -> tuple[int, int]:
        """Rows and columns of the blocks in which the file is stored."""
        high, wide = self.source.block_shapes[self.chosen[0] - 1]
        return high, wide

    def stored(self, part: Part) -> tuple[Array, Array]:
        """Samples (k, r, c) of a window as they are stored, and those that are missing.

        :raises FormatError: where the file cannot be read.
        """
        window, chosen = self._window(part), list(self.chosen)
        try:
            raw = self.source.read(chosen, window=window, out_dtype=self.frame.dtype)
            gone = gone_in(self.source, raw, chosen, self.nodata, window)
            if self.alpha is not None:
                gone |= self.source.read(self.alpha, window=window) == 0
        except (RasterioError, CPLE_BaseError) as cause:
            raise unreadable(self.path, cause) from cause
        for mark in self.marks:
            gone |= raw == mark
        if raw.dtype.kind == "f":
            gone |= ~np.isfinite(raw)
        return raw, gone

    def values(self, part: Part) -> tuple[Array, Array]:
        """Values (k, r, c) of a window with scale and offset, and those that are missing."""
        raw, gone = self.stored(part)
        values = real(raw, self.path.name)
        if self.frame.scaled:
            scale, offset = (np.reshape(factor, (-1, 1, 1)) for factor in (self.frame.scales, self.frame.offsets))
            values = np.where(gone, values, values * scale + offset).astype(values.dtype)
            gone |= ~np.isfinite(values)
        return values, gone

    def alpha_of(self, part: Part) -> Array | None:
        """The alpha band (r, c) of a window as it is stored; None where there is none."""
        return None if self.alpha is None else self.source.read(self.alpha, window=self._window(part))

    def _window(self, part: Part) -> Window:
        """A window of the part that is read, in the file."""
        rows, columns = (
            slice(one.start + origin.start, one.stop + origin.start)
            for one, origin in zip(part, self.part, strict=True)
        )
        return as_window((rows, columns))


@dataclass(frozen=True, eq=False)
class RasterWriter:
    """A raster that is written by windows.

    :ivar target: of GDAL.
    :ivar sums: checksums of the windows that were written, by their place.
    """

    target: DatasetWriter
    sums: dict[tuple[int, int, int, int], int]

    def write(self, part: Part, samples: Array, alpha: Array | None) -> None:
        """Write a window, by whole rows of blocks; each sample once.

        GDAL does not say that a disk is full, and goes on: the room is looked at before.

        :param samples: (k, r, c), in the type of the file; ``alpha``: (r, c), its alpha band.
        :raises OSError: where there is no room left.
        """
        if alpha is not None:
            samples = np.concatenate([samples, alpha_as(alpha, samples.dtype)[None]])
        samples = np.ascontiguousarray(samples)
        rows, columns = part
        high, folder = self.target.block_shapes[0][0], Path(self.target.name).parent
        high *= max(1, TILE // high)
        try:
            for top in range(0, rows.stop - rows.start, high):
                some = samples[:, top : top + high]
                must_have_room(folder, AHEAD * some.nbytes)
                begin = rows.start + top
                self.target.write(some, window=as_window((slice(begin, begin + some.shape[1]), columns)))
        except (RasterioError, CPLE_BaseError) as cause:
            raise OSError(reason_of(cause)) from cause
        self.sums[rows.start, rows.stop, columns.start, columns.stop] = zlib.crc32(samples.data)


@contextmanager
def raster_read(path: Path, options: ReadOptions) -> Iterator[RasterReader]:
    """Open a raster that is read by windows.

    :param options: as of :func:`.rasters.read`.
    :raises FormatError: when GDAL cannot open it, or its format is not read by parts.
    :raises InputError: for a band that is not there, and a part that is not in it.
    """
    where = Place.of(options)
    if path.suffix.lower() in (".asc", ".zip"):
        raise FormatError(f"{path.name}: {path.suffix} is not read by windows; gdal_translate it to .tif")
    with quiet(), rasterio.Env(GDAL_CACHEMAX=CACHE), plainly_named(path) as named:
        try:
            source = DatasetReader(str(named), driver=allowed_drivers(named, options.allow_remote))
        except (RasterioError, CRSError, CPLE_BaseError, OSError) as cause:
            raise unreadable(path, cause) from cause
        with source:
            colours = source.colorinterp
            every = [i for i in source.indexes if colours[i - 1] != ColorInterp.alpha]
            chosen = every if options.band is None else [options.band]
            must_have_bands(path, source, chosen)
            dtype = str(np.result_type(*source.dtypes))
            part = where.part(source)
            frame = where.placed(frame_of(source, dtype, chosen, options.nodata), part)
            last = source.count
            alpha = last if colours[-1] == ColorInterp.alpha and last not in chosen else None
            yield RasterReader(path, source, frame, part, tuple(chosen), alpha, options.nodata)


def tags_of_run(path: Path) -> dict[str, str]:
    """What a raster says of the run of meshflow that wrote it; empty where it is none of meshflow."""
    with quiet(), plainly_named(path) as named:
        try:
            with DatasetReader(str(named), driver=allowed_drivers(named, False)) as source:
                plain, own = source.tags(), source.tags(ns="meshflow")
        except (RasterioError, CRSError, CPLE_BaseError, OSError):
            return {}
    return {name.removeprefix(COPIED): word for name, word in plain.items() if name.startswith(COPIED)} | own


@contextmanager
def raster_written(
    path: Path, layout: Layout, frame: Frame, dtype: np.dtype, encoding: Encoding, tags: Mapping[str, str]
) -> Iterator[RasterWriter]:
    """Write a raster by windows; at the end it is read back, and then replaces an old one.

    No window need be run where there is no room for the first ones. They are written to a GeoTIFF; where the driver is another
    one, that is a temporary file beside the raster.

    :param frame: what is written around the samples.
    :param dtype: of the samples.
    :param tags: words on top of the frame's.
    :raises FormatError: when the file could not be written whole; an old one is then as it was.
    """
    count, (height, width) = layout.count, layout.shape
    shape = {"count": count + layout.alpha, "height": height, "width": width}
    first, copied = encoding, encoding.copied
    if copied:
        first = encoding_for("GTiff", {"ZLEVEL": "1"}, encoding.nodata, dtype, layout.shape)
        tags = {name.replace(":", "_"): word for name, word in tags.items()}
    with beside(path, several=copied) as temporary:
        written = temporary.with_name(f"{temporary.name}.part.tif") if copied else temporary
        sums: dict[tuple[int, int, int, int], int] = {}
        must_have_room(temporary.parent, AHEAD * shape["count"] * min(TILE, height) * width * dtype.itemsize)
        try:
            with rasterio.open(
                written, "w", driver=first.driver, dtype=dtype, nodata=first.nodata, **shape, **place(frame),
                **first.creation,
            ) as target:  # fmt: skip
                described = replace(frame, alpha=None)
                describe(target, described, count, tags)
                yield RasterWriter(target, sums)
            if copied:
                copied_to(written, temporary, encoding.named(path))
                written.unlink()
            _verify(temporary, {} if encoding.loses else sums)
            if frame.overviews and not copied:
                with rasterio.open(temporary, "r+") as target:
                    target.build_overviews(list(frame.overviews), Resampling.average)
        except (RasterioError, CPLE_BaseError) as cause:
            # A driver that copies removes what it has begun: there is room again.
            must_have_room(temporary.parent, AHEAD * written.stat().st_size if copied and written.exists() else FULL)
            raise OSError(reason_of(cause)) from cause


def _verify(path: Path, sums: Mapping[tuple[int, int, int, int], int]) -> None:
    """Read a file back, window by window.

    :raises OSError: where it does not hold what was written.
    """
    with rasterio.open(path) as written:
        for (top, bottom, left, right), checksum in sums.items():
            found = written.read(window=as_window((slice(top, bottom), slice(left, right))))
            if zlib.crc32(np.ascontiguousarray(found).data) != checksum:
                raise OSError("what was read back differs from what was written")
