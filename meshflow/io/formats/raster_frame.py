"""The content of a raster file besides its samples, and how it is written back."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from rasterio.control import GroundControlPoint
from rasterio.crs import CRS
from rasterio.enums import ColorInterp
from rasterio.io import DatasetWriter
from rasterio.rpc import RPC
from rasterio.transform import Affine

from meshflow.geometry.validation import Array
from meshflow.io.document import Source
from meshflow.io.spacing import linear_unit

__all__ = ["Frame", "Framed", "alpha_as", "describe", "place"]


@dataclass(frozen=True, eq=False)
class Frame:
    """The content of a raster file besides its samples.

    :param dtype: of the samples as they were stored.
    :param gone: (k, h, w), the missing samples of each band.
    :param alpha: (h, w), the alpha band as stored; it is kept and never smoothed.
    :param palette: (n, 4), red, green, blue, alpha of each index.
    :param tags: text by namespace (domain of GDAL), ``""`` the default one.
    :param overviews: factors of the overviews.
    :param notes: findings about the samples, sentences for the user.
    """

    dtype: str
    gone: Array
    alpha: Array | None = None
    nodata: float | None = None
    crs: CRS | None = None
    transform: Affine = field(default_factory=Affine.identity)
    gcps: tuple[Sequence[GroundControlPoint], CRS | None] = ((), None)
    rpcs: RPC | None = None
    scales: tuple[float, ...] = ()
    offsets: tuple[float, ...] = ()
    units: tuple[str | None, ...] = ()
    descriptions: tuple[str | None, ...] = ()
    colours: tuple[ColorInterp, ...] = ()
    palette: Array | None = None
    tags: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    band_tags: tuple[Mapping[str, str], ...] = ()
    overviews: tuple[int, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def georeferenced(self) -> bool:
        """Whether the file is georeferenced."""
        return not self.transform.is_identity

    @property
    def north_up(self) -> bool:
        """Whether the file lies on a map, its rows from north to south and its columns from west to east."""
        a, b, _, d, e, _ = tuple(self.transform)[:6]
        return self.crs is not None and self.georeferenced and b == 0 and d == 0 and a > 0 > e

    @property
    def ground_unit(self) -> str:
        """The unit of the lengths between samples: for a grid in degrees it is the metre; empty where it is not defined."""
        if self.crs is None or not self.georeferenced:
            return ""
        unit = linear_unit(self.crs)[0]
        return "m" if unit in ("metre", "meter", "metres", "meters") else unit

    def places(self, part: tuple[slice, slice]) -> tuple[Array, Array] | None:
        """x and y of the centres of the samples of some rows and columns on the map; None where the file lies on none."""
        if not self.georeferenced:
            return None
        a, b, c, d, e, f = tuple(self.transform)[:6]
        row, column = np.mgrid[part] + 0.5
        return a * column + b * row + c, d * column + e * row + f

    @property
    def scaled(self) -> bool:
        """Whether the stored numbers need a scale and an offset."""
        return any(scale != 1 for scale in self.scales) or any(self.offsets)

    def stored(self, values: Array) -> Array:
        """Values (k, h, w) as stored numbers, before scale and offset."""
        if not self.scaled:
            return values
        return (values - np.reshape(self.offsets, (-1, 1, 1))) / np.reshape(self.scales, (-1, 1, 1))

    def without_scale(self) -> "Frame":
        """The frame for values instead of scaled numbers."""
        return replace(self, scales=(), offsets=())

    def bare(self) -> "Frame":
        """The parts that an ASCII grid holds: samples, nodata and transform."""
        return Frame(self.dtype, self.gone, nodata=self.nodata, transform=self.transform)


@dataclass(frozen=True, eq=False)
class Framed(Source):
    """What is kept of a file that GDAL reads.

    :param frame: the content besides its samples.
    """

    frame: Frame

    @property
    def ground_unit(self) -> str:
        """The unit of the lengths between samples."""
        return self.frame.ground_unit

    def places(self, part: tuple[slice, slice]) -> tuple[Array, Array] | None:
        """x and y of the centres of the samples of some rows and columns on the map."""
        return self.frame.places(part)

    @property
    def north_up(self) -> bool:
        """Whether the file lies on a map, north up."""
        return self.frame.north_up

    @property
    def stored_as(self) -> str:
        """The type in which samples were stored."""
        return self.frame.dtype

    @property
    def placed(self) -> bool:
        """Whether there is a CRS, a transform, or an alpha band."""
        return self.frame.crs is not None or self.frame.georeferenced or self.frame.alpha is not None


def place(frame: Frame) -> Mapping[str, object]:
    """The position of the samples, as arguments for GDAL."""
    points, crs = frame.gcps
    if points:
        return {"gcps": points, "crs": CRS() if crs is None else crs}
    return {"crs": frame.crs} | ({"transform": frame.transform} if frame.georeferenced else {})


def describe(target: DatasetWriter, frame: Frame, count: int, tags: Mapping[str, str]) -> None:
    """Write everything but the samples; the driver stores what it supports."""
    if frame.rpcs:
        target.rpcs = frame.rpcs
    if frame.colours:
        plain = [ColorInterp.gray if colour == ColorInterp.palette else colour for colour in frame.colours]
        target.colorinterp = [*plain, *[ColorInterp.alpha] * (target.count - count)]
    if frame.scaled:
        target.scales = [*frame.scales, *[1.0] * (target.count - count)]
        target.offsets = [*frame.offsets, *[0.0] * (target.count - count)]
    for band in range(1, count + 1):
        for names, put in ((frame.descriptions, target.set_band_description), (frame.units, target.set_band_unit)):
            if names and names[band - 1]:
                put(band, names[band - 1])
        if frame.band_tags:
            target.update_tags(band, **frame.band_tags[band - 1])
    for space, words in frame.tags.items():
        target.update_tags(**({"ns": space} if space else {}), **words)
    for name, word in tags.items():
        space, _, key = name.rpartition(":")
        target.update_tags(**({"ns": space} if space else {}), **{key: word})


def alpha_as(alpha: Array, dtype: np.dtype) -> Array:
    """Alpha in another type: for whole numbers opaque stays opaque; for floating point it is unchanged."""
    if alpha.dtype.kind == "u" and dtype.kind == "u":
        return np.rint(alpha * (np.iinfo(dtype).max / np.iinfo(alpha.dtype).max)).astype(dtype)
    return alpha.astype(dtype)
