"""Small depth images: sixteen-bit numbers of a camera, some of them missing."""

import warnings
from pathlib import Path

import numpy as np
import rasterio

from meshflow.surfaces.camera import Pinhole

SHARED = Path(__file__).parents[3] / "shared" / "data"
CAMERA = Pinhole(525, 520, 3.5, 2.5)


def counts():
    raw = (1000 + np.arange(48).reshape(6, 8) * 7).astype("uint16")
    raw[0, 0], raw[1, 1], raw[5, 7] = 0, 65535, 65534
    return raw


def make(path, raw, **profile):
    with warnings.catch_warnings(), rasterio.Env(GDAL_PAM_ENABLED=False):
        warnings.simplefilter("ignore")
        raw = raw if raw.ndim == 3 else raw[None]
        count, height, width = raw.shape
        driver = {".png": "PNG", ".tif": "GTiff"}[path.suffix]
        size = {"count": count, "height": height, "width": width, "dtype": raw.dtype}
        with rasterio.open(path, "w", driver=driver, **size, **profile) as target:
            target.write(raw)
    return path


def stored(path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with rasterio.open(path) as source:
            return source.read(1), source.nodata
