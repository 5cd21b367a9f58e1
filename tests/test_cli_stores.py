"""``meshflow smooth IN.zarr/VARIABLE OUT.zarr``: what is written equals what the library makes of the variable."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import meshflow
from meshflow.cli.commands import app
from meshflow.errors import FormatError, InputError, NotConverged
from meshflow.io.stores import Place, in_store
from meshflow.large import chunk_graph

xarray = pytest.importorskip("xarray")
pytest.importorskip("zarr")

RUN = CliRunner()


def made(folder, times=0, chunks=40):
    """A store with noisy terrain on a UTM grid, its time steps, and a variable of one dimension."""
    rng = np.random.default_rng(3)
    y, x = np.mgrid[0:90, 0:100]
    truth = 20 * np.sin(y / 15) * np.cos(x / 12)
    shape = (times, 90, 100) if times else (90, 100)
    z = (truth + rng.normal(size=shape)).astype(np.float32)
    z[..., :10, :10] = np.nan
    dims = ("time", "y", "x") if times else ("y", "x")
    coords = {"y": 5e6 - 10.0 * np.arange(90), "x": 4e5 + 10.0 * np.arange(100)}
    if times:
        coords["time"] = np.arange(times).astype("datetime64[D]")
    height = xarray.DataArray(z, coords, dims, "height", {"units": "m", "long_name": "height"})
    data = xarray.Dataset({"height": height, "gauge": ("station", np.arange(3.0)), "label": 7})
    data["flags"] = (("y", "x"), np.ones((90, 100), bool))
    sizes = {"y": chunks, "x": chunks, **({"time": 1} if times else {})}
    data.chunk(sizes).to_zarr(folder / "in.zarr")
    return folder / "in.zarr", truth


def run(*words):
    return RUN.invoke(app, ["smooth", *map(str, words)], catch_exceptions=True)


def back(path):
    return xarray.open_zarr(path, chunks=None)


def test_a_variable_is_smoothed_as_the_library_does_and_keeps_coordinates_attributes_and_chunks(tmp_path):
    store, truth = made(tmp_path)
    found = run(store / "height", tmp_path / "out.zarr", "--json", "--quiet")
    assert found.exit_code == 0, found.output
    assert json.loads(found.stdout)["in"].endswith("in.zarr/height")
    out = back(tmp_path / "out.zarr")["height"]
    lazily = meshflow.smooth(xarray.open_zarr(store)["height"]).compute()
    np.testing.assert_array_equal(out.values, lazily.values)
    assert out.attrs["units"] == "m"
    assert out.encoding["chunks"] == (40, 40)
    np.testing.assert_array_equal(out.x, back(store).x)
    gone = np.isnan(out.values)
    assert gone[:10, :10].all()
    assert gone.sum() == 100
    assert np.sqrt(np.mean((out.values - truth)[~gone] ** 2)) < 0.5
    assert sorted(os.listdir(tmp_path)) == ["in.zarr", "out.zarr"]


@pytest.mark.parametrize("slices", ["each", "alike"])
def test_a_series_is_smoothed_slice_by_slice_when_that_is_asked_for(tmp_path, slices):
    store, truth = made(tmp_path, times=3)
    found = run(store, tmp_path / "out.zarr/smooth", "--slices", slices, "--method", "quick")
    assert found.exit_code == 0, found.output
    out = back(tmp_path / "out.zarr")["smooth"]
    assert out.dims == ("time", "y", "x")
    assert np.sqrt(np.nanmean((out.values - truth) ** 2)) < 0.7
    of_many = run(store, "--output", tmp_path / "folder", "--slices", slices, "--method", "quick")
    assert of_many.exit_code == 0, of_many.output
    np.testing.assert_array_equal(back(tmp_path / "folder" / "in.zarr")["height"].values, out.values)


def test_all_variables_of_a_store_are_smoothed_each_with_its_own_noise_and_the_rest_is_kept(tmp_path):
    store, truth = made(tmp_path, times=2)
    rng = np.random.default_rng(5)
    rough = (truth + 4 * rng.normal(size=truth.shape)).astype(np.float32)
    data = xarray.open_zarr(store).assign(dem=(("y", "x"), rough)).chunk({"y": 40, "x": 40}).drop_encoding()
    data.to_zarr(tmp_path / "both.zarr")
    words = ("--slices", "alike", "--method", "quick", "--json", "-q")
    found = run(tmp_path / "both.zarr", tmp_path / "out.zarr", *words)
    assert found.exit_code == 0, found.output
    told = json.loads(found.stdout)["variables"]
    assert {name: round(one["parameters"]["noise"]["value"]) for name, one in told.items()} == {"height": 1, "dem": 4}
    out = back(tmp_path / "out.zarr")
    np.testing.assert_array_equal(out["gauge"], np.arange(3.0))
    for name, most in (("height", 0.7), ("dem", 1.5)):
        assert np.sqrt(np.nanmean((out[name].values - truth) ** 2)) < most
        alone = tmp_path / f"{name}.zarr"
        alike = words[:2] if name == "height" else ()
        assert run(tmp_path / "both.zarr" / name, alone, *alike, *words[2:]).exit_code == 0
        np.testing.assert_array_equal(back(alone)[name], out[name])
    named = run(tmp_path / "both.zarr", tmp_path / "other.zarr/height", *words)
    assert "it names a variable, and" in str(named.exception)


def test_a_series_whose_chunks_hold_several_times_is_written_in_these_chunks(tmp_path):
    store, _ = made(tmp_path, times=2)
    xarray.open_zarr(store).chunk({"time": 2, "y": 90, "x": 50}).drop_encoding().to_zarr(tmp_path / "both.zarr")
    found = run(tmp_path / "both.zarr", tmp_path / "out.zarr", "--slices", "alike", "--method", "quick")
    assert found.exit_code == 0, found.output
    assert back(tmp_path / "out.zarr")["height"].encoding["chunks"] == (2, 90, 50)


def test_info_and_show_read_a_variable(tmp_path):
    store, _ = made(tmp_path)
    found = RUN.invoke(app, ["info", str(store / "height"), "--json"])
    assert found.exit_code == 0, found.output
    assert json.loads(found.stdout)["spacing"] == "10 x 10"
    several = RUN.invoke(app, ["info", str(tmp_path / "none.zarr")])
    assert "no folder" in str(several.exception)


def test_info_and_show_take_the_first_slice_of_a_series_and_say_so(tmp_path):
    store, _ = made(tmp_path, times=3)
    found = RUN.invoke(app, ["info", str(store / "height"), "--json"])
    assert found.exit_code == 0, found.output
    told = json.loads(found.stdout)
    first = meshflow.estimate_noise(xarray.open_zarr(store)["height"].isel(time=0).load())
    assert told["noise"] == pytest.approx(first.sigma)
    said = RUN.invoke(app, ["info", str(store / "height")])
    assert "3 along time: only the first of them" in " ".join(said.output.split())
    shown = RUN.invoke(app, ["show", str(store / "height"), str(tmp_path / "first.png")])
    assert shown.exit_code == 0, shown.output
    volume = RUN.invoke(app, ["info", str(store / "height"), "--kind", "volume"])
    assert "only the first" not in volume.output


def test_a_series_without_a_word_on_slices_is_refused(tmp_path):
    store, _ = made(tmp_path, times=3)
    found = run(store, tmp_path / "out.zarr")
    assert isinstance(found.exception, InputError)
    assert "time; choose --slices each or --slices alike" in str(found.exception)
    assert not (tmp_path / "out.zarr").exists()


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (
            ("in.zarr/gauge", "out.zarr"),
            "in.zarr/gauge: two dimensions or more .* it has 1 dimension; name one: .*height",
        ),
        (("in.zarr/label", "out.zarr"), "in.zarr/label: two dimensions or more .* it has 0 dimensions; name one"),
        (("in.zarr/flags", "out.zarr"), "in.zarr/flags: real numbers expected, got bool; name one"),
        (("in.zarr/y", "out.zarr"), "in.zarr/y: two dimensions or more .* it has 1 dimension"),
        (("in.zarr/none", "out.zarr"), "name one: .*height"),
        (("in.zarr", "out.tif"), "Zarr store expected beside"),
        (("in.zarr", "in.zarr"), "is the input"),
        (("nothing.zarr", "out.zarr"), "no folder"),
        (("empty.zarr", "out.zarr"), "no Zarr store"),
        (("in.zarr", "there.zarr"), "exists"),
        (("in.zarr", "out.zarr", "--picture", "p.png"), "picture"),
        (("in.zarr", "out.zarr", "--displacement", "0.1"), "not in windows"),
    ],
)
def test_what_cannot_be_done_is_refused_in_one_line_and_nothing_is_written(tmp_path, monkeypatch, words, why):
    made(tmp_path)
    monkeypatch.chdir(tmp_path)
    for name in ("empty.zarr", "there.zarr"):
        Path(name).mkdir()
    before = sorted(os.listdir())
    found = run(*words)
    assert isinstance(found.exception, (InputError, FormatError)), found.output
    assert "\n" not in str(found.exception)
    assert found.exception.args
    with pytest.raises(type(found.exception), match=why):
        raise found.exception
    assert sorted(os.listdir()) == before


@pytest.mark.parametrize("words", [(), ("--method", "beltrami", "--contrast", "2", "--time", "90", "--noise", "1")])
def test_a_store_with_a_chunk_that_cannot_be_decoded_is_refused_in_one_line(tmp_path, monkeypatch, words):
    made(tmp_path)
    monkeypatch.chdir(tmp_path)
    Path("in.zarr/height/c/1/1").write_text("123\n")
    for found in (run("in.zarr/height", "out.zarr", *words), RUN.invoke(app, ["info", "in.zarr/height"])):
        assert isinstance(found.exception, FormatError)
        assert str(found.exception).startswith("in.zarr: a chunk of it cannot be read (")
        assert "\n" not in str(found.exception)
    assert os.listdir() == ["in.zarr"]


@pytest.mark.parametrize("refusal", [NotConverged("no solution"), InputError("no"), RuntimeError("a fault")])
def test_what_fails_beside_the_reading_of_a_store_passes_unchanged(tmp_path, monkeypatch, refusal):
    def fails(*_, **__):
        raise refusal

    store, _ = made(tmp_path)
    monkeypatch.setattr("meshflow.large.chunk_graph.smoothed_chunk", fails)
    assert run(store, tmp_path / "out.zarr", "--method", "quick").exception is refusal
    assert os.listdir(tmp_path) == ["in.zarr"]


@pytest.mark.parametrize("slices", [None, "each", "alike"])
def test_what_was_removed_is_measured_while_the_store_is_written(tmp_path, monkeypatch, slices):
    store, _ = made(tmp_path, times=2 if slices else 0)
    given = ("--method", "beltrami", "--contrast", "2", "--time", "90", "--noise", "1", "--json")
    words = (*given, *(("--slices", slices) if slices else ()))
    computed, smoothed = [], chunk_graph.smoothed_chunk

    def counting(*parts, **told):
        computed.append(1)
        return smoothed(*parts, **told)

    monkeypatch.setattr(chunk_graph, "smoothed_chunk", counting)
    found = run(store / "height", tmp_path / "out.zarr", *words)
    assert found.exit_code == 0, found.output
    assert len(computed) == 9 * (2 if slices else 1)
    before, after = (back(path)["height"].values.astype(float) for path in (store, tmp_path / "out.zarr"))
    told = json.loads(found.stdout)
    each = list(told["slices"].values()) if slices == "each" else [told]
    gone = (before - after) if slices == "each" else [before - after]
    for one, change in zip(each, gone, strict=True):
        assert one["removed"]["rms"] == pytest.approx(np.sqrt(np.nanmean(change**2)), rel=1e-6)
        assert one["removed"]["largest"] == pytest.approx(np.nanmax(np.abs(change)), rel=1e-6)
    assert "removed rms " in found.stderr
    assert "known" not in found.stderr


def test_the_table_of_several_stores_has_what_was_removed(tmp_path):
    store, _ = made(tmp_path)
    found = run(store / "height", "--output", tmp_path / "done", "--method", "quick")
    line = next(line for line in found.stdout.splitlines() if "in.zarr" in line)
    change = back(store)["height"].values - back(tmp_path / "done" / "in.zarr")["height"].values
    assert f"{np.sqrt(np.nanmean(change.astype(float) ** 2)):.4g}" in line.split()


def test_a_store_that_is_replaced_is_whole_or_as_it_was(tmp_path, monkeypatch):
    store, _ = made(tmp_path)
    assert run(store, tmp_path / "out.zarr", "--method", "quick").exit_code == 0
    first = back(tmp_path / "out.zarr")["height"].values
    assert run(store, tmp_path / "out.zarr", "--overwrite", "--method", "quick", "--strength", "2").exit_code == 0
    second = back(tmp_path / "out.zarr")["height"].values
    assert not np.array_equal(first, second, equal_nan=True)

    def fails(self, delayed):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("meshflow.cli.stores._Computed.__call__", fails)
    found = run(store, tmp_path / "out.zarr", "--overwrite")
    assert "No space left" in str(found.exception)
    np.testing.assert_array_equal(back(tmp_path / "out.zarr")["height"].values, second)
    assert sorted(os.listdir(tmp_path)) == ["in.zarr", "out.zarr"]


def test_several_stores_go_into_a_folder_and_each_has_a_line(tmp_path):
    store, _ = made(tmp_path)
    series = (tmp_path / "b").resolve()
    series.mkdir()
    other, _ = made(series, times=2)
    other.rename(series / "series.zarr")
    found = run(store, series / "series.zarr/height", "--output", tmp_path / "done", "--method", "quick")
    assert found.exit_code == 1
    assert "slices" in found.output
    assert sorted(os.listdir(tmp_path / "done")) == ["in.zarr"]


def test_places_in_a_store_are_named_by_the_folder_and_the_variable():
    assert in_store(Path("a/b.zarr/g/z")) == Place(Path("a/b.zarr"), "g/z")
    assert in_store(Path("b.ZARR")) == Place(Path("b.ZARR"))
    assert in_store(Path("a/b.tif")) is None
