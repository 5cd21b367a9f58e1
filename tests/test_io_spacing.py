"""How far apart the samples of a raster are: turned grids, degrees on any ellipsoid, feet. meshflow.io.spacing."""

import warnings

import numpy as np
import pytest
from helpers.raster_files import UTM, heights, make, same, turned_by
from rasterio.control import GroundControlPoint
from rasterio.crs import CRS
from rasterio.transform import Affine, from_origin

from meshflow.errors import InputError
from meshflow.io.files import read
from meshflow.io.spacing import between_samples, height_unit, on_ellipsoid, units_disagree

MARS = CRS.from_wkt(
    'GEOGCS["Mars",DATUM["Mars",SPHEROID["Mars",3396000,0]],PRIMEM["0",0],UNIT["degree",0.0174532925199433]]'
)


def test_a_turned_grid_has_the_lengths_of_its_columns(tmp_path):
    document, again, _ = same(make(tmp_path / "a.tif", heights(), transform=turned_by(30, 20, 10)))
    assert document.data.spacing == pytest.approx((20, 10))
    assert again.source.frame.transform == document.source.frame.transform


def test_a_grid_from_south_to_north_is_as_good(tmp_path):
    document, again, _ = same(make(tmp_path / "a.tif", heights(), transform=Affine(30, 0, 0, 0, 20, 0)))
    assert document.data.spacing == (30, 20)
    assert np.array_equal(again.data.z, heights())


def test_a_sheared_grid_is_refused_with_the_way_out(tmp_path):
    path = make(tmp_path / "a.tif", heights(), transform=Affine(30, 10, 0, 0, -30, 0))
    with pytest.raises(InputError, match=r"sheared transform \(30.*gdalwarp"):
        read(path)
    assert read(path, spacing=30).data.spacing == (30, 30)


def test_no_georeference_is_one_pixel_and_said(tmp_path):
    path = make(tmp_path / "a.tif", heights(), crs=None, transform=None)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        document, again, _ = same(path)
    assert document.data.spacing == (1, 1)
    assert "no georeference: the spacing is 1" in document.notes[0]
    assert again.source.frame.transform.is_identity


def test_ground_control_points_survive_and_the_spacing_is_said(tmp_path):
    points = [GroundControlPoint(r, c, 100 + c, 200 - r, 0) for r, c in ((0, 0), (0, 7), (5, 0), (5, 7))]
    document, again, _ = same(make(tmp_path / "a.tif", heights(), transform=None, crs=UTM, gcps=points))
    assert "ground control points only" in document.notes[0]
    assert [(p.row, p.col, p.x, p.y) for p in again.source.frame.gcps[0]] == [(p.row, p.col, p.x, p.y) for p in points]
    assert again.source.frame.gcps[1] == UTM


def test_degrees_become_metres_on_the_earth():
    """A degree at latitude 45 on WGS 84: 78.847 km of longitude, 111.132 km of latitude (tables of the NGA)."""
    (dx, dy), notes = on_ellipsoid(CRS.from_epsg(4326), np.array([45.5, 45.0, 44.5]), 1.0, 1.0)
    assert dx[1] == pytest.approx(78847, abs=1)
    assert dy == pytest.approx(111132, abs=1)
    assert dx[0] < dx[1] < dx[2]
    assert "6378137 m" in notes[0]


def test_degrees_become_metres_on_a_sphere_that_is_not_the_earth(tmp_path):
    transform = from_origin(200, 20, 0.25, 0.25)  # longitudes from 0 to 360
    document = read(make(tmp_path / "a.tif", heights("int16", 80, 4), crs=MARS, transform=transform))
    dx, dy = document.data.spacing
    degree = 3396000 * np.pi / 180
    assert dy == pytest.approx(0.25 * degree, rel=1e-9)
    latitudes = 20 - 0.25 * (np.arange(80) + 0.5)
    assert np.allclose(dx, 0.25 * degree * np.cos(np.radians(latitudes)), rtol=1e-9)


def test_the_metres_of_degrees_agree_with_geodesics():
    geod = pytest.importorskip("pyproj").Geod(ellps="WGS84")
    crs = CRS.from_epsg(4326)
    for latitude in (-70.0, 0.0, 35.0, 80.0):
        (dx, dy), _ = on_ellipsoid(crs, np.array([latitude]), 1e-4, 1e-4)
        assert dx[0] == pytest.approx(geod.inv(7, latitude, 7 + 1e-4, latitude)[2], rel=1e-6)
        assert dy == pytest.approx(geod.inv(7, latitude - 5e-5, 7, latitude + 5e-5)[2], rel=1e-6)


@pytest.mark.parametrize("top", [91.0, 93.0])
def test_a_row_beyond_a_pole_is_refused(tmp_path, top):
    path = make(tmp_path / "a.tif", heights(), crs=CRS.from_epsg(4326), transform=from_origin(0, top, 1, 1))
    with pytest.raises(InputError, match=rf"from pole to pole expected, got {top - 0.5:g}.*gdalwarp"):
        read(path)
    assert read(path, spacing=(3, 4)).data.spacing == (3, 4)


def test_a_turned_grid_in_degrees_is_refused():
    with pytest.raises(InputError, match="turned transform.*gdalwarp"):
        between_samples(CRS.from_epsg(4326), turned_by(20, 0.1, 0.1), (6, 8))


def test_a_crs_in_feet_counts_feet_and_heights_in_metres_are_said(tmp_path):
    feet = CRS.from_epsg(2277)  # Texas Central, US survey feet
    path = make(tmp_path / "a.tif", heights(), crs=feet, after=lambda target: target.set_band_unit(1, "m"))
    document = read(path)
    assert document.data.spacing == (30, 30)
    assert document.data.unit == "m"
    assert "heights in m above a grid in US survey foot: nothing is to be set for smoothing" in document.notes[0]
    assert units_disagree(feet, "US survey foot") == ()
    assert units_disagree(CRS.from_epsg(4326), "ft") != ()
    assert units_disagree(UTM, "metres") == ()
    assert units_disagree(UTM, "furlongs") == ()


def test_a_vertical_crs_names_the_unit_of_heights():
    assert height_unit(CRS.from_user_input("EPSG:6318+6360"), None) == "US survey foot"
    assert height_unit(UTM, None) == ""
    assert height_unit(None, "m") == "m"


def test_degrees_without_a_crs_are_said(tmp_path):
    path = make(
        tmp_path / "a.asc", heights(), driver="AAIGrid", crs=None, transform=from_origin(7, 46, 1 / 1200, 1 / 1200)
    )
    assert "looks like degrees" in read(path).notes[0]
