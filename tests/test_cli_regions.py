"""Regions from the shell: --mask and --fixed by box, sphere, or an expression on coordinates and attributes."""

import numpy as np
import pytest
import rasterio
import trimesh
from typer.testing import CliRunner

from meshflow.cli.commands import app
from meshflow.cli.inputs import per_sample
from meshflow.cli.regions import LONGEST, is_region
from meshflow.errors import InputError
from meshflow.io.files import read

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
