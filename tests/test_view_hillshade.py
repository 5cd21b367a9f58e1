"""Shaded relief, the page, and the writing of pictures: nothing here needs OpenGL."""

import os
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from meshflow.errors import FormatError, InputError, MissingPackage
from meshflow.surfaces.camera import Pinhole
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.view import compare, hillshade, page, show
from meshflow.view.geometry import as_shown, drawable, geometry_of
from meshflow.view.look import Look
from meshflow.view.pair import paired
from meshflow.view.scale import Scale

CAMERA = Pinhole(50.0, 50.0, 19.5, 14.5)
NEUTRAL = 247  # the middle of the colour map, grey
TRIANGLE = Mesh(np.eye(3), np.array([[0, 1, 2]]))


@pytest.fixture(autouse=True)
def _without_opengl(monkeypatch):
    monkeypatch.setenv("MESHFLOW_RENDERING", "off")
    monkeypatch.delenv("DISPLAY", raising=False)


def plane(east=0.0, north=0.0, shape=(12, 15)):
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    return HeightField(1.0 * east * columns - north * rows)


def shade(data, **look):
    return hillshade.shaded(geometry_of(data, Look()), data.missing.shape, Look(**look))


def panels(path, aspect, look):
    """Before, after and removed as they stand in a picture, in levels from 0 to 255."""
    picture = np.round(imread(path)[..., :3] * 255).astype(int)
    boxes = page.layout(look, aspect).panels
    bottom = [look.size[1] - box.bottom for box in boxes]
    return [picture[b - x.height : b, x.left : x.left + x.width] for x, b in zip(boxes, bottom, strict=True)]


@pytest.mark.parametrize(("east", "north"), [(0, 0), (1, 0), (-0.3, 0.7), (0, -2)])
@pytest.mark.parametrize("azimuth", [0, 100, 315])
def test_a_plane_is_shaded_by_lamberts_law(east, north, azimuth):
    normal = np.array([-east, -north, 1]) / np.sqrt(east**2 + north**2 + 1)
    turn, lift = np.radians((azimuth, 40))
    light = np.array([np.sin(turn) * np.cos(lift), np.cos(turn) * np.cos(lift), np.sin(lift)])
    shades = shade(plane(east, north), azimuth=azimuth, altitude=40)
    assert np.nanmax(np.abs(shades - max(normal @ light, 0))) < 1e-12


def test_a_wall_in_front_of_a_camera_is_lit_like_level_ground():
    shades = shade(RangeImage(np.full((30, 40), 2.0), CAMERA), altitude=25)
    assert np.nanmax(np.abs(shades - np.sin(np.radians(25)))) < 1e-12


def test_a_sample_without_a_triangle_has_no_shade_and_all_others_have():
    z = plane(1.0).z.copy()
    z[4, 5] = z[0, 1] = z[1, 0] = np.nan
    expected = np.isnan(z)
    expected[0, 0] = True  # alone in its corner
    np.testing.assert_array_equal(np.isnan(shade(HeightField(z))), expected)


def test_noise_of_alternating_samples_shows():
    rows, columns = np.mgrid[:10, :10]
    shades = shade(HeightField(0.2 * (-1.0) ** (rows + columns)))
    assert np.nanstd(shades) > 0.05  # central differences would find the ground level


def test_triangles_across_a_jump_of_depth_are_left_out():
    depth = np.full((30, 40), 1.0)
    depth[:, 20:] = 3.0
    assert np.abs(shade(RangeImage(depth, CAMERA), altitude=30) - 0.5).max() < 1e-12  # two walls
    assert np.abs(shade(RangeImage(depth, CAMERA, jump=None), altitude=30)[:, 19] - 0.5).min() > 0.1  # joined


def test_the_exaggeration_is_round_and_makes_a_relief_visible():
    for size in (1e-3, 0.07, 1.0, 42.0, 1e5):
        field = HeightField(size * np.random.default_rng(0).random((50, 80)))
        _, factor, notes = drawable(field, Look())
        assert f"{factor:.0e}"[0] in "125"
        assert 0.05 < factor * size / np.sqrt(50 * 80) < 0.16, factor
        assert f"heights × {factor:g}" in notes
    assert drawable(plane(), Look())[1] == 1.0
    assert drawable(plane(1.0), Look(exaggeration=3))[1] == 3.0


def test_a_large_grid_is_thinned_in_place_and_says_so():
    step, _, notes = drawable(plane(1.0, 0.5, (30, 2100)), Look())
    assert step == 3
    assert "every 3rd sample" in notes
    for data in (plane(1.0, 0.5), RangeImage(1 + 0.01 * plane(1.0).z, CAMERA)):
        whole, thin = geometry_of(data, Look()), geometry_of(data, Look(), step=2)
        grid = np.full((data.missing.size, 3), np.nan)
        grid[whole.samples] = whole.points
        kept = np.arange(data.missing.size).reshape(data.missing.shape)[::2, ::2].ravel()[thin.samples]
        np.testing.assert_allclose(thin.points, grid[kept], atol=1e-12)


def test_colours_are_symmetric_about_no_change():
    colours = hillshade.coloured(Scale(np.array([[-2.0, -1, 0, 1, 2, np.nan]]), -2, 2, "RdBu_r", "x")).astype(int)[0]
    assert np.ptp(colours[2]) <= 1
    assert colours[0, 2] > colours[0, 0]  # blue is lower
    assert colours[4, 0] > colours[4, 2]  # red is higher
    assert colours[5].tolist() not in colours[:5].tolist()


@pytest.mark.parametrize("full", [1.0, 255.0, 65535.0])
def test_an_image_is_shown_as_it_is(full):
    values = np.random.default_rng(0).random((20, 30, 3))
    image = Image(values * full)
    np.testing.assert_allclose(hillshade.imaged(image, 1, as_shown(image)), 255 * values, atol=0.51)


def test_two_panels_differ_where_the_data_differ_and_the_third_says_how(tmp_path):
    before = plane(0.1, 0.2, (60, 90))
    z = before.z.copy()
    z[20:40, 60:80] += 1.0
    z[20:40, 10:30] -= 1.0
    look = Look(size=(900, 700), exaggeration=1)
    reported = compare(before, HeightField(z), tmp_path / "a.png", size=look.size, exaggeration=1)
    assert reported.renderer == "hillshade"
    first, second, removed = panels(reported.path, 90 / 60, look)
    differs = np.argwhere((np.abs(first - second) > 8).any(axis=2)) / first.shape[:2]
    assert len(differs) > 100
    assert differs[:, 0].min() > 0.28
    assert differs[:, 0].max() < 0.71
    middle, width = removed[removed.shape[0] // 2], removed.shape[1]
    raised, lowered, same = (middle[int(share * width)] for share in (0.78, 0.22, 0.5))
    assert raised[2] > raised[0] + 50  # blue: less than nothing was removed
    assert lowered[0] > lowered[2] + 50
    assert np.abs(same - NEUTRAL).max() <= 2


@pytest.mark.parametrize(
    "data",
    [
        plane(0.1, 0.2, (60, 90)),
        RangeImage(np.full((60, 90), 2.0), CAMERA),
        Image(np.random.default_rng(0).random((60, 90, 3))),
    ],
    ids=lambda n: type(n).__name__,
)
def test_a_surface_that_did_not_change_has_nothing_removed(data, tmp_path):
    reported = compare(data, data, tmp_path / "a.png", size=(600, 450))
    first, second, removed = panels(reported.path, 1.5, Look(size=(600, 450)))
    assert "before and after are equal" in reported.notes
    assert (first == second).all()
    inner = removed[10:-10, 20:-20]
    assert np.abs(inner - NEUTRAL).max() <= 2


def test_where_vtk_cannot_draw_a_relief_is_made_and_the_reason_given(tmp_path):
    for data in (plane(1.0), RangeImage(np.full((9, 9), 2.0), CAMERA)):
        reported = compare(data, data, tmp_path / "a.png", size=(320, 240), overwrite=True)
        assert reported.renderer == "hillshade"
        assert any("MESHFLOW_RENDERING=off" in note for note in reported.notes)


def test_what_only_vtk_can_draw_is_refused_with_the_reason(tmp_path, monkeypatch):
    for call in (
        lambda: compare(TRIANGLE, TRIANGLE, tmp_path / "a.png"),
        lambda: show(TRIANGLE, tmp_path / "a.png"),
        lambda: show(plane(), tmp_path / "a.png", renderer="pyvista"),
    ):
        with pytest.raises(MissingPackage, match="MESHFLOW_RENDERING=off"):
            call()
    monkeypatch.setenv("DISPLAY", ":0")
    with pytest.raises(MissingPackage, match="a window can be drawn by VTK only"):
        show(plane())


@pytest.mark.parametrize("name", ["a.png", "b.jpg", "c.JPEG", "d.tif"])
def test_pictures_have_the_size_asked_for_in_every_format(tmp_path, name):
    reported = show(plane(1.0), tmp_path / name, size=(501, 333), title="A plane of $1 and $2")
    assert reported.path == tmp_path / name
    assert imread(reported.path).shape[:2] == (333, 501)
    assert [p.name for p in tmp_path.iterdir()] == [name]


def test_scalars_colour_a_surface_and_leave_out_what_is_missing(tmp_path):
    z = plane(1.0, shape=(20, 30)).z.copy()
    z[:, :5] = -32768
    field = HeightField(z, missing=z == -32768)
    show(field, tmp_path / "a.png", scalars=z, size=(600, 450))
    picture = imread(tmp_path / "a.png")[..., :3]
    assert (np.abs(picture - [0.267, 0.005, 0.329]).max(axis=2) < 0.02).any()  # the first colour: of 5, not of -32768
    assert (np.abs(picture - [0.993, 0.906, 0.144]).max(axis=2) < 0.02).any()  # the last


def test_anything_that_the_edge_recognises_can_be_compared(tmp_path):
    z = plane(1.0).z
    assert compare(z, z + 1, tmp_path / "a.png", unit="m", size=(320, 240)).renderer == "hillshade"
    assert paired(z, z + 1, "m").removed.label == "height before − after [m]"
    np.testing.assert_array_equal(paired(z, z + 1, "m").removed.values, -1.0)


def _full(self, path, **options):
    Path(path).write_bytes(b"half a pic")
    raise OSError(28, "No space left on device")


def _held(source, target):
    raise PermissionError(28, "No space left on device")


@pytest.mark.parametrize(("owner", "name", "failure"), [(Figure, "savefig", _full), (os, "replace", _held)])
def test_the_old_picture_stays_when_the_new_one_cannot_be_written(tmp_path, monkeypatch, owner, name, failure):
    target = tmp_path / "a.png"
    target.write_bytes(b"old")
    monkeypatch.setattr(owner, name, failure)
    with pytest.raises(FormatError, match="No space left"):
        show(plane(), target, overwrite=True)
    assert target.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.png"]


def test_a_mesh_is_compared_along_its_normals_and_channels_that_move_by_their_mean():
    moved = Mesh(TRIANGLE.points + 1.0, TRIANGLE.faces)
    np.testing.assert_allclose(paired(TRIANGLE, moved, None).removed.values, -np.sqrt(3))
    one = Mesh(TRIANGLE.points, TRIANGLE.faces, channels=np.zeros((3, 2)), moves="channels")
    other = Mesh(TRIANGLE.points, TRIANGLE.faces, channels=np.full((3, 2), (1.0, 3.0)), moves="channels")
    np.testing.assert_allclose(paired(one, other, None).removed.values, -2.0)


def test_what_comes_after_is_shown_on_the_grid_of_what_was_before():
    field = HeightField(plane(1.0).z, spacing=(30.0, 20.0))
    assert paired(field, field.z, None).after.spacing == field.spacing
    view = RangeImage(np.ones((4, 5)), CAMERA)
    assert paired(view, RangeImage(np.ones((4, 5)), Pinhole(9, 9, 2, 2)), None).after.camera == CAMERA


def test_what_is_missing_in_one_of_two_was_not_removed():
    z = plane(1.0).z.copy()
    z[0, 0] = np.nan
    removed = paired(plane(1.0), HeightField(z), None).removed.values
    assert np.isnan(removed[0, 0])
    assert (removed.ravel()[1:] == 0).all()


def test_colours_reach_the_largest_where_nearly_nothing_was_removed():
    z = plane().z.copy()
    z[3, 3] = 5.0
    scale = paired(plane(), HeightField(z), None).removed
    assert (scale.low, scale.high) == (-5.0, 5.0)
    assert "almost nothing was removed" in scale.ends


def _half(left):
    z = np.zeros((6, 8))
    z[:, :4] = np.nan if left else 0.0
    z[:, 4:] = 0.0 if left else np.nan
    return HeightField(z)


@pytest.mark.parametrize(
    ("before", "after", "says"),
    [
        (plane(), Image(plane().z), "before is a HeightField, after a Image"),
        (plane(), plane(shape=(12, 16)), r"shape \(12, 15\), after \(12, 16\)"),
        (Image(np.ones((4, 4, 3))), Image(np.ones((4, 4, 2))), r"shape \(4, 4, 3\), after \(4, 4, 2\)"),
        (TRIANGLE, Mesh(np.eye(4)[:, :3], TRIANGLE.faces), r"points \(3, 3\), after \(4, 3\)"),
        (TRIANGLE, Mesh(TRIANGLE.points, np.array([[0, 2, 1]])), "not the same triangles"),
        (
            Mesh(np.eye(3), TRIANGLE.faces, np.ones((3, 1)), "channels"),
            Mesh(np.eye(3), TRIANGLE.faces, np.ones((3, 2)), "channels"),
            r"channels \(3, 1\), after \(3, 2\)",
        ),
        (_half(left=True), _half(left=False), "no sample in common"),
    ],
)
def test_two_surfaces_that_cannot_be_compared_are_refused(before, after, says, tmp_path):
    with pytest.raises(InputError, match=says):
        compare(before, after, tmp_path / "a.png")


@pytest.mark.parametrize(
    ("data", "options", "says"),
    [
        (plane(), {"size": (100, 100)}, "240 to 16000"),
        (plane(), {"size": (640,)}, "a width and a height"),
        (plane(), {"altitude": 0}, "altitude above 0"),
        (plane(), {"exaggeration": -1}, "exaggeration: a positive"),
        (RangeImage(np.ones((3, 3)), CAMERA), {"exaggeration": 2}, "of height fields only"),
        (plane(), {"up": "z"}, "of meshes only"),
        (TRIANGLE, {"up": "w"}, "up: y or z expected"),
        (plane(), {"renderer": "opengl"}, "pyvista or hillshade expected"),
        (TRIANGLE, {"renderer": "hillshade"}, "a mesh has no grid"),
        (Image(np.ones((3, 3))), {"renderer": "pyvista"}, "as the image it is"),
        (plane(), {"scalars": np.ones((3, 3))}, r"of shape \(12, 15\); got \(3, 3\)"),
        (plane(), {"scalars": np.full((12, 15), np.nan)}, "at least one finite number"),
        (HeightField([[1.0, np.nan], [np.nan, 1.0]]), {}, "nothing to draw"),
        (object(), {}, "meshflow"),
    ],
)
def test_what_makes_no_sense_is_refused(data, options, says, tmp_path):
    with pytest.raises(InputError, match=says):
        show(data, tmp_path / "a.png", **options)
    assert list(tmp_path.iterdir()) == []


def test_paths_that_cannot_be_written_are_refused_before_anything_is_drawn(tmp_path):
    (tmp_path / "folder.png").mkdir()
    for name, says in (
        ("a.svg", r"ends in \.png"),
        ("a", "no extension"),
        ("nowhere/a.png", "does not exist"),
        ("folder.png", "is a folder"),
    ):
        with pytest.raises(FormatError, match=says):
            show(plane(), tmp_path / name)


def test_a_window_needs_a_display_and_vtk(monkeypatch):
    for call in (lambda: show(plane()), lambda: compare(plane(), plane())):
        with pytest.raises(InputError, match="give a path"):
            call()
    monkeypatch.setenv("DISPLAY", ":0")
    with pytest.raises(InputError, match="not windows"):
        show(plane(), renderer="hillshade")
