"""What PLY, OBJ, STL and GLB keep, each in its own way; vertices that a format splits; scenes of several parts."""

import struct
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from helpers.mesh_files import again, cube_obj, ply, whole
from trimesh.exchange.stl import export_stl_ascii

from meshflow.errors import FormatError
from meshflow.io.files import read, write
from meshflow.io.vertex_merging import joined


def test_custom_vertex_scalars_survive_in_their_types(tmp_path):
    mesh = trimesh.creation.icosphere(subdivisions=1)
    n = len(mesh.vertices)
    mesh.vertex_attributes["quality"] = np.linspace(0, 1, n)
    mesh.vertex_attributes["label"] = np.arange(n, dtype=np.int64) * 10**12
    mesh.face_attributes["patch"] = np.arange(len(mesh.faces), dtype=np.int16)
    mesh.export(tmp_path / "in.ply")
    again(tmp_path / "in.ply", tmp_path / "out.ply")
    raw = whole(tmp_path / "out.ply").metadata["_ply_raw"]
    assert raw["vertex"]["properties"]["quality"] == "<f8"
    assert raw["vertex"]["properties"]["label"] == "<i8"
    assert np.array_equal(raw["vertex"]["data"]["quality"], mesh.vertex_attributes["quality"])
    assert np.array_equal(raw["vertex"]["data"]["label"], mesh.vertex_attributes["label"])
    assert np.array_equal(raw["face"]["data"]["patch"], mesh.face_attributes["patch"])


def test_an_element_before_the_vertices_survives(tmp_path):
    path = ply(tmp_path / "in.ply", before=[("element camera 1\nproperty float view_px", "7.5")])
    document, _ = again(path, tmp_path / "out.ply", by=0.5)
    assert document.data.points.shape == (4, 3)
    lines = (tmp_path / "out.ply").read_text().splitlines()
    assert "element camera 1" in lines
    assert "7.5" in lines
    np.testing.assert_array_equal(read(tmp_path / "out.ply").data.points, document.data.points + 0.5)


@pytest.mark.parametrize("kind", ["binary_little_endian", "binary_big_endian"])
def test_binary_ply_of_either_byte_order_survives_but_for_what_moved(kind, tmp_path):
    order = "<" if "little" in kind else ">"
    vertex = np.zeros(4, [("x", order + "f8"), ("q", order + "i2"), ("y", order + "f8"), ("z", order + "f8")])
    vertex["x"], vertex["y"], vertex["z"], vertex["q"] = [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [5, -6, 7, 8]
    face = np.zeros(4, [("n", "u1"), ("i", order + "i4", 3)])
    face["n"], face["i"] = 3, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]
    header = (
        f"ply\nformat {kind} 1.0\ncomment TextureFile none.png\nelement vertex 4\nproperty double x\nproperty short q\n"
        "property double y\nproperty double z\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n"
    )
    (tmp_path / "in.ply").write_bytes(header.encode() + vertex.tobytes() + face.tobytes())
    document = read(tmp_path / "in.ply")
    assert document.data.points.dtype == np.float64
    write(document.holding(replace(document.data, points=document.data.points + 1 / 3)), tmp_path / "out.ply", tags={})
    for name in "xyz":
        vertex[name] += 1 / 3
    assert (tmp_path / "out.ply").read_bytes() == header.encode() + vertex.tobytes() + face.tobytes()


def test_polygons_stay_polygons_and_the_reader_says_so(tmp_path):
    path = ply(tmp_path / "in.ply", faces=["4 0 1 3 2", "3 0 2 1"])
    document, _ = again(path, tmp_path / "out.ply")
    assert len(document.data.faces) == 3
    assert any("2 polygons are smoothed as 3 triangles" in note for note in document.notes)
    assert (tmp_path / "out.ply").read_text().splitlines()[-2:] == ["4 0 1 3 2", "3 0 2 1"]


def test_stored_normals_are_those_of_the_moved_shape(tmp_path):
    mesh = trimesh.creation.icosphere(subdivisions=2)
    assert mesh.vertex_normals.shape == (162, 3)  # makes them, and so the exporter writes them
    mesh.export(tmp_path / "in.ply")
    document = read(tmp_path / "in.ply")
    flat = document.data.points * np.float32([1, 1, 0.2])
    write(document.holding(replace(document.data, points=flat)), tmp_path / "out.ply", tags={})
    normals = whole(tmp_path / "out.ply").vertex_normals
    expected = trimesh.Trimesh(flat, document.data.faces, process=False).vertex_normals
    np.testing.assert_allclose(normals, expected, atol=1e-6)
    assert np.abs(normals - mesh.vertex_normals).max() > 0.3


def test_a_list_for_each_vertex_survives_and_is_no_channel(tmp_path):
    mesh = trimesh.creation.icosphere(subdivisions=1)
    mesh.vertex_attributes["vector"] = np.random.default_rng(0).random((42, 2))
    mesh.export(tmp_path / "in.ply")
    again(tmp_path / "in.ply", tmp_path / "out.ply")
    raw = whole(tmp_path / "out.ply").metadata["_ply_raw"]["vertex"]["data"]["vector"]
    np.testing.assert_array_equal(raw["f1"], mesh.vertex_attributes["vector"])
    with pytest.raises(FormatError, match="a list for each vertex"):
        read(tmp_path / "in.ply", channels="vector")


def test_tags_become_comments(tmp_path):
    document = read(ply(tmp_path / "in.ply"))
    write(document, tmp_path / "out.ply", tags={"scale": "2\nm"})
    assert "comment meshflow:scale 2 m" in (tmp_path / "out.ply").read_text().splitlines()
    assert np.array_equal(read(tmp_path / "out.ply").data.points, document.data.points)


def test_an_obj_keeps_all_lines_but_positions_and_normals(tmp_path):
    path = cube_obj(tmp_path / "a")
    document, notes = again(path, tmp_path / "a" / "out.obj", by=0.25)
    assert document.data.points.shape == (8, 3)
    assert len(document.data.faces) == 12
    assert any("6 polygons are smoothed as 12 triangles" in note for note in document.notes)
    old, new = path.read_text().splitlines(), (tmp_path / "a" / "out.obj").read_text().splitlines()
    assert [line for line in old if not line.startswith(("v ", "vn "))] == [
        line for line in new if not line.startswith(("v ", "vn "))
    ]
    assert [line for line in new if line.startswith("v ")][0] == "v 0.25 0.25 0.25"
    # a shifted cube has the normals of the cube: hard edges stay hard
    normals = np.array([line.split()[1:] for line in new if line.startswith("vn ")], float)
    np.testing.assert_allclose(
        normals, [[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]], atol=1e-12
    )
    assert notes == ()


def test_texture_coordinates_and_image_survive_a_round_trip(tmp_path):
    (tmp_path / "b").mkdir()
    again(cube_obj(tmp_path / "a"), tmp_path / "b" / "out.obj")
    assert (tmp_path / "b" / "cube.mtl").read_bytes() == (tmp_path / "a" / "cube.mtl").read_bytes()
    assert (tmp_path / "b" / "the image.png").read_bytes() == (tmp_path / "a" / "the image.png").read_bytes()
    old, new = whole(tmp_path / "a" / "cube.obj"), whole(tmp_path / "b" / "out.obj")
    assert np.array_equal(old.visual.uv, new.visual.uv)
    assert np.array_equal(np.asarray(old.visual.material.image), np.asarray(new.visual.material.image))


def test_a_companion_is_never_written_over_another_file(tmp_path):
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "cube.mtl").write_text("newmtl mine\n")
    _, notes = again(cube_obj(tmp_path / "a"), tmp_path / "b" / "out.obj")
    assert (tmp_path / "b" / "cube.mtl").read_text() == "newmtl mine\n"
    assert any("differs" in note for note in notes)


def test_a_companion_that_is_not_there_or_outside_is_said(tmp_path):
    (tmp_path / "b").mkdir()
    (tmp_path / "in.obj").write_text("mtllib gone.mtl\nmtllib ../up.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    _, notes = again(tmp_path / "in.obj", tmp_path / "b" / "out.obj")
    assert any("gone.mtl" in note for note in notes)
    assert any("outside" in note for note in notes)


def test_negative_indices_and_continued_faces_of_an_obj_are_read(tmp_path):
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 0 0 1\nf 1 2 \\\n -1\n"
    (tmp_path / "in.obj").write_text(text)
    assert read(tmp_path / "in.obj").data.faces.tolist() == [[0, 1, 2], [0, 1, 3]]


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\n", "no faces"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2\n", "three corners"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "names vertex 9 of 3"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1//1 2//1 3//7\n", "names normal 7"),
        ("v 0 0 0\nv 1 x 0\nv 0 1 0\nf 1 2 3\n", "could not convert"),
        ("v 0 0 \\\n0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "several lines"),
    ],
)
def test_a_broken_obj_is_refused_in_one_line(text, what, tmp_path):
    (tmp_path / "in.obj").write_text(text)
    with pytest.raises(FormatError, match=what) as refusal:
        read(tmp_path / "in.obj")
    assert "\n" not in str(refusal.value)
    assert "in.obj" in str(refusal.value)


def test_copies_of_a_vertex_at_a_seam_move_together(tmp_path):
    mesh = whole(cube_obj(tmp_path / "a"))
    assert len(mesh.vertices) == 24
    mesh.export(tmp_path / "in.glb")
    document = read(tmp_path / "in.glb")
    assert document.data.points.shape == (8, 3)
    assert any("24 stored vertices are 8" in note for note in document.notes)
    shaken = document.data.points + np.random.default_rng(0).normal(size=(8, 3)) * 0.1
    write(document.holding(replace(document.data, points=shaken)), tmp_path / "out.glb", tags={})
    back = whole(tmp_path / "out.glb")
    assert np.array_equal(back.visual.uv, whole(tmp_path / "in.glb").visual.uv)
    assert len(np.unique(back.vertices, axis=0)) == 8
    np.testing.assert_allclose(read(tmp_path / "out.glb").data.points, shaken, atol=1e-6)


def test_vertices_that_coincide_in_a_plain_mesh_stay_apart(tmp_path):
    rows = ["0 0 0", "1 0 0", "0 1 0", "0 0 0", "-1 0 0", "0 -1 0", "0 1 0"]
    document = read(ply(tmp_path / "in.ply", rows=rows, faces=["3 0 1 2", "3 3 4 5", "3 4 6 5"]))
    assert document.data.points.shape == (7, 3)
    assert document.notes == ()


def test_a_soup_of_triangles_is_one_surface(tmp_path):
    soup = trimesh.creation.icosphere(subdivisions=1)
    soup.unmerge_vertices()
    soup.export(tmp_path / "in.ply")
    assert read(tmp_path / "in.ply").data.points.shape == (42, 3)


def test_stl_is_joined_and_written_as_stl(tmp_path):
    trimesh.creation.icosphere(subdivisions=2).export(tmp_path / "in.stl")
    document, _ = again(tmp_path / "in.stl", tmp_path / "out.stl")
    assert document.data.points.shape == (162, 3)
    assert any("960 corners at bit-identical positions are 162 vertices" in note for note in document.notes)
    size = struct.unpack_from("<I", (tmp_path / "out.stl").read_bytes(), 80)[0]
    assert size == 320


def test_binary_stl_keeps_its_head_and_the_colours_of_its_triangles(tmp_path):
    trimesh.creation.box().export(tmp_path / "in.stl")
    content = bytearray((tmp_path / "in.stl").read_bytes())
    head = b"COLOR=\x10\x20\x30\xff, mm"
    content[: len(head)] = head
    content[84 + 48 :: 50] = range(12)
    (tmp_path / "in.stl").write_bytes(content)
    assert not any("not written" in note for note in read(tmp_path / "in.stl").notes)
    document = read(tmp_path / "in.stl")
    write(replace(document, data=replace(document.data, points=document.data.points * 2)), tmp_path / "out.stl")
    out = (tmp_path / "out.stl").read_bytes()
    assert out[:84] == content[:84]
    assert out[84 + 48 :: 50] == content[84 + 48 :: 50]
    assert trimesh.load(tmp_path / "out.stl").extents == pytest.approx(2.0)


def test_parts_keep_names_transforms_and_materials(tmp_path):
    scene = trimesh.Scene()
    turn = trimesh.transformations.rotation_matrix(0.5, [0, 0, 1], [1, 2, 3])
    turn[:3, :3] *= 2
    ball, box = trimesh.creation.icosphere(subdivisions=1), trimesh.creation.box()
    ball.visual = trimesh.visual.TextureVisuals(
        uv=ball.vertices[:, :2], material=trimesh.visual.material.PBRMaterial(name="steel", metallicFactor=0.7)
    )
    scene.add_geometry(ball, node_name="A", geom_name="ball", transform=turn)
    scene.add_geometry(box, node_name="B", geom_name="box")
    scene.export(tmp_path / "in.glb")
    before = trimesh.load_scene(tmp_path / "in.glb", process=False)
    document, _ = again(tmp_path / "in.glb", tmp_path / "out.glb", by=0.5)
    assert any("2 parts" in note for note in document.notes)
    after = trimesh.load_scene(tmp_path / "out.glb", process=False)
    assert sorted(after.geometry) == ["ball", "box"]
    assert after.geometry["ball"].visual.material.name == "steel"
    assert after.geometry["ball"].visual.material.metallicFactor == 0.7
    for name in ("A", "B"):
        (old_frame, part), (new_frame, same) = before.graph[name], after.graph[name]
        assert part == same
        np.testing.assert_allclose(old_frame, new_frame, atol=1e-12)
        old = trimesh.transform_points(before.geometry[part].vertices, old_frame)
        new = trimesh.transform_points(after.geometry[part].vertices, new_frame)
        np.testing.assert_allclose(new, old + 0.5, atol=1e-6)


def test_solids_of_an_ascii_stl_keep_their_names(tmp_path):
    text = ""
    for name, shift in (("Left", 0), ("Right", 3)):
        box = trimesh.creation.box()
        box.apply_translation([shift, 0, 0])
        box.metadata["name"] = name
        text += export_stl_ascii(box)
    (tmp_path / "in.stl").write_text(text)
    again(tmp_path / "in.stl", tmp_path / "out.stl")
    assert list(trimesh.load_scene(tmp_path / "out.stl", process=False).geometry) == ["Left", "Right"]


def test_a_part_without_inverse_transform_is_refused(tmp_path):
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.box(), transform=np.diag([1.0, 1, 0, 1]))
    scene.export(tmp_path / "in.glb")
    with pytest.raises(FormatError, match="flattened"):
        read(tmp_path / "in.glb")


@pytest.mark.parametrize("size", [0.0, 3e-7, 3e-6, 3e-5])
def test_corners_that_few_digits_have_moved_apart_are_one_vertex_at_a_border(size):
    ball, draw = trimesh.creation.icosphere(3), np.random.default_rng(0)
    corners = np.array(ball.vertices)[ball.faces].reshape(-1, 3)
    first, _ = joined(corners + size * draw.normal(size=corners.shape), faces=np.arange(len(corners)).reshape(-1, 3))
    assert len(first) == 642


def test_walls_that_are_close_to_each_other_stay_apart():
    sheet = trimesh.creation.box((1.0, 1.0, 1e-5)).subdivide().subdivide()
    first, _ = joined(np.array(sheet.vertices), faces=np.asarray(sheet.faces))
    assert len(first) == len(sheet.vertices)
