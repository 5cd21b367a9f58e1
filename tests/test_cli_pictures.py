"""The commands that look: compare, show, film, from files to pictures, and what they refuse."""

import numpy as np
import pytest
from matplotlib.image import imread
from typer.testing import CliRunner

from meshflow.cli.commands import app
from meshflow.errors import InputError

ROWS, COLUMNS = np.mgrid[:30, :40]


@pytest.fixture
def files(tmp_path, monkeypatch):
    rng = np.random.default_rng(0)
    z = 3.0 * (COLUMNS > 20) + rng.normal(size=(30, 40))
    z[3:6, 4:9] = np.nan
    np.save(tmp_path / "rough.npy", z)
    np.save(tmp_path / "flat.npy", 3.0 * (COLUMNS > 20))
    np.save(tmp_path / "held.npy", COLUMNS < 4)
    np.save(tmp_path / "wide.npy", np.zeros((30, 50)))
    np.save(tmp_path / "colour.npy", rng.random((30, 40, 3)))
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setenv("MESHFLOW_RENDERING", "off")
    return tmp_path


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words], catch_exceptions=True)


def drawn(name, size=(400, 300)):
    picture = imread(name)
    return picture.shape[1::-1] == size and (picture[..., :3] < 0.9).any(axis=2).mean() > 0.05


SIZE = ("--size", "400", "300")


@pytest.mark.parametrize(
    "words",
    [
        (),
        ("--arrange", "wipe", "--at", "0.3"),
        ("--quantity", "curvature", "--colours", "coolwarm"),
        ("--quantity", "edges", "--contrast", "2"),
        ("--azimuth", "90", "--altitude", "10", "--exaggeration", "2", "--title", "low light"),
    ],
)
def test_compare_draws_as_it_is_told_beside_its_numbers(words, files):
    done = run("compare", "rough.npy", "flat.npy", "--picture", "a.png", *SIZE, *words)
    assert done.exit_code == 0, done.output
    assert "rms difference" in done.stdout
    assert "picture: a.png" in done.stderr
    assert drawn("a.png")


def test_compare_blinks_into_a_gif(files):
    from PIL import Image

    assert run("compare", "rough.npy", "flat.npy", "--picture", "a.gif", "--arrange", "blink", *SIZE).exit_code == 0
    with Image.open("a.gif") as file:
        assert file.n_frames == 2
    again = run("compare", "rough.npy", "flat.npy", "--picture", "a.gif", "--arrange", "blink", *SIZE)
    assert "exists; name another file, or overwrite it on purpose" in str(again.exception)


def test_show_draws_a_quantity_and_what_is_fixed(files):
    done = run("show", "rough.npy", "a.png", "--quantity", "samples", "--fixed", "held.npy", *SIZE)
    assert done.exit_code == 0, done.output
    assert "picture: a.png" in done.stderr
    blue = imread("a.png")
    assert ((blue[..., 2] > blue[..., 0] + 0.3).mean()) > 0.02  # what is fixed
    again = run("show", "rough.npy", "a.png", *SIZE)
    assert isinstance(again.exception, InputError)
    assert "exists; name another file" in str(again.exception)
    assert run("show", "rough.npy", "a.png", "--overwrite", "--quiet", *SIZE).stderr == ""


def test_film_writes_frames_with_the_time_of_each(files):
    from PIL import Image

    words = ("--frames", "3", "--time", "1", "--method", "heat", "--quantity", "removed", *SIZE)
    done = run("film", "rough.npy", "a.gif", *words)
    assert done.exit_code == 0, done.output
    assert "film: a.gif" in done.stderr
    with Image.open("a.gif") as file:
        assert file.n_frames == 3
    assert "exists" in str(run("film", "rough.npy", "a.gif", *words).exception)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("show", "rough.npy"), "a window needs a display"),
        (("compare", "rough.npy", "flat.npy", "--window"), "a window needs a display"),
        (("compare", "rough.npy", "wide.npy", "--picture", "a.png"), r"\(30, 40\)"),
        (("compare", "rough.npy", "colour.npy", "--picture", "a.png"), "data of one kind expected"),
        (("show", "rough.npy", "a.png", "--colours", "virids"), "got 'virids'; viridis"),
        (("show", "rough.npy", "nowhere/a.png"), "create it first"),
        (("show", "rough.npy", "a.txt"), "a picture ends in"),
        (("film", "rough.npy", "a.avi"), r"ends in .mp4, .gif; got .avi"),
        (("film", "rough.npy", "a.gif", "--frames", "1"), "count: a whole number, 2 or more"),
        (("show", "rough.npy", "a.png", "--seen", "side"), "switched off by MESHFLOW_RENDERING"),
        (("show", "rough.npy", "a.png", "--own-colours"), "of meshes only"),
        (("show", "rough.npy", "a.png", "--size", "10", "10"), "240 to 16000"),
    ],
)
def test_what_cannot_be_shown_is_refused_by_name_and_nothing_is_left(words, says, files):
    before = sorted(files.iterdir())
    done = run(*words)
    assert done.exit_code != 0
    with pytest.raises((InputError, ImportError), match=says):
        raise done.exception
    assert sorted(files.iterdir()) == before


def test_a_folder_that_may_not_be_written_to_is_told(files):
    done = run("show", "rough.npy", "/proc/a.png", *SIZE)
    assert isinstance(done.exception, InputError)
    assert "was not written" in str(done.exception)
