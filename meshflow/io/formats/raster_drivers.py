"""The drivers of GDAL that may read a file, and checks of its header before anything is read or allocated.

By default GDAL chooses the driver by the content: a file named as a picture that contains a VRT reads other files of the
machine, and a TIFF that contains a WMS makes requests.
"""

import os
import re
from pathlib import Path

import rasterio

from meshflow.errors import FormatError
from meshflow.io.formats.vrt import must_be_local

__all__ = ["allowed_drivers", "must_be_numbers", "must_fit"]

# Self-contained formats, among which the content may decide: a JPEG named .png is read.
_PICTURES = ("GTiff", "PNG", "JPEG", "BMP", "WEBP", "GIF")
_PICTURE_SUFFIXES = {".tif", ".tiff", ".png", ".jpg", ".jpeg", ".bmp", ".webp", ".gif"}
# Drivers that get data from a network, a database or another file that the file refers to.
_ELSEWHERE = {
    "DAAS", "DERIVED", "EEDA", "EEDAI", "GTI", "GeoRaster", "HTTP", "KMLSUPEROVERLAY", "MAP", "MRF", "NGW", "OGCAPI", "PLMOSAIC",
    "PostGISRaster", "RDA", "STACIT", "STACTA", "TileDB", "VRT", "WCS", "WMS", "WMTS", "Zarr",
}  # fmt: skip
# The share of the machine's memory that the samples of a raster may take; smoothing needs at least as much again.
_SHARE = 0.5
# Bytes of samples for one byte of a file: no compression reaches it, nor a file of empty tiles that is of use.
_MOST_PACKED = 1e6
_WORD = re.compile(rb"(?<!\S)(?:\S*[^\s0-9.,+\-eE]\S*|[eE+\-.,]+(?!\S))")
# Bytes of an ASCII grid from which GDAL decides whether it has whole numbers.
_LOOKED_AT = 100_000
_NAN = re.compile(rb"(?:nan|1\.#qnan)$", re.IGNORECASE)


def allowed_drivers(path: Path, remote: bool = False) -> list[str]:
    """The drivers that may open a file, by its extension.

    :param remote: it may refer to files outside its folder, and in networks.
    :raises FormatError: for a VRT that refers to a file outside its folder, a network, or a virtual file system.
    """
    suffix = path.suffix.lower()
    if suffix in _PICTURE_SUFFIXES:
        return list(_PICTURES)
    if suffix == ".asc":
        return ["AAIGrid", "GRASSASCIIGrid"]
    if suffix == ".vrt":
        if not remote:
            must_be_local(path)
        return ["VRT"]
    with rasterio.Env() as env:
        return sorted(set(env.drivers()) - (set() if remote else _ELSEWHERE))


def must_fit(path: Path, bands: int, height: int, width: int) -> None:
    """Refuse samples that do not fit in memory, before they are read.

    :raises FormatError: the message names the size and the limit.
    """
    size, stored = 4.0 * bands * height * width, path.stat().st_size
    if path.suffix.lower() in _PICTURE_SUFFIXES and size > _MOST_PACKED * stored:
        raise FormatError(
            f"{path.name}: {bands} x {height} x {width} samples, {size / 1e9:.1f} GB in float32, are promised in {stored} bytes, "
            f"and {_MOST_PACKED:g} to one is the limit; is it cut off, or the header wrong?"
        )
    if not hasattr(os, "sysconf"):  # Windows has no sysconf
        return
    limit = _SHARE * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if size > limit:
        raise FormatError(
            f"{path.name}: {bands} x {height} x {width} samples are {size / 1e9:.1f} GB in float32, and {limit / 1e9:.1f} GB, "
            "half the memory of this machine, is the limit; cut a part out (gdal_translate -srcwin), or is the header wrong?"
        )


def must_be_numbers(path: Path) -> dict[str, str]:
    """Refuse an ASCII grid with a word instead of a number, or fewer numbers than its header claims.

    GDAL reads most words as 0, infinity as the largest float32, and NaN as 0 where all other numbers are whole.

    :returns: open options that make GDAL read NaN as NaN.
    :raises FormatError: the message names the word, or the counts.
    """
    content = path.read_bytes()
    header = re.match(rb"(?:[ \t]*[A-Za-z]\w*:?[ \t]+[^\s]+[ \t]*(?:\r\n|\r|\n)\s*)*", content)
    start = header.end() if header else 0
    holds_nan, says_nodata = False, b"nodata" in content[:start].lower()
    for word in _WORD.finditer(content, start):
        if _NAN.match(word.group()):
            holds_nan = True
        elif says_nodata or word.group().lower() != b"null":  # null marks missing samples where no number does
            line = content.count(b"\n", 0, word.start()) + 1
            raise FormatError(
                f"{path.name}, line {line}: a number expected, got {word.group()[:40].decode('latin-1')!r}; "
                "GDAL would read another one"
            )
    sides = [
        re.search(rb"(?im)^\s*" + name + rb":?\s+(\d+)", content[:start])
        for name in (rb"(?:ncols|cols)", rb"(?:nrows|rows)")
    ]
    counts = [int(side.group(1)) for side in sides if side is not None]
    if len(counts) == 2 and 2 * counts[0] * counts[1] - 1 > len(content) - start:
        raise FormatError(
            f"{path.name}: cut off, {counts[1]} x {counts[0]} numbers expected in {len(content) - start} bytes; "
            "get the whole file"
        )
    return {"DATATYPE": "Float64"} if holds_nan and b"." not in content[start : start + _LOOKED_AT] else {}
