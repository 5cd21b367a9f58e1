"""Wipe, blink, sides, colours of their own, notebooks: what of a pair or a thing is seen, and how."""

import numpy as np
import pytest
import trimesh
from matplotlib.image import imread

import meshflow
from meshflow.errors import FormatError, InputError, MissingPackage
from meshflow.surfaces.camera import Pinhole
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.synthetic import shapes
from meshflow.view import compare, measured, page, plotter, show
from meshflow.view.appearance import taken
from meshflow.view.geometry import Geometry, geometry_of
from meshflow.view.look import Look, picture_view, side_view
from meshflow.view.turning import coarse
from meshflow.viewer.screen import Screen

SIZE = (640, 480)
ROWS, COLUMNS = np.mgrid[:48, :64]
ROUGH = HeightField(np.random.default_rng(0).normal(size=(48, 64)), unit="m")
FLAT = HeightField(np.zeros((48, 64)), unit="m")
SPHERE = shapes.sphere(3)
BALL = Mesh(SPHERE.points, SPHERE.faces)


@pytest.fixture(autouse=True)
def _headless(monkeypatch, request):
    if "needs_gl" not in request.keywords:
        monkeypatch.setenv("MESHFLOW_RENDERING", "off")
    monkeypatch.delenv("DISPLAY", raising=False)


def panel(path, aspect, look):
    (box,) = page.layout(look, aspect, 1, labelled=True, scaled=False).panels
    picture = np.round(imread(path)[..., :3] * 255).astype(int)
    bottom = look.size[1] - box.bottom
    return picture[bottom - box.height : bottom, box.left : box.left + box.width]


@pytest.mark.parametrize("at", [0.0, 0.3, 1.0])
def test_a_wipe_is_before_to_the_left_of_its_divider_and_after_to_its_right(at, tmp_path):
    look, aspect = Look(size=SIZE), 64 / 48
    whole = [
        panel(compare(a, b, tmp_path / "w.png", arrange="wipe", at=0.5, size=SIZE, overwrite=True).path, aspect, look)
        for a, b in ((ROUGH, ROUGH), (FLAT, FLAT))
    ]
    mixed = panel(compare(ROUGH, FLAT, tmp_path / "a.png", arrange="wipe", at=at, size=SIZE).path, aspect, look)
    height, width = mixed.shape[:2]
    left = (width - height * aspect) / 2
    place = left + at * (width - 2 * left)
    for column in np.linspace(left + 10, width - left - 10, 9).astype(int):
        if abs(column - place) > 12 and abs(column - width / 2) > 12:
            expected = whole[0] if column < place else whole[1]
            np.testing.assert_array_equal(mixed[20:-20, column], expected[20:-20, column])


@pytest.mark.needs_gl
@pytest.mark.parametrize("kind", ["terrain", "camera"])
def test_the_divider_of_a_window_is_a_line_on_the_screen_whatever_the_camera_does(kind):
    wall = RangeImage(np.full((48, 64), 2.0), Pinhole(60.0, 60.0, 31.5, 23.5))
    pair = (ROUGH, FLAT) if kind == "terrain" else (RangeImage(wall.depth + 0.02 * ROUGH.z, wall.camera), wall)

    def drawn(one, other, at, turned):
        window = plotter(one, other, arrange="wipe", at=at, off_screen=True, size=SIZE)
        if turned:
            window.camera.Azimuth(20)
            window.camera.Roll(10)
        picture = window.screenshot(None, return_img=True).astype(int)
        window.close()
        return picture[60:-80]

    for turned in (False, True):
        mixed = drawn(*pair, 0.4, turned)
        for side, at in ((np.s_[:, : int(0.4 * 640) - 3], 1.0), (np.s_[:, int(0.4 * 640) + 3 :], 0.0)):
            whole = drawn(*pair, at, turned)
            assert (np.abs(mixed[side] - whole[side]).max(axis=2) > 30).mean() < 0.01, f"{kind}, turned: {turned}"


@pytest.mark.needs_gl
def test_a_key_shows_before_after_and_both():
    window = plotter(ROUGH, FLAT, arrange="blink", off_screen=True, size=SIZE)
    pictures = [window.screenshot(None, return_img=True)[60:-80].astype(int)]
    for _ in range(3):
        window.iren._key_press_event_callbacks["space"][0]()
        pictures.append(window.screenshot(None, return_img=True)[60:-80].astype(int))
    window.close()
    before, after, both, again = pictures
    assert (before == again).all()
    assert np.abs(before - after).mean() > 2
    assert np.abs(both[:, :310] - before[:, :310]).mean() < 0.5 < np.abs(both[:, 330:] - before[:, 330:]).mean()


def test_an_image_from_the_side_is_the_terrain_of_its_brightness():
    from meshflow.view.geometry import raised

    image = Image(np.stack([COLUMNS, ROWS, 2 * ROWS], axis=2) * 1.0, missing=(ROWS == 3))
    field = raised(image, "side")
    assert isinstance(field, HeightField)
    np.testing.assert_allclose(field.z, COLUMNS / 3 + ROWS)
    np.testing.assert_array_equal(field.missing, image.missing)
    assert raised(image, "front") is image


def test_a_range_image_from_the_side_is_seen_from_beside_its_camera_and_above():
    view = side_view()
    right, up, toward = view.right, view.up, view.toward
    assert toward[2] < 0  # still in front of it
    assert toward[0] > 0.5
    assert toward[1] < 0  # y is down
    assert up[1] < -0.5
    np.testing.assert_allclose(np.stack([right, up, toward]) @ np.stack([right, up, toward]).T, np.eye(3), atol=1e-12)
    assert not view.pinhole


def test_a_terrain_from_the_front_is_its_map():
    body = geometry_of(ROUGH, Look(seen="front"))
    np.testing.assert_allclose(body.view.toward, picture_view().toward)
    around = [geometry_of(BALL, Look(seen=seen)).view.toward for seen in (None, "side")]
    assert abs(np.dot(*around)) < 0.3  # a quarter turn


@pytest.mark.needs_gl
def test_a_mesh_is_drawn_in_its_own_colours_where_that_is_asked(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    pv = pytest.importorskip("pyvista")
    mesh = trimesh.Trimesh(SPHERE.points, SPHERE.faces, process=False, vertex_colors=[[200, 10, 10, 255]] * 642)
    poly = pv.PolyData.from_regular_faces(SPHERE.points, SPHERE.faces)
    poly.point_data["RGB"] = np.full((642, 3), (200, 10, 10), np.uint8)
    for data in (mesh, poly):
        for own, red in ((True, True), (False, False)):
            picture = imread(show(data, tmp_path / "a.png", own_colours=own, size=SIZE, overwrite=True).path)
            assert ((picture[..., 0] > picture[..., 1] + 0.2).mean() > 0.1) == red


def test_files_can_be_shown_as_they_were_read(tmp_path):
    np.save(tmp_path / "a.npy", ROUGH.z)
    document = meshflow.read(tmp_path / "a.npy")
    assert show(document, tmp_path / "a.png", size=SIZE).renderer == "hillshade"
    assert compare(document, document, tmp_path / "b.png", size=SIZE).path == tmp_path / "b.png"


@pytest.mark.parametrize("quantity", ["curvature", "edges", "triangles", "samples"])
def test_before_and_after_wear_one_scale_of_a_quantity(quantity, tmp_path):
    reported = compare(ROUGH, FLAT, tmp_path / "a.png", quantity=quantity, size=SIZE)
    assert reported.renderer == "hillshade"
    boxes = page.layout(Look(size=SIZE), 64 / 48, 2).panels
    assert boxes[0].size == boxes[1].size
    one = show(ROUGH, tmp_path / "b.png", quantity=quantity, colours="cividis", size=SIZE)
    assert imread(one.path).shape == (480, 640, 4)


def test_a_notebook_shows_the_picture_itself(tmp_path):
    reported = show(ROUGH, tmp_path / "a.png", size=SIZE)
    bundle = reported._repr_mimebundle_()
    assert bundle["image/png"] == reported.path.read_bytes()
    assert set(show(ROUGH, tmp_path / "a.tif", size=SIZE)._repr_mimebundle_()) == {"text/plain"}


@pytest.mark.needs_gl
def test_a_plotter_is_ours_to_draw_and_to_add_to():
    window = plotter(BALL, quantity="curvature", off_screen=True, size=SIZE)
    window.add_text("mine")
    picture = window.screenshot(None, return_img=True)
    window.close()
    assert picture.shape[1::-1] == SIZE
    assert (picture[..., :3] < 250).all(axis=2).mean() > 0.2


def test_a_coarse_geometry_is_the_same_surface_in_fewer_triangles():
    fine = shapes.sphere(6)
    body = Geometry(fine.points, fine.faces, np.arange(len(fine.points)), picture_view())
    few = coarse(body, 24)
    assert len(few.faces) < len(body.faces) / 4
    np.testing.assert_array_equal(few.points, fine.points[few.samples])
    np.testing.assert_allclose(np.ptp(few.points, axis=0), 2.0, atol=0.1)
    sides = np.sort(np.concatenate([few.faces[:, [0, 1]], few.faces[:, [1, 2]], few.faces[:, [2, 0]]]), axis=1)
    _, counts = np.unique(sides, axis=0, return_counts=True)
    assert (counts == 1).sum() < 0.01 * len(counts), "it has holes"
    middles = [
        points[faces].mean(axis=1)
        for points, faces in ((fine.points, fine.faces[few.triangles]), (few.points, few.faces))
    ]
    assert np.abs(middles[0] - middles[1]).max() < 3 * 2 / 24


@pytest.mark.needs_gl
def test_what_is_heavy_is_coarse_while_it_turns(monkeypatch):
    monkeypatch.setattr("meshflow.view.vtk_scene.HEAVY", 100)
    monkeypatch.setattr("meshflow.view.vtk_scene.coarse", lambda body: coarse(body, 8))
    window = plotter(BALL, off_screen=True, size=SIZE)
    fine, few = list(window.renderer.actors.values())[:2]
    assert fine.mapper.dataset.n_cells > few.mapper.dataset.n_cells

    def seen():
        return bool(fine.GetVisibility()), bool(few.GetVisibility())

    assert seen() == (True, False)
    style = window.iren.get_interactor_style()
    style.InvokeEvent("StartInteractionEvent")
    assert seen() == (False, True)
    style.InvokeEvent("EndInteractionEvent")
    assert seen() == (True, False)
    window.close()


@pytest.mark.needs_gl
def test_each_state_of_a_heavy_geometry_is_coarse_while_it_turns(monkeypatch):
    pv = pytest.importorskip("pyvista")
    monkeypatch.setattr("meshflow.view.vtk_scene.HEAVY", 100)
    monkeypatch.setattr("meshflow.view.vtk_scene.coarse", lambda body: coarse(body, 8))
    screen = Screen(BALL, Mesh(0.5 * BALL.points, BALL.faces), Look(size=SIZE), off_screen=True)
    style = screen.plotter.iren.get_interactor_style()

    def seen():
        (body,) = [a for a in screen.plotter.renderer.actors.values() if isinstance(a, pv.Actor) and a.GetVisibility()]
        return body.mapper.dataset.n_cells == len(BALL.faces), np.abs(body.mapper.dataset.points).max()

    for size, colouring in ((0.8, "surface"), (0.7, "surface"), (0.6, "removed")):
        screen.show(Mesh(size * BALL.points, BALL.faces), colouring)
        fine = (True, pytest.approx(size * np.abs(BALL.points).max(), rel=1e-6))
        assert seen() == fine
        style.InvokeEvent("StartInteractionEvent")
        whole, extent = seen()
        assert not whole
        assert extent == pytest.approx(size * np.abs(BALL.points).max(), rel=0.05)
        style.InvokeEvent("EndInteractionEvent")
        assert seen() == fine
    screen.plotter.close()


@pytest.mark.needs_gl
def test_what_is_heavy_is_coarse_on_both_sides_of_a_divider_while_it_turns(monkeypatch):
    pv = pytest.importorskip("pyvista")
    monkeypatch.setattr("meshflow.view.vtk_scene.HEAVY", 100)
    monkeypatch.setattr("meshflow.view.vtk_scene.coarse", lambda body: coarse(body, 8))
    window = plotter(BALL, Mesh(0.9 * BALL.points, BALL.faces), arrange="wipe", off_screen=True, size=SIZE)
    bodies = [actor for actor in window.renderer.actors.values() if isinstance(actor, pv.Actor)]
    many = [actor.mapper.dataset.n_cells for actor in bodies]
    assert sorted(many)[:2] < [len(BALL.faces)] * 2 == sorted(many)[2:]

    def seen():
        window.render()
        return [bool(actor.GetVisibility()) for actor in bodies]

    fine = [count == len(BALL.faces) for count in many]
    whole = window.screenshot(None, return_img=True)[60:-80].astype(int)
    assert seen() == fine
    style = window.iren.get_interactor_style()
    style.InvokeEvent("StartInteractionEvent")
    assert seen() == [not of for of in fine]
    few = window.screenshot(None, return_img=True)[60:-80].astype(int)
    window.iren._key_press_event_callbacks["space"][0]()  # before alone: one coarse body
    assert sum(seen()) == 1
    assert not any(there and of for there, of in zip(seen(), fine, strict=True))
    style.InvokeEvent("EndInteractionEvent")
    assert [there and of for there, of in zip(seen(), fine, strict=True)] == seen()
    window.close()
    # The coarse ones are cut by the same divider: apart from their facets the picture is the same.
    body = [(picture < 250).all(axis=2) for picture in (whole, few)]
    assert (body[0] != body[1]).mean() < 0.05


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"arrange": "above"}, "arrange: one of beside, wipe, blink expected, got 'above'"),
        ({"arrange": "wipe", "at": 1.5}, r"0 \(left\) to 1 \(right\), expected, got 1.5"),
        ({"quantity": "colour"}, "quantity: one of curvature"),
        ({"colours": "nonsense"}, "got 'nonsense'; viridis, cividis, RdBu_r"),
        ({"seen": "behind"}, "seen: front or side expected, got 'behind'"),
        ({"seen": "side", "renderer": "hillshade"}, "is seen from the front"),
        ({"own_colours": True}, "own_colours: of meshes only, this is a HeightField"),
        ({"color": "red"}, "color: no such option of a picture; there are exaggeration"),
    ],
)
def test_what_makes_no_sense_is_refused(options, says, tmp_path):
    with pytest.raises(InputError, match=says):
        compare(ROUGH, FLAT, tmp_path / "a.png", **options)
    assert list(tmp_path.iterdir()) == []


def test_a_mesh_without_colours_has_none_to_be_shown(tmp_path):
    for data in (BALL, (SPHERE.points, SPHERE.faces)):
        with pytest.raises(InputError, match="neither colours of its vertices nor a texture"):
            taken(data, own_colours=True)


def test_what_cannot_be_drawn_is_refused_and_no_window_is_left(tmp_path):
    with pytest.raises(InputError, match="a window needs a display"):
        compare(ROUGH, FLAT, arrange="wipe")
    with pytest.raises(MissingPackage, match="MESHFLOW_RENDERING"):
        plotter(ROUGH, FLAT)
    with pytest.raises(MissingPackage, match="MESHFLOW_RENDERING"):
        show(ROUGH, tmp_path / "a.png", seen="side")
    with pytest.raises(InputError, match="two surfaces expected, got one"):
        plotter(ROUGH, quantity="removed")
    with pytest.raises(InputError, match="only one of them can be shown"):
        show(ROUGH, tmp_path / "a.png", scalars=ROUGH.z, quantity="curvature")
    with pytest.raises(FormatError, match=r"ends in .gif, .png; got .jpg"):
        compare(ROUGH, FLAT, tmp_path / "a.jpg", arrange="blink")
    with pytest.raises(FormatError, match=r"got .gif"):
        compare(ROUGH, FLAT, tmp_path / "a.gif")
    holes = np.full((8, 8), np.nan)
    holes[::3, ::3] = 1.0
    for quantity in (None, "curvature"):
        with pytest.raises(InputError, match="nothing to (draw|show)"):
            show(HeightField(holes), tmp_path / "a.png", quantity=quantity)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("arrange", ["beside", "wipe", "blink", None])
def test_a_picture_that_is_there_is_replaced_on_purpose_alone(arrange, tmp_path, monkeypatch):
    target = tmp_path / "a.png"
    target.write_bytes(b"old")

    def look(**options):
        if arrange is None:
            return show(ROUGH, target, size=SIZE, **options)
        return compare(ROUGH, FLAT, target, arrange=arrange, size=SIZE, **options)

    with pytest.raises(FormatError, match="exists; name another file, or overwrite it on purpose"):
        look()
    assert target.read_bytes() == b"old"
    assert imread(look(overwrite=True).path).shape[:2] == (480, 640)


def test_where_all_is_missing_there_is_nothing_to_draw(tmp_path):
    gone = np.full((8, 8), np.nan)
    np.save(tmp_path / "gone.npy", gone)
    looks = (
        lambda: show(gone, tmp_path / "a.png"),
        lambda: compare(ROUGH, np.full((48, 64), np.nan), tmp_path / "a.png"),
        lambda: show(meshflow.read(tmp_path / "gone.npy"), tmp_path / "a.png"),
        lambda: show((np.zeros((0, 3)), np.zeros((0, 3), int)), tmp_path / "a.png"),
        lambda: meshflow.film(gone, tmp_path / "a.gif"),
        lambda: show(RangeImage(gone, Pinhole(60.0, 60.0, 3.5, 3.5)), tmp_path / "a.png"),
    )
    for look in looks:
        with pytest.raises(InputError, match="nothing .*to draw"):
            look()
    assert [path.name for path in tmp_path.iterdir()] == ["gone.npy"]


@pytest.mark.needs_gl
@pytest.mark.parametrize("arrange", ["beside", "wipe"])
def test_a_window_that_fails_is_closed(arrange, monkeypatch):
    from pyvista.plotting import plotter as plotters

    open_before = len(plotters._ALL_PLOTTERS)

    def fails(self, *args, **options):
        raise RuntimeError("the driver gave up")

    monkeypatch.setattr("pyvista.Plotter.add_mesh", fails)
    with pytest.raises(RuntimeError, match="gave up"):
        plotter(ROUGH, FLAT, arrange=arrange, off_screen=True)
    assert len(plotters._ALL_PLOTTERS) == open_before


def test_colours_that_stand_for_nothing_are_refused(tmp_path):
    field = HeightField(np.arange(64.0).reshape(8, 8))
    with pytest.raises(InputError, match="nothing is shown as colour"):
        show(field, tmp_path / "a.png", colours="cividis")
    ball = trimesh.creation.icosphere(2)
    ball.visual.vertex_colors = [200, 100, 50, 255]
    with pytest.raises(InputError, match="cannot be shown together"):
        show(ball, tmp_path / "a.png", quantity="curvature", own_colours=True)


def test_a_quantity_is_measured_of_whatever_smooth_takes():
    ball = trimesh.creation.icosphere(3)
    assert np.median(measured(ball, "curvature").values) == pytest.approx(1.0, abs=0.02)


def test_both_triangles_of_a_cell_are_shaded_alike_and_a_plane_by_its_own_normal():
    y, x = np.mgrid[:5, :6].astype(float)
    rough = geometry_of(meshflow.HeightField(np.random.default_rng(0).normal(size=x.shape)), Look())
    pairs = rough.normals.reshape(2, -1, 3)  # upper and lower triangles, cell by cell
    np.testing.assert_allclose(pairs[0], pairs[1])
    np.testing.assert_allclose(np.linalg.norm(rough.normals, axis=1), 1.0)
    plane = geometry_of(meshflow.HeightField(2.0 * x), Look(exaggeration=3.0), exaggeration=3.0)
    np.testing.assert_allclose(plane.normals, [np.array([-6.0, 0.0, 1.0]) / np.sqrt(37.0)] * len(plane.faces))
    assert "Normals" in plane.polydata().cell_data
