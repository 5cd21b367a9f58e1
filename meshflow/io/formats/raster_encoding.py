"""How GDAL stores samples: the driver of an extension, its creation options, and a trial of them before the work."""

import logging
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import rasterio
import rasterio.shutil
from rasterio._err import CPLE_BaseError  # errors of GDAL for which rasterio has no public name
from rasterio.errors import DriverRegistrationError, RasterioError

from meshflow.errors import FormatError, InputError, said_by
from meshflow.io.formats.raster_frame import Frame, place

__all__ = ["DRIVERS", "TILE", "Encoding", "copied_to", "driver_of", "encoding_for", "must_work", "reason_of"]

# The drivers of GDAL by extension; others are named.
DRIVERS: Mapping[str, str] = {
    ".tif": "GTiff", ".tiff": "GTiff", ".asc": "AAIGrid", ".img": "HFA", ".nc": "netCDF", ".gpkg": "GPKG", ".bil": "EHdr",
}  # fmt: skip
# What holds no samples of its own, or is a folder.
_NO_FILE = ("VRT", "MEM", "Zarr")
# The side of the tiles of a GeoTIFF, and that of the samples that are tried.
TILE, TRIED = 256, 32
# Creation options that lose nothing and take less room, where the caller gives none.
_SMALL: Mapping[str, Mapping[str, str]] = {
    "COG": {"COMPRESS": "DEFLATE", "PREDICTOR": "STANDARD", "BIGTIFF": "IF_SAFER", "OVERVIEW_RESAMPLING": "AVERAGE"},
    "netCDF": {"FORMAT": "NC4", "COMPRESS": "DEFLATE"},
}
# Compressions of TIFF that have a predictor; those that lose samples, and the option without which they do not.
_PREDICTED = ("DEFLATE", "LZW", "ZSTD")
_LOSING = {"JPEG": "", "WEBP": "WEBP_LOSSLESS", "JXL": "JXL_LOSSLESS"}
# What does not suit a raster that is smaller than its blocks.
_BLOCKS = ("TILED", "BLOCKXSIZE", "BLOCKYSIZE")
# What rasterio says of a creation option that a driver does not have.
_STRANGE = "does not support creation option"
# And of a value that an option does not have.
_UNEXPECTED = re.compile("is an unexpected value for|not recognised, ignoring")


@dataclass(frozen=True)
class Encoding:
    """How GDAL stores samples.

    :param driver: of GDAL.
    :param nodata: the value that marks missing samples; None: there is none.
    :param creation: creation options of the driver.
    """

    driver: str
    nodata: float | None = None
    creation: Mapping[str, Any] = field(default_factory=dict)

    @property
    def copied(self) -> bool:
        """Whether the driver stores a finished raster only: a GeoTIFF is written first."""
        return self.driver not in ("GTiff", "AAIGrid", "PNG", "JPEG", "BMP", "WEBP")

    @property
    def loses(self) -> bool:
        """Whether what is read back may differ from what was written, since the caller wants it so."""
        options = {name.upper(): str(value).upper() for name, value in self.creation.items()}
        compress = options.get("COMPRESS", "")
        if compress in _LOSING:
            word = _LOSING[compress]
            return not word or options.get(word, "NO" if compress == "WEBP" else "YES") in ("NO", "FALSE", "OFF")
        if compress.startswith("LERC"):
            return float(options.get("MAX_Z_ERROR", "0")) > 0
        if self.driver == "JP2OpenJPEG":
            return options.get("REVERSIBLE") not in ("YES", "TRUE", "ON")
        return "DISCARD_LSB" in options or "NBITS" in options or options.get("TILE_FORMAT", "TIFF") != "TIFF"

    def named(self, path: Path) -> "Encoding":
        """The same for a path: what a GeoPackage calls its table."""
        if self.driver != "GPKG" or any(name.upper() == "RASTER_TABLE" for name in self.creation):
            return self
        return replace(self, creation={**self.creation, "RASTER_TABLE": path.stem})


def driver_of(path: Path, named: str | None) -> str:
    """The driver that writes a file: the one that is named, else that of the extension.

    :raises InputError: for a driver that does not exist, or writes no file of its own.
    """
    if named is None:
        return DRIVERS[path.suffix.lower()]
    with rasterio.Env() as env:
        known = {driver.lower(): driver for driver in env.drivers()}
    driver = known.get(named.lower())
    if driver is None or driver in _NO_FILE:
        raise InputError(
            f"driver: GTiff, COG, HFA, netCDF, GPKG or another driver of GDAL that writes files expected, got {named!r}"
        )
    return driver


def encoding_for(
    driver: str, creation: Mapping[str, str], nodata: float | None, dtype: np.dtype, shape: tuple[int, int]
) -> Encoding:
    """How h x w samples are stored: as the caller says, else compressed, in tiles where they are more than one.

    :param creation: creation options of the caller.
    :param dtype: of the samples.
    """
    given = {name.upper(): value for name, value in creation.items()}
    if driver == "GTiff":
        return Encoding(driver, nodata, {**_geotiff(shape, given), **given})
    if driver == "AAIGrid":
        # As many digits as tell each number of the type from the next.
        digits = {"SIGNIFICANT_DIGITS": 9 if dtype == np.float32 else 17} if dtype.kind == "f" else {}
        return Encoding(driver, nodata, {**digits, **given})
    return Encoding(driver, nodata, {**_SMALL.get(driver, {}), **given})


def _geotiff(shape: tuple[int, int], given: Mapping[str, str]) -> dict[str, str | int | bool]:
    options: dict[str, str | int | bool] = {"COMPRESS": "DEFLATE", "BIGTIFF": "IF_SAFER"}
    if str(given.get("COMPRESS", "DEFLATE")).upper() in _PREDICTED:
        options["PREDICTOR"] = 2  # not 3, a tenth smaller for floats: tifffile reads that only with another package
    if min(shape) >= TILE and str(given.get("TILED", "YES")).upper() in ("YES", "TRUE", "ON"):
        options |= {"TILED": True, "BLOCKXSIZE": TILE, "BLOCKYSIZE": TILE}
    return options


def must_work(path: Path, encoding: Encoding, frame: Frame, count: int, dtype: np.dtype) -> None:
    """Refuse a driver, or creation options, by writing a few samples with them, before the work.

    :param frame: of the raster; ``count``: of its bands.
    :param dtype: of its samples.
    :raises FormatError: with what GDAL says.
    """
    shape = (count, *(TRIED,) * 2)
    some = (np.arange(np.prod(shape)).reshape(shape) % 100).astype(dtype)
    with TemporaryDirectory(prefix="meshflow-") as folder, _complaints() as said:
        try:
            plain = Path(folder) / "plain.tif"
            direct = {} if encoding.copied else {n: v for n, v in encoding.creation.items() if n not in _BLOCKS}
            with rasterio.open(
                plain, "w", driver="GTiff" if encoding.copied else encoding.driver, dtype=dtype, nodata=encoding.nodata,
                count=count, height=TRIED, width=TRIED, **place(frame), **direct,
            ) as target:  # fmt: skip
                target.write(some)
            tried = plain
            if encoding.copied:
                tried = Path(folder) / f"tried{path.suffix}"
                copied_to(plain, tried, encoding.named(path))
            with rasterio.open(tried) as written:
                kept = written.shape == (TRIED, TRIED) and written.count == count
                kept = kept and (encoding.loses or np.array_equal(written.read(), some))
        except (RasterioError, CPLE_BaseError, OSError, SystemError, ValueError) as cause:
            why = said[0] if said else reason_of(cause)
            raise FormatError(
                f"{path.name}: {encoding.driver} of GDAL does not store {count} x {dtype} so ({why})"
            ) from cause
    wrong = [word for word in said if _UNEXPECTED.search(word)]
    if wrong:
        raise FormatError(f"{path.name}: {encoding.driver} of GDAL: {wrong[0]} (creation)")
    strange = [word.partition(_STRANGE)[2].strip() for word in said if _STRANGE in word]
    if strange:
        raise FormatError(
            f"{path.name}: {encoding.driver} of GDAL has no creation option {', '.join(strange)} (creation)"
        )
    if not kept:
        raise FormatError(f"{path.name}: {encoding.driver} of GDAL changes {count} x {dtype}; write .tif")


def copied_to(source: Path | str, target: Path, encoding: Encoding) -> None:
    """Store a finished raster by another driver.

    :raises RasterioError: or another error of rasterio, where it does not.
    """
    try:
        rasterio.shutil.copy(str(source), str(target), driver=encoding.driver, strict=False, **encoding.creation)
    except DriverRegistrationError as cause:
        raise OSError(f"GDAL has no driver {encoding.driver}") from cause


def reason_of(cause: BaseException) -> str:
    """The message of GDAL, which rasterio only refers to."""
    while cause.__cause__ is not None:
        cause = cause.__cause__
    return said_by(cause)


class _Complaints(logging.Handler):
    """Keeps what rasterio logs."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.said: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a message."""
        self.said.append(re.sub("^CPLE_[A-Za-z]+ in ", "", record.getMessage()))


@contextmanager
def _complaints() -> Iterator[list[str]]:
    """What GDAL complains of meanwhile."""
    log, handler = logging.getLogger("rasterio"), _Complaints()
    log.addHandler(handler)
    try:
        yield handler.said
    finally:
        log.removeHandler(handler)
