"""Two meshes at the same place: what rides along on them is what is compared, and that is said."""

import json

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

import meshflow
from meshflow.cli.commands import app
from meshflow.surfaces.mesh import Mesh
from meshflow.synthetic import shapes
from meshflow.view import compare
from meshflow.view.appearance import carried, taken
from meshflow.view.pair import paired

BALL = shapes.sphere(2)
UPPER = BALL.points[:, 2] > 0.1
COLOURS = np.where(UPPER[:, None], (200, 40, 40, 255), (90, 90, 90, 255)).astype(np.uint8)


def coloured(colours=COLOURS, **scalars):
    mesh = trimesh.Trimesh(BALL.points, BALL.faces, process=False)
    mesh.visual.vertex_colors = colours
    mesh.vertex_attributes.update(scalars)
    return mesh


def darker():
    return np.where(UPPER[:, None], (140, 40, 40, 255), COLOURS).astype(np.uint8)


def test_of_meshes_that_differ_in_their_colours_alone_the_colours_are_compared():
    pair = paired(coloured(), coloured(darker()), None)
    np.testing.assert_allclose(pair.removed.values, 20.0 * UPPER)
    assert pair.removed.what == "mean of colours, before − after"
    assert pair.notes == ("before and after are equal in their points; colours differ, and are compared",)
    assert isinstance(pair.before, Mesh)
    assert isinstance(pair.after, Mesh)
    np.testing.assert_array_equal(pair.before.channels, COLOURS[:, :3])
    np.testing.assert_array_equal(pair.after.channels, darker()[:, :3])


def test_colours_of_one_brightness_are_as_far_apart_as_they_are():
    turned = COLOURS[:, [1, 0, 2, 3]]
    pair = paired(coloured(), coloured(turned), None)
    np.testing.assert_allclose(pair.removed.values, np.hypot(160, 160) * UPPER)
    assert "length of the difference of colours" in pair.removed.what


def test_of_meshes_that_differ_in_a_scalar_alone_that_is_compared_in_one_scale():
    heat = np.linspace(0.0, 5.0, len(BALL.points))
    pair = paired(coloured(heat=heat, flow=heat), coloured(heat=heat + 1.0, flow=2 * heat), None)
    np.testing.assert_allclose(pair.removed.values, -1.0)
    assert pair.notes[-1].endswith("heat differ, and are compared; so do flow")
    assert [(scale.low, scale.high) for scale in pair.worn] == [(0.0, 6.0)] * 2


def test_where_points_moved_they_are_what_is_compared():
    moved = coloured(darker())
    moved.vertices = moved.vertices * 0.9
    pair = paired(coloured(), moved, None)
    assert "moved inwards" in pair.removed.what
    assert pair.removed.values.min() > 0.05
    assert paired(coloured(), coloured(), None).notes == ("before and after are equal",)


def test_arrays_of_pyvista_ride_along_too_and_normals_and_words_do_not():
    pv = pytest.importorskip("pyvista")
    poly = pv.PolyData.from_regular_faces(BALL.points, BALL.faces)
    poly.point_data["RGB"] = COLOURS[:, :3]
    poly.point_data["heat"] = np.arange(len(BALL.points), dtype=np.float32)
    poly.point_data["words"] = np.array(["a"] * len(BALL.points))
    poly.point_data["Normals"] = BALL.points.astype(np.float32)
    found = carried(poly, taken(poly)[0])
    assert {name: values.shape[1] for name, values in found.items()} == {"colours": 3, "heat": 1}
    assert carried((BALL.points, BALL.faces), taken((BALL.points, BALL.faces))[0]) == {}


def test_the_command_tells_the_difference_of_the_colours_of_two_files(tmp_path):
    names = tmp_path / "a.ply", tmp_path / "b.ply"
    for name, mesh in zip(names, (coloured(), coloured(darker())), strict=True):
        mesh.export(name)
    done = CliRunner().invoke(app, ["compare", *map(str, names), "--json"])
    assert done.exit_code == 0, done.output
    reported = json.loads(done.stdout)
    assert reported["rms difference"] == 0
    assert reported["rms difference of colours"] == pytest.approx(60.0 * np.sqrt(UPPER.mean()))
    assert "colours differ" in str(reported) + done.stderr


@pytest.mark.needs_gl
def test_a_picture_shows_where_colours_differ(tmp_path):
    from matplotlib.image import imread

    for name, mesh in (("a.ply", coloured()), ("b.ply", coloured(darker()))):
        mesh.export(tmp_path / name)
    one, other = (meshflow.read(tmp_path / name) for name in ("a.ply", "b.ply"))
    reported = compare(one, other, tmp_path / "a.png", size=(640, 480))
    assert "colours differ" in " ".join(reported.notes)
    picture = imread(reported.path)[260:430, 20:310]
    # the last colour of the map is 0.28 redder than it is blue, and light adds nothing to it
    red, grey = (picture[..., 0] - picture[..., 2] > 0.2).mean(), (np.ptp(picture[..., :3], axis=2) < 0.05).mean()
    assert red > 0.1
    assert grey > 0.1
