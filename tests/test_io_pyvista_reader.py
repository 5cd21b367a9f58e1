"""``pyvista.read`` of PLY with meshflow installed: what ended the process or was lost comes whole."""

import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
import pyvista
import trimesh

from meshflow.errors import FormatError
from meshflow.io.adapters.pyvista_reader import read_ply

SHARED = Path(__file__).parents[2] / "shared" / "data"

TEXT = """ply
format ascii 1.0
element camera 1
property float view
element vertex 5
property double x
property double y
property double z
property uchar red
property uchar green
property uchar blue
property float quality
element face 2
property list uchar int vertex_indices
property int label
end_header
7
0 0 0 1 2 3 .5
1 0 0 1 2 3 .5
1 1 0 1 2 3 .5
0 1 0 1 2 3 .25
0.5 2 500000.123456789 4 5 6 .5
4 0 1 2 3 8
3 3 2 4 9
"""


def ball():
    return trimesh.creation.icosphere(1)


def test_pyvista_read_finds_it_by_its_entry_point(tmp_path):
    # in a process of its own: without the entry point VTK would end it
    path = tmp_path / "a.ply"
    path.write_text(TEXT)
    script = f"import pyvista; found = pyvista.read({str(path)!r}); assert list(found.point_data['quality'])[3] == 0.25"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_an_element_before_the_vertices_and_polygons_and_doubles_and_scalars_come_whole(tmp_path):
    path = tmp_path / "a.ply"
    path.write_text(TEXT)
    found = read_ply(str(path))
    assert found.points.dtype == np.float64
    assert found.points[4, 2] == 500000.123456789
    assert list(found.faces) == [4, 0, 1, 2, 3, 3, 3, 2, 4]
    assert found.active_scalars_name == "RGB"
    assert found.point_data["RGB"].dtype == np.uint8
    assert list(found.point_data["RGB"][4]) == [4, 5, 6]
    assert list(found.cell_data["label"]) == [8, 9]


def test_whole_numbers_of_64_bits_come_whole(tmp_path):
    mesh, path = ball(), tmp_path / "a.ply"
    mesh.face_attributes["part"] = np.arange(len(mesh.faces), dtype=np.int64) + 2**40
    mesh.visual.vertex_colors = np.arange(4 * len(mesh.vertices), dtype=np.uint8).reshape(-1, 4)
    path.write_bytes(mesh.export(file_type="ply", vertex_normal=True))
    found = read_ply(str(path))
    assert np.array_equal(found.cell_data["part"], mesh.face_attributes["part"])
    assert np.array_equal(found.faces.reshape(-1, 4)[:, 1:], mesh.faces)
    assert np.array_equal(found.point_data["RGBA"], mesh.visual.vertex_colors)
    assert np.allclose(found.point_data.active_normals, mesh.vertex_normals, atol=1e-6)


def test_a_cloud_is_vertex_cells_as_vtk_makes_them(tmp_path):
    plain, scalar = tmp_path / "a.ply", tmp_path / "b.ply"
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    plain.write_text(head + "end_header\n0 0 0\n1 0 0\n0 1 0\n")
    scalar.write_text(head + "property float confidence\nend_header\n0 0 0 1\n1 0 0 .5\n0 1 0 1\n")
    vtk, ours = pyvista.PLYReader(str(plain)).read(), read_ply(str(scalar))
    assert np.array_equal(vtk.verts, ours.verts)
    assert np.array_equal(vtk.points, ours.points)
    assert list(ours.point_data["confidence"]) == [1, 0.5, 1]


def test_what_vtk_reads_whole_is_what_vtk_reads(tmp_path):
    mesh, path = ball(), tmp_path / "a.ply"
    mesh.visual.vertex_colors = np.arange(4 * len(mesh.vertices), dtype=np.uint8).reshape(-1, 4)
    path.write_bytes(mesh.export(file_type="ply", vertex_normal=True))
    assert read_ply(str(path)) == pyvista.PLYReader(str(path)).read()


def test_trimesh_makes_the_arrays_that_vtk_would_have_made(tmp_path):
    mesh, path = ball(), tmp_path / "a.ply"
    mesh.visual.face_colors = np.arange(4 * len(mesh.faces), dtype=np.uint8).reshape(-1, 4)
    mesh.vertex_attributes["quality"] = np.linspace(0, 1, len(mesh.vertices)).astype(np.float32)
    path.write_bytes(mesh.export(file_type="ply", vertex_normal=True))
    vtk, ours = pyvista.PLYReader(str(path)).read(), read_ply(str(path))
    assert np.array_equal(ours.point_data.pop("quality"), mesh.vertex_attributes["quality"])
    assert np.array_equal(ours.points.astype(np.float32), vtk.points)
    assert np.array_equal(ours.faces, vtk.faces)
    for ours_data, vtk_data in ((ours.point_data, vtk.point_data), (ours.cell_data, vtk.cell_data)):
        assert list(ours_data) == list(vtk_data)
        assert all(np.array_equal(ours_data[name], vtk_data[name]) for name in vtk_data)
        assert ours_data.active_scalars_name == vtk_data.active_scalars_name


def mixed(wide):
    """A binary PLY of a triangle and a quadrilateral with a scalar that VTK leaves out."""
    kind, code = ("int64", "<i8") if wide else ("float", "<f4")
    head = (
        "ply\nformat binary_little_endian 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n"
        f"property {kind} mark\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n"
    )
    vertices = np.zeros(5, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("mark", code)])
    vertices["x"], vertices["y"] = [0, 1, 1, 0, 0.5], [0, 0, 1, 1, 2]
    faces = b"".join(bytes([len(one)]) + np.array(one, "<i4").tobytes() for one in ([0, 1, 2, 3], [3, 2, 4]))
    return head.encode() + vertices.tobytes() + faces


def test_mixed_polygons_in_binary_are_left_to_vtk_and_the_loss_is_said(tmp_path):
    path = tmp_path / "a.ply"
    path.write_bytes(mixed(wide=False))
    with pytest.warns(
        UserWarning, match=r"loses mark of vertex: a\.ply: its length differs|loses mark of vertex: a\.ply: binary"
    ):
        found = read_ply(str(path))
    assert list(found.faces) == [4, 0, 1, 2, 3, 3, 3, 2, 4]


def test_where_neither_can_read_it_is_an_error_and_not_the_end(tmp_path):
    path = tmp_path / "a.ply"
    path.write_bytes(mixed(wide=True))
    with pytest.raises(FormatError, match=r"a\.ply"):
        read_ply(str(path))


def test_a_remote_file_is_fetched_by_pyvista_first():
    with pytest.raises(pyvista.LocalFileRequiredError):
        read_ply("https://example.org/a.ply")


@pytest.mark.shared
@pytest.mark.skipif(not SHARED.exists(), reason="../shared/data is absent")
def test_files_of_other_programs_are_read_as_vtk_reads_them():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for path in sorted((SHARED / "meshes").rglob("*.ply")):
            assert read_ply(str(path)) == pyvista.PLYReader(str(path)).read()
