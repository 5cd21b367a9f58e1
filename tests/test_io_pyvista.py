"""pyvista objects in, new ones out: arrays and their types are kept, the caller's is untouched."""

from dataclasses import replace

import numpy as np
import pytest
import pyvista

import meshflow
from meshflow.errors import InputError
from meshflow.io.adapters.pyvista import triangulated
from meshflow.io.objects import from_object
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image


def ball():
    """A sphere in float64 with arrays of several types; "heat" is active."""
    poly = pyvista.Icosphere(nsub=2)
    poly.clear_data()
    poly.points = poly.points.astype(np.float64)
    poly.point_data["label"] = np.arange(poly.n_points, dtype=np.int64) * 10**12
    poly.point_data["heat"] = np.random.default_rng(0).random(poly.n_points).astype(np.float32)
    poly.point_data["RGBA"] = np.random.default_rng(0).integers(0, 255, (poly.n_points, 4)).astype(np.uint8)
    poly.cell_data["patch"] = np.arange(poly.n_cells, dtype=np.uint8)
    poly.field_data["era"] = np.array([1.5])
    poly.set_active_scalars("heat")
    return poly


def everything(mesh):
    """All arrays of an object, as bytes."""
    data = {name: np.asarray(mesh[name]).tobytes() for name in mesh.array_names}
    return data | {"points": np.asarray(mesh.points).tobytes()}


def heights(h=4, w=5):
    return np.random.default_rng(0).random((h, w))


# polygons


def test_arrays_types_and_the_active_one_come_back_and_points_move():
    poly = ball()
    taken = from_object(poly)
    back = taken.to_object(replace(taken.data, points=taken.data.points + 0.5))
    assert type(back) is pyvista.PolyData
    assert back.points.dtype == np.float64
    np.testing.assert_array_equal(back.points, poly.points + 0.5)
    np.testing.assert_array_equal(back.faces, poly.faces)
    assert back.active_scalars_name == "heat"
    for name in poly.array_names:
        assert back[name].dtype == poly[name].dtype
        np.testing.assert_array_equal(back[name], poly[name])
    assert back.field_data["era"] == 1.5


@pytest.mark.parametrize("make", [ball, lambda: pyvista.Plane(i_resolution=3, j_resolution=3)])
def test_the_callers_polydata_keeps_its_bytes_and_shares_no_memory(make):
    poly = make()
    before, faces = everything(poly), poly.faces.copy()
    taken = from_object(poly)
    points = taken.data.points + 1
    back = taken.to_object(replace(taken.data, points=points))
    assert not np.shares_memory(taken.data.points, poly.points)
    assert not np.shares_memory(back.points, points)
    for name in poly.array_names:
        assert not np.shares_memory(back[name], poly[name])
        back[name][:] = 0
    back.points[:] = 0
    taken.data.points[:] = 0
    assert everything(poly) == before
    assert np.array_equal(poly.faces, faces)


def test_float32_points_stay_float32():
    poly = pyvista.Icosphere(nsub=1)
    poly.points = poly.points.astype(np.float32)
    taken = from_object(poly)
    assert (
        taken.to_object(replace(taken.data, points=taken.data.points.astype(np.float64) + 1 / 3)).points.dtype
        == np.float32
    )


def test_normals_of_points_and_cells_are_those_of_the_moved_shape():
    poly = pyvista.Icosphere(nsub=2).compute_normals(cell_normals=True, point_normals=True, split_vertices=False)
    taken = from_object(poly)
    flat = taken.data.points * np.float32([1, 1, 0.2])
    back = taken.to_object(replace(taken.data, points=flat))
    np.testing.assert_allclose(back.cell_data["Normals"], back.face_normals, atol=1e-5)
    assert np.abs(back.cell_data["Normals"] - poly.cell_data["Normals"]).max() > 0.3
    again = pyvista.PolyData(back.points, back.faces).compute_normals(split_vertices=False, consistent_normals=False)
    # VTK weighs faces alike, trimesh by their angles
    assert (np.einsum("ij,ij->i", back.point_data["Normals"], again.point_data["Normals"]) > 0.99).all()
    assert back.point_data.active_normals_name == poly.point_data.active_normals_name


def test_hard_edges_of_a_split_cube_stay_hard_and_closed():
    cube = pyvista.Cube(clean=False).triangulate()
    assert cube.n_points == 24
    taken = from_object(cube)
    assert taken.data.points.shape == (8, 3)
    back = taken.to_object(replace(taken.data, points=taken.data.points * np.float32([1, 2, 3])))
    np.testing.assert_allclose(back.point_data["Normals"], cube.point_data["Normals"], atol=1e-6)
    assert len(np.unique(back.points, axis=0)) == 8


def test_polygons_and_strips_are_smoothed_as_triangles_and_come_back_as_they_were():
    plane = pyvista.Plane(i_resolution=3, j_resolution=2)
    plane.cell_data["patch"] = np.arange(6, dtype=np.int32)
    plane = plane.compute_normals(cell_normals=True, point_normals=False, consistent_normals=False)
    taken = from_object(plane)
    assert taken.data.faces.shape == (12, 3)
    assert any("6 polygons are smoothed as 12 triangles; the result keeps them" in note for note in taken.notes)
    back = taken.to_object(replace(taken.data, points=taken.data.points[:, [2, 0, 1]]))
    assert np.array_equal(back.faces, plane.faces)
    assert back.cell_data["patch"].dtype == np.int32
    np.testing.assert_array_equal(back.cell_data["patch"], np.arange(6))
    np.testing.assert_allclose(back.cell_data["Normals"], np.tile([1.0, 0, 0], (6, 1)), atol=1e-6)
    strip = pyvista.PolyData(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.0]]), strips=[4, 0, 1, 2, 3])
    taken = from_object(strip)
    assert taken.data.faces.shape == (2, 3)
    assert any("1 strips are smoothed as 2 triangles" in note for note in taken.notes)
    assert taken.to_object(taken.data).n_strips == 1


@pytest.mark.parametrize("faces", [[3, 0, 1, 2, 3, 0, 2, 3], [4, 0, 1, 2, 3]])
def test_lines_and_vertex_cells_stay_with_their_data(faces):
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    poly = pyvista.PolyData(points, faces=faces, lines=[2, 0, 2], verts=[1, 3])
    poly.cell_data["n"] = np.arange(poly.n_cells)
    poly.cell_data["Normals"] = np.tile([0.0, 0, 9], (poly.n_cells, 1))
    taken = from_object(poly)
    assert any("1 vertex cells and 1 lines stay" in note for note in taken.notes)
    back = taken.to_object(replace(taken.data, points=taken.data.points[:, [2, 0, 1]]))
    assert (back.n_lines, back.n_verts, len(taken.data.faces)) == (1, 1, 2)
    np.testing.assert_array_equal(back.faces, faces)
    np.testing.assert_array_equal(back.cell_data["n"], np.arange(poly.n_cells))
    np.testing.assert_array_equal(back.cell_data["Normals"], [[0, 0, 9], [0, 0, 9], *[[1, 0, 0]] * (poly.n_cells - 2)])


def test_a_named_array_returns_in_its_type_and_stays_active():
    poly = ball()
    taken = from_object(poly, {"channels": "heat", "moves": "channels"})
    back = taken.to_object(replace(taken.data, channels=taken.data.channels * 2))
    np.testing.assert_allclose(back["heat"], poly["heat"] * 2, rtol=1e-6)
    assert back["heat"].dtype == np.float32
    assert back.active_scalars_name == "heat"
    np.testing.assert_array_equal(back.points, poly.points)


def test_colours_are_rounded_and_clipped_and_alpha_stays():
    poly = ball()
    taken = from_object(poly, {"channels": "colors", "moves": "channels"})
    assert taken.data.channels.shape == (poly.n_points, 3)
    back = taken.to_object(replace(taken.data, channels=taken.data.channels + np.float32(99.6)))
    np.testing.assert_array_equal(back["RGBA"][:, :3], np.minimum(poly["RGBA"][:, :3].astype(int) + 100, 255))
    np.testing.assert_array_equal(back["RGBA"][:, 3], poly["RGBA"][:, 3])


# images


@pytest.mark.parametrize("flat", [0, 1, 2])
def test_an_image_is_a_height_field_with_its_north_up_and_returns_in_order(flat):
    z = heights()
    dimensions, spacing = [5, 4], [0.5, 2.0]
    dimensions.insert(flat, 1)
    spacing.insert(flat, 9.0)
    image = pyvista.ImageData(dimensions=dimensions, spacing=spacing, origin=(1, 2, 3))
    image.point_data["z"] = z.ravel()
    image.point_data["other"] = np.arange(20)
    image.set_active_scalars("z")
    before = everything(image)
    taken = from_object(image)
    assert isinstance(taken.data, HeightField)
    np.testing.assert_array_equal(taken.data.z, z[::-1])
    assert taken.data.spacing == (0.5, 2.0)
    back = taken.to_object(replace(taken.data, z=taken.data.z + np.arange(20.0).reshape(4, 5)))
    np.testing.assert_array_equal(back["z"].reshape(4, 5), z + np.arange(20.0).reshape(4, 5)[::-1])
    np.testing.assert_array_equal(back["other"], np.arange(20))
    assert (back.dimensions, back.spacing, back.origin) == (image.dimensions, image.spacing, image.origin)
    assert back.active_scalars_name == "z"
    assert not np.shares_memory(back["z"], image["z"])
    assert everything(image) == before
    taken.data.z[:] = 0
    assert everything(image) == before


def test_cell_scalars_are_taken_where_there_are_none_at_points():
    image = pyvista.ImageData(dimensions=(6, 5, 1))
    image.cell_data["z"] = heights().ravel()
    taken = from_object(image, {"kind": "image"})
    assert isinstance(taken.data, Image)
    back = taken.to_object(replace(taken.data, values=taken.data.values * 2))
    np.testing.assert_array_equal(back.cell_data["z"], heights().ravel() * 2)


def test_integers_become_floating_point_and_stay_active_and_colours_return_as_they_were():
    image = pyvista.ImageData(dimensions=(5, 4, 1))
    image.point_data["z"] = np.arange(20, dtype=np.int16)
    image.point_data["rgb"] = np.full((20, 3), 100, np.uint8)
    image.set_active_scalars("z")
    taken = from_object(image)
    assert any("int16 becomes floating point" in note for note in taken.notes)
    back = taken.to_object(replace(taken.data, z=taken.data.z + np.float32(0.25)))
    assert back["z"].dtype == np.float32
    np.testing.assert_array_equal(back["z"], np.arange(20) + 0.25)
    assert back.active_scalars_name == "z"
    taken = from_object(image, {"channels": "rgb"})
    back = taken.to_object(replace(taken.data, values=taken.data.values + np.float32(0.6)))
    assert back["rgb"].dtype == np.uint8
    assert (back["rgb"] == 101).all()
    assert back.active_scalars_name == "z"


def test_spacing_and_fixed_of_the_caller_are_taken_in_the_order_of_the_object():
    image = pyvista.ImageData(dimensions=(5, 4, 1))
    image.point_data["z"] = heights().ravel()
    taken = from_object(image, {"spacing": 3.0})
    assert taken.data.spacing == (3.0, 3.0)
    assert np.argwhere(taken.samples(np.arange(20) == 1, "fixed")).tolist() == [[3, 1]]


# terrains


@pytest.mark.parametrize("layout", ["ij", "xy"])
@pytest.mark.parametrize("signs", [(1, 1), (-1, 1), (1, -1), (-1, -1)])
def test_a_terrain_of_any_layout_is_a_height_field_with_its_north_up(layout, signs):
    x, y = np.meshgrid(np.arange(5) * 10.0 * signs[0], np.arange(4) * 30.0 * signs[1], indexing=layout)
    z = 100 * y + x
    grid = pyvista.StructuredGrid(x, y, z)
    grid["heat"] = np.arange(20)
    before = everything(grid)
    taken = from_object(grid)
    data = taken.data
    assert isinstance(data, HeightField)
    assert data.z.shape == (4, 5)
    assert data.spacing == (10.0, 30.0)
    assert (np.diff(data.z, axis=1) == 10).all()  # east is right
    assert (np.diff(data.z, axis=0) == -3000).all()  # north is up
    back = taken.to_object(replace(data, z=data.z * 2))
    np.testing.assert_array_equal(back.points, grid.points * [1, 1, 2])
    np.testing.assert_array_equal(back["heat"], np.arange(20))
    assert back.dimensions == grid.dimensions
    assert not np.shares_memory(back.points, grid.points)
    data.z[:] = 0
    back.points[:] = 0
    assert everything(grid) == before


def test_a_hole_in_a_terrain_is_missing():
    x, y = np.meshgrid(np.arange(5.0), np.arange(4.0), indexing="ij")
    z = x + y
    z[2, 1] = np.nan
    assert from_object(pyvista.StructuredGrid(x, y, z)).data.missing.sum() == 1


@pytest.mark.parametrize(
    "bend", [lambda x, y: (x + 0.1 * y, y), lambda x, y: (x**2, y), lambda x, y: (x, y + 0.2 * np.sin(x))]
)
def test_a_warped_grid_is_a_mesh_above_x_and_y_unless_it_lies_above_itself(bend):
    x, y = np.meshgrid(np.arange(5.0), np.arange(4.0), indexing="ij")
    grid = pyvista.StructuredGrid(*bend(x, y), x * 0)
    taken = from_object(grid)
    assert taken.data.points.shape == (20, 2)
    assert np.array_equal(taken.to_object(taken.data).points, grid.points)
    folded = pyvista.StructuredGrid(np.abs(x - 2), y, x * 0)
    with pytest.raises(InputError, match=r"\.extract_surface\(\)\.triangulate\(\)"):
        from_object(folded)
    assert len(from_object(grid.extract_surface(algorithm="dataset_surface").triangulate()).data.faces) == 24


# refusals


def volume():
    image = pyvista.ImageData(dimensions=(3, 3, 3))
    image["z"] = np.arange(27.0)
    return image


@pytest.mark.parametrize(
    ("data", "what"),
    [
        (pyvista.ImageData(dimensions=(3, 3, 1)), "no arrays"),
        (pyvista.StructuredGrid(*np.meshgrid(*[np.arange(3.0)] * 3)), r"\(3, 3, 3\).*extract_surface"),
        (pyvista.Plane().cast_to_unstructured_grid(), "extract_surface"),
        (pyvista.MultiBlock([pyvista.Cube()]), "one by one"),
        (pyvista.RectilinearGrid([0.0, 1, 3], [0.0, 1]), "say which array"),
        (pyvista.PolyData(np.eye(3)), "reconstruct_surface"),
        (pyvista.Line(), "reconstruct_surface"),
        (pyvista.PointSet(np.eye(3)), "no surface"),
    ],
)
def test_what_is_no_surface_is_refused_with_the_way_out(data, what):
    with pytest.raises(InputError, match=what):
        from_object(data)


def flat_image():
    image = pyvista.ImageData(dimensions=(5, 4, 1))
    image["z"] = np.arange(20.0)
    image["rgb"] = np.zeros((20, 3))
    image.set_active_scalars("z")
    return image


def terrain():
    x, y = np.meshgrid(np.arange(5.0), np.arange(4.0), indexing="ij")
    return pyvista.StructuredGrid(x, y, x * 0)


@pytest.mark.parametrize(
    ("make", "hints", "what"),
    [
        (ball, {"missing": 1}, "missing: no option of"),
        (ball, {"spacing": 1}, "spacing: no option of"),
        (ball, {"kind": "image"}, "kind='image'"),
        (ball, {"channels": "nothing"}, "no such point array; there are label, heat, RGBA"),
        (ball, {"channels": "patch"}, "cell_data_to_point_data"),
        (ball, {"moves": "all"}, "no channels"),
        (flat_image, {"moves": "points"}, "moves: no option of"),
        (flat_image, {"kind": "mesh"}, "kind='mesh'"),
        (flat_image, {"channels": "nothing"}, "no such array; there are z, rgb"),
        (flat_image, {"channels": np.zeros(20)}, "the name of an array"),
        (flat_image, {"channels": "rgb", "kind": "terrain"}, "3 components"),
        (
            flat_image,
            {"fixed": np.zeros((4, 5), bool)},
            "fixed: a constraint, no option of a reader; give constraints=Fixed",
        ),
        (terrain, {"channels": "z"}, "the name of a point array expected"),
        (terrain, {"kind": "image"}, "kind='image'"),
    ],
)
def test_a_hint_that_does_not_fit_is_refused(make, hints, what):
    with pytest.raises(InputError, match=what):
        from_object(make(), hints)


def test_quads_are_cut_from_their_first_corner_whatever_the_noise_and_concave_ones_where_they_are_whole():
    rng = np.random.default_rng(3)
    sheet = pyvista.Plane(i_resolution=50, j_resolution=50, i_size=4, j_size=4)
    sheet.points[:, 2] += 0.02 * rng.normal(size=sheet.n_points)
    found = meshflow.smooth(sheet, result=True)
    quads = sheet.faces.reshape(-1, 5)[:, 1:]
    for half, corners in ((0, [0, 1, 2]), (1, [0, 2, 3])):  # but where noise folds a quad
        assert (found.after.faces[half::2] == quads[:, corners]).all(axis=1).mean() > 0.99
    assert found.noise.sigma == pytest.approx(0.02, rel=0.1)
    assert found.data.points[:, 2].std() < 0.2 * 0.02
    arrow = pyvista.PolyData([[0, 0, 0], [2, 0, 0], [0.4, 0.4, 0], [0, 2, 0.0]], [4, 0, 1, 2, 3])
    for turn in range(4):
        arrow.faces = [4, *np.roll([0, 1, 2, 3], turn)]
        mesh = from_object(arrow).data
        corners = mesh.points[mesh.faces]
        areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] / 2
        assert (areas > 0).all()
        assert areas.sum() == pytest.approx(0.8)


def test_polygons_of_all_sizes_and_strips_keep_their_cell_data_and_their_order(tmp_path):
    points = np.array([[x, y, 0.0] for y in range(3) for x in range(6)], float)
    poly = pyvista.PolyData(points)
    poly.verts = np.zeros(0, int)
    poly.faces = [4, 0, 1, 7, 6, 3, 1, 2, 7, 5, 2, 3, 9, 8, 7]
    poly.strips = [4, 12, 13, 6, 7]
    poly.cell_data["number"] = [10, 20, 30, 40]
    made = from_object(poly).to_object(from_object(poly).data)
    assert np.array_equal(made.faces, poly.faces)
    assert np.array_equal(made.strips, poly.strips)
    np.testing.assert_array_equal(made.cell_data["number"], [10, 20, 30, 40])
    cut = triangulated(poly)  # for formats of triangles alone
    assert cut.is_all_triangles
    np.testing.assert_array_equal(cut.cell_data["number"], [10, 10, 20, 30, 30, 30, 40, 40])


@pytest.mark.parametrize("suffix", [".vtp", ".vtu", ".vtk"])
def test_quads_of_a_file_are_quads_of_the_file_that_is_written(suffix, tmp_path):
    sheet = pyvista.Plane(i_resolution=6, j_resolution=5)
    sheet.cell_data["patch"] = np.arange(30)
    given = sheet.cast_to_unstructured_grid() if suffix == ".vtu" else sheet
    given.save(tmp_path / f"in{suffix}")
    document = meshflow.read(tmp_path / f"in{suffix}")
    meshflow.write(meshflow.smooth(document, time=0.01), tmp_path / f"out{suffix}")
    back = pyvista.read(tmp_path / f"out{suffix}")
    assert back.n_cells == 30
    assert all(back.get_cell(i).n_points == 4 for i in range(30))
    np.testing.assert_array_equal(back.cell_data["patch"], np.arange(30))
    meshflow.write(document, tmp_path / "out.stl")  # triangles alone
    assert pyvista.read(tmp_path / "out.stl").n_cells == 60
