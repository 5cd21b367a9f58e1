"""The command: one line smooths a file, a refusal is one line, nothing is overwritten or left half written."""

import json
import os
import re
import subprocess
import sys

import numpy as np
import pytest
import rasterio
import trimesh
from helpers.command import run
from rasterio.transform import from_origin
from typer.testing import CliRunner

import meshflow
from meshflow.cli.commands import app, main

PROFILE = {
    "driver": "GTiff",
    "height": 40,
    "width": 50,
    "count": 1,
    "dtype": "int16",
    "crs": "EPSG:32632",
    "nodata": -9999,
}


@pytest.fixture
def terrain(tmp_path):
    rng = np.random.default_rng(0)
    rows, columns = np.mgrid[0:40, 0:50]
    z = (200 + 20 * np.sin(rows / 9) + columns + 2 * rng.normal(size=(40, 50))).round().astype(np.int16)
    z[5:9, 10:14] = -9999
    path = tmp_path / "in.tif"
    with rasterio.open(path, "w", transform=from_origin(5e5, 5e6, 10, 10), **PROFILE) as raster:
        raster.write(z, 1)
        raster.update_tags(SURVEY="spring")
    return path


def started(*words):
    """The command in a process of its own, as a shell starts it."""
    command = [sys.executable, "-m", "meshflow", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, "COLUMNS": "200"})


def refused(*words):
    """The one line of a refusal."""
    done = run(*words)
    assert done.returncode != 0
    assert "Traceback" not in done.stderr
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1, done.stderr
    return done.stderr


def test_one_command_smooths_a_terrain_and_says_what_it_did(terrain, tmp_path):
    target = tmp_path / "out.tif"
    done = started("smooth", terrain, target)
    assert done.returncode == 0, done.stderr
    assert "reached time" in done.stderr
    assert "Missing argument 'OUT'; see python -m meshflow smooth --help" in started("smooth", terrain).stderr
    found = re.search(r"of noise ([\d.]+)", done.stderr)
    assert found is not None
    assert float(found[1]) == pytest.approx(2.0, rel=0.1)
    with rasterio.open(terrain) as before, rasterio.open(target) as after:
        assert after.crs == before.crs
        assert after.transform == before.transform
        assert after.dtypes == ("float32",)
        assert np.array_equal(after.read_masks(1), before.read_masks(1))
        valid = before.read_masks(1) > 0
        z, smoothed = before.read(1)[valid].astype(float), after.read(1)[valid]
        assert after.tags()["SURVEY"] == "spring"
        assert float(after.tags(ns="meshflow")["time"]) > 100
        assert float(after.tags(ns="meshflow")["noise"]) == pytest.approx(2.0, rel=0.1)
    assert 0.5 < np.sqrt(np.mean((smoothed - z) ** 2)) < 5
    library = meshflow.read(terrain)
    assert np.allclose(meshflow.smooth(library.data).z[valid], smoothed, rtol=1e-6)


def test_info_says_the_type_that_a_file_has_and_the_one_that_is_smoothed(tmp_path):
    z = np.random.default_rng(0).integers(0, 300, (20, 30)).astype(np.int16)
    with rasterio.open(tmp_path / "z.tif", "w", driver="GTiff", count=1, height=20, width=30, dtype="int16") as file:
        file.write(z, 1)
    np.save(tmp_path / "z.npy", z.astype(float))
    for name, said in (("z.tif", "int16, smoothed as float32"), ("z.npy", "float64")):
        found = run("info", tmp_path / name, "--json")
        assert json.loads(found.stdout)["type"] == said


def test_info_says_what_a_file_is_in_words_and_in_json(terrain):
    done = run("info", terrain)
    assert done.returncode == 0, done.stderr
    assert "height field" in done.stdout
    assert "40 x 50" in done.stdout
    facts = json.loads(run("info", terrain, "--json").stdout)
    assert facts["missing"].startswith("16 of 2000")
    assert facts["spacing"] == "10 x 10 m"
    assert facts["quantum"] == 1
    assert facts["noise"] == pytest.approx(2, rel=0.2)


def test_compare_measures_what_smoothing_took_away(terrain, tmp_path):
    target = tmp_path / "out.tif"
    run("smooth", terrain, target, "--steps", "3", "-q")
    facts = json.loads(run("compare", terrain, target, "--json").stdout)
    before, after = meshflow.read(terrain).data, meshflow.read(target).data
    difference = (after.z - before.z)[~before.missing]
    assert facts["rms difference"] == pytest.approx(np.sqrt(np.mean(difference**2)), rel=1e-5)


def test_quiet_says_nothing_and_json_holds_the_parameters(terrain, tmp_path):
    done = run("smooth", terrain, tmp_path / "a.tif", "-q")
    assert (done.stdout, done.stderr) == ("", "")
    facts = json.loads(
        run("smooth", terrain, tmp_path / "b.tif", "-q", "--json", "--gamma", "1", "--steps", "2").stdout
    )
    assert facts["parameters"]["gamma"] == {"value": 1.0, "unit": "", "origin": "given"}
    assert facts["steps"] == 2
    assert [moment["time"] for moment in facts["history"]] == sorted(moment["time"] for moment in facts["history"])


def test_an_output_that_is_there_is_never_overwritten_unasked(terrain, tmp_path):
    target = tmp_path / "out.tif"
    target.write_bytes(b"precious")
    assert "--overwrite" in refused("smooth", terrain, target)
    assert target.read_bytes() == b"precious"
    assert run("smooth", terrain, target, "--overwrite", "--steps", "1").returncode == 0
    assert target.read_bytes() != b"precious"


def test_an_image_a_mesh_and_an_array_come_back_as_what_they_were(tmp_path):
    rng = np.random.default_rng(1)
    sphere = trimesh.creation.icosphere(subdivisions=3)
    sphere.vertices += 0.02 * rng.normal(size=sphere.vertices.shape)
    sphere.export(tmp_path / "in.ply")
    assert run("smooth", tmp_path / "in.ply", tmp_path / "out.ply").returncode == 0
    header = (tmp_path / "out.ply").read_bytes().partition(b"end_header")[0]
    assert b"comment meshflow:method fairing" in header or b"comment meshflow:method normal-filter" in header
    smoothed = trimesh.load(tmp_path / "out.ply", process=False)
    assert np.array_equal(smoothed.faces, sphere.faces)
    spread = [np.linalg.norm(mesh.vertices, axis=1).std() for mesh in (sphere, smoothed)]
    assert spread[1] < 0.7 * spread[0]

    np.save(tmp_path / "in.npy", rng.normal(size=(30, 30)).astype(np.float32))
    assert run("smooth", tmp_path / "in.npy", tmp_path / "out.npy").returncode == 0
    out = np.load(tmp_path / "out.npy")
    assert out.dtype == np.float32
    assert out.std() < 0.6

    colour = np.clip(120 + 20 * rng.normal(size=(3, 24, 32)), 0, 255).astype(np.uint8)
    with rasterio.open(tmp_path / "in.png", "w", driver="PNG", height=24, width=32, count=3, dtype="uint8") as image:
        image.write(colour)
    assert run("smooth", tmp_path / "in.png", tmp_path / "out.png").returncode == 0
    with rasterio.open(tmp_path / "out.png") as image:
        assert image.dtypes == ("uint8",) * 3
        assert image.read().std() < 0.7 * colour.std()


def test_a_depth_image_needs_its_camera_and_keeps_its_holes(tmp_path):
    rng = np.random.default_rng(2)
    depth = (2000 + 8 * rng.normal(size=(40, 48))).astype(np.uint16)
    depth[10:14, 20:25] = 0
    with rasterio.open(tmp_path / "d.png", "w", driver="PNG", height=40, width=48, count=1, dtype="uint16") as image:
        image.write(depth, 1)
    assert "camera" in refused("smooth", tmp_path / "d.png", tmp_path / "o.png", "--kind", "depth")
    (tmp_path / "camera.json").write_text(json.dumps({"fx": 50, "fy": 50, "cx": 23.5, "cy": 19.5}))
    done = run("smooth", tmp_path / "d.png", tmp_path / "o.png", "--camera", tmp_path / "camera.json")
    assert done.returncode == 0, done.stderr
    with rasterio.open(tmp_path / "o.png") as image:
        smoothed = image.read(1)
    assert np.array_equal(smoothed == 0, depth == 0)
    assert smoothed[depth > 0].std() < 0.5 * depth[depth > 0].std()


@pytest.mark.long
@pytest.mark.needs_gl
def test_the_picture_is_drawn_beside_the_result(terrain, tmp_path):
    done = run("smooth", terrain, tmp_path / "out.tif", "--picture", tmp_path / "p.png")
    assert done.returncode == 0, done.stderr
    with rasterio.open(tmp_path / "p.png") as image:
        assert (image.width, image.height) == (1600, 1200)
        assert image.read().std() > 10


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("smooth", "absent.tif", "out.tif"), "absent.tif: no such file"),
        (("smooth", "{in}", "out.ply"), "a terrain does not fit into .ply"),
        (("smooth", "{in}", "nowhere/out.tif"), "is not a folder"),
        (("smooth", "{in}", "out.tif", "--time", "-1"), "time: a finite number, zero or more"),
        (("smooth", "{in}", "out.tif", "--scale", "-1"), "scale: a finite number"),
        (("smooth", "{in}", "out.tif", "--time", "5", "--scale", "1"), "give one of them"),
        (("smooth", "{in}", "out.tif", "--dt", "0"), "dt: a positive finite number"),
        (("smooth", "{in}", "out.tif", "--dt", "1000", "--stepper", "explicit"), "the largest stable step is"),
        (("smooth", "{in}", "out.tif", "--contrast", "0"), "contrast: a positive finite number"),
        (("smooth", "{in}", "out.tif", "--steps", "-1"), "steps: a whole number"),
        (("smooth", "{in}", "out.tif", "--depth-scale", "5000"), "--depth-scale: no option of a raster"),
        (("smooth", "{in}", "out.tif", "--picture", "p.txt"), "a picture ends in"),
        (("smooth", "{in}", "out.tif", "--picture", "{text}"), "exists; name another file"),
        (("info", "{empty}"), "is empty (0 bytes)"),
        (("info", "{text}"), "notes.tif"),
        (("info", "."), "is a folder"),
        (("smooth", "{in}", "out.tif", "--time", "long"), "Invalid value for '--time'"),
        (("smooth", "{in}", "out.tif", "--triangles", "best"), "auto, given, delaunay or clamped expected, got 'best'"),
        (("smooth", "{in}", "out.tif", "--tme", "1"), "No such option: --tme"),
        (("smooth", "{in}"), "Missing argument 'OUT'; see "),
        (("smoth", "{in}"), "No such command 'smoth'"),
    ],
)
def test_a_refusal_is_one_line_and_leaves_nothing_behind(words, expected, terrain, tmp_path):
    (tmp_path / "empty.tif").touch()
    (tmp_path / "notes.tif").write_text("not a raster at all\n" * 20)
    places = {"{in}": terrain, "{empty}": tmp_path / "empty.tif", "{text}": tmp_path / "notes.tif"}
    before = sorted(tmp_path.iterdir())
    words = [
        places.get(word, tmp_path / word if word.startswith(("out", "nowhere", "absent")) else word) for word in words
    ]
    assert expected in refused(*words)
    assert sorted(tmp_path.iterdir()) == before


def test_an_interruption_says_so_and_writes_nothing(terrain, tmp_path, monkeypatch, capsys):
    def interrupted(*words, **more):
        raise KeyboardInterrupt

    monkeypatch.setattr("meshflow.smoothing.run_in_domain", interrupted)
    monkeypatch.setattr(sys, "argv", ["meshflow", "smooth", str(terrain), str(tmp_path / "out.tif")])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 130
    assert "interrupted; OUT is complete, or as it was before" in capsys.readouterr().err
    assert [p.name for p in tmp_path.iterdir()] == ["in.tif"]


def test_an_unknown_option_is_an_error_of_use(terrain, tmp_path):
    done = run("smooth", terrain, tmp_path / "out.tif", "--sharpen")
    assert done.returncode == 2
    assert "--sharpen" in done.stderr


def test_the_help_names_every_option_with_its_unit():
    words = CliRunner().invoke(app, ["smooth", "--help"], env={"COLUMNS": "160"}).output
    for name in ("--time", "--scale", "--gamma", "--contrast", "--boundary", "--camera", "--picture", "--overwrite"):
        assert name in words
    assert "squared length" in words


def test_masks_limits_and_weights_are_files_of_the_same_samples(terrain, tmp_path):
    before = meshflow.read(terrain).data
    only, weights = np.zeros(before.z.shape, bool), np.full(before.z.shape, 1e4)
    only[10:30, 10:40] = True
    np.save(tmp_path / "only.npy", only.astype(np.uint8))
    np.save(tmp_path / "weights.npy", weights)
    runner, moved = CliRunner(), {}
    for name, words in {
        "mask": ["--mask", tmp_path / "only.npy"],
        "fixed": ["--fixed", tmp_path / "only.npy"],
        "max_change": ["--max-change", "0.5"],
        "data_weights": ["--data-weights", tmp_path / "weights.npy"],
    }.items():
        target = tmp_path / f"{name}.tif"
        done = runner.invoke(
            app, ["smooth", *map(str, [terrain, target, *words]), "--time", "300", "--gamma", "0", "-q"]
        )
        assert done.exit_code == 0, done.output
        moved[name] = np.where(before.missing, 0, np.abs(meshflow.read(target).data.z - before.z))
    assert moved["mask"][~only].max() == 0 < moved["mask"][only].max()
    assert moved["fixed"][only].max() == 0 < moved["fixed"][~only].max()
    assert 0.4 < moved["max_change"].max() <= 0.5001
    assert moved["data_weights"].max() < 0.1
    assert "a mask of shape (40, 50) expected" in refused(
        "smooth", terrain, tmp_path / "x.tif", "--mask", small(tmp_path)
    )


def small(folder):
    np.save(folder / "small.npy", np.ones((3, 3)))
    return folder / "small.npy"


def test_a_report_is_written_asked_before_the_work_and_replaced_on_purpose_only(terrain, tmp_path):
    page, runner = tmp_path / "r.html", CliRunner()
    words = ["smooth", str(terrain), str(tmp_path / "out.tif"), "--steps", "2", "--report", str(page)]
    assert runner.invoke(app, [*words, "--verbose"]).exit_code == 0
    assert "contrast" in page.read_text()
    assert "exists" in refused(*words[:2], tmp_path / "other.tif", *words[3:])
    assert not (tmp_path / "other.tif").exists()
    page.write_text("old")
    assert runner.invoke(app, [*words, "--overwrite", "-q"]).exit_code == 0
    assert "contrast" in page.read_text()
    assert "a report ends in .html or .png; got .xyz" in refused(*words[:2], tmp_path / "o.tif", "--report", "r.xyz")


def test_a_mesh_is_masked_by_an_array_of_its_vertices(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=2)
    ball.vertices += 0.02 * np.random.default_rng(3).normal(size=ball.vertices.shape)
    ball.export(tmp_path / "in.ply")
    stays = np.asarray(ball.vertices)[:, 2] > 0
    np.save(tmp_path / "fixed.npy", stays)
    np.save(tmp_path / "short.npy", stays[:-1])
    words = ("--method", "curvature", "--time", "0.02")
    done = run("smooth", tmp_path / "in.ply", tmp_path / "out.ply", "--fixed", tmp_path / "fixed.npy", *words)
    assert done.returncode == 0, done.stderr
    before, after = (np.asarray(trimesh.load(tmp_path / n, process=False).vertices) for n in ("in.ply", "out.ply"))
    assert np.array_equal(before[stays], after[stays])
    assert not np.array_equal(before[~stays], after[~stays])
    np.save(tmp_path / "words.npy", np.array([{}], object), allow_pickle=True)
    wrong = run("smooth", tmp_path / "in.ply", tmp_path / "o.ply", "--mask", tmp_path / "words.npy", *words)
    assert wrong.returncode == 1
    assert "words.npy: an array of numbers expected" in wrong.stderr
    wrong = run("smooth", tmp_path / "in.ply", tmp_path / "o.ply", "--mask", tmp_path / "short.npy", *words)
    assert wrong.returncode == 1
    assert "mask" in wrong.stderr
