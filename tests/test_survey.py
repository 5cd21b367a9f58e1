"""Tiles of a survey, put together by their georeference, equal their mosaic bit for bit."""

import re
from itertools import chain
from types import SimpleNamespace

import numpy as np
import pytest
import rasterio
from helpers.raster_files import make
from helpers.windows import Sized
from hypothesis import given
from hypothesis import strategies as st
from rasterio.transform import from_origin
from typer.testing import CliRunner

from meshflow import Beltrami
from meshflow.cli.commands import app
from meshflow.estimate.request import Request
from meshflow.io.metadata import ReadOptions
from meshflow.large.memory import Budget
from meshflow.large.outcome import Outcome
from meshflow.large.outputs import Output
from meshflow.large.rasters import smooth_raster
from meshflow.large.survey import grouped, smooth_together

H, W, SIDE = 90, 120, 30
FIXED = Request.of(Beltrami(contrast=5.0), time=900.0, noise=2.0, outliers="include")
OUTPUT = Output(Budget(1e9))


def heights(seed=0):
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0:H, 0:W]
    z = (200 + 30 * np.sin(y / 9) * np.cos(x / 7) + 20 * (x > 50) + 2 * rng.normal(size=(H, W))).astype("float32")
    z[40:50, 20:45] = -9999
    return z


def placed(top, left, step, west=5e5, north=5e6):
    return from_origin(west + left * step, north - top * step, step, step)


def tiled(folder, z, step=30, **profile):
    """Tiles of 30 x 30, and of what is left at the end."""
    folder.mkdir(exist_ok=True)
    for top in range(0, H, SIDE):
        for left in range(0, W, SIDE):
            make(
                folder / f"t{top}_{left}.tif", z[top : top + SIDE, left : left + SIDE], nodata=-9999,
                **{"transform": placed(top, left, step), **profile},
            )  # fmt: skip
    return sorted(folder.glob("*.tif"))


def together(paths, folder, request=FIXED, *, output=OUTPUT, **options):
    folder.mkdir(exist_ok=True)
    pairs = [(path, folder / path.name) for path in paths]
    return dict(smooth_together(pairs, request, ReadOptions.of(options), output))


def mosaic_of(folder):
    """The smoothed tiles in their places."""
    found = np.full((H, W), -9999, "float32")
    for path in folder.glob("*.tif"):
        top, left = map(int, path.stem[1:].split("_"))
        with rasterio.open(path) as tile:
            found[top : top + SIDE, left : left + SIDE] = tile.read(1)
    return found


@pytest.mark.long
@pytest.mark.parametrize("request_", [FIXED, Request.of(outliers="include")], ids=["given", "found"])
def test_tiles_equal_the_mosaic_bit_for_bit(request_, tmp_path):
    z = heights()
    whole = make(tmp_path / "whole.tif", z, nodata=-9999, transform=placed(0, 0, 30))
    smooth_raster(whole, tmp_path / "smoothed.tif", request_, ReadOptions(), OUTPUT)
    outcomes = together(tiled(tmp_path / "in", z), tmp_path / "out", request_)
    assert all(isinstance(one, Outcome) for one in outcomes.values()), outcomes
    with rasterio.open(tmp_path / "smoothed.tif") as expected:
        assert mosaic_of(tmp_path / "out").tobytes() == expected.read(1).tobytes()
    assert len({str(one.parameters["contrast"].value) for one in outcomes.values()}) == 1


@pytest.mark.parametrize("sides", [(30, 30), (61, 70), (29, 120), (90, 31)], ids=str)
def test_tiles_that_are_run_as_one_window_equal_those_that_are_run_alone(sides, tmp_path):
    paths = tiled(tmp_path / "in", heights())
    one, two = tmp_path / "one", tmp_path / "two"
    assert all(isinstance(found, Outcome) for found in together(paths, one).values())
    assert len(together(paths, two, output=Output(Sized(1e9, sides)))) == len(paths)
    assert mosaic_of(one).tobytes() == mosaic_of(two).tobytes()


@given(
    origins=st.lists(st.tuples(st.integers(0, 90), st.integers(0, 90)), min_size=1, max_size=30),
    sizes=st.lists(st.tuples(st.integers(1, 9), st.integers(1, 9)), min_size=30, max_size=30),
    fit=st.tuples(st.integers(1, 60), st.integers(1, 60)),
)
def test_a_group_of_tiles_fits_into_a_window_wherever_they_lie(origins, sizes, fit):
    tiles = [
        SimpleNamespace(place=(slice(y, y + h), slice(x, x + w)))
        for (y, x), (h, w) in zip(origins, sizes, strict=False)
    ]
    groups = grouped(tiles, (9, 9), fit)
    assert sorted(map(id, chain(*groups))) == sorted(map(id, tiles))
    for group in groups:
        begin, end = ([[getattr(part, of) for part in tile.place] for tile in group] for of in ("start", "stop"))
        assert len(group) == 1 or (np.max(end, axis=0) - np.min(begin, axis=0) <= fit).all()


def test_in_degrees_rows_have_the_spacing_of_their_latitude(tmp_path):
    z, degrees = heights(), {"crs": "EPSG:4326"}
    step = 0.0003
    request = Request.of(Beltrami(contrast=5.0), time=400.0, noise=2.0, outliers="include")
    at = {"transform": placed(0, 0, step, 7, 46)}
    whole = make(tmp_path / "whole.tif", z, nodata=-9999, **degrees, **at)
    smooth_raster(whole, tmp_path / "smoothed.tif", request, ReadOptions(), OUTPUT)
    (tmp_path / "in").mkdir()
    for top in range(0, H, SIDE):
        make(
            tmp_path / "in" / f"t{top}_0.tif",
            z[top : top + SIDE],
            nodata=-9999,
            transform=placed(top, 0, step, 7, 46),
            **degrees,
        )
    outcomes = together(sorted((tmp_path / "in").glob("*.tif"))[::-1], tmp_path / "out", request)
    assert all(isinstance(one, Outcome) for one in outcomes.values()), outcomes
    with rasterio.open(tmp_path / "smoothed.tif") as expected:
        for top in range(0, H, SIDE):
            with rasterio.open(tmp_path / "out" / f"t{top}_0.tif") as tile:
                assert np.allclose(tile.read(1), expected.read(1)[top : top + SIDE], atol=1e-4)


def test_where_a_tile_is_missing_there_is_a_border(tmp_path):
    z = heights()
    paths = [path for path in tiled(tmp_path / "in", z) if path.name != "t30_30.tif"]
    outcomes = together(paths, tmp_path / "out")
    assert all(isinstance(one, Outcome) for one in outcomes.values())
    z[30:60, 30:60] = -9999
    whole = make(tmp_path / "whole.tif", z, nodata=-9999, transform=placed(0, 0, 30))
    smooth_raster(whole, tmp_path / "smoothed.tif", FIXED, ReadOptions(), OUTPUT)
    with rasterio.open(tmp_path / "smoothed.tif") as expected:
        assert mosaic_of(tmp_path / "out").tobytes() == expected.read(1).tobytes()


def test_what_is_there_already_is_left_and_gives_its_neighbours_their_halo(tmp_path):
    tiled(tmp_path / "in", heights())
    words = ["smooth", str(tmp_path / "in"), "--output", str(tmp_path / "out"), "--together", "--outliers", "include"]
    words += ["--method", "beltrami", "--contrast", "5", "--time", "900", "--noise", "2"]
    assert CliRunner().invoke(app, words).exit_code == 0
    at_once = {path: path.read_bytes() for path in sorted((tmp_path / "out").iterdir())}
    gone = list(at_once)[1]
    for more, code, said in (([], 1, "exists"), (["--resume"], 0, "done before")):
        gone.unlink()
        again = CliRunner().invoke(app, [*words, *more], env={"COLUMNS": "200"})
        assert again.exit_code == code
        assert again.output.count(said) >= len(at_once) - 1
        assert {path: path.read_bytes() for path in sorted((tmp_path / "out").iterdir())} == at_once


WORDS = (
    "--together",
    "--outliers",
    "include",
    "--method",
    "beltrami",
    "--contrast",
    "5",
    "--time",
    "900",
    "--noise",
    "2",
)


def survey(folder, out, *more):
    words = ["smooth", str(folder), "--output", str(out), *WORDS, *more]
    return CliRunner().invoke(app, words, env={"COLUMNS": "200"})


def contents(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def replaced(path, **odd):
    """Another tile in the place of one."""
    with rasterio.open(path) as tile:
        profile, samples = {"transform": tile.transform, **odd}, tile.read(1)
    make(path, profile.pop("of", lambda samples: samples)(samples), nodata=-9999, **profile)


@pytest.mark.parametrize(
    ("first", "more", "said"),
    [
        (lambda path: path.unlink(), (), "other tiles or options"),
        (lambda path: replaced(path, crs="EPSG:32633"), (), "other tiles or options"),
        (lambda path: replaced(path, of=lambda z: z + 1), (), "other tiles or options"),
        (lambda path: None, ("--contrast", "4"), "another contrast"),
        (lambda path: None, ("--outliers", "keep"), "other tiles or options"),
        (lambda path: None, ("--co", "COMPRESS=LZW"), "other tiles or options"),
    ],
    ids=["missing", "refused", "changed", "contrast", "outliers", "compressed"],
)
def test_a_run_that_is_resumed_writes_the_files_of_one_run(first, more, said, tmp_path):
    tiled(tmp_path / "in", heights())
    assert survey(tmp_path / "in", tmp_path / "one").exit_code == 0
    first(tmp_path / "in" / "t30_30.tif")
    survey(tmp_path / "in", tmp_path / "out", *more)
    count = len(contents(tmp_path / "out"))
    assert contents(tmp_path / "out") != contents(tmp_path / "one")
    tiled(tmp_path / "in", heights())
    again = survey(tmp_path / "in", tmp_path / "out", "--resume")
    assert again.exit_code == 0, again.output
    assert again.stderr.count(f"what was there was made with {said}, and is written again") == count
    assert contents(tmp_path / "out") == contents(tmp_path / "one")


def test_what_meshflow_did_not_write_is_refused_where_a_run_is_resumed(tmp_path):
    paths = tiled(tmp_path / "in", heights())
    (tmp_path / "out").mkdir()
    theirs = [tmp_path / "out" / "t0_0.tif", make(tmp_path / "out" / "t30_30.tif", heights())]
    theirs[0].write_bytes(b"no raster")
    before = [path.read_bytes() for path in theirs]
    done = survey(tmp_path / "in", tmp_path / "out", "--resume")
    assert done.exit_code == 1
    assert done.stderr.count(".tif exists; name another file") == 2
    assert [path.read_bytes() for path in theirs] == before
    assert len(contents(tmp_path / "out")) == len(paths)


def test_a_run_that_is_resumed_keeps_files_whatever_memory_threads_and_driver_it_has(tmp_path):
    tiled(tmp_path / "in", heights())
    driver = ("--of", "COG")
    assert survey(tmp_path / "in", tmp_path / "out", "--memory", "300MB", *driver).exit_code == 0
    before = contents(tmp_path / "out")
    again = survey(tmp_path / "in", tmp_path / "out", "--memory", "1GB", "--threads", "1", "--resume", *driver)
    assert again.exit_code == 0, again.output
    assert again.stdout.count("done before") == len(before)
    assert contents(tmp_path / "out") == before


def test_tiles_of_whole_numbers_and_of_single_precision_go_together_and_double_is_refused(tmp_path):
    z = np.rint(heights())
    paths = tiled(tmp_path / "in", z)
    assert all(isinstance(one, Outcome) for one in together(paths, tmp_path / "one").values())
    replaced(tmp_path / "in" / "t30_30.tif", of=lambda z: z.astype("int16"))
    assert all(isinstance(one, Outcome) for one in together(paths, tmp_path / "two").values())
    assert mosaic_of(tmp_path / "one").tobytes() == mosaic_of(tmp_path / "two").tobytes()
    replaced(tmp_path / "in" / "t30_30.tif", of=lambda z: z.astype("float64"))
    refused = [str(one) for one in together(paths, tmp_path / "three").values() if isinstance(one, Exception)]
    assert len(refused) == 1
    assert "its number type is float64; the other tiles, such as t0_0.tif, have float32" in refused[0]


def test_the_lattice_is_that_of_most_tiles_whatever_their_names(tmp_path):
    z = heights()
    paths = tiled(tmp_path / "in", z)
    first = make(tmp_path / "in" / "a.tif", z[:SIDE, :SIDE], nodata=-9999, transform=placed(0, W, 30), crs="EPSG:32633")
    outcomes = together([first, *paths], tmp_path / "out")
    assert [path.name for path, one in outcomes.items() if isinstance(one, Exception)] == ["a.tif"]


@pytest.mark.parametrize(
    ("odd", "why"),
    [
        ({"crs": "EPSG:32633"}, "its CRS is EPSG:32633; the other tiles, such as t0_0.tif, have"),
        ({"transform": from_origin(5e5 + 3600, 5e6, 10, 10)}, "samples .30.0, -30.0. apart, as in the other tiles"),
        ({"transform": from_origin(5e5 + 3610, 5e6, 30, 30)}, "0.000 rows and 0.333 columns off the grid"),
        ({"transform": from_origin(5e5 + 3570, 5e6, 30, 30)}, "odd.tif overlaps t0_90.tif by 30 x 1 samples"),
        (
            {"after": lambda tile: setattr(tile, "units", ("ft",))},
            "its unit is ft; the other tiles, such as t0_0.tif, have",
        ),
        ({"transform": rasterio.Affine.identity(), "crs": None}, "tiles are put together by their georeference"),
    ],
)
def test_a_tile_that_does_not_suit_is_refused_and_the_others_are_done(odd, why, tmp_path):
    z = heights()
    paths = tiled(tmp_path / "in", z)
    make(tmp_path / "in" / "odd.tif", z[:SIDE, :SIDE], nodata=-9999, **{"transform": placed(0, W, 30), **odd})
    outcomes = together([*paths, tmp_path / "in" / "odd.tif"], tmp_path / "out")
    refused = {path.name: one for path, one in outcomes.items() if isinstance(one, Exception)}
    assert list(refused) == ["odd.tif"]
    assert re.search(why, str(refused["odd.tif"])), refused["odd.tif"]
    assert len(list((tmp_path / "out").iterdir())) == len(paths)


def test_the_command_smooths_a_folder_of_tiles_together(tmp_path):
    tiled(tmp_path / "in", heights())
    words = ["smooth", str(tmp_path / "in"), "--output", str(tmp_path / "out"), "--together", "--outliers", "include"]
    done = CliRunner().invoke(app, words, env={"COLUMNS": "200"})
    assert done.exit_code == 0, done.output
    assert len(list((tmp_path / "out").iterdir())) == 12
    columns = [line.split() for line in done.stdout.splitlines()[1:]]
    assert len({(noise, time) for _, noise, time, *_ in columns}) == 1  # one choice for all


@pytest.mark.long
def test_the_command_says_of_all_tiles_what_it_says_of_their_mosaic(tmp_path):
    z = heights()
    whole = make(tmp_path / "whole.tif", z, nodata=-9999, transform=placed(0, 0, 30))
    one = smooth_raster(whole, tmp_path / "smoothed.tif", Request.of(outliers="include"), ReadOptions(), OUTPUT)
    tiled(tmp_path / "in", z)
    words = ["smooth", str(tmp_path / "in"), "--output", str(tmp_path / "out"), "--together", "--outliers", "include"]
    done = CliRunner().invoke(app, words, env={"COLUMNS": "200"})
    said = next(line for line in done.stderr.splitlines() if line.startswith("as one: "))
    assert said.partition("; ")[2] == one.summary.partition("; ")[2]
    assert "by 12 windows" in said
