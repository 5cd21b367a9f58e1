"""``.meshflow`` on objects of pyvista and xarray. meshflow.accessors."""

import subprocess
import sys

import numpy as np
import pytest
import pyvista
import xarray

from meshflow.errors import InputError
from meshflow.smoothing import smooth


def test_a_mesh_of_pyvista_smooths_itself_and_stays_what_it_was():
    ball = pyvista.Sphere(theta_resolution=20, phi_resolution=20)
    before = np.array(ball.points)
    found = ball.meshflow.smooth(method="curvature", time=0.001)
    assert isinstance(found, pyvista.PolyData)
    assert np.array_equal(found.points, smooth(ball, method="curvature", time=0.001).points)
    assert np.array_equal(ball.points, before)
    assert ball.meshflow.smooth(method="curvature", time=0.001, result=True).stopped_because.startswith("reached time")
    with pytest.raises(InputError, match="cells that fill space expected"):
        pyvista.UnstructuredGrid().meshflow.smooth()


def test_a_data_array_smooths_itself():
    z = xarray.DataArray(np.random.default_rng(0).normal(size=(24, 32)), dims=("y", "x"), name="z")
    found = z.meshflow.smooth(time=2.0)
    assert found.name == "z"
    assert float(found.std()) < 0.7 * float(z.std())


def test_pyvista_finds_it_by_its_entry_point():
    script = "import pyvista; assert type(pyvista.Sphere().meshflow).__name__ == 'Smoothing'"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_variables_of_a_dataset_are_smoothed_one_by_one():
    rng = np.random.default_rng(0)
    heights = xarray.DataArray(rng.normal(size=(16, 20)), dims=("y", "x"))
    data = xarray.Dataset({"a": heights, "b": 2 * heights, "scalar": 3.0, "line": heights[0]})
    smoothed = data.meshflow.smooth(method="heat", time=2.0)
    assert np.array_equal(smoothed["a"], smooth(heights, method="heat", time=2.0))
    assert (smoothed["b"] != data["b"]).any()
    assert smoothed["line"].identical(data["line"])
    one = data.meshflow.smooth("b", method="heat", time=2.0)
    assert one["a"].identical(data["a"])
    with pytest.raises(InputError, match="c: no such variable; there are a, b"):
        data.meshflow.smooth("c")
    with pytest.raises(InputError, match="variable line: "):
        data.meshflow.smooth("line")
