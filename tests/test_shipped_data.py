"""The shipped files are what their script makes, and measure what they say."""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
import rasterio
import trimesh

import meshflow
from meshflow.evaluate.metrics import compare

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
        off = np.abs(found.astype(float) - values)
        assert np.mean(off > 1e-6 * np.abs(values)) < 1e-3, name
        assert off.max() <= (1 if values.dtype.kind in "iu" else 1e-3), name
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
    noisy, truth = meshflow.read(DATA / "terrain.tif").data, meshflow.read(DATA / "terrain_truth.tif").data
    error = (noisy.z - truth.z)[~noisy.missing]
    assert abs(error.std() - np.hypot(2.0, 1 / np.sqrt(12))) < 0.05  # noise and rounding


def test_the_scene_is_in_millimetres_and_lacks_what_nothing_was_seen_of():
    camera = DATA / "scene_camera.json"
    with rasterio.open(DATA / "scene_depth.png") as raster:
        assert (raster.width, raster.height, raster.dtypes) == (320, 240, ("uint16",))
    noisy, truth = (meshflow.read(DATA / name, camera=camera).data for name in ("scene_depth.png", "scene_truth.tif"))
    assert (noisy.camera.fx, noisy.camera.cx, noisy.camera.cy) == (300.0, 159.5, 119.5)
    assert np.array_equal(noisy.missing, truth.missing)
    seen = ~truth.missing
    assert ((noisy.depth - truth.depth) / truth.depth**2)[seen].std() == pytest.approx(0.002, rel=0.02)


def test_the_shape_and_the_picture_have_the_noise_that_they_say():
    noisy, truth = (meshflow.read(DATA / f"shape_{name}.ply").data for name in ("noisy", "truth"))
    assert np.array_equal(noisy.faces, truth.faces)
    assert compare(noisy, truth).rms == pytest.approx(0.01, rel=0.03)
    noisy, truth = (meshflow.read(DATA / name).data for name in ("picture.png", "picture_truth.png"))
    assert compare(noisy, truth).rms == pytest.approx(12.0, rel=0.03)


def test_all_files_together_are_small():
    assert sum(path.stat().st_size for path in DATA.iterdir()) < 1_500_000
