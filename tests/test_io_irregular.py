"""Tables of points, curved coordinates of xarray and grids of pyvista: they come back with everything around their numbers."""

import numpy as np
import pytest

import meshflow
from meshflow.errors import FormatError, InputError

TABLE = """station;x;y;depth;salt;note
a;0;0;-1.25;35.1;first
b;3;0;-1.5;35.2;"semi; colon"
c;0;3;-2;;
d;3;3;-1.75;35.4;
e;1.5;1.25;nan;35.3;hole
f;2;1;-1.5;35.0;
g;1;1.2;-1.25;35.2;
"""
HEAT = {"method": "heat", "time": 0.3}


def table(tmp_path, text=TABLE, name="in.csv"):
    (tmp_path / name).write_text(text)
    return tmp_path / name


def test_a_table_comes_back_with_its_other_cells_as_they_were(tmp_path):
    document = meshflow.read(table(tmp_path))
    assert "depth over x and y" in document.notes[0]
    smooth = meshflow.smooth(document, **HEAT)
    meshflow.write(smooth, tmp_path / "out.csv")
    before, after = (TABLE.splitlines(), (tmp_path / "out.csv").read_text().splitlines())
    assert after[0] == before[0]
    for one, two in zip(before[1:], after[1:], strict=True):
        first, second = one.split(";"), two.split(";")
        assert first[:3] + first[4:] == second[:3] + second[4:]
        assert second[3] == "nan" if first[3] == "nan" else len(second[3].partition(".")[2]) == 4
    moved = np.array([float(line.split(";")[3]) for line in after[1:]])
    assert np.array_equal(np.isnan(moved), [False] * 4 + [True] + [False] * 2)
    again = meshflow.read(tmp_path / "out.csv")
    assert np.abs(again.data.channels - smooth.data.channels).max() < 1e-4


def test_columns_are_taken_by_name_and_several_move_together(tmp_path):
    path = table(tmp_path)
    assert meshflow.read(path, channels="salt").data.channels.shape == (6, 1)  # one cell is empty
    both = meshflow.read(path, channels="salt, depth").data
    assert both.channels.shape == (5, 2)
    assert meshflow.read(path, channels="salt", nodata=35.0).data.channels.min() > 35.0
    assert len(meshflow.read(path, max_edge=2.9).data.faces) < len(meshflow.read(path).data.faces)
    fixed = meshflow.read(path).samples("salt", "fixed")
    assert fixed.shape == (6,)


def test_longitude_and_latitude_are_degrees_on_the_earth(tmp_path):
    lines = [f"{lon},{lat},{lon + lat}" for lon in range(5) for lat in range(40, 45)]
    data = meshflow.read(table(tmp_path, "Lon,Lat,t\n" + "\n".join(lines))).data
    assert np.linalg.norm(data.points, axis=1) == pytest.approx(6_371_008.8)
    assert data.step == pytest.approx(1e5, rel=0.3)


def test_lines_of_x_y_z_that_are_no_grid_are_heights_where_that_is_said(tmp_path):
    x, y = np.random.default_rng(0).uniform(0, 9, (2, 40)).round(2)
    path = table(tmp_path, "".join(f"{a} {b} {a + b:.2f}\n" for a, b in zip(x, y, strict=True)), "in.xyz")
    with pytest.raises(FormatError, match="kind='terrain'"):
        meshflow.read(path)
    document = meshflow.smooth(meshflow.read(path, kind="terrain"), **HEAT)
    meshflow.write(document, tmp_path / "out.xyz")
    assert len((tmp_path / "out.xyz").read_text().splitlines()) == 40


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        ("a,b\n1,2\n", {}, "columns x and y, easting and northing, or lon and lat expected, got a, b"),
        ("x,y,u,v\n0,0,1,2\n1,0,1,2\n0,1,1,2\n", {}, "which column moves\\? Say channels='name'; there are u, v"),
        ("x,y,z\n0,0,1\n1,0\n", {}, "3 columns in each line expected, line 3 has 2"),
        ("nothing\n", {}, "a table of points"),
        (TABLE, {"channels": "sal"}, "channels='sal': no such column of numbers in in.csv; there are depth, salt"),
        (TABLE, {"spacing": 2}, "spacing: no option of a table of points"),
        (TABLE, {"kind": "depth"}, "is a mesh, got kind='depth'"),
    ],
)
def test_a_table_that_cannot_be_read_says_why(tmp_path, text, options, words):
    with pytest.raises(InputError, match=words):
        meshflow.read(table(tmp_path, text), **options)


# xarray


def test_a_dataarray_with_curved_coordinates_keeps_all_of_them():
    xr = pytest.importorskip("xarray")
    angle, r = np.linspace(0, 2, 12), np.linspace(1, 2, 9)[:, None]
    coords = {"xc": (("j", "i"), r * np.cos(angle)), "yc": (("j", "i"), r * np.sin(angle)), "time": 3}
    noise = np.random.default_rng(1).normal(size=(9, 12)).astype(np.float32)
    noise[2, 3] = np.nan
    array = xr.DataArray(noise, dims=("j", "i"), coords=coords, name="t", attrs={"units": "K"})
    smoothed = meshflow.smooth(array, method="heat", time=0.01)
    assert smoothed.dims == array.dims
    assert set(smoothed.coords) == set(array.coords)
    assert smoothed.attrs == array.attrs
    assert smoothed.dtype == np.float32
    assert np.isnan(smoothed.values[2, 3])
    expected = meshflow.smooth(
        meshflow.Curvilinear(coords["xc"][1], coords["yc"][1], noise), method="heat", time=0.01
    ).values
    assert np.array_equal(smoothed.values, expected, equal_nan=True)


def test_uneven_latitudes_are_places_on_the_earth_and_even_ones_stay_a_grid():
    xr = pytest.importorskip("xarray")
    lat, lon = np.degrees(np.arcsin(np.linspace(-0.95, 0.95, 12))), np.arange(0, 360, 15.0)
    array = xr.DataArray(np.zeros((12, 24)), dims=("lat", "lon"), coords={"lat": lat, "lon": lon})
    from meshflow.io.objects import from_object

    mesh = from_object(array).data
    assert isinstance(mesh, meshflow.Mesh)
    assert np.linalg.norm(mesh.points, axis=1) == pytest.approx(6_371_008.8)
    even = array.assign_coords(lat=np.linspace(-60, 50, 12))
    assert isinstance(from_object(even).data, meshflow.HeightField)
    if pytest.importorskip("dask"):
        with pytest.raises(InputError, match="lat: regular coordinates expected, .*interp"):
            meshflow.smooth(array.chunk())
    aside = even.rename(lat="y", lon="x").assign_coords(lon2=(("y", "x"), np.zeros((12, 24))))
    assert isinstance(from_object(aside).data, meshflow.HeightField)


# pyvista


def test_a_structured_grid_of_uneven_spacing_moves_in_z_alone_and_a_named_array_on_it():
    pyvista = pytest.importorskip("pyvista")
    x, y = np.meshgrid(np.cumsum(np.linspace(1, 2, 8)), np.cumsum(np.linspace(2, 1, 7)))
    z = np.random.default_rng(2).normal(size=x.shape)
    grid = pyvista.StructuredGrid(x, y, z)
    grid.point_data["t"] = z.ravel(order="F")
    after = meshflow.smooth(grid, **HEAT)
    assert np.array_equal(after.points[:, :2], grid.points[:, :2])
    assert np.std(after.points[:, 2]) < 0.95 * np.std(z)
    named = meshflow.smooth(grid, channels="t", **HEAT)
    assert np.array_equal(named.points, grid.points)
    assert np.std(named.point_data["t"]) < 0.99 * np.std(z)
    with pytest.raises(InputError, match="channels='u': the name of a point array expected; there are t"):
        meshflow.smooth(grid, channels="u")
    angle, high = np.meshgrid(np.linspace(0, 6, 12), np.arange(5.0))
    with pytest.raises(InputError, match="these lie above each other"):
        meshflow.smooth(pyvista.StructuredGrid(np.cos(angle), high, np.sin(angle)))
