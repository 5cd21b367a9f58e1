"""Several files: each by itself, a line for each refusal, the others go on, and the exit code is that of the worst."""

import json

import numpy as np
import pytest
import trimesh
from helpers.raster_files import make
from typer.testing import CliRunner

import meshflow
from meshflow.cli.commands import app
from meshflow.cli.many import inputs_of
from meshflow.errors import FormatError, InputError
from meshflow.surfaces.data import array_of

FIXED = ("--method", "beltrami", "--contrast", "5", "--time", "900", "--noise", "2", "--outliers", "include")


def heights(seed, h=30, w=40):
    rng = np.random.default_rng(seed)
    return (200 + 20 * np.sin(np.mgrid[0:h, 0:w][0] / 9) + 2 * rng.normal(size=(h, w))).astype("float32")


@pytest.fixture
def folder(tmp_path):
    made = tmp_path / "in"
    made.mkdir()
    for i in range(3):
        make(made / f"t{i}.tif", heights(i))
    return made


def smooth(*words):
    done = CliRunner().invoke(app, ["smooth", *map(str, words)], env={"COLUMNS": "200"})
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_folder_goes_into_a_folder_each_file_as_if_it_were_alone(folder, tmp_path):
    done = smooth(folder, "--output", tmp_path / "out", *FIXED)
    assert done.exit_code == 0
    assert names(tmp_path / "out") == ["t0.tif", "t1.tif", "t2.tif"]
    for i in range(3):
        alone = tmp_path / f"alone{i}.tif"
        assert smooth(folder / f"t{i}.tif", alone, *FIXED).exit_code == 0
        both = [meshflow.read(path).data for path in (alone, tmp_path / "out" / f"t{i}.tif")]
        assert array_of(both[0]).tobytes() == array_of(both[1]).tobytes()
    assert [line.split()[0].rpartition("/")[2] for line in done.stdout.splitlines()[1:]] == [
        "t0.tif",
        "t1.tif",
        "t2.tif",
    ]
    assert done.stdout.splitlines()[0].split() == ["file", "noise", "time", "removed", "took", "ended"]


@pytest.mark.parametrize("word", [("--together",), ("--resume",), ("--jobs", "2")])
def test_what_is_for_several_files_is_refused_beside_a_single_one(word, folder, tmp_path):
    with pytest.raises(InputError, match="are for several files; give --output FOLDER"):
        smooth(folder / "t0.tif", tmp_path / "out.tif", *word)
    assert not (tmp_path / "out.tif").exists()


def test_files_patterns_and_meshes_are_taken_together(folder, tmp_path):
    ball = trimesh.creation.icosphere(2)
    ball.vertices = ball.vertices + 0.01 * np.random.default_rng(0).normal(size=ball.vertices.shape)
    ball.export(tmp_path / "ball.ply")
    done = smooth(folder / "t[01].tif", tmp_path / "ball.ply", "--output", tmp_path / "out", "--json")
    assert done.exit_code == 0
    assert names(tmp_path / "out") == ["ball.ply", "t0.tif", "t1.tif"]
    told = json.loads(done.stdout)
    assert [one["out"].rpartition("/")[2] for one in told] == ["t0.tif", "t1.tif", "ball.ply"]
    assert all("stopped_because" in one for one in told)


def test_what_fails_is_said_in_one_line_and_the_others_go_on(folder, tmp_path):
    (folder / "t1.tif").write_bytes(b"II*\0 no raster")
    done = smooth(folder, folder / "none.tif", "--output", tmp_path / "out", *FIXED)
    assert done.exit_code == 1
    assert names(tmp_path / "out") == ["t0.tif", "t2.tif"]
    said = done.stderr.splitlines()
    assert sum("t1.tif cannot be read" in line for line in said) == 1
    assert sum("none.tif: no such file" in line for line in said) == 1
    assert said[-1] == "meshflow: 2 of 4 files refused"


def test_what_is_there_is_refused_replaced_or_left_out_as_asked(folder, tmp_path):
    target = tmp_path / "out"
    target.mkdir()
    (target / "t1.tif").write_bytes(b"old")
    done = smooth(folder, "--output", target, *FIXED)
    assert done.exit_code == 1
    assert "t1.tif exists" in done.stderr
    assert (target / "t1.tif").read_bytes() == b"old"
    before = (target / "t0.tif").stat().st_mtime_ns
    done = smooth(folder, "--output", target, "--resume", *FIXED)
    assert done.exit_code == 0
    assert done.stdout.count("done before") == 3
    assert (target / "t0.tif").stat().st_mtime_ns == before
    assert smooth(folder, "--output", target, "--overwrite", *FIXED).exit_code == 0
    assert (target / "t1.tif").read_bytes() != b"old"


def test_files_at_a_time_do_not_change_the_files(folder, tmp_path):
    for jobs in (1, 3):
        assert smooth(folder, "--output", tmp_path / str(jobs), "--jobs", jobs, "--outliers", "include").exit_code == 0
    for name in names(tmp_path / "1"):
        one, three = (array_of(meshflow.read(tmp_path / jobs / name).data) for jobs in ("1", "3"))
        assert one.tobytes() == three.tobytes()


def test_two_of_one_name_are_not_written_over_each_other(folder, tmp_path):
    make(tmp_path / "t0.tif", heights(7))
    done = smooth(folder / "t0.tif", tmp_path / "t0.tif", "--output", tmp_path / "out", *FIXED)
    assert done.exit_code == 1
    assert "is written under the same name" in done.stderr
    done = smooth(folder, "--output", folder, "--overwrite", *FIXED)
    assert done.exit_code == 1
    assert done.stderr.count("it is in the output folder itself") == 3


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("--output", "{out}", "--report", "r.html"), "--report: only for a single file"),
        (("--output", "{out}", "--jobs", "0"), "jobs: "),
        (("--output", "{in}/t0.tif"), "t0.tif is not a folder"),
        (("{out}.tif", "{in}/t1.tif"), "IN and OUT expected, got 3 names; --output FOLDER takes several"),
    ],
)
def test_a_refusal_of_the_command_names_the_option(words, why, folder, tmp_path):
    with pytest.raises((ValueError, OSError), match=why):
        smooth(folder / "t0.tif", *(word.format(out=tmp_path / "out", **{"in": folder}) for word in words))


def test_a_folder_without_files_is_refused(tmp_path):
    with pytest.raises(FormatError, match="no file in it that can be read"):
        inputs_of([tmp_path])


def test_a_refused_run_leaves_no_folder(tmp_path):
    (tmp_path / "in").mkdir()
    done = CliRunner().invoke(app, ["smooth", str(tmp_path / "in"), "--output", str(tmp_path / "out")])
    assert done.exit_code != 0
    assert not (tmp_path / "out").exists()


def test_a_table_that_no_terminal_reads_has_a_line_for_each_file(folder, tmp_path):
    done = CliRunner().invoke(
        app, ["smooth", str(folder), "--output", str(tmp_path / "out"), *FIXED], env={"COLUMNS": "30"}
    )
    assert [line.split()[0] for line in done.stdout.splitlines()[1:]] == [str(folder / f"t{i}.tif") for i in range(3)]
