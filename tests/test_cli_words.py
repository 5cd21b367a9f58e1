"""The command speaks the words of the command: flags where Python has keywords, the nearest word, the reason in one line."""

import sys

import numpy as np
import pytest
import trimesh

from meshflow.cli import commands
from meshflow.cli.spoken import spoken

Z = np.sin(np.arange(40) / 5.0) + np.arange(36)[:, None] / 9.0 + np.random.default_rng(14).normal(0, 0.05, (36, 40))


@pytest.fixture
def said(tmp_path, monkeypatch, capfd):
    """What a command says on stderr, and its exit status."""
    np.save(tmp_path / "z.npy", Z)
    trimesh.creation.icosphere(2).export(tmp_path / "m.ply")
    monkeypatch.chdir(tmp_path)

    def run(line):
        monkeypatch.setattr(sys, "argv", ["meshflow", *line.split()])
        with pytest.raises(SystemExit) as end:
            commands.main()
        return capfd.readouterr().err, end.value.code

    return run


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("smooth z.npy o.npy --mask nix.tif", "--mask: a file expected, and there is no file nix.tif"),
        (
            "smooth m.ply o.ply --fixed selection",
            "--fixed selection: no such array; there are none; nor is there a file",
        ),
        (
            "smooth z.npy o.npy --max-change abc",
            "--max-change: a number, step, or a file expected, and there is no file abc",
        ),
        ("smooth z.npy o.npy --kind depth", "needs its camera; give --camera: "),
        (
            "smooth z.npy o.npy --preserve volume",
            "--preserve volume and --preserve area: only for a mesh whose points move",
        ),
        ("smooth z.npy o.npy --area-loss 3", "--area-loss: a share"),
        ("smooth z.npy o.npy --min-component 3", "--min-component: only for range images"),
        ("smooth z.npy o.npy --depth-scale 3", "--depth-scale 3.0 belongs to depths"),
        ("smooth m.ply o.ply --depth-scale 3", "which takes --kind, --channels, --moves"),
        ("smooth z.npy o.npy --time 1 --scale 2", "--time 1.0 and --scale 2.0: they say the same"),
        (
            "smooth z.npy o.npy --method search --no-search",
            "--method search and --no-search: they contradict each other",
        ),
        ("smooth z.npy o.npy --method quick --search", "--method quick and --search: they contradict each other"),
        ("smooth z.npy o.npy --quiet --verbose", "--quiet and --verbose: they contradict each other"),
        ("smooth z.npy z.npy", "z.npy exists; name another file, or overwrite it on purpose (--overwrite)"),
        ("smooth z.npy o.npy --boundary neuman", "(of meshes) expected, got 'neuman'; did you mean neumann?"),
        ("smooth z.npy o.npy --scale 25m", "'--scale': a number expected, got '25m'"),
        ("smooth z.npy o.npy --scale=25m", "'--scale': a number expected, got '25m'"),
        ("smooth z.npy o.npy --steps 1.5", "'--steps': a whole number expected, got '1.5'"),
        ("smooth m.ply o.ply --preserve volum", "volume, scaling or area expected, got 'volum'; did you mean volume?"),
        ("smooth m.ply o.ply --method curvatur", "did you mean curvature?"),
        ("smooth m.ply o.ply --along normal", "did you mean normals?"),
        ("smooth z.npy o.npy --kind dem", "did you mean terrain?"),
        ("compare z.npy z.npy --arrange wip --picture x.png", "did you mean wipe?"),
        ("smooth z.npy o.npy --streng 2", "No such option: --streng; did you mean --strength?; see"),
        ("smooth z.npy o.npy --sigma 2", "No such option: --sigma; the noise is set by --noise"),
        ("smooth z.npy o.npy --method tv", "tv: no such method; use total-variation"),
    ],
)
def test_a_refusal_is_one_line_in_the_words_of_the_command(said, line, words):
    told, status = said(line)
    assert status != 0
    assert words in told
    assert told.count("\n") == 1
    assert "Value error" not in told
    assert "Input should" not in told
    assert "Possible options" not in told


def test_options_that_decide_the_method_are_said_to_do_so(said):
    told, status = said("smooth z.npy o.npy --sharpness 3")
    assert not status
    assert (
        "--sharpness: an option of method beltrami, so this method was used (--method names another one that has it: perona-malik"
        in told
    )
    told, _ = said("smooth z.npy p.npy --method perona-malik --sharpness 3")
    assert "--method names another" not in told


def test_a_warning_is_said_with_flags(said, tmp_path):
    np.save(tmp_path / "y.npy", np.where(np.arange(40) < 6, -9999.0, Z))
    told, _ = said("smooth y.npy o.npy")
    assert "--nodata=-9999" in told
    assert "nodata=-9999, " not in told.replace("--nodata=-9999, ", "")


@pytest.mark.parametrize(
    ("python", "shell"),
    [
        ("max_change='step': the data is not quantized", "--max-change step: the data is not quantized"),
        ("give constraints=DataWeights(...)", "give --data-weights"),
        ("give stop=Residual(...)", "give --residual"),
        ("give method=Fairing(order=...)", "give --order"),
        ("give compute=Compute(stepper=...)", "give --stepper"),
        ("give spacing=(dx, dy), or a CRS", "give --spacing, or a CRS"),
        ("take nodata=-9999; nodata=nan takes it", "take --nodata=-9999; --nodata nan takes it"),
        ("the noise of a picture: 3 times as large", "the noise of a picture: 3 times as large"),
        ("a.time_unit and time_unit(x)", "a.time_unit and time_unit(x)"),
        ("slice time=3: left", "slice time=3: left"),
        ("time=2020-01-01: left", "time=2020-01-01: left"),
    ],
)
def test_words_of_python_become_flags_and_others_stay(python, shell):
    assert spoken(python) == shell
