"""open3d triangle meshes in, new ones of the same class out; the caller's is untouched."""

from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest

from meshflow.errors import InputError
from meshflow.io.objects import from_object

pytestmark = pytest.mark.skipif(find_spec("open3d") is None, reason="open3d is not installed")


def legacy():
    """A sphere with colours, texture coordinates, a texture, and normals of vertices and triangles."""
    import open3d

    mesh = open3d.geometry.TriangleMesh.create_sphere(1.0, resolution=6)
    n, m = len(mesh.vertices), len(mesh.triangles)
    rng = np.random.default_rng(0)
    mesh.vertex_colors = open3d.utility.Vector3dVector(rng.random((n, 3)) / 2)
    mesh.triangle_uvs = open3d.utility.Vector2dVector(rng.random((3 * m, 2)))
    mesh.triangle_material_ids = open3d.utility.IntVector(list(range(m)))
    mesh.textures = [open3d.geometry.Image(rng.integers(0, 255, (4, 4, 3)).astype(np.uint8))]
    mesh.compute_vertex_normals()
    return mesh


def tensor(kind=np.float32):
    """A sphere with attributes of many types, and a material."""
    import open3d

    mesh = open3d.t.geometry.TriangleMesh.create_sphere(1.0, resolution=6)
    n, m = len(mesh.vertex.positions), len(mesh.triangle.indices)
    rng = np.random.default_rng(0)
    mesh.vertex.positions = open3d.core.Tensor(mesh.vertex.positions.numpy().astype(kind))
    mesh.vertex.colors = open3d.core.Tensor(rng.integers(0, 255, (n, 3)).astype(np.uint8))
    mesh.vertex.heat = open3d.core.Tensor(rng.random((n, 1)).astype(np.float32))
    mesh.vertex.label = open3d.core.Tensor(np.arange(n, dtype=np.int64)[:, None])
    mesh.triangle.texture_uvs = open3d.core.Tensor(rng.random((m, 3, 2)).astype(np.float32))
    mesh.triangle.patch = open3d.core.Tensor(np.arange(m, dtype=np.int32)[:, None])
    mesh.material.set_default_properties()
    mesh.material.material_name = "defaultLit"
    mesh.material.texture_maps["albedo"] = open3d.t.geometry.Image(open3d.core.Tensor(np.full((2, 2, 3), 7, np.uint8)))
    mesh.compute_vertex_normals()
    mesh.compute_triangle_normals()
    return mesh


LEGACY = (
    "vertices",
    "triangles",
    "vertex_colors",
    "vertex_normals",
    "triangle_normals",
    "triangle_uvs",
    "triangle_material_ids",
)


def parts(mesh):
    """All arrays of a mesh, copied."""
    if hasattr(mesh, "vertices"):
        return {name: np.array(getattr(mesh, name)) for name in LEGACY}
    vertex = {f"vertex.{name}": tensor.numpy().copy() for name, tensor in mesh.vertex.items()}
    return vertex | {f"triangle.{name}": tensor.numpy().copy() for name, tensor in mesh.triangle.items()}


@pytest.mark.parametrize("make", [legacy, tensor, lambda: tensor(np.float64)])
def test_attributes_come_back_in_their_types_and_points_move(make):
    mesh = make()
    before = parts(mesh)
    taken = from_object(mesh)
    back = taken.to_object(replace(taken.data, points=taken.data.points + np.float32(0.5)))
    assert type(back) is type(mesh)
    after = parts(back)
    assert set(after) == set(before)
    for name, old in before.items():
        assert after[name].dtype == old.dtype, name
        if name in ("vertices", "vertex.positions"):
            np.testing.assert_array_equal(after[name], old + old.dtype.type(0.5))
        elif "normals" not in name:
            np.testing.assert_array_equal(after[name], old, err_msg=name)
        else:  # a shift turns no normal
            cosines = np.einsum("ij,ij->i", after[name], old)
            assert (cosines > (0.97 if name.startswith("vert") else 0.999)).all(), name


@pytest.mark.parametrize("make", [legacy, tensor])
def test_the_callers_mesh_keeps_its_bytes_and_shares_no_memory(make):
    mesh = make()
    before = {name: array.tobytes() for name, array in parts(mesh).items()}
    taken = from_object(mesh, {"channels": "colors", "moves": "all"})
    back = taken.to_object(replace(taken.data, points=taken.data.points * 2, channels=taken.data.channels * 0.5))
    taken.data.points[:] = 7
    views = (
        [np.asarray(getattr(back, name)) for name in LEGACY]
        if make is legacy
        else [t.numpy() for _, t in (*back.vertex.items(), *back.triangle.items())]
    )
    for view in views:
        view[:] = 1
    assert {name: array.tobytes() for name, array in parts(mesh).items()} == before


def test_textures_and_materials_come_back():
    taken = from_object(legacy())
    back = taken.to_object(replace(taken.data, points=taken.data.points * 2))
    np.testing.assert_array_equal(np.asarray(back.textures[0]), np.asarray(legacy().textures[0]))
    mesh = tensor()
    taken = from_object(mesh)
    back = taken.to_object(replace(taken.data, points=taken.data.points * 2))
    assert back.material.material_name == "defaultLit"
    np.testing.assert_array_equal(back.material.texture_maps["albedo"].as_tensor().numpy(), np.full((2, 2, 3), 7))
    back.material.texture_maps["albedo"].as_tensor()[:] = 1
    np.testing.assert_array_equal(mesh.material.texture_maps["albedo"].as_tensor().numpy(), np.full((2, 2, 3), 7))


@pytest.mark.parametrize("make", [legacy, tensor])
def test_normals_are_those_of_the_moved_shape(make):
    mesh = make()
    taken = from_object(mesh)
    flat = taken.data.points * taken.data.points.dtype.type(1) * np.array([1, 1, 0.2], taken.data.points.dtype)
    back = taken.to_object(replace(taken.data, points=flat))
    fresh = type(mesh)(back) if make is legacy else back.clone()
    fresh.compute_vertex_normals()
    fresh.compute_triangle_normals()
    new, expected, old = parts(back), parts(fresh), parts(mesh)
    for name in (name for name in new if "normals" in name):
        # open3d weighs faces by area, trimesh by angle
        assert np.einsum("ij,ij->i", new[name], expected[name]).min() > 0.95, name
        assert np.abs(new[name] - old[name]).max() > 0.3, name


def test_a_named_attribute_returns_in_its_type_and_shape():
    mesh = tensor()
    taken = from_object(mesh, {"channels": "label", "moves": "channels"})
    back = taken.to_object(replace(taken.data, channels=taken.data.channels + 0.6))
    assert back.vertex.label.numpy().dtype == np.int64
    np.testing.assert_array_equal(back.vertex.label.numpy(), mesh.vertex.label.numpy() + 1)
    np.testing.assert_array_equal(back.vertex.positions.numpy(), mesh.vertex.positions.numpy())


def test_colours_return_as_what_they_were():
    taken = from_object(tensor(), {"channels": "colors", "moves": "channels"})
    back = taken.to_object(replace(taken.data, channels=taken.data.channels + np.float32(99.6)))
    np.testing.assert_array_equal(
        back.vertex.colors.numpy(), np.minimum(tensor().vertex.colors.numpy().astype(int) + 100, 255)
    )
    taken = from_object(legacy(), {"channels": "colors", "moves": "channels"})
    back = taken.to_object(replace(taken.data, channels=taken.data.channels * 2))
    np.testing.assert_allclose(np.asarray(back.vertex_colors), np.asarray(legacy().vertex_colors) * 2)


def test_a_soup_is_joined():
    import open3d

    sphere = legacy()
    points = np.asarray(sphere.vertices)[np.asarray(sphere.triangles)].reshape(-1, 3)
    soup = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(points), open3d.utility.Vector3iVector(np.arange(len(points)).reshape(-1, 3))
    )
    taken = from_object(soup)
    assert len(taken.data.points) == len(sphere.vertices)
    assert taken.notes
    assert len(taken.to_object(taken.data).vertices) == len(points)


@pytest.mark.parametrize("name", ["geometry.PointCloud", "t.geometry.PointCloud", "geometry.VoxelGrid"])
def test_what_is_no_mesh_is_refused_with_the_way_out(name):
    import open3d

    data = open3d
    for word in name.split("."):
        data = getattr(data, word)
    with pytest.raises(InputError, match=r"TriangleMesh expected.*reconstruct"):
        from_object(data())


@pytest.mark.parametrize("name", ["geometry", "t"])
def test_an_empty_mesh_is_refused(name):
    import open3d

    home = open3d.geometry if name == "geometry" else open3d.t.geometry
    with pytest.raises(InputError):
        from_object(home.TriangleMesh())


@pytest.mark.parametrize(
    ("make", "hints", "what"),
    [
        (legacy, {"missing": 1}, "missing: no option of"),
        (tensor, {"spacing": 1}, "spacing: no option of"),
        (legacy, {"kind": "depth"}, "kind='depth'"),
        (legacy, {"channels": "heat"}, "it has colors"),
        (tensor, {"channels": "nothing"}, "it has .*heat"),
        (tensor, {"moves": "channels"}, "no channels"),
        (legacy, {"fixed": np.zeros(3, bool)}, "fixed: a constraint, no option of a reader; give constraints=Fixed"),
    ],
)
def test_a_hint_that_does_not_fit_is_refused(make, hints, what):
    with pytest.raises(InputError, match=what):
        from_object(make(), hints)
