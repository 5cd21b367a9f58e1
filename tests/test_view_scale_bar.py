"""How long, and where north is: what stands below a picture is true of what is in it."""

import imageio.v3 as imageio
import numpy as np
import pytest
import rasterio
from matplotlib.image import imread
from rasterio.transform import Affine

import meshflow
from meshflow.surfaces.camera import Pinhole
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.view import page, show
from meshflow.view.film import Reel, filmed
from meshflow.view.look import Look
from meshflow.view.scale_bar import Ground, ground_of, scale_bar_of
from meshflow.view.scene import of_one

SIZE = (800, 600)
LOOK = Look(size=SIZE)
UNIT = 0.5  # pixels of such a page for one of 1600 x 1200
FIELD = HeightField(np.random.default_rng(0).normal(size=(60, 80)), (10.0, 10.0), unit="m")
SQUARE = Mesh(np.array([[0, 0, 0], [3, 0, 0], [3, 2, 0], [0, 2, 0.0]]), [[0, 1, 2], [0, 2, 3]])


@pytest.fixture(autouse=True)
def _headless(monkeypatch, request):
    if "needs_gl" not in request.keywords:
        monkeypatch.setenv("MESHFLOW_RENDERING", "off")
    monkeypatch.delenv("DISPLAY", raising=False)


def bar(picture):
    """How long the bar at the foot of a picture is, pixels."""
    row = picture[-round(20 * UNIT) - 2 : -round(20 * UNIT) + 2, :, 0].min(axis=0) < 0.5
    ends = np.flatnonzero(np.diff(np.concatenate([[0], row, [0]])))
    return int(np.diff(ends)[::2].max())


def test_a_bar_over_a_relief_is_as_long_as_it_says(tmp_path):
    reported = show(FIELD, tmp_path / "a.png", size=SIZE)
    assert reported.renderer == "hillshade"
    picture = imread(reported.path)
    wide = np.flatnonzero((picture[:500, :, :3].min(axis=2) < 0.97).any(axis=0))
    metres = 800 / (wide[-1] + 1 - wide[0])
    ruler = of_one(FIELD, LOOK)
    (box,) = page.layout(LOOK, ruler.aspect, panels=1).panels
    foot = ruler.foot(box.size, UNIT)
    assert foot.scale_bar.words.endswith(" m")
    said = float(foot.scale_bar.words.split()[0])
    assert bar(picture) * metres == pytest.approx(said, rel=0.04)


@pytest.mark.needs_gl
def test_a_bar_below_a_mesh_is_as_long_as_it_says(tmp_path):
    picture = imread(show(SQUARE, tmp_path / "a.png", size=SIZE).path)
    wide = np.flatnonzero((picture[:540, :, :3].min(axis=2) < 0.97).any(axis=0))
    length = 3 / (wide[-1] + 1 - wide[0])
    words = scale_bar_of(length, "", UNIT, False).words
    assert bar(picture) * length == pytest.approx(float(words), rel=0.04)


@pytest.mark.needs_gl
@pytest.mark.parametrize("turn", [0.0, 40.0])
def test_a_bar_in_a_film_of_a_mesh_is_as_long_as_it_says_in_all_frames(tmp_path, turn):
    points, faces = np.asarray(SQUARE.points), SQUARE.faces
    states = [(0.0, SQUARE), (1.0, Mesh(points + [0, 0, 0.1], faces))]
    filmed(states, tmp_path / "a.gif", Look(size=SIZE), Reel(turn=turn))
    frames = imageio.imread(tmp_path / "a.gif") / 255.0
    bars = {bar(frame) for frame in frames[[0, -1]]}
    assert len(bars) == 1
    if not turn:
        wide = np.flatnonzero((frames[0][60:540, :, :3].min(axis=2) < 0.97).any(axis=0))
        length = 3 / (wide[-1] + 1 - wide[0])
        assert bars.pop() * length == pytest.approx(float(scale_bar_of(length, "", UNIT, False).words), rel=0.05)


def test_a_bar_is_round_and_at_most_an_eighth_of_the_page():
    for length in (0.00123, 0.5, 1.0, 7.7, 420.0):
        ruler = scale_bar_of(length, "m", 1.0, False)
        assert 220 / 2.5 <= ruler.pixels <= 220
        digit = ruler.pixels * length / 10.0 ** np.floor(np.log10(ruler.pixels * length) + 1e-9)
        assert round(digit, 6) in (1, 2, 5)


def test_what_has_no_length_that_holds_everywhere_has_no_bar():
    seen = RangeImage(np.full((48, 64), 2.0), Pinhole(60.0, 60.0, 31.5, 23.5))
    for data in (seen, Image(FIELD.z)):
        sight = of_one(data, LOOK)
        assert sight.foot((400, 300), UNIT).scale_bar.pixels == 0


def raster(path, transform, crs="EPSG:32632"):
    with rasterio.open(
        path, "w", driver="GTiff", height=60, width=80, count=1, dtype="float64", crs=crs, transform=transform
    ) as file:
        file.write(FIELD.z, 1)
    return meshflow.read(path)


@pytest.mark.needs_gl
def test_an_arrow_points_north_on_maps_alone(tmp_path):
    upright = raster(tmp_path / "a.tif", Affine(10, 0, 6e5, 0, -10, 5e6))
    turned = raster(tmp_path / "b.tif", Affine(8, 6, 6e5, 6, -8, 5e6))
    nowhere = raster(tmp_path / "c.tif", Affine(10, 0, 6e5, 0, -10, 5e6), crs=None)

    def north(data, seen=None, renderer=None):
        sight = of_one(data, Look(size=SIZE, seen=seen, renderer=renderer))
        return sight.foot((400, 300), UNIT).scale_bar.north

    assert north(upright, seen="front")
    assert north(upright, renderer="hillshade")
    assert not north(upright), "aslant, north is not up"
    assert not any(north(data, seen="front") for data in (turned, nowhere, FIELD))


def test_the_unit_of_the_ground_is_that_of_its_map_and_degrees_are_measured_in_metres(tmp_path):
    feet = raster(tmp_path / "a.tif", Affine(10, 0, 9e5, 0, -10, 2e5), crs="EPSG:2263")
    assert "foot" in ground_of(feet, feet.data).unit
    degrees = raster(tmp_path / "b.tif", Affine(0.001, 0, 8, 0, -0.001, 47), crs="EPSG:4326")
    assert ground_of(degrees, degrees.data) == Ground("m", north=True)
    assert ground_of(FIELD, FIELD) == Ground("m")
    words = [
        scale_bar_of(length / 220, unit, 1.0, False).words for length, unit in ((7e3, "m"), (0.03, "m"), (3.1, "foot"))
    ]
    assert words == ["5 km", "20 mm", "2 foot"]
