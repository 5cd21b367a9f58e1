"""Bodies of pyvista, meshio and files: what comes back, cells and arrays kept."""

import meshio
import numpy as np
import pytest
import pyvista
from helpers.command import run

import meshflow
from meshflow import FormatError, InputError, TetMesh
from meshflow.io.objects import from_object

QUICK = {"method": "quick", "noise": 0.3}


def image(seed=0):
    grid = pyvista.ImageData(dimensions=(6, 5, 4), spacing=(1.0, 0.8, 1.5))
    draw = np.random.default_rng(seed)
    grid["depth"] = draw.normal(size=120).astype(np.float32)
    grid["number"] = np.arange(120)
    grid.cell_data["rock"] = np.arange(60, dtype=np.int16)
    grid.set_active_scalars("depth")
    return grid


def mixed():
    """A tetrahedron, a voxel, a hexahedron, a wedge, a pyramid, and a triangle."""
    points = np.random.default_rng(1).normal(size=(4 + 8 + 8 + 6 + 5, 3)) * 0.1
    cube = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
    loop = [0, 1, 3, 2, 4, 5, 7, 6]
    points[:4] += np.eye(4)[:, 1:] + [9, 0, 0]
    points[4:12] += cube
    points[12:20] += cube[loop] + [3, 0, 0]
    points[20:26] += cube[[0, 1, 2, 4, 5, 6]] + [6, 0, 0]
    points[26:31] += np.concatenate([cube[[0, 1, 3, 2]], [[0.5, 0.5, 1]]]) + [12, 0, 0]
    cells = [
        [4, 0, 1, 2, 3],
        [8, *range(4, 12)],
        [8, *range(12, 20)],
        [6, *range(20, 26)],
        [5, *range(26, 31)],
        [3, 0, 1, 2],
    ]
    grid = pyvista.UnstructuredGrid(np.concatenate(cells), [10, 11, 12, 13, 14, 5], points)
    grid["heat"] = np.random.default_rng(2).normal(size=(31, 2))
    return grid


def same_cells(one, other):
    assert np.array_equal(one.celltypes, other.celltypes)
    assert np.array_equal(one.cells, other.cells)
    assert np.array_equal(one.points, other.points)
    assert [name for name in one.array_names if not name.startswith("meshflow:")] == other.array_names


def test_a_grid_of_cells_comes_back_with_its_cells_and_arrays():
    grid = image().cast_to_unstructured_grid()
    before = grid.copy(deep=True)
    done = meshflow.smooth(grid, **QUICK)
    same_cells(done, before)
    assert np.array_equal(grid["depth"], before["depth"])
    assert done["depth"].dtype == np.float32
    assert done.active_scalars_name == "depth"
    assert np.std(done["depth"]) < 0.8 * np.std(before["depth"])
    assert np.array_equal(done["number"], before["number"])
    assert "the active array 'depth' moves; for another one give channels='number'" in " ".join(from_object(grid).notes)
    assert "active" not in " ".join(from_object(grid, {"channels": "number"}).notes)
    number = meshflow.smooth(grid, channels="number", **QUICK)
    assert number["number"].dtype.kind == "f"
    fixed = meshflow.smooth(grid, constraints=meshflow.Fixed("number"), **QUICK)  # all but the first are not zero
    assert (fixed["depth"] == before["depth"]).sum() >= 119


def test_cells_of_every_kind_are_split_and_kept():
    grid = mixed()
    taken = from_object(grid)
    assert isinstance(taken.data, TetMesh)
    assert len(taken.data.tetrahedra) == 1 + 6 + 6 + 3 + 2
    assert (taken.data.spanned.volumes > 0.03).all()
    same_cells(taken.to_object(taken.data), grid)
    assert np.array_equal(taken.to_object(taken.data)["heat"], grid["heat"])
    assert "18 tetrahedra" in taken.notes[0]


def test_a_rectilinear_grid_comes_back_as_one():
    x, y, z = np.array([0.0, 1, 3, 4, 7]), np.array([0.0, 2, 3, 5]), np.array([0.0, 1, 1.5])
    body = pyvista.RectilinearGrid(x, y, z)
    body["v"] = np.random.default_rng(0).normal(size=body.n_points)
    done = meshflow.smooth(body, **QUICK)
    assert isinstance(done, pyvista.RectilinearGrid)
    assert np.array_equal(done.x, x)
    assert np.std(done["v"]) < np.std(body["v"])
    straight = np.asarray(body.points @ [1.0, 2, 3])
    taken = from_object(body, {"channels": "v"}).data
    assert np.array_equal(taken.points, body.points)
    assert taken.spanned.volumes.sum() == pytest.approx(7 * 5 * 1.5)
    assert np.std(straight) > 0
    flat = pyvista.RectilinearGrid(x, y)
    flat["v"] = np.random.default_rng(0).normal(size=20)
    assert np.std(meshflow.smooth(flat, **QUICK)["v"]) < np.std(flat["v"])
    flat.clear_data()
    flat.cell_data["c"] = np.random.default_rng(0).normal(size=12)
    assert np.std(meshflow.smooth(flat, **QUICK).cell_data["c"]) < np.std(flat.cell_data["c"])


def test_a_structured_grid_of_three_axes_moves_an_array():
    x, y, z = np.meshgrid(np.arange(5.0), np.arange(4.0), np.arange(3.0), indexing="ij")
    grid = pyvista.StructuredGrid(x + 0.1 * y, y, z + 0.1 * x)
    grid["v"] = np.random.default_rng(0).normal(size=60)
    done = meshflow.smooth(grid, **QUICK)
    assert isinstance(done, pyvista.StructuredGrid)
    assert np.array_equal(done.points, grid.points)
    assert np.std(done["v"]) < np.std(grid["v"])


@pytest.mark.parametrize("suffix", [".vtu", ".vtk", ".msh"])
def test_files_keep_their_cells_and_arrays(tmp_path, suffix):
    grid = mixed() if suffix != ".msh" else image().cast_to_unstructured_grid().triangulate()
    name = "heat" if suffix != ".msh" else "depth"
    path, out = tmp_path / f"in{suffix}", tmp_path / f"out{suffix}"
    if suffix == ".msh":
        del grid.cell_data["rock"]
        del grid.point_data["number"]
        mesh = meshio.Mesh(grid.points, [("tetra", grid.cells_dict[10])], {"depth": np.float64(grid["depth"])})
        meshio.write(path, mesh, file_format="gmsh")
    else:
        grid.save(path)
    document = meshflow.read(path)
    assert document.kind == "tetrahedra"
    meshflow.write(document, out, tags={"meshflow:method": "quick"})
    back = meshio.gmsh.read(out) if suffix == ".msh" else pyvista.read(out)
    if suffix == ".msh":
        assert np.array_equal(back.cells_dict["tetra"], grid.cells_dict[10])
        assert np.array_equal(back.point_data[name].ravel(), np.float64(grid[name]))
        meshflow.write(document, tmp_path / "other.vtu")
        assert np.array_equal(pyvista.read(tmp_path / "other.vtu")[name].ravel(), np.float64(grid[name]))
    else:
        same_cells(back, grid)
        assert np.array_equal(back[name], grid[name])
        assert back.field_data["meshflow:method"][0] == "quick"


def test_the_command_smooths_a_body(tmp_path):
    grid = image().cast_to_unstructured_grid()
    grid.save(tmp_path / "in.vtu")
    assert (
        run("smooth", tmp_path / "in.vtu", tmp_path / "out.vtu", "--channels", "depth", "--method", "quick").returncode
        == 0
    )
    done = pyvista.read(tmp_path / "out.vtu")
    assert np.std(done["depth"]) < np.std(grid["depth"])
    said = run("info", tmp_path / "in.vtu", "--channels", "depth")
    assert "tetrahedra" in said.stdout


def test_a_data_object_is_written_as_tetrahedra(tmp_path):
    taken = from_object(image().cast_to_unstructured_grid()).data
    meshflow.write(taken, tmp_path / "one.vtu")
    back = meshflow.read(tmp_path / "one.vtu").data
    assert np.array_equal(back.values, taken.values)
    assert np.array_equal(back.tetrahedra, taken.tetrahedra)
    with pytest.raises(FormatError, match=r"a tetrahedra does not fit.*\.vtu"):
        meshflow.write(taken, tmp_path / "one.ply")


@pytest.mark.parametrize(
    ("change", "options", "words"),
    [
        (lambda g: g.clear_data(), {}, r"say which array.*cell_data_to_point_data"),
        (lambda g: g, {"channels": "nothing"}, "there are depth, number"),
        (lambda g: g, {"spacing": 2.0}, "no option of an UnstructuredGrid"),
        (lambda g: g, {"kind": "mesh"}, "leave the kind out"),
    ],
)
def test_what_is_not_clear_is_asked(change, options, words):
    grid = image().cast_to_unstructured_grid()
    change(grid)
    with pytest.raises(InputError, match=words):
        from_object(grid, options)


def test_curved_cells_are_refused_with_the_way_out():
    curved = pyvista.UnstructuredGrid(np.array([10, *range(10)]), [24], np.random.default_rng(0).normal(size=(10, 3)))
    curved["v"] = np.zeros(10)
    with pytest.raises(InputError, match="linear_copy"):
        from_object(curved)


@pytest.mark.parametrize(
    "content", [b"no mesh", b"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 9", b"$MeshFormat\n2.2 1 8\n"]
)
def test_a_broken_mesh_of_gmsh_is_refused_in_a_line(tmp_path, content):
    (tmp_path / "a.msh").write_bytes(content)
    with pytest.raises(FormatError, match=r"a\.msh cannot be read as MSH"):
        meshflow.read(tmp_path / "a.msh")
