"""ASCII grids in and out: their place and their floats are kept, what they have no room for is said or refused."""

import numpy as np
import pytest
from helpers.raster_files import UP, heights, make, same, turned_by

from meshflow.errors import FormatError
from meshflow.io.files import read, write


def test_an_ascii_grid_keeps_its_place_and_its_floats(tmp_path):
    z = np.random.default_rng(0).normal(1000, 100, (6, 8)).astype("float32")
    z[1, 1] = -9999
    path = make(tmp_path / "a.asc", z, driver="AAIGrid", crs=None, nodata=-9999)
    document, again, notes = same(path)
    assert np.array_equal(again.data.z, document.data.z)
    assert np.array_equal(again.data.missing, document.data.missing)
    assert (again.source.frame.crs, again.source.frame.transform) == (None, UP)
    assert notes == ()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.asc", "again.asc"]


def test_an_ascii_grid_says_that_it_has_no_room_for_the_crs(tmp_path):
    document = read(make(tmp_path / "a.tif", heights()))
    assert "no room for the CRS" in write(document, tmp_path / "b.asc")[0]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.tif", "b.asc"]


def test_an_ascii_grid_refuses_what_it_cannot_hold(tmp_path):
    turned = read(make(tmp_path / "a.tif", heights(), transform=turned_by(30, 20, 20)))
    with pytest.raises(FormatError, match="rows from north to south"):
        write(turned, tmp_path / "b.asc")
    two = read(make(tmp_path / "a.tif", np.stack([heights()] * 2)))
    with pytest.raises(FormatError, match=r"one band fits into \.asc, got 2"):
        write(two, tmp_path / "b.asc")
