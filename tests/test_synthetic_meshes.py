"""Laws of the shapes with known surfaces, of their noise, and of what is measured on them."""

from importlib.util import find_spec

import numpy as np
import pytest
from peers import meshes as peers

from meshflow.errors import InputError, MissingPackage
from meshflow.evaluate.meshes import flipped, mesh_quality
from meshflow.evaluate.metrics import is_closed, normal_angle, volume
from meshflow.synthetic.shapes import SHAPES, blob, cube, dome, mean_edge, part, plate, ring, sphere
from meshflow.synthetic.true_surfaces import Blob, Box, Dome, LPart, Ring

MADE = {name: make() for name, make in SHAPES.items()}
EVERY = pytest.mark.parametrize("shape", MADE.values(), ids=MADE)
# Volume, and how far that of triangles may be from it: flat ones inside of what is round.
HOLLOW = np.pi * 0.09**2 * 0.3
PART = (0.35 + 0.35 * 0.45 + (1 - np.pi / 4) * 0.15**2) * 0.3 - HOLLOW
VOLUMES = {
    "cube": (1.0, 1e-12),
    "irregular cube": (1.0, 1e-12),
    "plate": (0.03, 1e-12),
    "CAD part": (PART, 1e-3),
    "sphere": (4 / 3 * np.pi, 2e-3),
    "torus": (2 * np.pi**2 * 0.4**2, 5e-3),
}
DISTANT = {"plate": 1e-3, "CAD part": 1e-3}


@EVERY
def test_the_truth_lies_on_its_surface(shape):
    assert shape.distance(shape.points).max() < 1e-9


@EVERY
def test_all_but_the_dome_are_closed_and_all_look_outwards(shape):
    assert is_closed(shape.faces) == (shape.name != "dome")
    assert set(np.unique(shape.faces)) == set(range(len(shape.points)))
    if shape.name in VOLUMES:
        expected, off = VOLUMES[shape.name]
        assert volume(shape.points, shape.faces) == pytest.approx(expected, rel=off)
    # A little way along the normals is as far from the surface as that, on creases less; and it is outside.
    step = DISTANT.get(shape.name, 1e-2)
    out = shape.points + step * shape.normals()
    assert np.median(shape.distance(out)) == pytest.approx(step, rel=1e-3)
    if shape.name != "dome":
        assert volume(out, shape.faces) > volume(shape.points, shape.faces)
    else:
        assert np.linalg.norm(out, axis=1).min() > 1.0


@pytest.mark.parametrize("spacing", [0.02, 0.03, 0.05, 0.09])
def test_a_part_is_closed_however_coarse_it_is_and_its_rims_lie_on_its_walls(spacing):
    for seed in range(3):
        shape = part(spacing, seed)
        assert is_closed(shape.faces)
        assert volume(shape.points, shape.faces) == pytest.approx(PART, rel=30.0 * spacing**2)


@EVERY
def test_no_triangle_is_without_area_and_slivers_are_where_they_are_meant(shape):
    a, b, c = np.moveaxis(shape.points[shape.faces], 1, 0)
    longest = np.max([np.linalg.norm(p - q, axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    height = np.linalg.norm(np.cross(b - a, c - a), axis=1) / longest / shape.edge
    assert height.min() > 1e-5, height.min()
    assert (height.min() < 0.05) == (shape.name in ("CAD part", "blob")), height.min()


@EVERY
def test_a_shape_is_the_same_each_time(shape):
    again = SHAPES[shape.name]()
    assert np.array_equal(again.points, shape.points)
    assert np.array_equal(again.faces, shape.faces)
    assert np.array_equal(shape.noisy("iso", 0.2, 3), again.noisy("iso", 0.2, 3))


@EVERY
def test_noise_has_the_standard_deviation_that_is_asked_for(shape):
    iso = (shape.noisy("iso", 0.2) - shape.points) / shape.edge
    assert iso.std(axis=0) == pytest.approx(0.2, rel=0.05)
    nrm = (shape.noisy("nrm", 0.3) - shape.points) / shape.edge
    along = np.einsum("ij,ij->i", nrm, shape.normals())
    assert along.std() == pytest.approx(0.3, rel=0.05)
    assert np.abs(nrm - along[:, None] * shape.normals()).max() < 1e-12


def test_creases_are_exact():
    body = part()
    flat = body.points[np.isclose(np.abs(body.points[:, 2]), 0.15)]
    rim = np.abs(LPart().from_outline(flat[:, :2])) < 1e-12
    assert rim.sum() > 200
    for shape in (cube(8), cube(8, irregular=True)):
        normals = np.cross(*(shape.points[shape.faces[:, i]] - shape.points[shape.faces[:, 0]] for i in (1, 2)))
        assert (np.sum(np.abs(normals) > 1e-12, axis=1) == 1).all(), "a triangle goes around a crease"


@pytest.mark.parametrize(
    "surface", [Box((0.5, 0.4, 0.2)), Ring(1.0, 0.4), Ring(0.0, 1.0), LPart(), Dome()], ids=lambda s: type(s).__name__
)
def test_a_distance_is_that_to_the_nearest_of_many_points_of_the_surface(surface):
    from scipy.spatial import cKDTree

    points = np.random.default_rng(0).uniform(-1.6, 1.6, (400, 3))
    dense = {
        Box: lambda: box_points(surface.half),
        Ring: lambda: ring(1200, 600).points if surface.radius else sphere(7).points,
        LPart: lambda: part(0.004).points,
        Dome: lambda: dome(60000).points,
    }[type(surface)]()
    found, brute = surface.distance(points), cKDTree(dense).query(points)[0]
    assert (brute > found - 1e-3).all()
    assert np.abs(brute - found).max() < 6e-3


def box_points(half):
    body = cube(100)
    return 2 * body.points * np.array(half)


def test_the_distance_to_a_level_set_is_along_its_gradient():
    body, shape = Blob(), blob()
    value, slope = body._measured(shape.points)
    assert np.abs(value).max() < 1e-12
    normals = -slope / np.linalg.norm(slope, axis=1, keepdims=True)
    for step in (-0.03, 0.02):
        assert body.distance(shape.points + step * normals) == pytest.approx(abs(step), abs=1e-9)
    assert mesh_quality(shape.points, shape).rms < 1e-12


@EVERY
def test_the_truth_itself_has_nothing_left_to_smooth(shape):
    q = mesh_quality(shape.points, shape)
    assert (q.normal_error, q.flipped) == (0.0, 0)
    assert max(q.rms, q.largest) < 1e-9
    assert np.isnan(q.drift) if shape.name == "dome" else q.drift == 0.0


def test_a_grown_sphere_is_off_by_what_it_has_grown():
    ball = sphere(3)
    q = mesh_quality(1.1 * ball.points, ball)
    assert q.normal_error < 1e-6
    assert q.rms == pytest.approx(0.1 / ball.edge)
    assert q.largest == pytest.approx(0.1 / ball.edge)
    assert q.drift == pytest.approx(1.1**3 - 1)


def test_a_vertex_pulled_through_the_other_side_flips_its_triangles():
    body = plate(20)
    points = body.points.copy()
    top = np.flatnonzero((points[:, 2] > 0) & (np.abs(points[:, :2]) < 0.3).all(axis=1))[0]
    points[top, :2] += 0.2
    assert flipped(points, body.points, body.faces) >= 1
    assert mesh_quality(points, body).flipped == flipped(points, body.points, body.faces)


def test_edges_count_once_each():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    faces = np.array([[0, 1, 2], [1, 3, 2]])
    assert mean_edge(points, faces) == pytest.approx((4 + np.sqrt(2)) / 5)


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: cube(1), "2 cells"),
        (lambda: part(0.5), "below 0.1"),
        (lambda: sphere(0), "subdivision"),
        (lambda: ring(2, 8), "3 vertices"),
        (lambda: blob(4), "8 cells"),
        (lambda: dome(10), "100 vertices"),
        (lambda: cube(4).noisy("all", 0.1), "iso or nrm"),  # pyright: ignore[reportArgumentType]
        (lambda: cube(4).noisy("iso", -0.1), "0 or more"),
        (lambda: mesh_quality(np.zeros((3, 3)), cube(4)), "points of shape"),
        (lambda: mesh_quality(np.nan * cube(4).points, cube(4)), "finite"),
    ],
)
def test_refusals_say_what_was_expected(call, says):
    with pytest.raises(InputError, match=says):
        call()


@pytest.mark.long
@pytest.mark.parametrize("peer", peers.mesh_peers(MADE["cube"].faces), ids=lambda peer: peer.name)
def test_every_peer_smooths_in_the_order_that_vertices_came(peer):
    shape = MADE["cube"]
    noisy = shape.noisy("iso", 0.2)
    middle = {name: values[len(values) // 2] for name, values in peer.grid.items()}
    if peer.package == "meshlib" and find_spec("meshlib") is None:  # its licence keeps it out of the extras
        with pytest.raises(MissingPackage, match="pip install meshlib"):
            peer.run(noisy, 0.2 * shape.edge, **middle)
        return
    found = peer.run(noisy, 0.2 * shape.edge, **middle)
    assert found.shape == noisy.shape
    assert normal_angle(found, shape.points, shape.faces) < 0.8 * normal_angle(noisy, shape.points, shape.faces)
    assert np.array_equal(noisy, shape.noisy("iso", 0.2)), "the caller's points were changed"


def test_taubin_is_what_meshlab_and_trimesh_make_of_it_on_a_closed_mesh():
    shape = sphere(3)
    noisy = shape.noisy("iso", 0.2)
    ours = peers.taubin(noisy, shape.faces, 0.5, 0.1, 10)
    assert np.abs(ours - peers.meshlab_taubin(noisy, shape.faces, 0.5, 0.1, 10)).max() < 1e-6
    assert np.abs(ours - peers.trimesh_taubin(noisy, shape.faces, 0.5, 0.1, 10)).max() < 1e-6
