"""Range images as points, normals and meshes of other libraries. meshflow.io.export."""

import numpy as np
import pytest
from helpers.cameras import ALL, CAMERAS, H, W

import meshflow
from meshflow.errors import InputError
from meshflow.io.export import to_mesh, to_normals, to_open3d, to_points, to_pyvista
from meshflow.surfaces.camera import Pinhole
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.range_image import RangeImage
from meshflow.surfaces.scanner import Spherical

RNG = np.random.default_rng(2)
PICTURE = RNG.integers(0, 256, (H, W, 3), dtype=np.uint8)


def image(camera=CAMERAS["pinhole"], jump=0.05):
    depth = 2 + 0.01 * np.sin(np.arange(W) / 5) * np.cos(np.arange(H) / 4)[:, None]
    depth[:, 30:] += 1.0
    depth[3:6, 4:9] = np.nan
    depth[0, 0] = np.nan
    return RangeImage(depth, camera, jump=jump)


def test_points_are_those_of_the_samples_that_are_there_row_by_row():
    data = image()
    points = to_points(data)
    assert np.array_equal(points, data.cloud[~data.missing])
    assert np.array_equal(points[:, 2], data.depth[~data.missing])
    assert np.array_equal(meshflow.to_points(data), points)


def test_points_have_the_colours_of_their_pixels():
    data = image()
    points, colours = to_points(data, PICTURE)
    assert np.array_equal(points, to_points(data))
    assert np.array_equal(colours, PICTURE[~data.missing])
    with pytest.raises(InputError, match="colours: a picture of shape"):
        to_points(data, PICTURE[1:])


@ALL
def test_normals_have_length_one_and_look_at_the_camera(camera):
    data = image(camera)
    normals, there = to_normals(data), ~data.missing
    assert np.allclose(np.linalg.norm(normals, axis=1), 1)
    sights = (data.points_at(data.depth + 1) - data.cloud)[there]
    assert ((normals * sights).sum(1) < 0).mean() > 0.98


@pytest.mark.parametrize("azimuth", [(60, -60), (-60, 60)])
def test_a_sweep_turned_either_way_is_seen_from_inside(azimuth):
    mesh = to_mesh(RangeImage(np.full((H, W), 2.0), Spherical(azimuth, (15, -25))))
    assert (np.sum(mesh.face_normals * mesh.triangles_center, axis=1) < 0).all()


def test_a_plane_has_its_own_normal():
    rays = CAMERAS["pinhole"].rays((H, W))
    n = np.array([0.3, -0.2, 1.0])
    normals = to_normals(RangeImage(2 / (rays @ n), CAMERAS["pinhole"]))
    assert np.abs(normals + n / np.linalg.norm(n)).max() < 1e-12


def test_a_mesh_has_colours_and_no_triangle_across_a_jump():
    data = image()
    mesh = to_mesh(data, PICTURE)
    assert np.ptp(mesh.triangles[..., 2], axis=1).max() < 0.1
    assert len(mesh.vertices) == (~data.missing).sum()
    assert np.array_equal(mesh.visual.vertex_colors[:, :3], PICTURE[~data.missing])
    assert len(to_mesh(image(jump=None)).faces) == len(mesh.faces) + 2 * (H - 1)
    lonely = np.full((H, W), np.nan)
    lonely[:2, :2] = lonely[9, 9] = 1.0
    assert len(to_mesh(RangeImage(lonely, CAMERAS["pinhole"])).vertices) == 4


@pytest.mark.parametrize(
    "convert", [lambda p: p * np.uint16(257), lambda p: p / 255.0, lambda p: np.dstack([p, p[..., 0]])]
)
def test_colours_of_every_type_are_the_same_colours(convert):
    there = ~image().missing
    assert np.array_equal(to_mesh(image(), convert(PICTURE)).visual.vertex_colors[:, :3], PICTURE[there])


@pytest.mark.parametrize("tensor", [False, True])
def test_open3d_gets_the_same_points_normals_triangles_and_colours(tensor):
    pytest.importorskip("open3d")
    data, plain = image(), to_mesh(image())
    cloud = to_open3d(data, PICTURE, "points", tensor=tensor)
    mesh = to_open3d(data, PICTURE, tensor=tensor)
    if tensor:
        cloud, mesh = cloud.to_legacy(), mesh.to_legacy()
    assert np.allclose(cloud.points, to_points(data), atol=1e-6)
    assert np.allclose(cloud.normals, to_normals(data), atol=1e-6)
    assert np.allclose(cloud.colors, PICTURE[~data.missing] / 255, atol=1e-6)
    assert np.allclose(mesh.vertices, plain.vertices, atol=1e-6)
    assert np.array_equal(mesh.triangles, plain.faces)
    assert np.allclose(mesh.vertex_normals, to_normals(data), atol=1e-6)
    assert np.allclose(mesh.vertex_colors, PICTURE[~data.missing] / 255, atol=1e-6)
    bare = to_open3d(data, tensor=tensor)
    assert not (("colors" in bare.vertex) if tensor else bare.has_vertex_colors())


def test_open3d_makes_the_same_points_of_the_same_image():
    open3d = pytest.importorskip("open3d")
    data = image()
    depth = np.where(data.missing, 0, data.depth).astype(np.float32)
    camera = open3d.camera.PinholeCameraIntrinsic(W, H, 50, 55, 19.5, 14.5)
    theirs = open3d.geometry.PointCloud.create_from_depth_image(
        open3d.geometry.Image(depth), camera, depth_scale=1.0, depth_trunc=100.0
    )
    assert np.allclose(theirs.points, to_points(data), atol=1e-6)


def test_pyvista_gets_a_grid_of_which_missing_samples_are_hidden():
    data = image()
    grid = to_pyvista(data, PICTURE)
    assert tuple(grid.dimensions) == (H, W, 1)
    points = np.asarray(grid.points).reshape(W, H, 3).transpose(1, 0, 2)
    assert np.allclose(points[~data.missing], data.cloud[~data.missing])
    assert np.isfinite(points).all()
    colours = np.asarray(grid.point_data["colours"]).reshape(W, H, 3).transpose(1, 0, 2)
    assert np.array_equal(colours, PICTURE)
    hidden = np.asarray(grid.point_data["vtkGhostType"]).reshape(W, H).T > 0
    assert np.array_equal(hidden, data.missing)
    assert np.array_equal(np.isnan(grid.point_data["depth"]).reshape(W, H).T, data.missing)


SPARSE = np.where(np.indices((H, W)).sum(0) % 2, np.nan, 1.0)
BAD = [
    (
        lambda: to_mesh(image(), PICTURE[:-1]),
        rf"shape \({H}, {W}, 3\), as the depths, expected, got \(29, 40, 3\); register it",
    ),
    (lambda: to_pyvista(image(), PICTURE[..., 0]), r"expected, got \(30, 40\)"),
    (lambda: to_open3d(image(), PICTURE.astype(float)), "from 0 to 1 expected, got float64 up to 255.0"),
    (lambda: to_open3d(image(), kind="cloud"), "kind: mesh or points expected, got 'cloud'"),
    (
        lambda: to_mesh(RangeImage(SPARSE, Pinhole(50, 50, 20, 15))),
        "no triangle between the 600 depths .* or to_points",
    ),
    (lambda: to_points(HeightField(np.ones((3, 3)))), "a RangeImage expected, got HeightField"),
]


@pytest.mark.parametrize(("make", "words"), BAD, ids=[words[:40] for _, words in BAD])
def test_what_is_no_surface_with_colours_is_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()


def test_points_without_triangles_have_normals_towards_the_camera():
    data = RangeImage(SPARSE, Pinhole(50, 50, 20, 15))
    points = to_points(data)
    assert np.allclose(to_normals(data), -points / np.linalg.norm(points, axis=1, keepdims=True))
