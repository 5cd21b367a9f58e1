"""A height field or an image as an explicit mesh: the same points and triangles, without what is missing."""

from pathlib import Path

import numpy as np
import pytest
import rasterio
import trimesh
from typer.testing import CliRunner

import meshflow
from meshflow.cli.commands import app
from meshflow.errors import InputError
from meshflow.io.grid_mesh import mesh_of_grid

DATA = Path(__file__).parents[1] / "data"


def terrain():
    z = np.add.outer(0.1 * np.arange(6.0), np.arange(8.0))
    z[2, 3] = np.nan
    return meshflow.HeightField(z, (2.0, 3.0))


def test_points_are_the_samples_that_have_a_triangle_in_the_unit_of_the_ground():
    data = terrain()
    mesh = meshflow.to_mesh(data)
    assert len(mesh.vertices) == 47
    assert len(mesh.faces) == 2 * 5 * 7 - 6  # the six triangles at the missing sample
    row, column = np.nonzero(np.isfinite(data.z))
    there = {(float(x), float(y)): float(z) for x, y, z in mesh.vertices}
    for r, c in zip(row, column, strict=True):
        assert there[2.0 * c, -3.0 * r] == data.z[r, c]
    assert (mesh.face_normals[:, 2] > 0).all()


def test_every_other_sample_is_a_coarser_mesh_of_the_same_ground():
    data = terrain()
    coarse = mesh_of_grid(data, 2)
    assert len(coarse.points) == 3 * 4
    assert np.ptp(coarse.points[:, 0]) == 12.0
    assert np.ptp(coarse.points[:, 1]) == 12.0


def test_channels_of_an_image_are_attributes():
    image = meshflow.Image(np.random.default_rng(0).random((5, 6, 3)))
    mesh = meshflow.to_mesh(image)
    assert np.array_equal(mesh.vertex_attributes["channels"], image.values.reshape(-1, 3))
    assert (mesh.vertices[:, 2] == 0).all()


@pytest.mark.parametrize("suffix", [".ply", ".glb", ".obj", ".stl"])
def test_the_command_writes_a_mesh(tmp_path, suffix):
    source, target = tmp_path / "dem.npy", tmp_path / f"dem{suffix}"
    np.save(source, terrain().z)
    done = CliRunner().invoke(app, ["convert", str(source), str(target), "--every", "1"])
    assert done.exit_code == 0, done.output
    mesh = trimesh.load_mesh(target)
    assert len(mesh.faces) == 64
    assert mesh.area == pytest.approx(meshflow.to_mesh(meshflow.HeightField(terrain().z)).area, rel=1e-5)


def test_the_command_says_from_where_on_the_map_positions_count(tmp_path):
    done = CliRunner().invoke(app, ["convert", str(DATA / "terrain.tif"), str(tmp_path / "a.ply")])
    assert done.exit_code == 0, done.output
    with rasterio.open(DATA / "terrain.tif") as raster:
        east, north = raster.xy(0, 0)
    assert f"({east:.9g}, {north:.10g} on the map), to east and north in m" in " ".join(done.output.split())
    assert abs(trimesh.load_mesh(tmp_path / "a.ply").vertices[:, :2]).min() == 0


def test_what_makes_no_sense_is_refused_in_words():
    with pytest.raises(InputError, match="every: a whole number"):
        meshflow.to_mesh(terrain(), every=0)
    with pytest.raises(InputError, match="two samples or more"):
        meshflow.to_mesh(terrain(), every=7)
    with pytest.raises(InputError, match="colours: only for range images"):
        meshflow.to_mesh(terrain(), np.zeros((6, 8, 3)))
    with pytest.raises(InputError, match="no triangle"):
        meshflow.to_mesh(meshflow.HeightField(np.where(np.eye(4) > 0, 1.0, np.nan)))
    depth = meshflow.RangeImage(np.ones((4, 4)), meshflow.Pinhole(4.0, 4.0, 2.0, 2.0))
    with pytest.raises(InputError, match="every: only for height fields"):
        meshflow.to_mesh(depth, every=2)
