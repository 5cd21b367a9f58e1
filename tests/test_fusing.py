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
    result = meshflow.fuse(frames(9), camera=CAMERA, result=True)
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
    assert sigma.value == pytest.approx(NOISE / 3 / np.median(TRUTH) ** 2, rel=0.1)
    assert (sigma.unit, sigma.origin) == ("1/m", "estimated")
    assert result.noise.sigma == pytest.approx(NOISE / 3, rel=0.1)
    assert " m of noise " in result.summary
    assert np.std(result.data.depth - TRUTH) < NOISE / 3


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
    assert reported["parameters"]["noise"]["why"] == "spread of the frames"
    assert any("number 1) without a single depth" in note for note in reported["notes"])
    assert (files / "p.png").stat().st_size > 1000
    assert "spread of the frames" in (files / "r.html").read_text()


def test_along_the_rays_the_command_reads_ranges_and_searches(files):
    done = called(files, "--measure", "range", "--search", "-v")
    assert done.exit_code == 0, (done.output, done.exception)
    assert "risk" in done.output
    assert "of them at a pixel in the mean" in done.output
    for i in (1, 2):
        (files / f"{i}.png").write_bytes((files / "0.png").read_bytes())
    assert "3 frames without a single one" in str(called(files).exception)


def test_one_array_is_no_list_of_frames():
    with pytest.raises(InputError, match="got one array; give a list"):
        meshflow.fuse(np.ones((8, 8)), camera=Pinhole(60.0, 60.0, 3.5, 3.5))
