"""trimesh.Trimesh in, a new one out: everything else it has is kept, the caller's is untouched."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from PIL import Image as Picture

from meshflow.errors import InputError
from meshflow.io.objects import from_object


def ball(**more):
    """An icosphere with colours, attributes of vertices and faces, and metadata."""
    mesh = trimesh.creation.icosphere(subdivisions=1)
    rng = np.random.default_rng(0)
    mesh.visual.vertex_colors = rng.integers(0, 255, (42, 4)).astype(np.uint8)
    mesh.vertex_attributes["heat"] = rng.random(42)
    mesh.vertex_attributes["label"] = np.arange(42, dtype=np.int64)
    mesh.face_attributes["patch"] = np.arange(80, dtype=np.int16)
    mesh.metadata["owner"] = "me"
    return mesh


def textured():
    """A grid of two squares whose shared edge is a seam: its two vertices are stored twice."""
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [1, 0, 0], [2, 0, 0], [2, 1, 0], [1, 1, 0]], float)
    faces = [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]
    uv = np.tile([[0, 0], [1, 0], [1, 1], [0, 1]], (2, 1)).astype(float)
    image = Picture.fromarray(np.arange(48, dtype=np.uint8).reshape(4, 4, 3))
    material = trimesh.visual.material.SimpleMaterial(image=image, diffuse=[9, 8, 7, 255])
    visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    return trimesh.Trimesh(points, faces, visual=visual, process=False)


def test_colours_attributes_and_metadata_come_back_and_points_move():
    mesh = ball()
    taken = from_object(mesh)
    back = taken.to_object(replace(taken.data, points=taken.data.points + 0.5))
    assert type(back) is trimesh.Trimesh
    assert back is not mesh
    np.testing.assert_array_equal(back.vertices, mesh.vertices + 0.5)
    np.testing.assert_array_equal(back.faces, mesh.faces)
    np.testing.assert_array_equal(back.visual.vertex_colors, mesh.visual.vertex_colors)
    for name, kind in (("heat", np.float64), ("label", np.int64)):
        assert back.vertex_attributes[name].dtype == kind
        np.testing.assert_array_equal(back.vertex_attributes[name], mesh.vertex_attributes[name])
    np.testing.assert_array_equal(back.face_attributes["patch"], mesh.face_attributes["patch"])
    assert back.metadata["owner"] == "me"


def test_face_colours_come_back():
    mesh = trimesh.creation.icosphere(subdivisions=1)
    mesh.visual.face_colors = np.random.default_rng(0).integers(0, 255, (80, 4)).astype(np.uint8)
    taken = from_object(mesh)
    back = taken.to_object(replace(taken.data, points=taken.data.points * 2))
    assert back.visual.kind == "face"
    np.testing.assert_array_equal(back.visual.face_colors, mesh.visual.face_colors)


def test_the_callers_mesh_keeps_its_bytes_and_shares_no_memory():
    mesh = ball()
    arrays = {
        "vertices": mesh.vertices,
        "faces": mesh.faces,
        "heat": mesh.vertex_attributes["heat"],
        "colors": mesh.visual.vertex_colors,
        "patch": mesh.face_attributes["patch"],
    }
    before = {name: np.asarray(array).tobytes() for name, array in arrays.items()}
    taken = from_object(mesh, {"channels": "heat", "moves": "all"})
    taken.data.points[:] = 7
    back = taken.to_object(replace(taken.data, channels=taken.data.channels + 1))
    others = {
        "vertices": back.vertices,
        "faces": back.faces,
        "heat": back.vertex_attributes["heat"],
        "colors": back.visual.vertex_colors,
        "patch": back.face_attributes["patch"],
    }
    for name, array in others.items():
        assert not np.shares_memory(np.asarray(array), np.asarray(arrays[name])), name
        np.asarray(array).setflags(write=True)
        np.asarray(array)[:] = 1
    assert {name: np.asarray(array).tobytes() for name, array in arrays.items()} == before
    assert not np.shares_memory(taken.data.points, np.asarray(mesh.vertices))


def test_texture_coordinates_and_material_come_back_and_the_seam_holds():
    mesh = textured()
    taken = from_object(mesh)
    assert taken.data.points.shape == (6, 3)
    assert any("8 stored vertices are 6" in note for note in taken.notes)
    shaken = taken.data.points + np.random.default_rng(0).normal(size=(6, 3))
    back = taken.to_object(replace(taken.data, points=shaken))
    assert len(back.vertices) == 8
    np.testing.assert_array_equal(back.vertices[1], back.vertices[4])
    np.testing.assert_array_equal(back.vertices[2], back.vertices[7])
    np.testing.assert_array_equal(back.visual.uv, mesh.visual.uv)
    assert not np.shares_memory(np.asarray(back.visual.uv), np.asarray(mesh.visual.uv))
    np.testing.assert_array_equal(np.asarray(back.visual.material.image), np.asarray(mesh.visual.material.image))
    np.testing.assert_array_equal(back.visual.material.diffuse, mesh.visual.material.diffuse)


def test_a_soup_is_joined_and_a_plain_mesh_is_not():
    soup = trimesh.creation.icosphere(subdivisions=1)
    soup.unmerge_vertices()
    assert from_object(soup).data.points.shape == (42, 3)
    plain = trimesh.Trimesh(np.concatenate([np.eye(3), np.eye(3)]), [[0, 1, 2], [3, 4, 5], [3, 5, 4]], process=False)
    assert from_object(plain).data.points.shape == (6, 3)


def test_looking_at_normals_does_not_change_what_is_imported():
    plain = trimesh.Trimesh(np.concatenate([np.eye(3), np.eye(3)]), [[0, 1, 2], [3, 4, 5], [3, 5, 4]], process=False)
    assert plain.vertex_normals.shape == (6, 3)
    assert from_object(plain).data.points.shape == (6, 3)


def test_stored_normals_are_those_of_the_moved_shape():
    mesh = trimesh.creation.icosphere(subdivisions=2)
    round_ones = mesh.vertex_normals.copy()
    taken = from_object(mesh)
    flat = taken.data.points * [1, 1, 0.2]
    back = taken.to_object(replace(taken.data, points=flat))
    assert "vertex_normals" in back._cache.cache
    expected = trimesh.Trimesh(flat, mesh.faces, process=False).vertex_normals
    np.testing.assert_allclose(back.vertex_normals, expected, atol=1e-12)
    assert np.abs(back.vertex_normals - round_ones).max() > 0.3


def test_a_named_attribute_returns_in_its_type():
    mesh = ball()
    taken = from_object(mesh, {"channels": "label", "moves": "channels"})
    back = taken.to_object(replace(taken.data, channels=taken.data.channels + 0.6))
    assert back.vertex_attributes["label"].dtype == np.int64
    np.testing.assert_array_equal(back.vertex_attributes["label"], np.arange(42) + 1)
    np.testing.assert_array_equal(back.vertices, mesh.vertices)


def test_colours_are_rounded_and_clipped_and_alpha_stays():
    mesh = ball()
    taken = from_object(mesh, {"channels": "colors", "moves": "channels"})
    back = taken.to_object(replace(taken.data, channels=taken.data.channels + np.float32(99.6)))
    old = mesh.visual.vertex_colors.astype(int)
    np.testing.assert_array_equal(back.visual.vertex_colors[:, :3], np.minimum(old[:, :3] + 100, 255))
    np.testing.assert_array_equal(back.visual.vertex_colors[:, 3], old[:, 3])


def test_channels_that_differ_across_a_seam_keep_their_difference():
    mesh = textured()
    mesh.vertex_attributes["heat"] = np.arange(8.0)
    taken = from_object(mesh, {"channels": "heat", "moves": "channels"})
    assert taken.data.channels[1, 0] == (1 + 4) / 2
    back = taken.to_object(replace(taken.data, channels=taken.data.channels + 2))
    np.testing.assert_array_equal(back.vertex_attributes["heat"], np.arange(8.0) + 2)


def test_channels_and_what_is_fixed_are_taken_as_arrays():
    mesh = textured()
    fixed = np.arange(8) == 4
    taken = from_object(mesh, {"channels": np.arange(16.0).reshape(8, 2), "moves": "all"})
    assert taken.data.channels.shape == (6, 2)
    np.testing.assert_array_equal(taken.samples(fixed, "fixed"), [False, True, False, False, False, False])


@pytest.mark.parametrize(
    ("data", "what"),
    [
        (trimesh.Scene([trimesh.creation.box()]), "to_mesh"),
        (trimesh.PointCloud(np.eye(3)), "no surface"),
        (trimesh.load_path(np.eye(3)), "trimesh.Trimesh expected"),
    ],
)
def test_what_is_no_trimesh_is_refused_with_the_way_out(data, what):
    with pytest.raises(InputError, match=what):
        from_object(data)


@pytest.mark.parametrize(
    ("hints", "what"),
    [
        ({"missing": np.zeros(42, bool)}, "missing: no option of"),
        ({"spacing": 2.0}, "spacing: no option of"),
        ({"kind": "terrain"}, "kind='terrain'"),
        ({"channels": "nothing"}, "it has heat, label, colors"),
        ({"channels": np.zeros((41, 2))}, r"shape \(42, k\)"),
        ({"fixed": np.zeros(41, bool)}, "fixed: a constraint, no option of a reader; give constraints=Fixed"),
        ({"moves": "channels"}, "no channels"),
        ({"moves": "sideways"}, "sideways"),
    ],
)
def test_a_hint_that_does_not_fit_is_refused(hints, what):
    with pytest.raises(InputError, match=what):
        from_object(ball(), hints)


def test_faces_that_name_no_vertex_and_nan_are_refused():
    with pytest.raises(InputError, match="vertices 0 to 2"):
        from_object(trimesh.Trimesh(np.eye(3), [[0, 1, 5]], process=False))
    with pytest.raises(InputError, match="finite"):
        from_object(trimesh.Trimesh([[0, 0, 0], [1, 0, np.nan], [0, 1, 0]], [[0, 1, 2]], process=False))


def test_a_data_object_of_another_size_is_refused():
    with pytest.raises(InputError, match=r"to_object: .*\(42, 3\) expected"):
        from_object(ball()).to_object(from_object(textured()).data)
