"""What of a raster is read, and how it is written: parts, CRS, units, drivers, a second raster; as a whole and by windows."""

import numpy as np
import pytest
import rasterio
from helpers.raster_files import UTM, heights, make
from rasterio.control import GroundControlPoint
from rasterio.crs import CRS
from rasterio.rpc import RPC
from rasterio.transform import from_origin
from typer.testing import CliRunner

import meshflow
from meshflow import Beltrami
from meshflow.cli.commands import app
from meshflow.errors import FormatError, InputError
from meshflow.estimate.request import Request
from meshflow.io.files import read, write
from meshflow.io.formats.raster_frame import Frame
from meshflow.io.formats.raster_place import Place
from meshflow.io.metadata import ReadOptions
from meshflow.large.memory import Budget
from meshflow.large.outputs import Output
from meshflow.large.rasters import smooth_raster
from meshflow.surfaces.data import array_of

H, W = 150, 180


class Small(Budget):
    """Windows of 64 samples a side."""

    def sides(self, form, halo, held=0):
        return 64, 64


def terrain(path, *, k=1, dtype="float32", hole=None, **profile):
    rng = np.random.default_rng(3)
    y, x = np.mgrid[0:H, 0:W]
    z = 200 + 30 * np.sin(y / 9) * np.cos(x / 7) + 20 * (x > W // 2) + 2 * rng.normal(size=(k, H, W))
    if hole is not None:
        z[:, 40:60, 30:90] = hole
    return make(path, z.astype(dtype), **profile)


ASKED = Request.of(Beltrami(contrast=5.0), time=900.0, noise=2.0, outliers="include")
FIXED = ("--method", "beltrami", "--contrast", "5", "--time", "900", "--noise", "2", "--outliers", "include")


def by_windows(path, target, *, dtype=None, driver=None, creation=(), removed=None, **options):
    writing = Output(Small(1e9), dtype, False, driver, dict(creation), removed)
    return smooth_raster(path, target, ASKED, ReadOptions.of(options), writing)


def run(*words):
    return CliRunner().invoke(app, ["smooth", *map(str, words), *FIXED])


# --- parts --------------------------------------------------------------------------------------------------------------


PARTS = {
    "window": {"window": (20, 30, 100, 90)},
    "bounds": {"bounds": (376000 + 20 * 30, 3808000 - 120 * 30, 376000 + 120 * 30, 3808000 - 30 * 30)},
    "bounds between centres": {
        "bounds": (376000 + 19.6 * 30, 3808000 - 120.4 * 30, 376000 + 120.4 * 30, 3808000 - 29.6 * 30)
    },
}


@pytest.mark.parametrize("name", PARTS)
def test_a_part_is_what_a_file_of_that_part_is(name, tmp_path):
    path = terrain(tmp_path / "in.tif", hole=-9999, nodata=-9999)
    with rasterio.open(path) as whole:
        window = rasterio.windows.Window(20, 30, 100, 90)
        cut = make(
            tmp_path / "cut.tif", whole.read(window=window), nodata=-9999, transform=whole.window_transform(window)
        )
    found, expected = read(path, **PARTS[name]), read(cut)
    assert np.array_equal(found.data.z, expected.data.z)
    assert np.array_equal(found.data.missing, expected.data.missing)
    write(found, tmp_path / "one.tif")
    write(expected, tmp_path / "two.tif")
    assert (tmp_path / "one.tif").read_bytes() == (tmp_path / "two.tif").read_bytes()


@pytest.mark.parametrize("name", PARTS)
def test_a_part_by_windows_is_the_part_as_a_whole(name, tmp_path):
    path = terrain(tmp_path / "in.tif", hole=-9999, nodata=-9999)
    by_windows(path, tmp_path / "out.tif", **PARTS[name])
    whole = meshflow.smooth(
        read(path, **PARTS[name]), method=Beltrami(contrast=5.0), time=900.0, noise=2.0, outliers="include"
    )
    done = read(tmp_path / "out.tif")
    assert array_of(done.data).tobytes() == array_of(whole.data).tobytes()
    assert done.source.frame.transform == whole.source.frame.transform


def test_a_part_in_degrees_has_the_spacing_of_its_rows(tmp_path):
    path = terrain(tmp_path / "in.tif", crs="EPSG:4326", transform=from_origin(7, 46, 0.0003, 0.0003))
    whole, part = read(path), read(path, window=(0, 30, W, 90))
    assert np.array_equal(part.data.spacing[0], whole.data.spacing[0][30:120])


def test_control_points_move_with_the_part(tmp_path):
    points = [GroundControlPoint(row, col, 7 + col, 46 - row) for row, col in ((0, 0), (0, 9), (9, 0), (9, 9))]
    path = make(tmp_path / "in.tif", heights(h=20, w=20), gcps=points, crs="EPSG:4326", transform=None)
    moved = read(path, window=(3, 5, 10, 12)).source.frame.gcps[0]
    assert [(p.row, p.col, p.x, p.y) for p in moved] == [(p.row - 5, p.col - 3, p.x, p.y) for p in points]


def test_rational_polynomials_move_with_the_part():
    rpcs = RPC(0.0, 1.0, [1.0] * 20, [1.0] * 20, 46.0, 1.0, 10.0, 9.0, 7.0, 1.0, [1.0] * 20, [1.0] * 20, 12.0, 9.0)
    frame = Frame("float32", np.zeros(0, bool), rpcs=rpcs)
    moved = Place().placed(frame, (slice(5, 9), slice(3, 9))).rpcs
    assert (moved.line_off, moved.samp_off) == (rpcs.line_off - 5, rpcs.samp_off - 3)
    assert {**moved.to_dict(), "line_off": 0, "samp_off": 0} == {**rpcs.to_dict(), "line_off": 0, "samp_off": 0}


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"window": (100, 0, 100, 20)}, "window: column, row, width, height inside 180 x 150 samples expected, got"),
        ({"window": (0, 0, 10)}, "window: four numbers, column, row, width, height, expected"),
        ({"window": (0.5, 0, 10, 10)}, "window: whole numbers of samples expected"),
        ({"bounds": (0, 0, 1, 1)}, "bounds: a part of 376000 3.8035e.06 .* expected, got"),
        ({"bounds": (1, 0, 0, 1)}, "bounds: left below right and bottom below top expected"),
        ({"bounds": (0, 0, float("nan"), 1)}, "bounds: four finite numbers"),
        ({"bounds": (0, 0, 1, 1), "window": (0, 0, 9, 9)}, "window, bounds: they name the same part in two ways"),
        ({"crs": "EPSG:1"}, "crs: an EPSG code such as EPSG:25832, a PROJ string or WKT expected, got 'EPSG:1'"),
    ],
)
def test_a_part_that_is_not_there_is_refused(options, why, tmp_path):
    path = terrain(tmp_path / "in.tif")
    with pytest.raises(InputError, match=why):
        read(path, **options)


def test_bounds_need_a_georeference_along_the_axes(tmp_path):
    plain = make(tmp_path / "plain.tif", heights(), crs=None, transform=None)
    with pytest.raises(InputError, match="bounds: the file has no georeference; give window="):
        read(plain, bounds=(0, 0, 4, 4))
    turned = make(tmp_path / "turned.tif", heights(), transform=from_origin(0, 9, 1, 1) * rasterio.Affine.rotation(10))
    with pytest.raises(InputError, match="bounds: a grid along the axes of its CRS expected"):
        read(turned, bounds=(0, 0, 4, 4))


@pytest.mark.parametrize("windows", [False, True])
def test_crs_and_unit_replace_those_of_the_file_and_are_written(windows, tmp_path):
    path, target = terrain(tmp_path / "in.tif"), tmp_path / "out.tif"
    if windows:
        by_windows(path, target, crs="EPSG:2229", unit="ft")
    else:
        done = run(path, target, "--crs", "EPSG:2229", "--z-unit", "ft")
        assert done.exit_code == 0, done.output
    with rasterio.open(target) as raster:
        assert raster.crs == CRS.from_epsg(2229)
        assert raster.units == ("ft",)


def test_a_spacing_of_two_numbers_is_given_to_the_command(tmp_path):
    path = terrain(tmp_path / "in.tif")
    done = run(path, tmp_path / "out.tif", "--spacing", "30,20")
    assert done.exit_code == 0, done.output
    whole = meshflow.smooth(
        read(path, spacing=(30, 20)), method=Beltrami(contrast=5.0), time=900.0, noise=2.0, outliers="include"
    )
    assert array_of(read(tmp_path / "out.tif").data).tobytes() == array_of(whole.data).tobytes()
    with pytest.raises(InputError, match="two as DX,DY, or three as DZ,DY,DX of a volume, expected, got '30,x'"):
        raise run(path, tmp_path / "no.tif", "--spacing", "30,x").exception


# --- drivers ------------------------------------------------------------------------------------------------------------


def content(path, driver):
    with rasterio.open(path) as raster:
        assert raster.driver == driver
        assert raster.crs == UTM
        return raster.read().tobytes(), raster.transform, raster.read_masks().tobytes(), raster.dtypes


DRIVERS = {
    "COG": (".tif", {"driver": "COG"}, "GTiff"),
    "COG as it is wanted": (".tif", {"driver": "cog", "creation": {"COMPRESS": "ZSTD", "blocksize": "128"}}, "GTiff"),
    "zstd": (".tif", {"creation": {"compress": "zstd"}}, "GTiff"),
    "uncompressed strips": (".tif", {"creation": {"COMPRESS": "NONE", "TILED": "NO", "BIGTIFF": "YES"}}, "GTiff"),
    "HFA": (".img", {}, "HFA"),
    "netCDF": (".nc", {}, "netCDF"),
    "GPKG": (".gpkg", {}, "GPKG"),
    "EHdr": (".bil", {}, "EHdr"),
    "ENVI": (".dat", {"driver": "ENVI"}, "ENVI"),
}


@pytest.mark.long
@pytest.mark.parametrize("nodata", [-9999.0, np.nan])
@pytest.mark.parametrize("name", DRIVERS)
def test_every_driver_stores_the_result_as_a_whole_and_by_windows(name, nodata, tmp_path):
    suffix, options, driver = DRIVERS[name]
    path = terrain(tmp_path / "in.tif", hole=nodata, nodata=nodata)
    one, two = tmp_path / f"one{suffix}", tmp_path / f"two{suffix}"
    done = meshflow.smooth(read(path), method=Beltrami(contrast=5.0), time=900.0, noise=2.0, outliers="include")
    write(done, one, **options)
    by_windows(path, two, **options)
    assert content(one, driver) == content(two, driver)
    there = ~done.data.missing
    with rasterio.open(one) as raster:
        assert raster.read(1)[there].tobytes() == done.data.z[there].tobytes()
        assert np.array_equal(raster.read_masks(1) > 0, there)
    assert not [file.name for file in tmp_path.iterdir() if file.name.startswith(".meshflow")]


def test_a_cog_has_overviews_and_says_what_was_run(tmp_path):
    rng = np.random.default_rng(0)
    path = make(tmp_path / "in.tif", (200 + rng.normal(size=(600, 700))).astype("float32"))
    by_windows(path, tmp_path / "cog.tif", driver="COG", creation={"BLOCKSIZE": "256"})
    with rasterio.open(tmp_path / "cog.tif") as raster:
        assert raster.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
        assert raster.overviews(1) == [2, 4]
        assert raster.tags()["meshflow_method"] == "beltrami"


def test_files_of_several_parts_replace_one_another_whole(tmp_path):
    path = terrain(tmp_path / "in.tif")
    document = read(path)
    write(document, tmp_path / "out.bil")
    part = read(path, window=(0, 0, 50, 60))
    write(part, tmp_path / "out.bil", overwrite=True)
    with rasterio.open(tmp_path / "out.bil") as raster:
        assert raster.shape == (60, 50)
        assert np.array_equal(raster.read(1), part.data.z)
    assert {file.name for file in tmp_path.iterdir()} >= {"out.bil", "out.hdr", "out.prj"}


def test_what_is_stored_with_loss_is_said(tmp_path):
    path = terrain(tmp_path / "in.tif")
    notes = write(read(path), tmp_path / "out.tif", creation={"COMPRESS": "LERC", "MAX_Z_ERROR": "0.5"})
    assert any("GTiff (" in note and "loses a part of the result" in note for note in notes)
    outcome = by_windows(path, tmp_path / "two.tif", creation={"COMPRESS": "LERC", "MAX_Z_ERROR": "0.5"})
    assert any("loses a part of the result" in note for note in outcome.notes)
    assert not write(read(path), tmp_path / "exact.tif", creation={"COMPRESS": "LERC"})


REFUSED = [
    ({"driver": "Nope"}, "driver: GTiff, COG, HFA, netCDF, GPKG or another driver of GDAL .* got 'Nope'"),
    ({"driver": "VRT"}, "driver: .* that writes files expected, got 'VRT'"),
    ({"creation": {"COMPRES": "ZSTD"}}, "GTiff of GDAL has no creation option COMPRES"),
    ({"driver": "COG", "creation": {"TILED": "YES"}}, "COG of GDAL has no creation option TILED"),
    ({"creation": {"COMPRESS": "FOO"}}, "GTiff of GDAL: .*FOO.* is an unexpected value for COMPRESS"),
    ({"creation": {"COMPRESS": "ZSTD", "ZLEVEL": "99"}}, "GTiff of GDAL: ZLEVEL=99 value not recognised"),
    ({"driver": "JP2OpenJPEG"}, "JP2OpenJPEG of GDAL does not store 1 x float32 so"),
    ({"driver": "USGSDEM"}, "USGSDEM of GDAL changes 1 x float32; write .tif"),
]


@pytest.mark.parametrize("windows", [False, True])
@pytest.mark.parametrize(("options", "why"), REFUSED)
def test_what_gdal_does_not_store_is_refused_before_the_work(options, why, windows, tmp_path, monkeypatch):
    path, target = terrain(tmp_path / "in.tif"), tmp_path / "out.tif"
    monkeypatch.setattr("meshflow.large.rasters.windowed", None)
    with pytest.raises(InputError, match=why):
        by_windows(path, target, **options) if windows else write(read(path), target, **options)
    assert [file.name for file in tmp_path.iterdir()] == ["in.tif"]


def test_a_driver_of_gdal_writes_no_mesh(tmp_path):
    with pytest.raises(
        InputError, match="driver, creation: of rasters .a terrain or an image., got a mesh; leave them out"
    ):
        write(_tetrahedron(), tmp_path / "out.ply", driver="COG")
    with pytest.raises(InputError, match="driver, creation: of rasters"):
        write(_tetrahedron(), tmp_path / "out.ply", creation={"COMPRESS": "ZSTD"})


def test_the_command_takes_driver_and_creation_options(tmp_path):
    path = terrain(tmp_path / "in.tif")
    done = run(path, tmp_path / "out.tif", "--of", "COG", "--co", "COMPRESS=ZSTD", "--co", "BLOCKSIZE=128")
    assert done.exit_code == 0, done.output
    with rasterio.open(tmp_path / "out.tif") as raster:
        assert raster.profile["compress"] == "zstd"
        assert raster.block_shapes == [(128, 128)]
    wrong = run(path, tmp_path / "no.tif", "--co", "COMPRESS")
    assert str(wrong.exception) == "creation: NAME=VALUE, such as COMPRESS=ZSTD, expected, got 'COMPRESS'"


# --- what was removed ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("k", "suffix"), [(1, ".tif"), (3, ".tif"), (1, ".nc")])
def test_what_was_removed_is_a_second_raster_the_same_by_windows(k, suffix, tmp_path):
    path = terrain(tmp_path / "in.tif", k=k, dtype="int16", hole=-999, nodata=-999)
    done = run(path, tmp_path / "out.tif", "--removed", tmp_path / f"one{suffix}", "--dtype", "source")
    assert done.exit_code == 0, done.output
    by_windows(path, tmp_path / "again.tif", removed=tmp_path / f"two{suffix}", dtype="source")
    with rasterio.open(tmp_path / f"one{suffix}") as one, rasterio.open(tmp_path / f"two{suffix}") as two:
        assert one.read().tobytes() == two.read().tobytes()
        assert one.crs == two.crs == UTM
        assert one.dtypes == ("float32",) * k
        assert np.isnan(one.nodata)
        kept = one.read()
    before = read(path)
    smoothed = meshflow.smooth(before, method=Beltrami(contrast=5.0), time=900.0, noise=2.0, outliers="include")
    expected = array_of(before.data).astype(float) - array_of(smoothed.data)
    found = kept[0] if k == 1 else np.moveaxis(kept, 0, 2)
    there = ~before.data.missing
    assert np.array_equal(found[there], expected[there].astype("float32"))
    assert np.isnan(found[~there]).all()


def test_what_was_removed_goes_to_a_file_of_its_own(tmp_path):
    path = terrain(tmp_path / "in.tif")
    target = tmp_path / "out.tif"
    with pytest.raises(FormatError, match="each output needs a name of its own"):
        raise run(path, target, "--removed", target).exception
    with pytest.raises(FormatError, match="each output needs a name of its own"):
        by_windows(path, target, removed=target)
    terrain(tmp_path / "there.tif")
    with pytest.raises(FormatError, match="there.tif exists"):
        raise run(path, target, "--removed", tmp_path / "there.tif").exception
    assert not target.exists()


@pytest.mark.parametrize("windows", [False, True])
@pytest.mark.parametrize("flag", ["--removed", "--uncertainty"])
def test_no_raster_beside_the_result_replaces_the_input(flag, windows, tmp_path, monkeypatch):
    path = terrain(tmp_path / "in.tif")
    before = path.read_bytes()
    if windows:
        monkeypatch.setattr("meshflow.cli.commands.memory_for", lambda given: 1e9)
    with pytest.raises(FormatError, match="in.tif: it is the input; name another file"):
        raise run(path, tmp_path / "out.tif", flag, path, "--overwrite").exception
    assert path.read_bytes() == before
    assert not (tmp_path / "out.tif").exists()


def test_nothing_is_removed_from_a_mesh_as_a_raster(tmp_path):
    meshflow.write(_tetrahedron(), tmp_path / "in.ply")
    done = CliRunner().invoke(
        app, ["smooth", str(tmp_path / "in.ply"), str(tmp_path / "out.ply"), "--removed", str(tmp_path / "r.tif")]
    )
    assert "removed: of samples on a grid only, got a mesh" in str(done.exception)


def _tetrahedron():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    return points, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
