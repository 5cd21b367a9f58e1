"""Rasters through GDAL: samples, missing samples, and everything that must be kept around them."""

import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np
import rasterio
from rasterio._err import CPLE_BaseError  # errors of GDAL for which rasterio has no public name
from rasterio.enums import ColorInterp, MaskFlags, Resampling
from rasterio.errors import CRSError, NodataShadowWarning, NotGeoreferencedWarning, RasterioError
from rasterio.io import DatasetReader, MemoryFile
from rasterio.transform import Affine
from rasterio.windows import Window

from meshflow.errors import FormatError, InputError
from meshflow.geometry.validation import Array, real, slim
from meshflow.io.atomic_write import beside
from meshflow.io.document import Source
from meshflow.io.formats.elsewhere import said_of
from meshflow.io.formats.raster_drivers import allowed_drivers, must_be_numbers, must_fit
from meshflow.io.formats.raster_encoding import Encoding, copied_to, reason_of
from meshflow.io.formats.raster_frame import Frame, Framed, alpha_as, describe, place
from meshflow.io.formats.raster_place import WHOLE, Place, as_window, shape_of
from meshflow.io.formats.zipped_heights import taken_out
from meshflow.io.incoming import plainly_named
from meshflow.io.undeclared import mark_in
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.range_image import RangeImage

__all__ = [
    "frame_of", "framed", "gone_in", "layers", "load", "merged", "must_have_bands", "quiet", "save", "unreadable",
]  # fmt: skip

T = TypeVar("T")

# What is not transparent.
_OPAQUE = (1, 255, 65535)

# More bands than any instrument has; the work for each pair of bands would take too long.
_MOST_BANDS = 1024

# Without this, GDAL (3.10) accepts a PNG of 8 bit that is cut off, and fills it from uninitialized memory.
_SAFE = {"GDAL_PNG_WHOLE_IMAGE_OPTIM": False}
# Samples of a band that are read back at a time.
_AT_ONCE = 1 << 20
_LOSSLESS = ("GTiff", "PNG", "BMP", "WEBP")
_DESCRIBE_THE_FILE = ("IMAGE_STRUCTURE", "DERIVED_SUBDATASETS", "SUBDATASETS", "RPC", "rio_creation_kwds")


def load(
    path: Path,
    *,
    bands: Sequence[int] | None = None,
    nodata: float | None = None,
    remote: bool = False,
    search: bool = False,
    where: Place = WHOLE,
) -> tuple[Array, Frame]:
    """Samples (k, h, w) as float32 or float64, scale and offset applied, and their frame.

    Samples are missing where nodata, an internal mask or an alpha of 0 says so, and where they are not finite; they keep their
    bits.

    :param bands: numbers of bands, from 1; None: all but the alpha band.
    :param nodata: instead of the declared one.
    :param remote: the file may refer to files outside its folder, and in networks.
    :param search: what nothing declares is looked for, too: a mask among the bands, values that mark missing samples.
    :param where: the part to read, and what replaces the georeference of the file.
    :raises FormatError: when GDAL cannot open or read the file, or it has no bands.
    """
    opening = must_be_numbers(path) if path.suffix.lower() == ".asc" else {}
    try:
        with (
            quiet(),
            plainly_named(path) as named,
            taken_out(named) as file,
            DatasetReader(str(file), driver=allowed_drivers(file, remote), **opening) as source,
        ):
            part = where.part(source)
            must_fit(path, len(bands or source.indexes), *shape_of(part))
            window = as_window(part)
            colours = source.colorinterp
            chosen = list(bands or [i for i in source.indexes if colours[i - 1] != ColorInterp.alpha])
            must_have_bands(path, source, chosen)
            raw = source.read(chosen, out_dtype=np.result_type(*source.dtypes), window=window)
            gone = gone_in(source, raw, chosen, nodata, window)
            transparent = colours[-1] == ColorInterp.alpha and source.count not in chosen
            alpha = source.read(source.count, window=window) if transparent else None
            found: tuple[str, ...] = ()
            if search and bands is None and alpha is None and _ends_in_mask(raw, colours[-1]):
                found = (
                    f"band {len(raw)} holds 0 and {raw[-1].max():g} alone, and is 0 where all others are: it is taken as the "
                    "mask, and comes back as it is (band= takes one as data)",
                )
                raw, gone, alpha, chosen = raw[:-1], gone[:-1], raw[-1], chosen[:-1]
            frame = where.placed(frame_of(source, str(raw.dtype), chosen, nodata), part)
    except (RasterioError, CRSError, CPLE_BaseError, OSError, MemoryError) as cause:
        raise unreadable(path, cause) from cause
    values = real(raw, path.name)
    if alpha is not None:
        gone |= alpha == 0
    while search and nodata is None and (mark := mark_in(raw, gone)) is not None:
        gone |= raw == mark.value
        found += (mark.sentence,)
        frame = frame if frame.nodata is not None else replace(frame, nodata=mark.value)
    if frame.scaled:
        scale, offset = (np.reshape(factor, (-1, 1, 1)) for factor in (frame.scales, frame.offsets))
        values = np.where(gone, values, values * scale + offset).astype(values.dtype)
    return values, replace(frame, gone=slim(gone | ~np.isfinite(values)), alpha=alpha, notes=found)


def save(samples: Array, frame: Frame, path: Path, encoding: Encoding, tags: Mapping[str, str]) -> None:
    """Write samples (k, h, w), in their own dtype, and all of the frame that the driver has room for; then read them back.

    GDAL writes to memory, and Python to the disk: GDAL does not say what a disk is short of, and its TIFF library prints lines of
    its own on stderr. Drivers that copy a finished raster write to the disk themselves.

    :param tags: words on top of the frame's; ``name:key`` goes to the namespace ``name``, since GDAL splits at the colon.
    :raises FormatError: when the file could not be written whole; the old one is then as it was.
    """
    count = len(samples)
    if frame.alpha is not None:
        samples = np.concatenate([samples, alpha_as(frame.alpha, samples.dtype)[None]])
    shape = {"count": len(samples), "height": samples.shape[1], "width": samples.shape[2]}
    first, copied = encoding, encoding.copied
    if copied:
        first, tags = Encoding("GTiff", encoding.nodata), {name.replace(":", "_"): word for name, word in tags.items()}
    with beside(path, several=copied) as temporary:
        try:
            with quiet(), MemoryFile(ext=".tif" if copied else path.suffix) as memory:
                with memory.open(
                    driver=first.driver,
                    dtype=samples.dtype,
                    nodata=encoding.nodata,
                    **shape,
                    **place(frame),
                    **first.creation,
                ) as target:
                    describe(target, frame, count, tags)
                    target.write(samples)
                if copied:
                    copied_to(memory.name, temporary, encoding.named(path))
                _verify(str(temporary) if copied else memory.name, samples, encoding)
                if encoding.driver == "GTiff" and frame.overviews:
                    with rasterio.open(memory.name, "r+") as target:
                        target.build_overviews(list(frame.overviews), Resampling.average)
                if not copied:
                    temporary.write_bytes(memory.getbuffer())
        except (RasterioError, CPLE_BaseError) as cause:
            raise OSError(reason_of(cause)) from cause


def framed(data: HeightField | Image | RangeImage, dtype: str) -> Frame:
    """A frame for data that was not read from a raster: missing samples, and a transform if the spacing is not 1."""
    values, missing = layers(data), np.asarray(data.missing)
    spacing = (1.0, 1.0) if isinstance(data, RangeImage) else data.spacing
    dx, dy = spacing
    plain = np.ndim(dx) > 0 or (dx, dy) == (1.0, 1.0)
    transform = Affine.identity() if plain else Affine(dx, 0, 0, 0, -dy, dy * values.shape[1])
    return Frame(dtype, np.broadcast_to(missing, values.shape) | ~np.isfinite(values), transform=transform)


def layers(data: HeightField | Image | RangeImage) -> Array:
    """The samples of data on a grid as bands (k, h, w)."""
    match data:
        case HeightField():
            return data.z[None]
        case RangeImage():
            return data.depth[None]
        case Image():
            return data.values[None] if data.values.ndim == 2 else np.moveaxis(data.values, 2, 0)


def merged(source: Source, data: HeightField | Image | RangeImage) -> tuple[Array, Frame]:
    """The samples (k, h, w) of data on a grid, and the frame of the file, or a plain one.

    :raises InputError: when samples and frame differ in shape.
    """
    values = layers(data)
    frame = source.frame if isinstance(source, Framed) else framed(data, source.stored_as)
    if frame.gone.shape != values.shape:
        raise InputError(
            f"samples of shape {frame.gone.shape}, as they were read, expected for the frame of the file, got {values.shape}; "
            "crop or resample the file itself (gdalwarp, gdal_translate)"
        )
    return values, frame


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress warnings about files without georeference, and alpha beside nodata."""
    with warnings.catch_warnings(), rasterio.Env(**_SAFE):
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        warnings.simplefilter("ignore", NodataShadowWarning)
        yield


def _alike_pages(source: DatasetReader, pages: Sequence[str]) -> bool:
    """Whether the last page is as large as the first one, and no thumbnail of it."""
    with DatasetReader(pages[-1], driver="GTiff") as page:
        return (page.shape, page.count) == (source.shape, source.count)


def must_have_bands(path: Path, source: DatasetReader, chosen: list[int]) -> None:
    """Refuse no band, a band that is not there, more than are smoothed together, and a stack of pages.

    :raises FormatError: for a file without bands, and for too many.
    :raises InputError: for a band that is not there, and for pages of which all but the first would be lost.
    """
    pages = source.subdatasets if chosen and source.driver == "GTiff" else []
    if len(pages) > 1 and _alike_pages(source, pages):
        raise InputError(
            f"{path.name}: a stack of {len(pages)} pages; give kind='volume', which smooths them as one body, or write a page to "
            "a file of its own"
        )
    if not chosen:
        inside = ", ".join(source.subdatasets[:4])
        raise FormatError(
            f"{path.name} holds no bands of samples, but {inside or 'nothing'}; gdal_translate one to .tif"
        )
    for band in chosen:
        if band not in range(1, source.count + 1):
            raise InputError(
                f"{path.name}: band {band!r} expected to be one of 1 to {source.count}; bands count from 1"
            )
    if len(chosen) > _MOST_BANDS:
        raise FormatError(
            f"{path.name}: {len(chosen)} bands, and {_MOST_BANDS} smoothed as one image is the limit; choose one (band=), "
            "or take some out: gdal_translate -b"
        )


def _ends_in_mask(raw: Array, colour: ColorInterp) -> bool:
    """Whether the last band is a mask that is not called one: two values, the lower one 0, where all other bands are 0, too."""
    if len(raw) < 2 or colour not in (ColorInterp.undefined, ColorInterp.gray):
        return False
    last, peak = raw[-1], raw[-1].max()
    holes = last == 0
    return bool(peak in _OPAQUE and holes.any() and (holes | (last == peak)).all() and not raw[:-1, holes].any())


def gone_in(
    source: DatasetReader, raw: Array, chosen: list[int], nodata: float | None, window: Window | None = None
) -> Array:
    """Missing samples (k, h, w) of bands; a given nodata value replaces the declared one, an internal mask stays.

    :param raw: (k, h, w), the samples as stored; ``window``: where they lie, None for all.
    """
    if nodata is None:
        return source.read_masks(chosen, window=window) == 0
    flags = source.mask_flag_enums[chosen[0] - 1]
    masked = np.zeros(raw.shape, bool) if MaskFlags.nodata in flags else source.read_masks(chosen, window=window) == 0
    return masked | (raw == float(nodata))


def frame_of(source: DatasetReader, dtype: str, chosen: list[int], nodata: float | None) -> Frame:
    """The frame of bands of a raster, but for their missing samples.

    :param dtype: in which their samples are stored.
    :param chosen: numbers of bands, from 1.
    :param nodata: instead of the declared one.
    """

    def of(each: Sequence[T]) -> tuple[T, ...]:
        """The entries of the bands that are read."""
        return tuple(each[i - 1] for i in chosen)

    spaces = [
        name
        for name in source.tag_namespaces()
        if name not in _DESCRIBE_THE_FILE and not name.startswith(("json:", "xml:"))
    ]
    declared = nodata if nodata is not None else next((n for n in of(source.nodatavals) if n is not None), None)
    palette = None
    if source.colorinterp[chosen[0] - 1] == ColorInterp.palette:
        palette = np.array(list(source.colormap(chosen[0]).values()), dtype=np.uint8)
    return Frame(
        dtype=dtype,
        gone=np.zeros(0, bool),
        nodata=declared,
        crs=source.crs,
        transform=source.transform,
        gcps=source.gcps,
        rpcs=source.rpcs,
        scales=of(source.scales),
        offsets=of(source.offsets),
        units=of(source.units),
        descriptions=of(source.descriptions),
        colours=of(source.colorinterp),
        palette=palette,
        tags={"": source.tags(), **{name: source.tags(ns=name) for name in spaces}},
        band_tags=tuple({k: v for k, v in source.tags(i).items() if not k.startswith("STATISTICS_")} for i in chosen),
        overviews=tuple(source.overviews(chosen[0])),
    )


def _verify(path: str, samples: Array, encoding: Encoding) -> None:
    lossless = (encoding.driver in _LOSSLESS or encoding.copied) and not encoding.loses
    with rasterio.open(path) as written:
        h, w = samples.shape[1:]
        for top in range(0, h, max(1, _AT_ONCE // w)):
            part = slice(top, min(top + max(1, _AT_ONCE // w), h)), slice(0, w)
            found = written.read(window=as_window(part))
            if lossless and not np.array_equal(found, samples[:, part[0]], equal_nan=samples.dtype.kind == "f"):
                raise OSError("what was read back differs from what was written")


def unreadable(path: Path, cause: BaseException) -> FormatError:
    """The refusal of a file that GDAL cannot read."""
    labels = [
        label for label in (path.with_suffix(".LBL"), path.with_suffix(".lbl")) if label.exists() and label != path
    ]
    advice = (
        f"its label says how to read it: open {labels[0].name}"
        if labels
        else "is it whole, and a raster that GDAL opens (GeoTIFF, .asc, .hgt, .dem, PDS label, VRT, PNG, ...)?"
    )
    return FormatError(f"{path.name} cannot be read ({reason_of(cause)}); {said_of(path) or advice}")
