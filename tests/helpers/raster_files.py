"""Small rasters for the tests of the edge."""

import warnings

import numpy as np
import rasterio
from rasterio.crs import CRS
from rasterio.transform import Affine, from_origin

from meshflow.io.files import read, write

UTM = CRS.from_epsg(32611)
UP = from_origin(376000, 3808000, 30, 30)


def heights(dtype="float32", h=6, w=8):
    return (np.arange(h * w).reshape(h, w) % 7 * 10 + 100).astype(dtype)


def make(path, samples, *, mask=None, tags=None, colours=None, scale=None, after=None, **profile):
    samples = samples if samples.ndim == 3 else samples[None]
    profile = {"driver": "GTiff", "crs": UTM, "transform": UP} | profile
    count, height, width = samples.shape
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
        with (
            rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True),
            rasterio.open(path, "w", count=count, height=height, width=width, dtype=samples.dtype, **profile) as target,
        ):
            if colours:
                target.colorinterp = colours
            if scale:
                target.scales, target.offsets = [scale[0]] * count, [scale[1]] * count
            if tags:
                target.update_tags(**tags)
            if after:
                after(target)
            target.write(samples)
            if mask is not None:
                target.write_mask(~mask)
    return path


def turned_by(degrees, dx, dy):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return Affine(dx * c, dy * s, 5, dx * s, -dy * c, 6)


def same(path, **options):
    """The file, read and written again unchanged: its document, the new one, and the notes."""
    document = read(path, **options)
    out = path.parent / f"again{path.suffix if path.suffix == '.asc' else '.tif'}"
    notes = write(document, out, overwrite=True)
    return document, read(out), notes
