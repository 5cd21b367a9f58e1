"""Frames of a view that stays: their spread is the noise, what has no depth is left out, and the command has its words."""

import json

import numpy as np
import pytest
import rasterio
from typer.testing import CliRunner

import meshflow
from meshflow import Pinhole, RangeImage
from meshflow.cli.commands import app
from meshflow.errors import InputError

CAMERA = Pinhole(60.0, 60.0, 23.5, 19.5)
SHAPE = (40, 48)
TRUTH = 2.0 + 0.01 * np.broadcast_to(np.arange(48.0), SHAPE)
NOISE = 0.015


def frames(many, seed=5):
    rng = np.random.default_rng(seed)
    return [TRUTH + NOISE * rng.normal(size=SHAPE) for _ in range(many)]


def test_the_spread_of_the_frames_is_the_noise_and_says_so():
    chosen = meshflow.fuse(frames(9), camera=CAMERA, result=True).parameters[
        "noise"
    ]  # pixels are alike: that of the mean
    assert chosen.value == pytest.approx(NOISE / 3, rel=0.15)
    result = meshflow.fuse(frames(9), camera=CAMERA, domain="length", result=True)
    sigma, seen = result.parameters["noise"], result.parameters["frames"]
    assert sigma.value == pytest.approx(NOISE / 3, rel=0.1)
    assert (sigma.origin, sigma.why, result.noise.how) == ("estimated", *["spread of the frames"] * 2)
    assert (seen.value, seen.why) == (9.0, "9 of them at a pixel in the mean")
    assert result.warnings == ()
    assert meshflow.fuse(frames(3), camera=CAMERA, noise=0.01, result=True).parameters["noise"].origin == "given"


def test_a_frame_without_a_depth_is_left_out_and_said():
    some = frames(3)
    nothing = np.zeros(SHAPE)
    result = meshflow.fuse([nothing, some[0], None, *some[1:], np.full(SHAPE, np.nan)], camera=CAMERA, result=True)
    np.testing.assert_array_equal(result.data, meshflow.fuse(some, camera=CAMERA))
    assert result.parameters["frames"].value == 3.0
    assert result.warnings == ("3 of the frames (number 1, 3, 6) without a single depth, left out",)
    with pytest.raises(InputError, match="two or more with depths, of the same view, expected, got 1, and 2 without"):
        meshflow.fuse([nothing, some[0], None], camera=CAMERA)


def test_frames_in_inverse_depth_take_their_spread_and_count_what_they_removed_in_depths():
    images = [RangeImage(frame, CAMERA, unit="m") for frame in frames(9)]
    result = meshflow.fuse(images, domain="disparity", result=True)
    sigma = result.parameters["noise"]
    assert sigma.value == pytest.approx(NOISE / 3, rel=0.1)
    assert (sigma.unit, sigma.origin) == ("m", "estimated")
    assert result.noise.sigma == pytest.approx(NOISE / 3, rel=0.1)
    assert " m of noise " in result.summary
    assert np.std(result.data.depth - TRUTH) < NOISE / 3


def seen_from(place):
    """Depths of a ball before a slanted wall, from a place near the origin."""
    v, u = np.mgrid[0:96, 0:128]
    rays = np.stack([(u - 63.5) / 120, (v - 47.5) / 120, np.ones(u.shape)], axis=-1)
    normal, middle = np.array([0.3, 0.1, 1.0]), np.array([0.0, 0.0, 1.2]) - place
    wall = (2.0 - normal @ place) / (rays @ normal)
    along, square = rays @ middle, (rays * rays).sum(axis=-1)
    inside = along**2 - square * (middle @ middle - 0.35**2)
    return np.where(inside > 0, (along - np.sqrt(np.maximum(inside, 0))) / square, wall)


@pytest.mark.long
@pytest.mark.parametrize("far", [0.0, 0.002, 0.02])
def test_frames_of_a_camera_that_moves_are_no_worse_than_one_of_them(far):
    rng = np.random.default_rng(1)
    places = [np.zeros(3), *(far * rng.normal(size=3) for _ in range(6))]
    views = [seen_from(place) for place in places]
    noisy = [view + 0.004 * view**2 * rng.normal(size=view.shape) for view in views]
    camera = Pinhole(120.0, 120.0, 63.5, 47.5)
    found = meshflow.fuse(noisy, camera=camera, result=True)
    alone = meshflow.smooth(noisy[0], kind="depth", camera=camera)
    errors = [float(np.sqrt(np.mean(np.square(one - views[0])))) for one in (found.data, alone)]
    assert errors[0] <= 1.02 * errors[1], f"{errors[0]:.5f} of seven, {errors[1]:.5f} of one"
    assert ("the scene has moved" in " ".join(found.warnings)) == (far > 0)


@pytest.mark.long
def test_more_frames_are_better():
    errors = []
    for many in (1, 2, 4, 12):
        rng, view, camera = np.random.default_rng(3), seen_from(np.zeros(3)), Pinhole(120.0, 120.0, 63.5, 47.5)
        noisy = [view + 0.004 * view**2 * rng.normal(size=view.shape) for _ in range(many)]
        one = many == 1
        found = meshflow.smooth(noisy[0], kind="depth", camera=camera) if one else meshflow.fuse(noisy, camera=camera)
        errors.append(float(np.sqrt(np.mean(np.square(found - view)))))
    assert (np.diff(errors) < 0).all()
    assert errors[-1] < 0.4 * errors[0]


def test_a_depth_that_flickers_in_the_first_frame_is_outvoted():
    some = frames(9)
    some[0][20, 20] = 3.5
    result = meshflow.fuse(some, camera=CAMERA)
    assert abs(result[20, 20] - TRUTH[20, 20]) < NOISE


def stepped():
    """A slanted wall whose disparities come in steps of an eighth of a pixel."""
    wall = 2.5 + 0.01 * np.add.outer(np.arange(40.0), np.arange(48.0))
    return 1.0 / (np.rint(8 * 40.0 / wall) / (8 * 40.0))


def test_strength_counts_where_inverse_depths_come_in_steps():
    images = RangeImage(stepped(), CAMERA)
    removed = [
        np.std(meshflow.smooth(images, domain="disparity", strength=strength).depth - images.depth)
        for strength in (0.25, 1.0, 4.0)
    ]
    assert removed[0] < removed[1] < removed[2], removed


def test_nothing_is_searched_for_where_depths_come_in_steps():
    images = RangeImage(stepped(), CAMERA)
    found = meshflow.smooth(images, method="search", result=True)
    assert "come in steps" in " ".join(found.warnings)
    np.testing.assert_array_equal(found.data.depth, meshflow.smooth(images, domain="length").depth)


def test_an_option_that_does_not_exist_is_refused_as_smooth_does_it():
    given = "no keyword of smooth; give method=Beltrami"
    for words, says in (({"strenght": 2.0}, "did you mean strength"), ({"gamma": 1.0}, given)):
        with pytest.raises(InputError, match=says):
            meshflow.fuse(frames(2), camera=CAMERA, **words)


@pytest.fixture
def files(tmp_path):
    """Three frames in millimetres, the first without a depth, and a camera."""
    (tmp_path / "camera.json").write_text(json.dumps({"fx": 60, "fy": 60, "cx": 23.5, "cy": 19.5}))
    for i, frame in enumerate([np.zeros(SHAPE), *frames(2)]):
        with rasterio.open(
            tmp_path / f"{i}.png", "w", driver="PNG", height=40, width=48, count=1, dtype="uint16"
        ) as out:
            out.write(np.rint(1000 * frame).astype(np.uint16), 1)
    return tmp_path


def called(folder, *words):
    names = [str(folder / f"{i}.png") for i in range(3)]
    more = ["-o", str(folder / "o.tif"), "--camera", str(folder / "camera.json"), "--overwrite"]
    return CliRunner().invoke(app, ["fuse", *names, *more, *map(str, words)])


def test_the_command_fuses_with_the_words_of_smooth(files):
    words = ("--domain", "disparity", "--measure", "depth", "--no-search", "--max-change", 0.01)
    done = called(files, *words, "--picture", files / "p.png", "--report", files / "r.html", "--json")
    assert done.exit_code == 0, (done.output, done.exception)
    reported = json.loads(done.stdout)
    assert reported["parameters"]["domain"]["value"] == "disparity"
    assert reported["parameters"]["max_change"]["value"] == 0.01
    assert (
        "at the median depth" in reported["parameters"]["noise"]["why"]
    )  # two frames say nothing of the noise of a pixel
    assert any("number 1) without a single depth" in note for note in reported["notes"])
    assert (files / "p.png").stat().st_size > 1000
    assert "at the median depth" in (files / "r.html").read_text()


def test_along_the_rays_the_command_reads_ranges_and_searches(files):
    done = called(files, "--measure", "range", "--search", "-v")
    assert done.exit_code == 0, (done.output, done.exception)
    assert "risk" in done.output
    assert "of them at a pixel in the mean" in done.output
    for i in (1, 2):
        (files / f"{i}.png").write_bytes((files / "0.png").read_bytes())
    assert "3 frames in which all are missing" in str(called(files).exception)


def test_one_array_is_no_list_of_frames():
    with pytest.raises(InputError, match="got one array; give a list"):
        meshflow.fuse(np.ones((8, 8)), camera=Pinhole(60.0, 60.0, 3.5, 3.5))
