"""Regions from the shell: --mask and --fixed by box, sphere, or an expression on coordinates and attributes."""

import numpy as np
import pytest
import rasterio
import trimesh
from typer.testing import CliRunner

from meshflow.cli import by_windows
from meshflow.cli.commands import app
from meshflow.cli.inputs import per_sample, plain_sample
from meshflow.cli.regions import LONGEST, is_region
from meshflow.errors import InputError
from meshflow.io.files import read
from meshflow.io.metadata import ReadOptions

RNG = np.random.default_rng(8)


@pytest.fixture
def ball(tmp_path):
    mesh = trimesh.creation.icosphere(3)
    mesh.vertices += RNG.normal(0, 0.01, mesh.vertices.shape)
    mesh.vertex_attributes["wear"] = np.arange(len(mesh.vertices), dtype=np.float32)
    mesh.export(tmp_path / "ball.ply")
    return tmp_path / "ball.ply"


@pytest.fixture
def terrain(tmp_path):
    z = (np.add.outer(np.arange(40.0), 2 * np.arange(50.0)) + RNG.normal(size=(40, 50))).astype(np.float32)
    z[3, 4] = -9999
    place = rasterio.Affine(10, 0, 500_000, 0, -10, 5_000_000)
    with rasterio.open(tmp_path / "z.tif", "w", "GTiff", 50, 40, 1, "EPSG:32632", place, "float32", -9999) as file:
        file.write(z, 1)
    return tmp_path / "z.tif"


@pytest.mark.parametrize(
    ("text", "truth"),
    [
        ("z > 0.2", lambda p, w: p[:, 2] > 0.2),
        ("-0.1 <= z < 0.5 and not x > 0", lambda p, w: (p[:, 2] >= -0.1) & (p[:, 2] < 0.5) & ~(p[:, 0] > 0)),
        ("(z > 0.5) | (z < -0.5) & (x > 0)", lambda p, w: (p[:, 2] > 0.5) | ((p[:, 2] < -0.5) & (p[:, 0] > 0))),
        ("box(-1, -1, 0, 1, 0, 2)", lambda p, w: (p[:, 1] <= 0) & (p[:, 2] >= 0) & (np.abs(p[:, 0]) <= 1)),
        ("sphere(1, 0, 0, 0.5)", lambda p, w: np.linalg.norm(p - [1, 0, 0], axis=1) <= 0.5),
        ("~sphere(1, 0, 0, 0.5)", lambda p, w: np.linalg.norm(p - [1, 0, 0], axis=1) > 0.5),
        ("wear % 2 == 1 or wear >= 2 ** 9", lambda p, w: (w % 2 == 1) | (w >= 512)),
        ("sphere(0, 0, 2)", lambda p, w: np.hypot(p[:, 0], p[:, 1]) <= 2),
        ("hypot(x, y) < max(0.5, abs(z))", lambda p, w: np.hypot(p[:, 0], p[:, 1]) < np.maximum(0.5, np.abs(p[:, 2]))),
    ],
)
def test_a_region_of_a_mesh_is_what_the_expression_says(ball, text, truth):
    document = read(ball)
    points = document.data.points.astype(np.float64)
    found = per_sample(document, "mask", text)
    assert np.array_equal(found, truth(points, np.arange(len(points))))


def test_a_region_of_a_raster_is_on_its_map(terrain):
    document = read(terrain)
    x, y = 500_005 + 10 * np.arange(50), 4_999_995 - 10 * np.arange(40)
    found = per_sample(document, "fixed", "x > 500200 and y >= 4999900")
    assert np.array_equal(found, np.logical_and.outer(y >= 4_999_900, x > 500_200))
    assert np.array_equal(per_sample(document, "mask", "row < 7 and column == 3"), _one(40, 50, np.s_[:7, 3]))
    high = per_sample(document, "mask", "z > 20")
    assert not high[3, 4], "a missing sample is in no region"
    assert np.array_equal(high & ~document.data.missing, (document.data.z > 20) & ~document.data.missing)
    assert per_sample(document, "mask", "box(500000, 4999800, 500100, 5000000)").sum() == 10 * 20


def _one(h, w, where):
    mask = np.zeros((h, w), bool)
    mask[where] = True
    return mask


def test_what_is_outside_of_a_mask_stays_and_what_is_fixed_stays(ball, terrain, tmp_path):
    run = CliRunner().invoke
    done = run(app, ["smooth", str(ball), str(tmp_path / "o.ply"), "--mask", "z > 0.2", "--noise", "0.01"])
    assert done.exit_code == 0, done.output
    before, after = (np.asarray(read(path).data.points) for path in (ball, tmp_path / "o.ply"))
    moved = (before != after).any(axis=1)
    assert not moved[before[:, 2] <= 0.2].any()
    assert moved[before[:, 2] > 0.3].mean() > 0.9
    done = run(app, ["smooth", str(terrain), str(tmp_path / "o.tif"), "--fixed", "y > 4999800"])
    assert done.exit_code == 0, done.output
    before, after = (read(path).data.z for path in (terrain, tmp_path / "o.tif"))
    assert np.array_equal(before[:20], after[:20])
    assert (before[25:] != after[25:]).any()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("z > 100", r"true for none of 642 samples; x -1.* y -1.*z -0.99"),
        ("heat > 3", r"no 'heat' in the data, its coordinates are x, y, z and its vertex attributes"),
        ("spher(0,0,0,1)", "no function spher; there are box, sphere"),
        ("sphere(0,0)", "plain numbers expected"),
        ("sphere(x,0,0,1)", "plain numbers expected"),
        ("z > (", "an expression expected"),
        ("z > 'a'", "an expression expected"),
        ("__import__('os').system('true') == 0", "an expression expected|no function"),
        ("(lambda: 1)() > 0", "an expression expected"),
        ("[x for x in (1,)] == 1", "an expression expected"),
        ("z in (1, 2)", "== or != expected"),
        ("sqrt(x, y, z, z) > 0", "takes other numbers"),
        ("9 ** 9 ** 9 ** 9 < 0", "true for none"),
        ("(" * 300 + "z" + ")" * 300 + " > 900", "an expression expected|none of"),
        ("z > 1 and " * 300 + "z > 1", f"at most {LONGEST}"),
    ],
)
def test_what_is_no_region_is_one_line(ball, text, said):
    with pytest.raises(InputError, match=said) as refused:
        per_sample(read(ball), "mask", text)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("name", ["a.npy", "mask-1.npy", "wear", "../a b.tif", "C:\\a.tif", "roi_2.png"])
def test_names_are_no_regions(name):
    assert not is_region(name)


def test_only_points_to_the_mask(ball):
    from subprocess import run
    from sys import executable

    done = run(
        [executable, "-m", "meshflow", "smooth", ball, "o.ply", "--only", "z > 2"], capture_output=True, text=True
    )
    assert done.returncode == 2
    assert "--mask" in done.stderr
    assert done.stderr.count("\n") == 1


# --- by windows ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bands", [1, 3])
@pytest.mark.parametrize("crs", ["EPSG:32632", "EPSG:4326", None])
def test_a_region_evaluated_by_windows_is_that_of_the_whole(tmp_path, monkeypatch, bands, crs):
    monkeypatch.setattr(by_windows, "PIECE", 300)
    rng = np.random.default_rng(bands)
    z = (np.add.outer(np.arange(40.0), 2 * np.arange(50.0)) + rng.normal(size=(bands, 40, 50))).astype(np.float32)
    z[:, 3, 4] = z[:, 20:28] = -9999
    step = 10 if crs != "EPSG:4326" else 1e-4
    place = rasterio.Affine(step, 0, 9, 0, -step, 45) if crs else rasterio.Affine.identity()
    file = tmp_path / "z.tif"
    with rasterio.open(file, "w", "GTiff", 50, 40, bands, crs, place, "float32", -9999) as made:
        made.write(z)
    for options in (ReadOptions(), ReadOptions(window=(5, 3, 31, 30))):
        document = read(file, window=options.window)
        low, high = np.nanquantile(document.data.z if bands == 1 else document.data.values, [0.3, 0.7])
        name = "z" if bands == 1 else "c1"
        x0 = 9 + 25 * step if crs else 25
        for text in (f"{low} < {name} < {high}", "row > 7 and column != 3", f"x > {x0}", f"y < 44 or {name} > {low}"):
            whole = per_sample(document, "mask", text)
            assert np.array_equal(by_windows._per_sample(file, options, 1e9, "mask", text), whole), text
    with pytest.raises(InputError, match=r"true for none of 2000 samples; x [^n]* to [^n]*, y [^n]* to [^n]*"):
        by_windows._per_sample(file, ReadOptions(), 1e9, "fixed", f"{name} > 1e6")


def test_a_mask_by_an_expression_is_the_same_by_windows_as_in_memory(terrain, tmp_path, monkeypatch):
    words = [
        "--mask",
        "z > 60 and column < 40",
        "--method",
        "beltrami",
        "--contrast",
        "2",
        "--time",
        "200",
        "--noise",
        "1",
    ]
    for name, memory in (("windows.tif", 400e6), ("whole.tif", None)):
        monkeypatch.setattr("meshflow.cli.commands.memory_for", lambda _, memory=memory: memory)
        done = CliRunner().invoke(app, ["smooth", str(terrain), str(tmp_path / name), *words])
        assert done.exit_code == 0, done.output
    windows, whole = (rasterio.open(tmp_path / name).read(1) for name in ("windows.tif", "whole.tif"))
    assert windows.tobytes() == whole.tobytes()
    assert windows.tobytes() != rasterio.open(terrain).read(1).tobytes()


def test_an_expression_where_there_is_none_is_refused_in_one_line():
    with pytest.raises(InputError, match=r"mask: an expression is for one raster.*; give a mask as a file"):
        plain_sample("mask", "z > 1000")
    with pytest.raises(InputError, match="there is no file z.tif"):
        plain_sample("mask", "z.tif")
