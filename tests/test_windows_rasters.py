"""A raster file that is smoothed by windows: the same file as the whole makes, in a bounded memory, or nothing at all."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import rasterio
from helpers.raster_files import make
from rasterio.enums import ColorInterp
from rasterio.errors import RasterioError
from rasterio.transform import from_origin

from meshflow import Beltrami, Mask
from meshflow.errors import FormatError, InputError
from meshflow.estimate.request import Request
from meshflow.io.files import read, write
from meshflow.io.formats.raster_windows import RasterWriter
from meshflow.io.metadata import ReadOptions
from meshflow.large.memory import Budget, bytes_in
from meshflow.large.outputs import Output
from meshflow.large.rasters import smooth_raster
from meshflow.results.run import run
from meshflow.smoothing import smooth_object
from meshflow.surfaces.data import array_of

H, W = 130, 170


class Small(Budget):
    """Windows of 64 samples a side, and bands of 20 rows for counting."""

    def sides(self, form, halo, held=0):
        return 64, 64

    def counted(self, form):
        return 20 * form.shape[1]


SMALL = Small(1e9)


def heights(dtype="float32", k=1, level=200.0, seed=0):
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0:H, 0:W]
    z = level + 30 * np.sin(y / 9) * np.cos(x / 7) + 20 * (x > W // 2) + 2 * rng.normal(size=(k, H, W))
    return z.astype(dtype)


def request(**options):
    return Request.of(
        options.pop("method", Beltrami(contrast=5.0)), time=options.pop("time", 900.0), noise=2.0,
        outliers="include", **options,
    )  # fmt: skip


def both(path, asked, dtype=None, **options):
    """The file that the whole makes, and that of windows."""
    one, two = path.parent / "whole.tif", path.parent / "windows.tif"
    done, _ = smooth_object(read(path, **options), asked, record=None)
    write(done, one, **({"dtype": dtype} if dtype else {}))
    outcome = smooth_raster(path, two, asked, ReadOptions.of(options), Output(SMALL, dtype))
    return one, two, outcome


def alike(one, two):
    with rasterio.open(one) as a, rasterio.open(two) as b:
        ours = {name: value for name, value in b.profile.items() if name != "interleave"}
        assert {name: a.profile[name] for name in ours} == ours
        assert a.read().tobytes() == b.read().tobytes()
        assert np.array_equal(a.read_masks(), b.read_masks())
        assert (a.colorinterp, a.descriptions, a.units, a.scales) == (b.colorinterp, b.descriptions, b.units, b.scales)
        assert [a.overviews(i) for i in a.indexes] == [b.overviews(i) for i in b.indexes]
        return b.tags(ns="meshflow")


def holed(samples, value):
    samples = samples.copy()
    samples[:, 40:60, 30:90] = value
    samples[:, 100, 5] = value
    return samples


DEGREES = {"crs": "EPSG:4326", "transform": from_origin(7, 46, 0.0003, 0.0003)}
FILES = {
    "plain": lambda path: make(path, heights()),
    "tiled": lambda path: make(path, heights(), tiled=True, blockxsize=64, blockysize=64, compress="deflate"),
    "nodata": lambda path: make(path, holed(heights(), -9999), nodata=-9999),
    "nan": lambda path: make(path, holed(heights(), np.nan)),
    "undeclared": lambda path: make(path, holed(heights("int16"), -32768)),
    "far above zero": lambda path: make(path, heights(level=90_000.0)),
    "degrees": lambda path: make(path, holed(heights(), -9999), nodata=-9999, **DEGREES),
    "scaled": lambda path: make(path, heights("int16"), scale=(0.5, 3.0)),
    "mask": lambda path: make(path, heights(), mask=np.indices((H, W)).sum(axis=0) < 90),
    "three": lambda path: make(path, heights(k=3)),
    "alpha": lambda path: make(
        path, np.concatenate([heights("uint8", 3) // 2, np.full((1, H, W), 255, np.uint8)]),
        colours=[ColorInterp.red, ColorInterp.green, ColorInterp.blue, ColorInterp.alpha],
    ),
    "two, the second": lambda path: make(path, heights(k=2)),
}  # fmt: skip


@pytest.mark.parametrize("outliers", [None, "repair"])
@pytest.mark.parametrize("k", [1, 3])
def test_outliers_of_a_file_are_those_of_the_whole(k, outliers, tmp_path):
    z = heights(k=k)
    z[:, np.random.default_rng(1).random((H, W)) < 0.004] = 420.0
    asked = replace(request(), outliers=outliers)
    one, two, outcome = both(make(tmp_path / "in.tif", z), asked)
    alike(one, two)
    assert any("unlike all neighbours" in word for word in outcome.warnings)


@pytest.mark.long
@pytest.mark.parametrize("name", sorted(FILES))
def test_the_file_that_windows_write_is_that_of_the_whole(name, tmp_path):
    path = FILES[name](tmp_path / "in.tif")
    one, two, outcome = both(path, request(), **({"band": 2} if "second" in name else {}))
    tags = alike(one, two)
    assert outcome.windows == 9
    assert tags["method"] == "beltrami"
    assert "by 9 windows" in tags["stopped_because"]
    if name == "undeclared":
        assert any("1201 samples are -32768" in note for note in outcome.notes)


@pytest.mark.parametrize(
    ("asked", "dtype"),
    [
        (request(), "source"),
        (request(method=Beltrami(patch=0.7, contrast=3.0, twicing=0.5), time=4000.0), None),
        (request(constraints=[Mask(np.indices((H, W)).sum(axis=0) % 7 > 0)]), None),
        (request(boundary="fixed"), "float64"),
    ],
)
def test_so_it_is_for_other_flows_masks_and_types(asked, dtype, tmp_path):
    path = make(tmp_path / "in.tif", holed(heights("int16"), -999), nodata=-999)
    alike(*both(path, asked, dtype)[:2])


@pytest.mark.parametrize(
    ("kind", "dtype", "declared", "mark"),
    [
        ("float32", None, 200.0, -9999.0),
        ("float32", None, 1e4, 1e4),
        ("int16", "source", 200.0, -9999.0),
        ("uint8", "source", 110.0, 255.0),
        ("float64", None, -9999.0, np.nan),
    ],
)
def test_a_mark_of_missing_samples_that_smoothed_ones_may_have_is_replaced_before_the_run(
    kind, dtype, declared, mark, tmp_path
):
    z = heights(level=100.0 if kind == "uint8" else 0.0 if kind == "float64" else 200.0)
    z = np.where(np.abs(z - declared) < 0.7, declared, z * (1e3 if kind == "float64" else 1.0)).astype(kind)
    path, out = make(tmp_path / "in.tif", z), tmp_path / "out.tif"
    outcome = smooth_raster(path, out, request(), ReadOptions.of({"nodata": declared}), Output(SMALL, dtype))
    with rasterio.open(out) as written:
        assert np.array_equal(written.nodata, mark, equal_nan=True)
        assert np.count_nonzero(written.read_masks() == 0) == np.count_nonzero(z == declared)
    assert (f"missing samples are marked by nodata {mark:g}" in outcome.notes) == (mark != declared)


def test_where_no_mark_is_left_it_is_refused_before_the_run(tmp_path, monkeypatch):
    z = heights("uint8", level=100.0)
    z[0, 0, :2] = 0, 255
    path = make(tmp_path / "in.tif", z)
    monkeypatch.setattr("meshflow.large.rasters.windowed", None)
    with pytest.raises(FormatError, match="uint8 has no value left to mark them; write dtype='float32'"):
        smooth_raster(path, tmp_path / "out.tif", request(), ReadOptions.of({"nodata": 110.0}), Output(SMALL, "source"))
    assert [file.name for file in tmp_path.iterdir()] == ["in.tif"]


def test_the_formats_that_are_said_to_be_written_by_windows_are_written(tmp_path):
    path = make(tmp_path / "in.tif", heights())
    with pytest.raises(FormatError, match="out.asc: a .* is written by windows, got .asc") as why:
        smooth_raster(path, tmp_path / "out.asc", request(), ReadOptions(), Output(SMALL))
    smooth_raster(path, tmp_path / "out.tif", request(), ReadOptions(), Output(SMALL))
    expected = array_of(read(tmp_path / "out.tif").data).tobytes()
    said = re.findall(r"\.[a-z]+(?=,| or| is)", str(why.value).partition(": a ")[2])
    assert said == [".tif", ".tiff", ".img", ".nc", ".gpkg", ".bil"]
    for suffix in said[1:]:
        target = tmp_path / f"out{suffix}"
        smooth_raster(path, target, request(), ReadOptions(), Output(SMALL))
        assert array_of(read(target).data).tobytes() == expected


def test_overviews_and_tags_of_the_source_are_kept(tmp_path):
    path = make(tmp_path / "in.tif", heights(), tags={"SURVEY": "spring"})
    with rasterio.open(path, "r+") as raster:
        raster.build_overviews([2, 4])
    one, two, _ = both(path, request())
    alike(one, two)
    with rasterio.open(two) as raster:
        assert raster.overviews(1) == [2, 4]
        assert raster.tags()["SURVEY"] == "spring"


def test_what_is_removed_is_summed_over_the_windows(tmp_path):
    path = make(tmp_path / "in.tif", holed(heights(), -9999), nodata=-9999)
    document = read(path)
    outcome = smooth_raster(path, tmp_path / "out.tif", request(), ReadOptions(), Output(SMALL))
    result = run(document.data, request(), record=None)
    assert outcome.removed.rms == pytest.approx(float(np.sqrt(np.mean(result.counted**2))), rel=1e-12)
    assert outcome.removed.largest == float(np.abs(result.counted).max())
    assert f"rms {outcome.removed.rms:.4g} of noise 2" in outcome.summary


def test_a_raster_may_replace_itself(tmp_path):
    path = make(tmp_path / "in.tif", heights())
    before = array_of(read(path).data)
    smooth_raster(path, path, request(), ReadOptions(), Output(SMALL, overwrite=True))
    after = array_of(read(path).data)
    assert before.shape == after.shape
    assert not np.array_equal(before, after)


def test_a_full_disk_half_way_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    path, target = make(tmp_path / "in.tif", heights()), tmp_path / "out.tif"
    target.write_bytes(b"old")
    written, windows = RasterWriter.write, []

    def counted(self, part, samples, alpha):
        windows.append(part)
        written(self, part, samples, alpha)

    def usage(folder):
        assert folder == tmp_path.resolve()
        return SimpleNamespace(total=1 << 40, free=1 << 40 if len(windows) < 5 else 1 << 10)

    monkeypatch.setattr(RasterWriter, "write", counted)
    monkeypatch.setattr("meshflow.io.atomic_write.disk_usage", usage)
    with pytest.raises(
        FormatError, match="out.tif was not written .No space left on device.; an existing file is unch"
    ):
        smooth_raster(path, target, request(), ReadOptions(), Output(SMALL, overwrite=True))
    assert len(windows) == 5
    assert target.read_bytes() == b"old"
    assert sorted(file.name for file in tmp_path.iterdir()) == ["in.tif", "out.tif"]


def test_no_window_is_run_where_a_disk_is_full_from_the_first(tmp_path, monkeypatch):
    path = make(tmp_path / "in.tif", heights())
    monkeypatch.setattr("meshflow.io.atomic_write.disk_usage", lambda folder: SimpleNamespace(total=1 << 40, free=9))
    monkeypatch.setattr("meshflow.large.rasters.smoothed", None)
    with pytest.raises(FormatError, match="out.tif was not written .No space left on device."):
        smooth_raster(path, tmp_path / "out.tif", request(), ReadOptions(), Output(SMALL))
    assert [file.name for file in tmp_path.iterdir()] == ["in.tif"]


def test_the_reason_is_a_full_disk_where_a_copy_of_another_driver_finds_no_room(tmp_path, monkeypatch):
    path = make(tmp_path / "in.tif", heights())
    room = [1 << 40]

    def refused(*rest):
        room[0] = 1 << 10
        raise RasterioError("Seek error at scanline 0")

    usage = lambda folder: SimpleNamespace(total=1 << 40, free=room[0])  # noqa: E731
    monkeypatch.setattr("meshflow.io.atomic_write.disk_usage", usage)
    monkeypatch.setattr("meshflow.io.formats.raster_windows.copied_to", refused)
    with pytest.raises(FormatError, match="out.tif was not written .No space left on device.; an existing file"):
        smooth_raster(path, tmp_path / "out.tif", request(), ReadOptions(), Output(SMALL, driver="COG"))
    assert [file.name for file in tmp_path.iterdir()] == ["in.tif"]


def test_what_is_not_read_back_as_it_was_written_is_refused(tmp_path, monkeypatch):
    path = make(tmp_path / "in.tif", heights())
    written = RasterWriter.write

    def another(self, part, samples, alpha):
        written(self, part, samples, alpha)
        self.sums[next(iter(self.sums))] ^= 1

    monkeypatch.setattr(RasterWriter, "write", another)
    with pytest.raises(FormatError, match="what was read back differs"):
        smooth_raster(path, tmp_path / "out.tif", request(), ReadOptions(), Output(SMALL))
    assert [file.name for file in tmp_path.iterdir()] == ["in.tif"]


# --- memory -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "size"), [("2GB", 2e9), ("500 MB", 5e8), ("1.5g", 1.5e9), ("1e3", None), ("x", None), ("60", None)]
)
def test_a_size_is_said_in_bytes(words, size):
    if size is None:
        with pytest.raises(InputError, match="memory: .*a size such as 2GB or 500MB expected"):
            bytes_in(words)
    else:
        assert bytes_in(words) == size


def test_a_memory_too_small_for_one_window_is_refused_with_the_least_that_works(tmp_path):
    path, leasts = make(tmp_path / "in.tif", np.tile(heights(), (1, 4, 4))), []
    for memory, end in ((50e6, "MB is the least, and more"), (253.73e6, "MB is the least$")):
        with pytest.raises(InputError, match=f"too little for a window of 256 .* halo of .*; (\\d+) {end}") as why:
            smooth_raster(path, tmp_path / "out.tif", request(), ReadOptions(), Output(Budget(memory)))
        leasts.append(float(str(why.value).split(";")[1].split()[0]))
    assert leasts[0] <= leasts[1]
    smooth_raster(path, tmp_path / "out.tif", request(), ReadOptions(), Output(Budget(1e6 * leasts[1])))
