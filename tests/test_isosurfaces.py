"""Surfaces of bodies, and values on meshes, in pictures."""

import numpy as np
import pytest
import pyvista
from PIL import Image

import meshflow
from meshflow import InputError, Mesh, TetMesh, Volume
from meshflow.view import compare, isosurfaces, show

SMALL = {"size": (480, 280)}


def ball(noise=0.0):
    z, y, x = np.mgrid[-1:1:14j, -1:1:14j, -1:1:14j]
    draw = np.random.default_rng(0)
    return (x**2 + y**2 + z**2 < 0.4) + noise * draw.normal(size=x.shape)


def colours(path):
    """The number of colours that are not grey in a picture."""
    found = np.asarray(Image.open(path).convert("RGB")).reshape(-1, 3).astype(int)
    return len(np.unique(found[np.ptp(found, axis=1) > 60] // 16, axis=0))


@pytest.mark.needs_gl
def test_the_surface_of_a_body_is_drawn_before_and_after(tmp_path):
    noisy, clean = Volume(ball(0.2), (1.0, 1.0, 2.0)), Volume(ball(), (1.0, 1.0, 2.0))
    path = isosurfaces(noisy, clean, tmp_path / "a.png", **SMALL)
    picture = np.asarray(Image.open(path).convert("L"))
    dark = (picture < 230).mean(axis=0)
    assert dark[:240].sum() > 10
    assert dark[240:].sum() > 10
    grid = pyvista.ImageData(dimensions=(14, 14, 14)).cast_to_unstructured_grid()
    grid["v"] = ball().ravel()
    assert isosurfaces(grid, grid, tmp_path / "b.png", level=0.5, **SMALL).exists()


@pytest.mark.parametrize(
    ("data", "options", "words"),
    [
        (np.zeros((4, 4)), {}, "of volumes and of values on tetrahedra, got a HeightField"),
        (Volume(np.zeros((4, 4, 4, 2))), {}, "one channel expected"),
        (Volume(ball()), {"level": 7.0}, "a value between 0 and 1 expected, got 7"),
    ],
)
def test_what_has_no_surface_is_refused(tmp_path, data, options, words):
    with pytest.raises(InputError, match=words):
        isosurfaces(data, data, tmp_path / "a.png", **options)


@pytest.mark.needs_gl
def test_one_channel_on_a_mesh_and_on_the_skin_of_a_body_is_shown_in_colours(tmp_path):
    sphere = pyvista.Sphere(theta_resolution=16, phi_resolution=16)
    heat = np.sin(5 * sphere.points[:, 2])
    mesh = Mesh(np.array(sphere.points), sphere.regular_faces, heat)
    show(mesh, tmp_path / "a.png", **SMALL)
    assert colours(tmp_path / "a.png") > 8
    compare(mesh, meshflow.smooth(mesh, method="heat", time=0.01), tmp_path / "b.png", **SMALL)
    assert colours(tmp_path / "b.png") > 8
    grid = pyvista.ImageData(dimensions=(6, 6, 6)).cast_to_unstructured_grid()
    body = TetMesh(np.array(grid.points), grid.triangulate().cells_dict[10], np.array(grid.points[:, 0]))
    show(body, tmp_path / "c.png", **SMALL)
    assert colours(tmp_path / "c.png") > 4
    show(Mesh(np.array(sphere.points), sphere.regular_faces), tmp_path / "d.png", **SMALL)
    assert colours(tmp_path / "d.png") == 0  # a mesh whose points move stays of stone
