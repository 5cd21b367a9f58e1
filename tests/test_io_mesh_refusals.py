"""Mesh files that are cut off, wrongly named, or no surface: one clear line, and the process lives."""

import itertools
import struct
import sys

import numpy as np
import pytest
import pyvista
import trimesh
from helpers.mesh_files import ply
from PIL import Image as Picture

from meshflow.errors import FormatError, InputError, MissingPackage
from meshflow.io.files import read, write
from meshflow.io.formats import meshes
from meshflow.io.metadata import ReadOptions
from meshflow.surfaces.mesh import Mesh


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.999])
@pytest.mark.parametrize("suffix", [".ply", ".ascii.ply", ".off", ".stl", ".ascii.stl", ".glb", ".vtp", ".vtk"])
def test_a_file_that_is_cut_off_is_refused_in_one_line(suffix, share, tmp_path):
    mesh = trimesh.creation.icosphere(subdivisions=2)
    path = tmp_path / f"in{suffix}"
    if suffix == ".ascii.ply":
        mesh.export(path, file_type="ply", encoding="ascii")
    elif suffix == ".ascii.stl":
        mesh.export(path, file_type="stl_ascii")
    elif suffix in (".vtp", ".vtk"):
        pyvista.PolyData.from_regular_faces(mesh.vertices, mesh.faces).save(path)
    else:
        mesh.export(path)
    content = path.read_bytes().rstrip()
    # an ASCII file that lost its last digits alone cannot be told from a whole one; cut at least a word
    path.write_bytes(content[: min(int(len(content) * share), len(content) - 12)])
    with pytest.raises(FormatError) as refusal:
        read(path)
    assert "\n" not in str(refusal.value)
    assert path.name in str(refusal.value)
    if suffix == ".stl" and share >= 0.5:
        assert "cut off, 320 triangles expected" in str(refusal.value)


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".stl", ".off", ".glb", ".gltf", ".vtp", ".vtk", ".3mf"])
@pytest.mark.parametrize("content", ["", "no mesh at all\n1 2 3\n", "\0\1\2\3" * 100, "picture"])
def test_a_file_that_is_something_else_is_refused(suffix, content, tmp_path):
    path = tmp_path / f"in{suffix}"
    if content == "picture":
        Picture.new("RGB", (9, 9)).save(path, format="png")
    else:
        path.write_bytes(content.encode())
    with pytest.raises(FormatError) as refusal:
        read(path)
    assert "\n" not in str(refusal.value)
    assert path.name in str(refusal.value)


@pytest.mark.parametrize(
    ("true", "false"), list(itertools.permutations([".ply", ".obj", ".stl", ".off", ".glb", ".vtp"], 2))
)
def test_a_wrong_extension_is_refused(true, false, tmp_path):
    mesh = trimesh.creation.box()
    path = tmp_path / f"in{false}"
    if true == ".vtp":
        pyvista.wrap(mesh).save(tmp_path / "true.vtp")
        path.write_bytes((tmp_path / "true.vtp").read_bytes())
    else:
        path.write_bytes(
            mesh.export(None, file_type=true[1:])
            if true in (".ply", ".stl", ".glb")
            else mesh.export(None, file_type=true[1:]).encode()
        )
    with pytest.raises(FormatError, match=f"in{false}"):
        read(path)


@pytest.mark.parametrize("suffix", [".ply", ".glb", ".vtp", ".obj", ".off"])
def test_a_point_cloud_is_refused(suffix, tmp_path):
    path = tmp_path / f"in{suffix}"
    points = np.random.default_rng(0).random((9, 3))
    if suffix == ".vtp":
        pyvista.PolyData(points).save(path)
    elif suffix == ".off":
        path.write_text("OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n")
    elif suffix == ".glb":
        trimesh.Scene(trimesh.PointCloud(points)).export(path)
    else:
        trimesh.PointCloud(points).export(path)
    with pytest.raises(FormatError, match="no surface|no faces|with triangles"):
        read(path)


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".off", ".vtp", ".stl"])
def test_nan_is_refused_by_the_name_of_the_file(suffix, tmp_path):
    mesh = trimesh.creation.icosphere(subdivisions=1)
    points = mesh.vertices.copy()
    points[3] = np.nan
    path = tmp_path / f"in{suffix}"
    if suffix == ".vtp":
        pyvista.PolyData.from_regular_faces(points, mesh.faces).save(path)
    else:
        trimesh.Trimesh(points, mesh.faces, process=False).export(path)
    with pytest.raises(FormatError, match=rf"in\{suffix}.*finite"):
        read(path)


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"rows": ["0 0 0", "1 0 zero", "0 1 0", "0 0 1"]}, "no number"),
        ({"vertex": ("int x", "int y", "int z")}, "store them as float"),
        ({"faces": ["3 0 1 9"]}, "vertices 0 to 3"),
    ],
)
def test_a_ply_that_cannot_be_smoothed_is_refused(changes, what, tmp_path):
    with pytest.raises(FormatError, match=what):
        read(ply(tmp_path / "in.ply", **changes))


@pytest.mark.parametrize("sizes", [(3, 4, 3), (4, 3, 3)])
def test_a_binary_ply_of_mixed_polygons_is_refused_with_the_way_out(sizes, tmp_path):
    header = (
        "ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(sizes)}\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode()
    faces = b"".join(struct.pack(f"<B{size}i", size, *range(size)) for size in sizes)
    (tmp_path / "in.ply").write_bytes(header + np.eye(4, 3, dtype="<f4").tobytes() + faces)
    with pytest.raises(FormatError, match="triangulate it first"):
        read(tmp_path / "in.ply")


def test_a_binary_ply_whose_lists_only_add_up_is_refused(tmp_path):
    header = (
        b"ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
        b"element face 3\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = b"".join(struct.pack(f"<B{size}i", size, *range(size)) for size in (3, 4, 2))
    (tmp_path / "in.ply").write_bytes(header + np.eye(4, 3, dtype="<f4").tobytes() + faces)
    with pytest.raises(FormatError, match="different length"):
        read(tmp_path / "in.ply")


def test_what_3mf_takes_is_named_where_it_is_not_there(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "lxml", None)
    document = read(ply(tmp_path / "in.ply"))
    with pytest.raises(MissingPackage, match=r"pip install 'meshflow\[3mf\]'"):
        write(document, tmp_path / "out.3mf", tags={})
    assert not (tmp_path / "out.3mf").exists()


def test_another_kind_or_an_unknown_format_is_refused(tmp_path):
    path = ply(tmp_path / "in.ply")
    with pytest.raises(FormatError, match="kind='terrain'"):
        meshes.read(path, ReadOptions(kind="terrain"))
    path.rename(tmp_path / "in.xyz")
    with pytest.raises(FormatError, match="not a mesh format"):
        read(tmp_path / "in.xyz", kind="mesh")
    with pytest.raises(InputError, match="spacing"):
        read(ply(tmp_path / "in.ply"), spacing=2)


def test_a_data_object_of_another_size_is_refused_and_nothing_is_written(tmp_path):
    document = read(ply(tmp_path / "in.ply"))
    other = document.holding(Mesh(np.eye(3), np.array([[0, 1, 2]])))
    with pytest.raises(InputError, match=r"\(4, 3\)"):
        write(other, tmp_path / "out.ply", tags={})
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in.ply"]
