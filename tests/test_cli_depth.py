"""The command on depth images: inverse depth, islands, frames, and what is dropped is written as missing."""

import json

import numpy as np
import pytest
import rasterio
from typer.testing import CliRunner

from meshflow.cli.commands import app


@pytest.fixture
def frames(tmp_path):
    """Three frames of a wall in millimetres, with a hole, a piece of four pixels in it, and a camera."""
    rng = np.random.default_rng(2)
    (tmp_path / "camera.json").write_text(json.dumps({"fx": 60, "fy": 60, "cx": 23.5, "cy": 19.5}))
    for i in range(3):
        depth = (2000 + 10 * np.arange(48) + 15 * rng.normal(size=(40, 48))).astype(np.uint16)
        depth[10:20, 20:30] = 0
        depth[14:16, 24:26] = 65535 if i == 2 else 2200
        with rasterio.open(
            tmp_path / f"{i}.png", "w", driver="PNG", height=40, width=48, count=1, dtype="uint16"
        ) as out:
            out.write(depth, 1)
    return tmp_path


def called(folder, *words):
    done = CliRunner().invoke(app, [*map(str, words), "--camera", str(folder / "camera.json")])
    assert done.exit_code == 0, (done.output, done.exception)
    return done


def counts(path):
    with rasterio.open(path) as image:
        return image.read(1)


def test_a_piece_that_is_dropped_is_written_as_missing(frames):
    called(frames, "smooth", frames / "0.png", frames / "o.png", "--min-component", 5, "-q")
    assert (counts(frames / "o.png")[10:20, 20:30] == 0).all()
    called(frames, "smooth", frames / "0.png", frames / "p.png", "-q")
    np.testing.assert_array_equal(counts(frames / "p.png") == 0, counts(frames / "0.png") == 0)


def test_inverse_depths_come_back_as_depths(frames):
    called(frames, "smooth", frames / "0.png", frames / "o.tif", "--domain", "disparity", "-q")
    before, after = counts(frames / "0.png"), counts(frames / "o.tif")
    there = before > 0
    np.testing.assert_array_equal(after > 0, there)
    assert np.abs(after[there] - before[there] / 1000).max() < 0.1


def test_frames_are_fused_into_one(frames):
    done = called(frames, "fuse", *(frames / f"{i}.png" for i in range(3)), "-o", frames / "f.tif", "--json")
    reported = json.loads(done.stdout)
    assert len(reported["in"]) == 3
    fused = counts(frames / "f.tif")
    truth = 2.0 + 0.01 * np.arange(48)
    seen = fused > 0
    assert not seen[10:14, 20:30].any()
    assert np.std((fused - truth)[seen]) < 0.5 * 0.015
    again = CliRunner().invoke(
        app,
        ["fuse", str(frames / "0.png"), "-o", str(frames / "f.tif"), "--camera", str(frames / "camera.json")],
    )
    assert again.exit_code != 0
    assert "exists" in str(again.exception)


def test_a_limit_of_half_the_step_is_one_word(frames):
    called(frames, "smooth", frames / "0.png", frames / "o.tif", "--max-change", "step", "-q")
    before, after = counts(frames / "0.png"), counts(frames / "o.tif")
    there = (before > 0) & (before < 65535)
    assert np.abs(after[there] - before[there] / 1000).max() <= 0.00051
