"""What the numbers of a raster mean, where its tags do not say it: masks, marks, lengths on maps, units."""

import json

import numpy as np
import pytest
import rasterio
from typer.testing import CliRunner

import meshflow
from meshflow.cli.commands import app
from meshflow.errors import InputError
from meshflow.io.files import read, write
from meshflow.results.multipart import Results
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image


def terrain(rows=48, columns=64, seed=0):
    """Heights (h, w) with noise of 1, and without."""
    y, x = np.mgrid[0:rows, 0:columns]
    clean = 500 + 30 * np.sin(x / 13) * np.cos(y / 17)
    return (clean + np.random.default_rng(seed).normal(size=clean.shape)).astype(np.float32), clean


def raster(path, bands, crs="EPSG:32632", transform=None, **profile):
    bands = (
        np.atleast_3d(np.moveaxis(np.asarray(bands), 0, -1)) if np.ndim(bands) == 3 else np.asarray(bands)[..., None]
    )
    units, names = profile.pop("units", ()), profile.pop("names", ())
    height, width, count = bands.shape
    transform = transform or rasterio.Affine(10, 0, 500_000, 0, -10, 5_000_000)
    with rasterio.open(
        path, "w", driver="GTiff", width=width, height=height, count=count, dtype=bands.dtype, crs=crs, transform=transform,
        **profile,
    ) as target:  # fmt: skip
        target.write(np.moveaxis(bands, 2, 0))
        for i, unit in enumerate(units, start=1):
            target.set_band_unit(i, unit)
        for i, name in enumerate(names, start=1):
            target.set_band_description(i, name)
    return path


def said(document):
    return "; ".join(document.notes)


# --- what marks missing samples and says so nowhere


@pytest.mark.parametrize("value", [-9999, -99999, -3.4028235e38, 1e30, 3.4028235e38, -32768])
def test_a_mark_that_nothing_declares_is_missing_and_named_and_stays(tmp_path, value):
    z, clean = terrain()
    holes = np.zeros(z.shape, bool)
    holes[10:16, 20:30] = holes[0, :9] = True
    z[holes] = value
    document = read(raster(tmp_path / "a.tif", z))
    assert np.array_equal(document.data.missing, holes)
    assert f"{int(holes.sum())} samples are {np.float32(value):.9g}" in said(document)
    assert f"nodata={np.float32(value):.9g} declares it" in said(document)
    smoothed = meshflow.smooth(document)
    write(smoothed, tmp_path / "b.tif")
    with rasterio.open(tmp_path / "b.tif") as written:
        back, declared = written.read(1), written.nodata
    assert declared == np.float32(value)
    assert (back[holes] == np.float32(value)).all()
    beside = np.zeros(z.shape, bool)
    beside[9:17, 19:31] = True
    error = np.abs(back - clean)
    assert error[beside & ~holes].mean() < 2.5 * error[~beside & ~holes].mean()


def test_a_mark_is_data_where_the_caller_says_so_and_where_data_reach_it(tmp_path):
    z, _ = terrain()
    z[0, :5] = -9999
    assert not read(raster(tmp_path / "a.tif", z), nodata=float("nan")).data.missing.any()
    deep = -9990 * np.random.default_rng(1).random(z.shape).astype(np.float32)  # a sea as deep as the mark
    deep[0, :5] = -9999
    document = read(raster(tmp_path / "b.tif", deep))
    assert not document.data.missing.any()
    assert "declares" not in said(document)
    level = np.full_like(z, 100)
    level[3, 3] = -9999  # once is a measurement that failed, or a well
    assert not read(raster(tmp_path / "c.tif", level)).data.missing.any()


def test_whole_numbers_have_marks_too(tmp_path):
    z = np.rint(terrain()[0]).astype(np.int16)
    z[:3, :3] = -32768
    document = read(raster(tmp_path / "a.tif", z))
    assert document.data.missing.sum() == 9
    write(document, tmp_path / "b.tif", dtype="source")
    assert np.array_equal(rasterio.open(tmp_path / "b.tif").read(1), z)


# --- a band that is a mask


@pytest.mark.parametrize("peak", [1, 255])
@pytest.mark.parametrize("declared", [True, False])
def test_an_alpha_band_is_the_mask_and_comes_back_as_it_was(tmp_path, peak, declared):
    z, _ = terrain()
    holes = np.zeros(z.shape, bool)
    holes[5:20, 7:13] = True
    alpha = np.where(holes, 0, peak).astype(np.float32)
    path = raster(tmp_path / "a.tif", [np.where(holes, 0, z), alpha])
    if declared:
        with rasterio.open(path, "r+") as target:
            target.colorinterp = [rasterio.enums.ColorInterp.gray, rasterio.enums.ColorInterp.alpha]
    document = read(path)
    assert isinstance(document.data, HeightField)
    assert np.array_equal(document.data.missing, holes)
    write(meshflow.smooth(document, method="quick"), tmp_path / "b.tif")
    assert np.array_equal(rasterio.open(tmp_path / "b.tif").read(2), alpha)


def test_a_band_of_two_values_is_data_where_others_are_not_empty_under_it(tmp_path):
    z, _ = terrain()
    water = (z > 510).astype(np.float32)
    document = read(raster(tmp_path / "a.tif", [z, water]))
    assert isinstance(document.data, Image)
    assert document.data.values.shape[2] == 2


# --- lengths on maps that stretch


@pytest.mark.parametrize(
    ("crs", "north", "expected"),
    [
        ("EPSG:3857", 8_399_737.89, (0.5013, 0.5004)),  # 60 degrees north: N cos / a, M cos / a
        ("EPSG:3857", 0.0, (1.0, 0.99331)),
        ("EPSG:3395", 8_362_698.55, (0.50125, 0.50125)),  # conformal on the ellipsoid
        ("EPSG:32662", 6_679_169.45, (0.50126, 1.00083)),  # degrees as metres
        ("EPSG:32632", 5_000_000.0, (1.0, 1.0)),
    ],
)
def test_lengths_on_a_cylindrical_map_are_those_on_the_ground(tmp_path, crs, north, expected):
    z, _ = terrain(16, 16)
    transform = rasterio.Affine(30, 0, 500_000, 0, -30, north + 8 * 30)
    dx, dy = read(raster(tmp_path / "a.tif", z, crs=crs, transform=transform)).data.spacing
    across = np.mean(dx) / 30, dy / 30
    assert across == pytest.approx(expected, rel=2e-3)
    assert np.ndim(dx) == (0 if crs == "EPSG:32632" else 1)


def test_the_scale_on_mercator_is_in_metres_on_the_ground(tmp_path):
    noise = np.random.default_rng(3).normal(size=(128, 128)).astype(np.float32)
    left = []
    for crs, north, cell in (("EPSG:32632", 5_000_000, 10), ("EPSG:3857", 8_400_000, 20)):
        transform = rasterio.Affine(cell, 0, 500_000, 0, -cell, north)
        document = read(raster(tmp_path / "a.tif", noise, crs=crs, transform=transform))
        left.append(meshflow.smooth(document, method="heat", scale=30.0).data.z[20:-20, 20:-20].std())
    assert left[1] == pytest.approx(left[0], rel=0.03)


def test_a_map_that_stretches_much_says_which_row_counts(tmp_path):
    z, _ = terrain(32, 8)
    transform = rasterio.Affine(100_000, 0, 0, 0, -100_000, 10_000_000)
    assert "of the middle row counts for all" in said(read(raster(tmp_path / "a.tif", z, "EPSG:3857", transform)))


# --- around the Earth


def test_rows_on_the_poles_are_smoothed_and_the_meeting_ends_are_told(tmp_path):
    z, _ = terrain(19, 36)
    document = read(raster(tmp_path / "a.tif", z, "EPSG:4326", rasterio.Affine(10, 0, -5, 0, -10, 95)))
    dx = document.data.spacing[0]
    assert dx[0] == pytest.approx(dx[-1])
    assert 0 < dx[0] < dx[1]
    assert "on a pole" in said(document)
    assert "two ends of each row meet" in said(document)
    smoothed = meshflow.smooth(document, method="heat", time=1e10).data.z
    assert np.isfinite(smoothed).all()
    assert (smoothed[[0, -1]] != z[[0, -1]]).any()
    assert "meet" not in said(read(raster(tmp_path / "b.tif", z, "EPSG:4326", rasterio.Affine(1, 0, 0, 0, -1, 40))))
    with pytest.raises(InputError, match="from pole to pole"):
        read(raster(tmp_path / "c.tif", z, "EPSG:4326", rasterio.Affine(1, 0, 0, 0, -1, 92)))


def test_a_grid_of_nanometres_is_not_taken_for_degrees(tmp_path):
    z, _ = terrain(16, 16)
    for step, alike in ((1e-8, False), (0.001, True)):
        document = read(raster(tmp_path / "a.tif", z, None, rasterio.Affine(step, 0, 7, 0, -step, 47)))
        assert ("looks like degrees" in said(document)) == alike


# --- units


def test_feet_above_metres_need_nothing_and_are_told_once(tmp_path):
    z, _ = terrain()
    feet = (z / 0.3048006).astype(np.float32)
    document = read(raster(tmp_path / "a.tif", feet, units=["US survey foot"]))
    assert said(document).count("US survey foot") == 1
    assert "nothing is to be set for smoothing" in said(document)
    metres = meshflow.smooth(read(raster(tmp_path / "b.tif", z))).data.z
    assert np.abs(meshflow.smooth(document).data.z * 0.3048006 - metres).max() < 0.02


def test_bands_of_unlike_size_are_smoothed_each_by_its_own_noise_and_so_it_is_told(tmp_path):
    z, clean = terrain(64, 64)
    other, flat = terrain(64, 64, seed=1)
    small = (0.05 * (other - flat)).astype(np.float32) + np.float32(0.3)
    path = raster(tmp_path / "a.tif", [z, small], names=["elevation", "uncertainty"])
    document = read(path)
    assert "each is smoothed separately" in said(document)
    result = meshflow.smooth(document, result=True)
    assert isinstance(result, Results)
    assert list(result) == ["elevation", "uncertainty"]
    assert any("each is smoothed separately" in word for word in result.warnings)
    alone = meshflow.smooth(read(path, band=1)).data.z
    assert np.array_equal(result.data.data.values[..., 0], alone)
    assert np.std(result.data.data.values[..., 1] - 0.3) < 0.02
    assert np.std(alone - clean) < 0.5
    assert "itself" not in said(read(path, kind="image"))
    assert "itself" not in said(read(raster(tmp_path / "b.tif", [z, other])))


def test_info_says_the_unit_of_the_spacing(tmp_path):
    path = raster(tmp_path / "a.tif", terrain()[0])
    told = CliRunner().invoke(app, ["info", str(path), "--json"])
    assert json.loads(told.stdout)["spacing"] == "10 x 10 m"


def test_an_ascii_grid_holds_the_digits_of_its_type_and_no_more(tmp_path):
    z, _ = terrain()
    write(read(raster(tmp_path / "a.tif", z)), tmp_path / "a.asc")
    lines = (tmp_path / "a.asc").read_text().splitlines()
    words = [word for line in lines if line[0].isdigit() or line[0] == " " for word in line.split()]
    assert max(len(word.replace(".", "")) for word in words) <= 9
    assert np.array_equal(read(tmp_path / "a.asc").data.z, z)
