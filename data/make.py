"""Make the samples of this folder: ``python data/make.py``. Seeded: made again, they hold the same numbers.

- ``terrain.tif``: elevations in whole metres (int16), 256 x 256 samples of 10 m, EPSG:32632, nodata -9999 over a ragged area;
  noise of 2 m and the rounding.
- ``terrain_truth.tif``: the same terrain without noise, rounding or missing samples, float32 metres.
- ``scene_depth.png``: what a depth camera saw, 320 x 240, 16 bit, millimetres, 0 where nothing is; noise of 0.002 z^2 (z in m).
- ``scene_camera.json``: that camera, as Open3D writes it (intrinsic_matrix column by column).
- ``scene_truth.tif``: the true depths, float32 metres, 0 where nothing is.
- ``shape_noisy.ply``: an irregular closed mesh, a ball of radius 1 with two flat cuts; noise of 0.01 along the normals.
- ``shape_truth.ply``: the same triangles on the true surface (``meshflow.synthetic.solids.CappedBall``).
- ``picture.png``: coloured discs on ramps, 192 x 144, 8 bit; noise of 12 grey levels.
- ``picture_truth.png``: the same without noise, rounded.
"""

import json
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
import trimesh
from rasterio.crs import CRS
from rasterio.errors import NotGeoreferencedWarning
from rasterio.transform import from_origin

from meshflow.synthetic import samples

HERE = Path(__file__).parent
NODATA = -9999
GROUND = {
    "crs": CRS.from_epsg(32632),
    "transform": from_origin(610_000.0, 5_280_000.0, 10.0, 10.0),
    "compress": "deflate",
}
TALL = {"compress": "deflate", "predictor": 3}


def rasters() -> dict[str, tuple[np.ndarray, dict[str, Any]]]:
    """File names to the values (bands, h, w) that they hold, and how they are written."""
    terrain, scene, picture = samples.terrain(), samples.depth_scene(), samples.picture()
    whole = np.where(ragged(len(terrain.truth)), NODATA, np.rint(terrain.noisy)).astype(np.int16)
    truth = np.nan_to_num(scene.truth).astype(np.float32)
    return {
        "terrain.tif": (whole[None], {**GROUND, "predictor": 2, "nodata": NODATA}),
        "terrain_truth.tif": (terrain.truth.astype(np.float32)[None], {**GROUND, "predictor": 3}),
        "scene_depth.png": (np.rint(1000.0 * np.nan_to_num(scene.noisy)).astype(np.uint16)[None], {}),
        "scene_truth.tif": (truth[None], {**TALL, "nodata": 0.0}),
        "picture.png": (np.moveaxis(picture.noisy, 2, 0).astype(np.uint8), {}),
        "picture_truth.png": (np.moveaxis(np.rint(picture.truth), 2, 0).astype(np.uint8), {}),
    }


def meshes() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """File names to points (n, 3), float32 as PLY holds them, and faces (m, 3)."""
    shape = samples.irregular_mesh()
    points = {"shape_noisy.ply": shape.noisy, "shape_truth.ply": shape.truth}
    return {name: (values.astype(np.float32), shape.faces) for name, values in points.items()}


def camera() -> dict[str, Any]:
    """The camera of the scene, in the layout of Open3D."""
    c = samples.CAMERA
    return {"width": 320, "height": 240, "intrinsic_matrix": [c.fx, 0.0, 0.0, 0.0, c.fy, 0.0, c.cx, c.cy, 1.0]}


def ragged(n: int) -> np.ndarray:
    """Where the terrain was not seen (n, n): a strip as of another flight, ragged ponds, and single samples."""
    rng = np.random.default_rng(7)
    y, x = np.mgrid[0:n, 0:n] / n
    rough = samples.fractal(n, 2.0, rng)
    return (x + 0.3 * y + 0.02 * rough > 1.2) | (rough < -2.0) | (rng.uniform(size=(n, n)) < 0.002)


def main(folder: Path = HERE) -> None:
    """Write all files into a folder."""
    for name, (values, options) in rasters().items():
        count, height, width = values.shape
        driver = "PNG" if name.endswith(".png") else "GTiff"
        shape = {"driver": driver, "count": count, "height": height, "width": width, "dtype": values.dtype}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)  # pictures lie nowhere on the ground
            with rasterio.open(folder / name, "w", **shape, **options) as raster:
                raster.write(values)
                if name.startswith("terrain"):
                    raster.units = ("m",)
    for name, (points, faces) in meshes().items():
        trimesh.Trimesh(points, faces, process=False).export(folder / name)
    (folder / "scene_camera.json").write_text(json.dumps(camera(), indent=1) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE)
