"""The shipped files are what their script makes, and measure what they say."""

import importlib.util
import json
from pathlib import Path

import numpy as np
import rasterio
import trimesh

import meshflow

DATA = Path(__file__).parents[1] / "data"


def make():
    spec = importlib.util.spec_from_file_location("make", DATA / "make.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_script_makes_the_files_that_are_there():
    module = make()
    for name, (values, _) in module.rasters().items():
        with rasterio.open(DATA / name) as raster:
            found = raster.read()
        assert found.dtype == values.dtype
        # Sines and logarithms differ in their last bits between machines; a rounded sample may fall to the other side.
        assert np.mean(np.abs(found.astype(float) - values) > 1e-3 * np.abs(values)) < 1e-3, name
    for name, (points, faces) in module.meshes().items():
        mesh = trimesh.load(DATA / name, process=False)
        assert np.allclose(mesh.vertices, points, atol=1e-5)
        assert np.array_equal(mesh.faces, faces)
    assert json.loads((DATA / "scene_camera.json").read_text()) == module.camera()


def test_the_terrain_has_a_crs_whole_metres_ragged_holes_and_two_metres_of_noise():
    with rasterio.open(DATA / "terrain.tif") as raster:
        assert raster.crs.to_epsg() == 32632
        assert raster.nodata == -9999
        assert raster.dtypes == ("int16",)
        assert raster.res == (10.0, 10.0)
        missing = raster.read(1) == -9999
    assert 0.03 < missing.mean() < 0.3
    noisy, truth = meshflow.read(DATA / "terrain.tif").noun, meshflow.read(DATA / "terrain_truth.tif").noun
    error = (noisy.z - truth.z)[~noisy.missing]
    assert abs(error.std() - np.hypot(2.0, 1 / np.sqrt(12))) < 0.05  # noise and rounding


def test_all_files_together_are_small():
    assert sum(path.stat().st_size for path in DATA.iterdir()) < 1_500_000
