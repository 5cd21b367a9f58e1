"""Films and blinking pictures: what is in their frames, and what becomes of a file that fails."""

import numpy as np
import pytest
from PIL import Image as Pillow

from meshflow import film
from meshflow.errors import FormatError, InputError, MissingPackage
from meshflow.estimate.request import Request
from meshflow.flow.compute import Compute
from meshflow.flow.offsets import without_offsets
from meshflow.flow.stops import Residual, Steps
from meshflow.results.run import run, states
from meshflow.surfaces.camera import Pinhole
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.synthetic import shapes
from meshflow.view import compare
from meshflow.view.frames import Frames
from meshflow.view.look import terrain_view

SIZE = (320, 240)
ROUGH = HeightField(np.random.default_rng(0).normal(size=(40, 50)) + 5.0 * (np.arange(50) > 25), unit="m")
GIVEN = Request.of(method="beltrami", time=2.0)


@pytest.fixture(autouse=True)
def _without_opengl(monkeypatch, request):
    if "needs_gl" not in request.keywords:
        monkeypatch.setenv("MESHFLOW_RENDERING", "off")
    monkeypatch.delenv("DISPLAY", raising=False)


def frames(path):
    with Pillow.open(path) as file:
        pictures = []
        for k in range(file.n_frames):
            file.seek(k)
            pictures.append(np.asarray(file.convert("RGB"), dtype=int))
        return pictures


def test_states_begin_with_the_data_and_end_with_what_smoothing_gives():
    times, surfaces = zip(*states(ROUGH, GIVEN, 5), strict=True)
    np.testing.assert_allclose(times, 2.0 * (np.arange(5) / 4) ** 2)
    np.testing.assert_array_equal(surfaces[0].z, ROUGH.z)
    np.testing.assert_allclose(surfaces[-1].z, run(ROUGH, GIVEN).after.z, atol=0.03)  # other steps
    steps = [
        data.z
        for _, data in states(
            ROUGH, Request.of(method="heat", stop=Steps(8), compute=Compute(stepper="explicit", dt=0.1)), 3
        )
    ]
    assert len(steps) == 3
    ended = run(ROUGH, Request.of(method="heat", stop=Steps(8), compute=Compute(stepper="explicit", dt=0.1))).after.z
    np.testing.assert_array_equal(steps[-1], ended)


def test_a_stop_is_where_the_states_end():
    request = Request.of(method="heat", stop=Residual(0.5))
    *_, (time, last) = states(ROUGH, request, 4)
    ended = run(ROUGH, request)
    assert time == pytest.approx(ended.end.time)
    np.testing.assert_allclose(last.z, ended.after.z, atol=0.15)  # that one lies on a line between steps


def test_what_takes_one_step_is_stepped_afresh_for_each_state():
    sphere = shapes.sphere(3)
    mesh = Mesh(
        sphere.points * (1 + 0.02 * np.random.default_rng(0).normal(size=(len(sphere.points), 1))), sphere.faces
    )
    request = Request.of(method="fairing", time=0.01)
    found = list(states(mesh, request, 4))
    assert [time for time, _ in found] == pytest.approx([0.0, 0.01 / 9, 0.04 / 9, 0.01])
    end = without_offsets(found[-1][1].points, mesh.points, mesh.faces, np.zeros(len(mesh.points), bool))
    np.testing.assert_allclose(end, run(mesh, request).after.points, atol=1e-9)


def test_a_film_shows_the_noise_go_and_the_last_frame_stay(tmp_path):
    reported = film(ROUGH, tmp_path / "a.gif", count=5, request=GIVEN, size=SIZE)
    shown = frames(reported.path)
    assert len(shown) == 5
    rough = [np.abs(np.diff(picture[60:180, 60:250], axis=1)).mean() for picture in shown]
    assert rough[0] > 2 * rough[-1]
    with Pillow.open(reported.path) as file:
        file.seek(4)
        assert file.info["duration"] > 1000


def test_the_time_in_a_frame_is_a_number_in_full_with_its_unit(tmp_path, monkeypatch):
    from meshflow.view import page

    drawn, labels = page.single_page, []

    def listened(*given):
        labels.extend(label for _, label in given[5])
        return drawn(*given)

    monkeypatch.setattr(page, "single_page", listened)
    wide = HeightField(ROUGH.z, spacing=(30.0, 30.0), unit="m")
    film(wide, tmp_path / "a.gif", count=3, request=Request.of(time=2540.0, method="heat"), size=SIZE)
    assert labels == ["time 0 m²", "time 635 m²", "time 2540 m²"]


def test_colours_of_a_film_are_the_same_in_all_frames(tmp_path):
    reported = film(ROUGH, tmp_path / "a.png.gif", count=4, request=Request.of(time=2.0), quantity="removed", size=SIZE)
    shown = frames(reported.path)
    bars = [picture[208:230] for picture in shown]
    assert np.abs(bars[0] - bars[-1]).max() < 12
    assert np.ptp(shown[-1][60:150], axis=2).max() > np.ptp(shown[0][60:150], axis=2).max() + 40


def test_images_and_range_images_are_filmed_as_they_are(tmp_path):
    picture = Image(np.random.default_rng(0).random((30, 40, 3)) * 255)
    assert film(picture, tmp_path / "a.gif", count=3, request=Request.of(time=1.0), size=SIZE).renderer == "hillshade"
    scan = RangeImage(2.0 + 0.01 * ROUGH.z, Pinhole(60.0, 60.0, 24.5, 19.5))
    assert len(frames(film(scan, tmp_path / "b.gif", count=3, size=SIZE).path)) == 3


def test_an_mp4_holds_all_frames(tmp_path):
    imageio = pytest.importorskip("imageio")
    pytest.importorskip("imageio_ffmpeg")
    reported = film(ROUGH, tmp_path / "a.mp4", count=4, rate=4.0, request=Request.of(time=2.0), size=(321, 241))
    with imageio.get_reader(reported.path) as reader:
        assert reader.count_frames() == 4 + 6  # the last one stays for a second and a half
        assert reader.get_data(0).shape == (240, 320, 3)


@pytest.mark.needs_gl
def test_a_camera_that_turns_keeps_the_whole_surface_in_its_frame(tmp_path):
    sphere = shapes.sphere(3)
    mesh = Mesh(sphere.points * (1.0, 1.0, 2.0), sphere.faces)
    reported = film(
        mesh, tmp_path / "a.gif", count=3, turn=90.0, request=Request.of(time=1e-4, method="curvature"), size=SIZE
    )
    shown = frames(reported.path)
    for picture in shown:
        body = (picture[40:190] < 240).all(axis=2)
        assert 0.02 < body.mean() < 0.5
        assert not body[:, [0, -1]].any()
    assert np.abs(shown[0] - shown[-1]).max() > 50


def test_who_walks_around_a_terrain_sees_it_from_there():
    view = terrain_view()
    turned = view.turned(90.0)
    np.testing.assert_allclose(turned.toward, [-view.toward[1], view.toward[0], view.toward[2]], atol=1e-12)
    np.testing.assert_allclose(view.turned(360.0).up, view.up, atol=1e-12)
    np.testing.assert_allclose(turned.ground, view.ground)


@pytest.mark.parametrize("name", ["a.gif", "a.png"])
def test_a_picture_that_blinks_has_two_frames(tmp_path, name):
    reported = compare(ROUGH, HeightField(np.zeros((40, 50))), tmp_path / name, arrange="blink", size=SIZE)
    one, other = frames(reported.path)
    assert np.abs(one - other).max() > 30
    assert (one[:30, :12] == 255).all()
    assert (other[:30, :12] == 255).all()


def test_a_film_that_fails_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    target = tmp_path / "a.gif"
    target.write_bytes(b"old")

    def full(self, *args, **options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Pillow.Image, "save", full)
    with pytest.raises(FormatError, match="No space left"), Frames(target, 5.0) as file:
        file.add(np.zeros((8, 8, 3), np.uint8))
    assert target.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.gif"]


def test_a_film_that_is_there_is_replaced_on_purpose_alone(tmp_path, monkeypatch):
    target = tmp_path / "a.gif"
    target.write_bytes(b"old")
    given = {"count": 2, "request": Request.of(time=1.0, method="beltrami"), "size": SIZE}
    with monkeypatch.context() as nothing:
        nothing.setattr("meshflow.viewer.filming.flowing", None)  # it is refused before anything is computed
        with pytest.raises(FormatError, match="exists; name another file, or overwrite it on purpose"):
            film(ROUGH, target, **given)
    assert target.read_bytes() == b"old"
    film(ROUGH, target, overwrite=True, **given)
    assert len(frames(target)) == 2


def test_without_ffmpeg_the_install_line_is_named(tmp_path, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(MissingPackage, match=r"pip install 'meshflow\[film\]'"):
        film(ROUGH, tmp_path / "a.mp4", request=GIVEN)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"count": 1}, "count: a whole number, 2 or more"),
        ({"rate": 0.0}, "rate: 0.1 to 60 frames per second"),
        ({"rate": float("nan")}, "rate: 0.1 to 60 frames per second"),
        ({"turn": 90.0, "renderer": "hillshade"}, "turn: degrees"),
        ({"colours": "virids"}, "viridis"),
        ({"request": Request.of(domain="disparity")}, "states can be shown for domain=.length. only"),
        ({"fps": 3}, "fps: no such option of a film; did you mean rate"),
    ],
)
def test_a_film_that_makes_no_sense_is_refused(options, says, tmp_path):
    with pytest.raises(InputError, match=says):
        film(ROUGH, tmp_path / "a.gif", **options)
    assert list(tmp_path.iterdir()) == []


def test_a_film_is_asked_where_it_goes_before_it_is_computed(tmp_path, monkeypatch):
    monkeypatch.setattr("meshflow.viewer.filming.flowing", None)
    for name, says in (("a.avi", "ends in .mp4, .gif"), ("no/a.gif", "create it first")):
        with pytest.raises(FormatError, match=says):
            film(ROUGH, tmp_path / name)
