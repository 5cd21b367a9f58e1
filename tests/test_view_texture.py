"""Meshes in their own colours: the texture itself, and colours as bright as they are."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from matplotlib.image import imread
from PIL import Image as Pillow

import meshflow
from meshflow.errors import InputError
from meshflow.estimate.request import Request
from meshflow.results.run import states
from meshflow.surfaces.mesh import Mesh
from meshflow.synthetic import shapes
from meshflow.view import compare, plotter, show
from meshflow.view.appearance import taken
from meshflow.view.geometry import geometry_of
from meshflow.view.look import Look
from meshflow.view.texture import Textured
from meshflow.view.turning import coarse

SIZE = (640, 480)
SPHERE = shapes.sphere(4)
BOTTLE = Path(__file__).parents[2] / "shared" / "data" / "meshes" / "attributes" / "fuze.obj"


@pytest.fixture(autouse=True)
def _headless(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)


def flag(stripes=8):
    """A square of two triangles, split at a seam, that wears upright stripes; its lower half is darker."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    picture = np.zeros((64, 64, 3), np.uint8)
    picture[..., 0] = np.where(np.arange(64) // (64 // stripes) % 2, 250, 0)
    picture[32:, :, 2] = 200
    visual = trimesh.visual.TextureVisuals(uv=points[:, :2], image=Pillow.fromarray(picture))
    return trimesh.Trimesh(points, [[0, 1, 2], [3, 4, 5]], visual=visual, process=False)


@pytest.mark.needs_gl
def test_a_texture_is_drawn_finer_than_the_triangles_and_the_right_way_up(tmp_path):
    picture = imread(show(flag(), tmp_path / "a.png", own_colours=True, size=SIZE).path)[..., :3]
    inside = np.flatnonzero((picture[..., 1] < 0.1).all(axis=1) | (picture[..., 1] < 0.1).any(axis=1))
    top, bottom = picture[inside[len(inside) // 4]], picture[inside[-len(inside) // 4]]
    for row, blue in ((top, 0.0), (bottom, 200 / 255)):
        there = row[row[:, 1] < 0.1]
        red = there[:, 0] > 0.5
        assert np.count_nonzero(np.diff(red.astype(int))) == 7, "eight stripes over two triangles"
        assert np.median(there[:, 2]) == pytest.approx(blue, abs=0.02)


def test_a_texture_rides_along_with_the_points_and_with_the_triangles_that_are_left():
    data, _ = taken(flag(), own_colours=True)
    assert isinstance(data, Textured)
    assert data.texture.corners.shape == (2, 3, 2)
    np.testing.assert_array_equal(data.texture.corners, data.points[data.faces][..., :2])
    shape = shapes.sphere(2)
    uv = shape.points[:, :2] / 2 + 0.5
    visual = trimesh.visual.TextureVisuals(uv=uv, image=flag().visual.material.image)
    ball, _ = taken(trimesh.Trimesh(shape.points, shape.faces, visual=visual, process=False), own_colours=True)
    *_, (_, last) = states(ball, Request.of(method="curvature", scale=0.2), 3, None)
    assert isinstance(last, Textured)
    assert last.texture is ball.texture
    few = coarse(geometry_of(last, Look(own_colours=True)), 6)
    assert len(few.texture.corners) == len(few.faces) < len(ball.faces)
    np.testing.assert_array_equal(few.texture.corners, ball.texture.corners[few.triangles])


def test_a_mesh_whose_picture_is_not_there_has_no_texture():
    visual = trimesh.visual.TextureVisuals(uv=SPHERE.points[:, :2])
    mesh = trimesh.Trimesh(SPHERE.points, SPHERE.faces, visual=visual, process=False)
    with pytest.raises(InputError, match="neither colours of its vertices nor a texture"):
        taken(mesh, own_colours=True)


@pytest.mark.needs_gl
def test_own_colours_are_nowhere_brighter_than_they_are_and_six_sevenths_of_it_towards_the_viewer(tmp_path):
    colour = np.array([200, 120, 40])
    ball = Mesh(SPHERE.points, SPHERE.faces, np.tile(colour, (len(SPHERE.points), 1)), "points")
    for azimuth in (315.0, 90.0):
        reported = show(ball, tmp_path / "a.png", own_colours=True, azimuth=azimuth, overwrite=True, size=SIZE)
        picture = np.round(255 * imread(reported.path)[:440, :, :3]).astype(int)  # without its foot and its letters
        there = picture[picture[..., 2] < 50]  # the rim is blended with white
        assert (there <= 1.03 * colour + 1).all(axis=1).mean() > 0.999
        y, x = (int(np.median(axis)) for axis in np.nonzero(picture[..., 2] < 50))
        assert (picture[y, x] > 0.83 * colour).all(), "towards the viewer"
        assert (np.percentile(there, 2, axis=0) > 0.5 * colour).all(), "in the shadow"


@pytest.mark.needs_gl
def test_windows_show_the_texture_and_what_was_removed_in_turn():
    window = plotter(flag(), flag(), own_colours=True, off_screen=True, size=SIZE)
    worn = [
        actor.texture is not None
        for actor in [a for r in window.renderers for a in r.actors.values()]
        if hasattr(actor, "texture")
    ]
    window.close()
    assert worn.count(True) == 2, "before and after wear it, what was removed does not"


@pytest.mark.needs_gl
def test_a_state_that_moves_takes_its_texture_along():
    from meshflow.viewer.screen import Screen

    first, _ = taken(flag(), own_colours=True)
    moved = replace(first, points=first.points + [0.0, 0.3, 0.0])
    screen = Screen(first, moved, Look(size=SIZE, own_colours=True), off_screen=True)
    pictures = []
    for state, colouring in ((first, "surface"), (moved, "surface"), (moved, "removed"), (first, "surface")):
        screen.show(state, colouring)
        pictures.append(screen.picture().astype(int))
    screen.plotter.close()
    dark = [np.nonzero(picture[..., 1] < 30) for picture in pictures]
    assert dark[1][0].mean() < dark[0][0].mean() - 20, "it went up"
    assert len(dark[1][0]) == pytest.approx(len(dark[0][0]), rel=0.02), "with all of its picture"
    assert len(dark[2][0]) < 0.1 * len(dark[0][0])
    assert np.abs(pictures[3] - pictures[0]).mean() < 0.5


@pytest.mark.needs_gl
@pytest.mark.shared
@pytest.mark.skipif(not BOTTLE.exists(), reason="../shared/data/meshes/attributes/fuze.obj is absent")
def test_a_scan_with_a_texture_shows_its_label_before_and_after(tmp_path):
    document = meshflow.read(BOTTLE)
    fewer = document.holding(replace(document.data, points=document.data.points * 0.99))
    reported = compare(document, fewer, tmp_path / "a.png", own_colours=True, size=SIZE)
    picture = imread(reported.path)[..., :3]
    light = (picture.min(axis=2) > 0.45) & (picture.max(axis=2) < 0.9) & (np.ptp(picture, axis=2) < 0.2)
    assert light.sum() > 200, "the bar code, which no vertex has"


def test_the_texture_of_an_open3d_mesh_survives_and_is_drawn_the_right_way_up():
    open3d = pytest.importorskip("open3d")
    mesh = open3d.geometry.TriangleMesh.create_sphere(0.5, 8, create_uv_map=True)
    picture = np.zeros((4, 6, 3), np.uint8)
    picture[0] = (255, 0, 0)  # open3d stores the lowest row first
    mesh.textures = [open3d.geometry.Image(picture)]
    mesh.triangle_material_ids = open3d.utility.IntVector([0] * len(mesh.triangles))
    done = meshflow.smooth(mesh, method="curvature", time=1e-4)
    np.testing.assert_array_equal(done.triangle_uvs, mesh.triangle_uvs)
    np.testing.assert_array_equal(np.asarray(done.textures[0]), picture)
    texture = taken(done, own_colours=True)[0].texture
    np.testing.assert_array_equal(texture.picture[-1], picture[0])
    np.testing.assert_array_equal(texture.corners.reshape(-1, 2), mesh.triangle_uvs)


def test_a_texture_is_taken_at_the_vertices_seams_and_all():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)  # two split at a seam
    picture = Pillow.fromarray(np.array([[[0, 0, 255]] * 8] * 4 + [[[255, 0, 0]] * 8] * 4, np.uint8))
    visual = trimesh.visual.TextureVisuals(uv=points[:, :2] * 0.98 + 0.01, image=picture)
    mesh = trimesh.Trimesh(points, [[0, 1, 2], [3, 4, 5]], visual=visual, process=False)
    data, _ = taken(mesh, own_colours=True)
    assert len(data.points) == 4
    assert data.moves == "points"
    red = data.channels[:, 0] > data.channels[:, 2]
    np.testing.assert_array_equal(red, data.points[:, 1] == 0)
