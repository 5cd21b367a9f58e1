"""Methods side by side: the same noise removed, measured against the truth, the best one first."""

import json

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

import meshflow
from meshflow.cli.commands import app
from meshflow.errors import FormatError, InputError

TRUTH = np.add.outer(0.05 * np.arange(32), 10.0 * (np.arange(36) > 18))
NOISY = TRUTH + np.random.default_rng(0).normal(size=TRUTH.shape)


def test_each_method_removes_as_much_and_the_best_comes_first():
    runs = meshflow.compare_methods(
        NOISY, ["beltrami", meshflow.PeronaMalik(sharpness=2.0), "half-quadratic", "heat"], TRUTH, noise=1.0
    )
    assert [run.error for run in runs] == sorted(run.error for run in runs)
    assert {run.name for run in runs} == {"beltrami", "perona-malik", "half-quadratic", "heat"}
    for run in runs:
        assert run.removed == pytest.approx(0.9, abs=0.05), run.name
        assert run.error == pytest.approx(float(np.sqrt(np.mean((run.result.data - TRUTH) ** 2))))
    assert runs[-1].name == "heat"  # it blurs the cliff
    assert runs[0].as_dict()["seconds"] > 0


def test_without_a_truth_they_stay_in_order_and_meshes_go_too():
    runs = meshflow.compare_methods(NOISY, ["heat", "patches"], noise=1.0)
    assert [run.name for run in runs] == ["heat", "patches"]
    assert all(run.error is None for run in runs)
    ball = np.random.default_rng(1).normal(size=(60, 3))
    ball /= np.linalg.norm(ball, axis=1)[:, None]
    from scipy.spatial import ConvexHull

    faces = ConvexHull(ball).simplices
    noisy = ball * (1 + 0.02 * np.random.default_rng(2).normal(size=(60, 1)))
    (run,) = meshflow.compare_methods((noisy, faces), "curvature", ball, noise=0.02)
    assert run.removed == pytest.approx(0.9, abs=1e-3)
    after = run.result.after.points
    assert run.error == pytest.approx(np.sqrt(np.mean(np.sum((after - ball) ** 2, axis=1))))
    assert run.largest == pytest.approx(np.linalg.norm(after - noisy, axis=1).max())


def test_a_picture_shows_the_data_each_result_and_what_each_removed(tmp_path):
    picture = tmp_path / "methods.png"
    runs = meshflow.compare_methods(NOISY, ["heat", "perona-malik"], TRUTH, noise=1.0, picture=picture)
    assert len(runs) == 2
    with Image.open(picture) as drawn:
        assert drawn.size[0] == 1600
    with pytest.raises(FormatError, match="exists"):
        meshflow.compare_methods(NOISY, ["heat"], picture=picture)
    with pytest.raises(FormatError, match="a picture ends in"):
        meshflow.compare_methods(NOISY, ["heat"], picture=tmp_path / "methods.doc")


def test_methods_are_compared_by_the_command_with_a_table_and_a_picture(tmp_path):
    np.save(tmp_path / "z.npy", NOISY)
    np.save(tmp_path / "truth.npy", TRUTH)
    words = [
        "compare-methods",
        str(tmp_path / "z.npy"),
        "heat",
        "PM90",
        "--truth",
        str(tmp_path / "truth.npy"),
        "--noise",
        "1",
    ]
    done = CliRunner().invoke(app, [*words, "--picture", str(tmp_path / "p.jpg"), "--json"])
    rows = json.loads(done.stdout)["rows"]
    assert [row["name"] for row in rows] == ["perona-malik", "heat"]
    assert (tmp_path / "p.jpg").stat().st_size > 10_000
    table = CliRunner().invoke(app, words).stdout
    assert "perona-malik" in table
    assert "error" in table
    refused = CliRunner().invoke(app, ["compare-methods", str(tmp_path / "z.npy"), "beltramy"])
    assert "did you mean beltrami" in str(refused.exception)


def test_what_makes_no_sense_is_refused_in_words():
    with pytest.raises(InputError, match="one or more expected"):
        meshflow.compare_methods(NOISY, [])
    with pytest.raises(InputError, match=r"truth: the shape of the data, \(32, 36\)"):
        meshflow.compare_methods(NOISY, ["heat"], TRUTH[1:])
    with pytest.raises(InputError, match="a share of the noise up to 1"):
        meshflow.compare_methods(NOISY, ["heat"], removed=2.0)
    with pytest.raises(InputError, match="no such method"):
        meshflow.compare_methods(NOISY, ["beltramy"])


def test_the_table_of_methods_says_of_each_when_to_take_it():
    done = CliRunner().invoke(app, ["methods", "--json"])
    rows = json.loads(done.output)
    assert len(rows) > 20
    assert [row["method"] for row in rows if not row["when"] and row["method"] not in ("search", "quick")] == []
    assert all("---" not in row["options"] for row in rows)
