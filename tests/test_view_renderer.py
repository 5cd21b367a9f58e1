"""Pictures that VTK draws."""

import numpy as np
import pytest

from meshflow.errors import InputError
from meshflow.surfaces.camera import Pinhole
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.view import compare, page, show, vtk_scene
from meshflow.view.geometry import geometry_of
from meshflow.view.look import Look
from meshflow.view.probe import Rendering
from meshflow.view.renderer import renderer_for
from meshflow.view.scale import Scale

pytestmark = pytest.mark.needs_gl
CAMERA = Pinhole(60.0, 60.0, 31.5, 23.5)
SIZE = (640, 480)


def hill(height=8.0):
    rows, columns = np.mgrid[:48, :64]
    return HeightField(height * np.exp(-((rows - 24.0) ** 2 + (columns - 32.0) ** 2) / 100), unit="m")


def ball(radius=1.0):
    pv = pytest.importorskip("pyvista")
    sphere = pv.Sphere(radius=radius, theta_resolution=40, phi_resolution=40)
    return Mesh(np.array(sphere.points, float), sphere.faces.reshape(-1, 4)[:, 1:])


def wall():
    return RangeImage(np.full((48, 64), 2.0), CAMERA)


def noisy(data):
    noise = np.random.default_rng(0).normal(size=(48, 64))
    if isinstance(data, HeightField):
        return HeightField(data.z + 0.5 * noise)
    if isinstance(data, RangeImage):
        return RangeImage(data.depth + 0.01 * noise, CAMERA)
    return Mesh(data.points * (1 + 0.01 * np.random.default_rng(0).normal(size=(len(data.points), 1))), data.faces)


def panels(reported, look, data):
    from matplotlib.image import imread

    stage = renderer_for((data, data), look, window=False)
    boxes = page.layout(look, stage.aspect(*stage.geometries(data), data)).panels
    picture = np.round(imread(reported.path)[..., :3] * 255).astype(int)
    bottom = [look.size[1] - box.bottom for box in boxes]
    return [picture[b - x.height : b, x.left : x.left + x.width] for x, b in zip(boxes, bottom, strict=True)]


def drawn(data, scale=None, look=None):
    (body,) = renderer_for((data,), look or Look(), window=False).geometries(data)
    return vtk_scene.drawn(body, look or Look(), (200, 150), scale).astype(int)


def colourful(picture):
    return np.ptp(picture, axis=2)


@pytest.mark.parametrize("data", [hill(), ball(), wall()], ids=lambda data: type(data).__name__)
def test_before_and_after_differ_in_the_picture_as_in_the_data(data, tmp_path):
    rough = noisy(data)
    reported = compare(rough, data, tmp_path / "a.png", size=SIZE)
    assert reported.renderer == "pyvista"
    first, second, removed = panels(reported, Look(size=SIZE), rough)
    body = (second < 250).all(axis=2)
    assert body.mean() > 0.2, "the body does not fill the frame"
    assert (np.abs(first - second).max(axis=2) > 15)[body].mean() > 0.3
    assert (colourful(removed) > 60).mean() > 0.05


@pytest.mark.parametrize("data", [hill(), ball(), wall()], ids=lambda data: type(data).__name__)
def test_a_surface_that_did_not_change_is_drawn_twice_alike_and_a_third_time_without_colour(data, tmp_path):
    reported = compare(data, data, tmp_path / "a.png", size=SIZE)
    first, second, removed = panels(reported, Look(size=SIZE), data)
    assert "before and after are equal" in reported.notes
    assert (first < 250).all(axis=2).mean() > 0.2
    assert (first == second).all()
    assert (removed < 250).all(axis=2).mean() > 0.2
    assert colourful(removed).max() <= 4


def test_a_mesh_that_shrank_is_red_and_one_that_grew_is_blue(tmp_path):
    for size, channel in ((0.9, 0), (1.1, 2)):
        reported = compare(ball(), ball(size), tmp_path / "a.png", size=SIZE, overwrite=True)
        removed = panels(reported, Look(size=SIZE), ball())[2]
        strong = removed[colourful(removed) > 60]
        assert len(strong) > 100
        assert (strong.argmax(axis=1) == channel).all()


def test_the_frame_holds_both_bodies(tmp_path):
    reported = compare(ball(), ball(1.5), tmp_path / "a.png", size=SIZE)
    small, large, _ = panels(reported, Look(size=SIZE), ball())
    rim = np.concatenate([large[:2].reshape(-1, 3), large[-2:].reshape(-1, 3)])
    assert (rim == 255).all()
    share = (small < 250).all(axis=2).sum() / (large < 250).all(axis=2).sum()
    assert abs(share - 1 / 1.5**2) < 0.05, "not drawn to one scale"


def test_north_is_up_and_east_is_right_in_the_picture_of_a_terrain():
    values = np.zeros((48, 64))
    values[:10, -14:] = 1.0  # north-east
    picture = drawn(hill(), Scale(values, -1.0, 1.0, "RdBu_r", ""))
    row, column = np.argwhere(picture[..., 0] > picture[..., 2] + 60).mean(axis=0)
    assert row < 75
    assert column > 100


def test_a_range_image_is_seen_as_its_camera_saw_it():
    values = np.zeros((48, 64))
    values[:10, -14:] = 1.0  # top right
    picture = drawn(wall(), Scale(values, -1.0, 1.0, "RdBu_r", ""))
    row, column = np.argwhere(picture[..., 0] > picture[..., 2] + 60).mean(axis=0)
    assert row < 75
    assert column > 100


def test_light_from_the_west_brightens_western_slopes():
    picture = drawn(hill(20.0), look=Look(azimuth=270.0, exaggeration=1.0)).sum(axis=2)
    (body,) = renderer_for((hill(20.0),), Look(), window=False).geometries(hill(20.0))
    assert body.view.right[0] > 0.9, "east is not to the right"
    middle = picture[60:90]
    assert middle[:, 65:95].mean() > middle[:, 105:135].mean() + 30


def test_faces_are_shaded_flat():
    pyramid = Mesh(
        np.array([[1.0, 0, 0], [-0.5, 0.8, 0], [-0.5, -0.8, 0], [0, 0, 1.0]]),
        np.array([[0, 1, 3], [1, 2, 3], [2, 0, 3], [0, 2, 1]]),
    )
    picture = drawn(pyramid).reshape(-1, 3)
    colours, counts = np.unique(picture[(picture < 250).all(axis=1)], axis=0, return_counts=True)
    assert np.sort(counts)[-2:].sum() > 0.8 * counts.sum(), f"{len(colours)} colours on two visible faces"


def test_what_is_up_of_a_mesh_is_guessed_or_told():
    ends = {"bust": (0.8, 1.0, 0.7), "horse": (0.8, 1.8, 1.5), "terrain": (1.0, 1.0, 0.1)}
    ups = {
        name: geometry_of(Mesh(np.eye(3) * extent, np.array([[0, 1, 2]])), Look()).view.up
        for name, extent in ends.items()
    }
    assert {name: "xyz"[int(np.argmax(up))] for name, up in ups.items()} == {"bust": "y", "horse": "z", "terrain": "z"}
    reported = geometry_of(Mesh(np.eye(3), np.array([[0, 1, 2]])), Look(up="y")).view.up
    assert np.argmax(reported) == 1


def test_colours_that_move_are_shown_on_the_mesh():
    red = np.full((len(ball().points), 3), (200.0, 10.0, 10.0))
    picture = drawn(Mesh(ball().points, ball().faces, red, moves="channels"))
    assert (picture[..., 0] > picture[..., 1] + 60).mean() > 0.2
    assert colourful(drawn(Mesh(ball().points, ball().faces, red, moves="points"))).max() < 40  # they only ride along


def test_missing_samples_leave_a_hole():
    field = hill()
    hole = np.zeros(field.z.shape, bool)
    hole[15:33, 20:44] = True
    whole, holed = drawn(field), drawn(HeightField(field.z, missing=hole))
    assert (holed[75, 100] == 255).all()
    assert (whole[75, 100] < 250).all()


def test_the_picture_has_the_size_asked_for_and_no_plotter_is_left(tmp_path, monkeypatch):
    from matplotlib.image import imread
    from pyvista.plotting import plotter as plotters

    open_before = len(plotters._ALL_PLOTTERS)
    reported = show(ball(), tmp_path / "a.png", size=(701, 503), title="A ball")
    assert imread(reported.path).shape[:2] == (503, 701)
    assert len(plotters._ALL_PLOTTERS) == open_before

    def fails(self, *args, **options):
        raise RuntimeError("the driver gave up")

    monkeypatch.setattr("pyvista.Plotter.screenshot", fails)
    old = reported.path.read_bytes()
    with pytest.raises(RuntimeError, match="gave up"):
        show(ball(), reported.path, overwrite=True)
    assert reported.path.read_bytes() == old
    assert [p.name for p in tmp_path.iterdir()] == ["a.png"]
    assert len(plotters._ALL_PLOTTERS) == open_before


@pytest.mark.parametrize(
    "data",
    [hill(), ball(), wall(), Image(np.random.default_rng(0).random((48, 64, 3)))],
    ids=lambda data: type(data).__name__,
)
def test_a_window_shows_all_panels_from_one_camera(data, monkeypatch):
    pv = pytest.importorskip("pyvista")
    seen = {}

    def look_at(plotter, **options):
        seen["picture"] = plotter.screenshot(None, return_img=True)[..., :3].astype(int)
        seen["cameras"] = {id(renderer.camera) for renderer in plotter.renderers}

    monkeypatch.setattr(pv.Plotter, "show", look_at)
    monkeypatch.setattr(pv, "OFF_SCREEN", True)
    monkeypatch.setattr("meshflow.view.pictures.displayed", lambda: True)
    monkeypatch.setattr("meshflow.view.renderer.rendering", lambda: Rendering(True, None, "for this test"))
    reported = compare(data, data, size=(600, 400))
    assert (reported.path, reported.renderer) == (None, "pyvista")
    assert seen["picture"].shape == (400, 600, 3)
    assert len(seen["cameras"]) == 1
    upper, lower = seen["picture"][30:195], seen["picture"][205:]
    for panel in (upper[:, 5:295], upper[:, 305:595], lower[:, 5:595]):
        assert (panel < 250).any(axis=2).mean() > 0.1, "a panel is empty"


def test_a_window_is_refused_where_vtk_draws_into_files_alone(monkeypatch):
    monkeypatch.setenv("DISPLAY", ":77")
    answer = Rendering(True, "vtkEGLRenderWindow", "VTK draws with vtkEGLRenderWindow")
    monkeypatch.setattr("meshflow.view.renderer.rendering", lambda: answer)
    with pytest.raises(InputError, match="a display that VTK can draw on"):
        show(hill())
