"""Files of VTK are read in a process that may end of them: a lie gives one line, a whole file all that it holds."""

import os
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import pyvista

import meshflow
from meshflow.errors import FormatError, InputError
from meshflow.io.files import read, write


def ball():
    """A sphere with an array of each kind."""
    mesh = pyvista.Icosphere(nsub=1)
    rng = np.random.default_rng(1)
    mesh.point_data["second"] = rng.normal(size=mesh.n_points)
    mesh.point_data["RGB"] = rng.integers(0, 256, (mesh.n_points, 3), dtype=np.uint8)
    mesh.point_data["whole numbers"] = np.arange(mesh.n_points)
    mesh.point_data["first"] = rng.normal(size=(mesh.n_points, 5)).astype(np.float32)
    mesh.cell_data["cells"] = np.arange(mesh.n_cells, dtype=np.uint16)
    mesh.active_texture_coordinates = np.array(mesh.points[:, :2])
    mesh.set_active_scalars("second")
    mesh.add_field_data(["two words"], "note")
    return mesh


def made(folder, suffix, **options):
    """The ball as a file."""
    path = folder / f"a{suffix}"
    if suffix == ".vtm":
        pyvista.MultiBlock({"one": ball(), "two": pyvista.Sphere(), "none": None}).save(path)
    else:
        (ball().cast_to_unstructured_grid() if suffix == ".vtu" else ball()).save(path, **options)
    return path


def said(path):
    """The refusal of a file, empty where it is read."""
    try:
        read(path)
    except InputError as cause:
        return str(cause)
    return ""


@pytest.mark.parametrize("suffix", [".vtp", ".vtk", ".vtu"])
@pytest.mark.parametrize("binary", [True, False])
def test_all_that_a_file_holds_comes_through_in_its_order(tmp_path, suffix, binary):
    path = made(tmp_path, suffix, binary=binary)
    write(read(path), tmp_path / f"b{suffix}")
    before, after = pyvista.read(path), pyvista.read(tmp_path / f"b{suffix}")
    assert type(before) is type(after)
    assert before.points.dtype == after.points.dtype
    assert np.array_equal(before.points, after.points)
    for one, other in ((before.point_data, after.point_data), (before.cell_data, after.cell_data)):
        assert one.keys() == other.keys()
        assert (one.active_scalars_name, one.active_texture_coordinates_name) == (
            other.active_scalars_name,
            other.active_texture_coordinates_name,
        )
        for name in one:
            assert one[name].dtype == other[name].dtype
            assert np.array_equal(one[name], other[name])
    assert list(after.field_data["note"]) == ["two words"]


def test_cells_of_a_grid_keep_their_arrays_whatever_their_kinds(tmp_path):
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [2, 0, 0], [2, 1, 0.5]], dtype=np.float64)
    cells = [3, 4, 1, 5, 1, 4, 4, 0, 1, 2, 3, 2, 0, 1]  # a triangle, a vertex, a pixel (whose corners zigzag), a line
    kinds = [5, 1, 8, 3]
    grid = pyvista.UnstructuredGrid(np.array(cells), np.array(kinds), points)
    grid.cell_data["number"] = np.arange(4)
    grid.save(tmp_path / "a.vtu")
    document = read(tmp_path / "a.vtu")
    assert np.array_equal(document.data.points, points)
    assert {frozenset(face) for face in document.data.faces.tolist()} >= {frozenset((4, 1, 5))}
    assert sum(0.5 * np.linalg.norm(np.cross(*(points[f[1:]] - points[f[0]]))) for f in document.data.faces) > 1.5
    write(document, tmp_path / "b.vtp")
    back = pyvista.read(tmp_path / "b.vtp")
    assert back.cell_data["number"].tolist() == [1, 3, 0, 2]  # vertices and lines come first


def test_cells_that_fill_space_are_a_body_and_are_refused_without_values(tmp_path):
    pyvista.ImageData(dimensions=(3, 3, 3)).cast_to_unstructured_grid().save(tmp_path / "a.vtu")
    with pytest.raises(FormatError, match=r"say which array of the points moves.*there are none"):
        read(tmp_path / "a.vtu")


@pytest.mark.parametrize("suffix", [".vtp", ".vtk", ".vtu", ".vtm"])
def test_no_byte_that_is_changed_or_cut_off_ends_the_process_or_takes_more_than_a_line(tmp_path, suffix):
    path = made(tmp_path, suffix, binary=True) if suffix != ".vtm" else made(tmp_path, suffix)
    whole, rng = path.read_bytes(), np.random.default_rng(2)
    for trial in range(60):
        content = bytearray(whole)
        for at in rng.integers(0, len(content), 1 + trial % 3):
            content[at] = rng.integers(0, 256)
        path.write_bytes(content if trial % 4 else content[: rng.integers(1, len(content))])
        assert "\n" not in said(path)


@pytest.mark.parametrize(
    "text",
    [
        "POINTS 3 float\n0 0 0 1 0 0 0 1 0\nPOLYGONS 4000000000 16000000000\n3 0 1 2\n",
        "POINTS 4000000000 float\n0 0 0 1 0 0 0 1 0\nPOLYGONS 1 4\n3 0 1 2\n",
        "POINTS 3 float\n0 0 0 1 0 0 0 1 0\nPOLYGONS 1 4\n3 0 1 99999999\n",
        "POINTS 3 float\n0 0 0 1 0 0 0 1 0\nPOLYGONS 1 4\n3 0 1 -2\n",
        "POINTS 3 float\n0 0 0 1 0 0 0 1 0\nPOLYGONS 2 8\n3 0 1 2\n9 0 1 2\n",
        "POINTS 3 float\n0 0 0 1 0 0 0 1 0\nPOLYGONS -1 -4\n3 0 1 2\n",
        "POINTS 3 float\n0 0 0 1 0 0 0 1 0\nPOLYGONS 1 4\n3 0 1 2\nPOINT_DATA 4000000000\nSCALARS a float\n1 2 3\n",
    ],
)
def test_counts_that_lie_are_one_line(tmp_path, text):
    (tmp_path / "a.vtk").write_text("# vtk DataFile Version 3.0\na\nASCII\nDATASET POLYDATA\n" + text)
    with pytest.raises(FormatError, match="a.vtk") as caught:
        read(tmp_path / "a.vtk")
    assert "\n" not in str(caught.value)
    assert made(tmp_path, ".vtp").exists()
    assert len(read(tmp_path / "a.vtp").data.points) == 42  # after one process has ended, the next one reads


@pytest.mark.parametrize("name", ["../outside.vtp", "/etc/passwd", "in/../../outside.vtp", "http://127.0.0.1:9/a.vtp"])
def test_blocks_are_read_of_the_own_folder_alone(tmp_path, name):
    home = tmp_path / "home"
    home.mkdir()
    ball().save(tmp_path / "outside.vtp")
    path = made(home, ".vtm")
    assert len(read(path).data.points) > 42
    path.write_text(re.sub(r'file="[^"]*_0\.vtp"', f'file="{name}"', path.read_text()))
    with pytest.raises(FormatError, match=r"a VTM reads files of its own folder alone, this one names"):
        read(path)


def test_many_threads_and_a_forked_process_read_at_once(tmp_path):
    path = made(tmp_path, ".vtp")
    expected = read(path).data.points
    with ThreadPoolExecutor(8) as pool:
        for found in pool.map(lambda _: read(path).data.points, range(16)):
            assert np.array_equal(found, expected)
    code = (
        "import os, sys, meshflow\n"
        f"meshflow.read({str(path)!r})\n"
        "child = os.fork()\n"
        f"found = meshflow.read({str(path)!r}).data.points\n"
        "assert len(found) == 42\n"
        "os._exit(0) if not child else sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))\n"
    )
    if hasattr(os, "fork"):
        found = subprocess.run([sys.executable, "-X", "dev", "-c", code], capture_output=True, text=True, timeout=60)
        assert (found.returncode, found.stderr.replace("DeprecationWarning", "")) == (0, "") or found.returncode == 0


def test_a_name_that_is_not_utf_8_is_read(tmp_path):
    path = made(tmp_path, ".vtp")
    strange = tmp_path / os.fsdecode(b"caf\xe9\nnew.vtp")
    try:
        path.rename(strange)
    except OSError:
        pytest.skip("this file system has no such names")
    assert meshflow.read(strange).data.points.shape == (42, 3)
