"""Rasters in and out: nothing around the samples is lost, nothing is quantised unasked."""

import resource
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rasterio
import tifffile
from helpers.raster_files import UP, UTM, heights, make, same
from rasterio.enums import ColorInterp

from meshflow.errors import FormatError, InputError
from meshflow.io.files import Document, read, write
from meshflow.io.formats import raster_bands as bands
from meshflow.io.formats import rasters
from meshflow.io.metadata import ReadOptions
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image

SHARED = Path(__file__).parents[2] / "shared" / "data"
DEMS = sorted(p.name for p in (SHARED / "dem").glob("*") if p.suffix != ".IMG") if SHARED.exists() else []
shared = [pytest.mark.shared, pytest.mark.skipif(not SHARED.exists(), reason="../shared/data is absent")]


# --- every file of the world outside


@pytest.mark.parametrize("name", [pytest.param(n, marks=shared) for n in DEMS])
def test_every_elevation_model_comes_out_as_it_came_in(name, tmp_path):
    document = read(SHARED / "dem" / name)
    out = tmp_path / "out.tif"
    write(document, out, tags={"meshflow:time": "3"})
    again = read(out)
    assert isinstance(again.data, HeightField)
    assert np.array_equal(document.data.missing, again.data.missing)
    there = ~document.data.missing
    assert np.array_equal(document.data.z[there], again.data.z[there])
    assert again.data.unit == document.data.unit
    assert np.array_equal(again.data.spacing[0], document.data.spacing[0])
    assert again.data.spacing[1] == document.data.spacing[1]
    with warnings.catch_warnings(), rasterio.open(SHARED / "dem" / name) as source, rasterio.open(out) as target:
        assert target.dtypes == (str(document.data.z.dtype),)
        assert np.array_equal(source.read_masks(1), target.read_masks(1))
        assert (source.crs, source.transform, source.shape) == (target.crs, target.transform, target.shape)
        words = {k: v for k, v in source.tags().items() if v}
        assert words.items() <= target.tags().items()
        assert target.tags(ns="meshflow") == {"time": "3"}
        assert source.overviews(1) == target.overviews(1)
        assert (source.units, source.descriptions) == (target.units, target.descriptions)
    assert [p.name for p in tmp_path.iterdir()] == ["out.tif"]


@pytest.mark.shared
@pytest.mark.skipif(not SHARED.exists(), reason="../shared/data is absent")
def test_the_data_file_of_a_label_is_refused_with_the_name_of_the_label():
    with pytest.raises(FormatError, match="open MEGT90N000CB.LBL"):
        read(SHARED / "dem" / "MEGT90N000CB.IMG")


# --- what is missing


@pytest.mark.parametrize(
    ("dtype", "nodata"),
    [("uint8", 0), ("int16", 32767), ("uint16", 65535), ("int32", -(2**31)), ("float32", -3.4e38), ("float32", np.nan),
     ("float64", -1.7e308), ("float32", -9999)],
)  # fmt: skip
def test_the_mask_of_missing_samples_survives(tmp_path, dtype, nodata):
    z = heights(dtype)
    z[1, 2] = z[4, :3] = nodata
    document, again, notes = same(make(tmp_path / "a.tif", z, nodata=nodata))
    gone = np.zeros(z.shape, bool)
    gone[1, 2] = gone[4, :3] = True
    assert np.array_equal(document.data.missing, gone)
    assert np.array_equal(again.data.missing, gone)
    assert np.array_equal(again.data.z[~gone], z[~gone])
    assert again.source.frame.nodata == pytest.approx(nodata, rel=1e-6, nan_ok=True)
    assert notes == ()


def test_an_internal_mask_becomes_nodata(tmp_path):
    gone = np.zeros((6, 8), bool)
    gone[2:4, 3] = True
    document, again, _ = same(make(tmp_path / "a.tif", heights("int16"), mask=gone))
    assert document.source.frame.nodata is None
    assert np.array_equal(document.data.missing, gone)
    assert np.array_equal(again.data.missing, gone)
    assert again.source.frame.nodata == -9999


def test_nodata_is_not_declared_where_nothing_is_missing(tmp_path):
    assert same(make(tmp_path / "a.tif", heights()))[1].source.frame.nodata is None


def test_nan_without_a_nodata_value_gets_one(tmp_path):
    z = heights()
    z[0, 0] = np.nan
    _, again, _ = same(make(tmp_path / "a.tif", z))
    assert again.source.frame.nodata == -9999
    assert np.argwhere(again.data.missing).tolist() == [[0, 0]]


def test_a_sample_that_was_moved_onto_the_nodata_value_does_not_go_missing(tmp_path):
    z = heights("uint16")
    z[0, 0] = 0
    document = read(make(tmp_path / "a.tif", z, nodata=0))
    moved = document.data.z.copy()
    moved[3, 3] = 0.0
    write(document.holding(replace(document.data, z=moved)), tmp_path / "b.tif")
    again = read(tmp_path / "b.tif")
    assert np.array_equal(again.data.missing, document.data.missing)
    assert again.data.z[3, 3] == 0
    assert again.source.frame.nodata == -9999


def test_nodata_of_the_caller_stands_in_for_the_declared_one(tmp_path):
    z = heights("int16")
    z[0, 0], z[0, 1] = -1, -2
    path = make(tmp_path / "a.tif", z, nodata=-1)
    document = read(path, nodata=-2)
    assert np.argwhere(document.data.missing).tolist() == [[0, 1]]
    write(document, tmp_path / "b.tif")
    assert np.argwhere(read(tmp_path / "b.tif").data.missing).tolist() == [[0, 1]]


def test_bands_keep_their_own_holes(tmp_path):
    z = np.stack([heights(), heights() + 1, heights() + 2])
    z[1, 2, 2] = -9999
    document, _, _ = same(make(tmp_path / "a.tif", z, nodata=-9999))
    assert document.data.missing[2, 2]
    with rasterio.open(tmp_path / "again.tif") as target:
        assert np.array_equal(target.read(), z)


# --- what is around the samples


def test_tags_units_descriptions_and_colours_survive(tmp_path):
    def after(target):
        target.set_band_description(2, "green")
        target.set_band_unit(1, "m")
        target.update_tags(3, sensor="b", STATISTICS_MAXIMUM="7")
        target.update_tags(ns="private", key="a:b=c")

    colours = [ColorInterp.red, ColorInterp.green, ColorInterp.blue]
    path = make(tmp_path / "a.tif", np.stack([heights("uint8")] * 3), colours=colours, after=after,
                tags={"AREA_OR_POINT": "Point", "made": "by hand"})  # fmt: skip
    document, _, _ = same(path)
    assert isinstance(document.data, Image)
    assert document.data.values.shape == (6, 8, 3)
    with rasterio.open(tmp_path / "again.tif") as target:
        assert target.colorinterp == tuple(colours)
        assert target.descriptions[1] == "green"
        assert target.units[0] == "m"
        assert target.tags(3) == {"sensor": "b"}, "statistics of the old values are not true of the new ones"
        assert target.tags(ns="private") == {"key": "a:b=c"}
        assert target.tags()["AREA_OR_POINT"] == "Point"
        assert target.tags()["made"] == "by hand"
        assert (target.crs, target.transform) == (UTM, UP)


def test_large_rasters_are_tiled_and_have_a_predictor_that_tifffile_reads_by_itself(tmp_path):
    _, again, _ = same(make(tmp_path / "a.tif", heights("int16", 300, 300)))
    with rasterio.open(tmp_path / "again.tif") as target:
        assert target.block_shapes == [(256, 256)]
        assert target.compression.name == "deflate"
        assert target.tags(ns="IMAGE_STRUCTURE")["PREDICTOR"] == "2"
        assert target.dtypes == ("float32",)
    assert np.array_equal(tifffile.imread(tmp_path / "again.tif"), again.data.z)


def test_alpha_is_carried_along_and_marks_what_is_missing(tmp_path):
    rgba = np.stack([heights("uint8")] * 4)
    rgba[3] = 255
    rgba[3, 1, 1], rgba[3, 2, 2] = 0, 100
    colours = [ColorInterp.red, ColorInterp.green, ColorInterp.blue, ColorInterp.alpha]
    document, again, _ = same(make(tmp_path / "a.tif", rgba, colours=colours))
    assert document.data.values.shape == (6, 8, 3)
    assert np.argwhere(document.data.missing).tolist() == [[1, 1]]
    assert np.array_equal(again.data.missing, document.data.missing)
    assert np.array_equal(again.source.frame.alpha, rgba[3])
    write(document, tmp_path / "bytes.tif", dtype="source")
    with rasterio.open(tmp_path / "bytes.tif") as target:
        assert np.array_equal(target.read(), rgba)
        assert target.colorinterp == tuple(colours)


def test_alpha_in_floating_point_marks_what_is_missing_too(tmp_path):
    """GDAL itself makes a mask of alpha in whole numbers only."""
    grey = np.stack([heights(), np.full((6, 8), 255, "float32")])
    grey[1, 1, 1] = 0
    document, again, _ = same(make(tmp_path / "a.tif", grey, colours=[ColorInterp.gray, ColorInterp.alpha]))
    assert isinstance(document.data, HeightField)
    assert np.argwhere(document.data.missing).tolist() == [[1, 1]]
    assert np.array_equal(again.data.missing, document.data.missing)


def test_scale_and_offset_are_applied_once_and_said(tmp_path):
    raw = heights("int16")
    raw[0, 0] = -1
    path = make(tmp_path / "a.tif", raw, scale=(0.1, 5.0), nodata=-1)
    document, again, notes = same(path)
    there = ~document.data.missing
    assert np.allclose(document.data.z[there], raw[there] * 0.1 + 5, rtol=1e-6)
    assert np.array_equal(again.data.z[there], document.data.z[there])
    assert "scale 0.1 and offset 5" in document.notes[0]
    assert "as they are" in notes[0]
    assert not again.source.frame.scaled
    notes = write(document, tmp_path / "packed.tif", dtype="source")
    assert "in steps of 0.1" in notes[0]
    with rasterio.open(tmp_path / "packed.tif") as target:
        assert np.array_equal(target.read(1), raw)
        assert (target.scales, target.offsets, target.nodata) == ((0.1,), (5.0,), -1)


def test_one_band_of_several_can_be_chosen(tmp_path):
    path = make(tmp_path / "a.tif", np.stack([heights(), heights() + 1]))
    document, again, _ = same(path, band=2)
    assert np.array_equal(document.data.z, heights() + 1)
    assert np.array_equal(again.data.z, heights() + 1)
    with pytest.raises(InputError, match="band 3 expected to be one of 1 to 2"):
        read(path, band=3)
    with pytest.raises(InputError, match="one band expected for a terrain, got 2; choose one: band=1"):
        read(path, kind="terrain")
    assert isinstance(rasters.read(path, ReadOptions(kind="image", band=1)).data, Image)


# --- quantisation, only when asked for


def test_integers_become_floats_wide_enough_to_hold_them(tmp_path):
    for dtype, expected in (("uint8", "float32"), ("int16", "float32"), ("int32", "float64"), ("float64", "float64")):
        same(make(tmp_path / "a.tif", heights(dtype)))
        with rasterio.open(tmp_path / "again.tif") as target:
            assert target.dtypes == (expected,)


def test_whole_numbers_are_written_only_when_asked_and_said(tmp_path):
    document = read(make(tmp_path / "a.tif", heights("uint8")))
    z = document.data.z + np.float32(0.4)
    z[0, 0], z[0, 1] = -5, 300
    notes = write(document.holding(replace(document.data, z=z)), tmp_path / "b.tif", dtype="source")
    assert "quantised again" in notes[0]
    assert "2 samples were clipped to 0 to 255" in notes[1]
    with rasterio.open(tmp_path / "b.tif") as target:
        assert target.dtypes == ("uint8",)
        assert target.read(1)[0, :2].tolist() == [0, 255]
        assert np.array_equal(target.read(1)[1:], heights("uint8")[1:])
    with pytest.raises(InputError, match="dtype: source or one of .* expected, got 'int7'"):
        write(document, tmp_path / "c.tif", dtype="int7")


def test_a_type_without_a_value_left_for_missing_samples_is_refused(tmp_path):
    z = np.arange(256, dtype="float32").reshape(16, 16).repeat(2, axis=0)
    z[0, 0] = np.nan
    document = read(make(tmp_path / "a.tif", z))
    with pytest.raises(FormatError, match="1 samples are missing and uint8 has no value left"):
        write(document, tmp_path / "b.tif", dtype="uint8")


def test_another_mark_than_the_declared_one_is_said_where_nothing_is_missing_too(tmp_path):
    document = read(make(tmp_path / "a.tif", heights(), nodata=-5))
    z = document.data.z.copy()
    assert write(document, tmp_path / "b.tif") == ()
    z[0, 0] = -5
    assert write(document.holding(replace(document.data, z=z)), tmp_path / "c.tif") == (
        "missing samples are marked by nodata -9999",
    )


# --- files that are not what they should be


def test_a_file_that_cannot_be_read_is_refused_with_the_reason(tmp_path):
    whole = make(tmp_path / "whole.tif", np.random.default_rng(0).normal(size=(200, 200)).astype("float32"))
    short = tmp_path / "short.tif"
    short.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    text = tmp_path / "text.tif"
    text.write_text("not a raster at all")
    for path, reason in ((short, "short.tif cannot be read"), (text, "not recognized")):
        with pytest.raises(FormatError, match=reason):
            read(path)
    (tmp_path / "empty.tif").touch()
    with pytest.raises(FormatError, match="is empty"):
        read(tmp_path / "empty.tif")
    with pytest.raises(FormatError, match="no such file"):
        read(tmp_path / "nowhere.tif")


def test_a_wrong_extension_does_not_matter_where_gdal_sees_what_it_is(tmp_path):
    path = make(tmp_path / "a.tif", heights())
    path.rename(tmp_path / "a.dem")
    assert np.array_equal(read(tmp_path / "a.dem").data.z, heights())


def test_a_kind_or_option_that_does_not_belong_is_refused(tmp_path):
    path = make(tmp_path / "a.tif", heights())
    with pytest.raises(InputError, match="depth_scale: no option of a raster"):
        read(path, depth_scale=1000)
    with pytest.raises(
        InputError,
        match="kind: terrain, .*, vectors or tensors expected, got 'soup'",
    ):
        read(path, kind="soup")


def test_a_data_object_of_another_size_is_refused(tmp_path):
    document = read(make(tmp_path / "a.tif", heights()))
    with pytest.raises(InputError, match=r"shape \(1, 6, 8\), as they were read, .* got \(1, 5, 8\)"):
        write(document.holding(HeightField(heights(h=5))), tmp_path / "b.tif")


# --- writing


def test_a_full_disk_leaves_the_old_file(tmp_path):
    """GDAL itself may say nothing of a full disk; a limit on the size of files stands in for one."""
    noise = np.random.default_rng(0).normal(size=(600, 600)).astype("float32")
    document = read(make(tmp_path / "a.tif", noise))
    old = make(tmp_path / "old.tif", heights())
    before = old.read_bytes()
    write(document, tmp_path / "whole.tif")
    size = (tmp_path / "whole.tif").stat().st_size
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    for share in (0.0, 0.3, 0.9, 0.999):
        resource.setrlimit(resource.RLIMIT_FSIZE, (int(share * size), hard))
        try:
            with pytest.raises(FormatError) as refusal:
                write(document, old, overwrite=True)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        assert "old.tif was not written" in str(refusal.value)
        assert old.read_bytes() == before
        assert sorted(p.name for p in tmp_path.iterdir()) == ["a.tif", "old.tif", "whole.tif"]


def test_samples_that_are_not_there_when_read_back_are_an_error(tmp_path, monkeypatch):
    """As on a full disk of which GDAL says nothing: the tiles are there, and hold zeros."""
    document = read(make(tmp_path / "a.tif", heights()))
    describe = bands.describe

    def and_lose_the_samples(target, *rest):
        describe(target, *rest)
        target.write(np.zeros((1, 6, 8), "float32"))
        target.close()

    monkeypatch.setattr(rasterio.io.DatasetWriter, "write", lambda *_: None, raising=False)
    monkeypatch.setattr(bands, "describe", and_lose_the_samples)
    with pytest.raises(FormatError, match="read back differs"):
        write(document, tmp_path / "b.tif")
    assert not (tmp_path / "b.tif").exists()


def test_an_existing_file_is_replaced_only_on_purpose(tmp_path):
    path = make(tmp_path / "a.tif", heights())
    document = read(path)
    with pytest.raises(FormatError, match="exists"):
        write(document, path)
    write(document.holding(replace(document.data, z=document.data.z + 1)), path, overwrite=True)
    assert np.array_equal(read(path).data.z, heights() + 1)


def test_a_terrain_from_elsewhere_keeps_its_spacing_and_holes(tmp_path):
    z = heights()
    z[2, 2] = np.nan
    document = Document(HeightField(z, (30.0, 20.0)), tmp_path / "a.npy")
    write(document, tmp_path / "b.tif")
    again = read(tmp_path / "b.tif")
    assert again.data.spacing == (30, 20)
    assert np.argwhere(again.data.missing).tolist() == [[2, 2]]
    assert again.source.frame.nodata == -9999
