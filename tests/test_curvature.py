"""Principal curvatures, the flow that they weigh, lengths measured in normals. meshflow.geometry.curvature, flow.principal."""

import numpy as np
import pytest
from shapes import sphere, square, tube
from test_facets import along_normals

from meshflow.errors import InputError
from meshflow.flow.rate import MeshFlow
from meshflow.geometry.connectivity import connect
from meshflow.geometry.curvature import Curvatures, anisotropy, curvatures, directions
from meshflow.geometry.facets import normals_at
from meshflow.geometry.operator import cotangents, curvature_normal, gather_mass
from meshflow.geometry.surface import Surface
from meshflow.smoothing import denoise, smooth
from meshflow.study import shapes
from meshflow.study.mesh_quality import mesh_quality
from meshflow.study.metrics import volume

BALL, FACES = sphere(1200, radius=2.0, shake=0.15)
PIPE, WALL, INSIDE = tube(lambda s: 0.5 + 0 * s, 40, 40, 3.0)


def test_curvatures_of_a_sphere_are_those_of_its_radius():
    found = curvatures(BALL, FACES)
    for part in (found.mean, found.greatest, found.least):
        assert np.median(part) == pytest.approx(0.5, rel=0.05)
    assert np.median(found.gauss) == pytest.approx(0.25, rel=0.02)
    mass = gather_mass(connect((FACES,), len(BALL)), *cotangents(BALL, FACES), "voronoi")
    assert (found.gauss * mass).sum() == pytest.approx(4 * np.pi, rel=1e-12)  # Gauss and Bonnet
    inside_out = curvatures(BALL, FACES[:, ::-1])
    assert np.allclose(inside_out.greatest, -found.least)


def test_curvatures_of_a_cylinder_go_round_it_and_along_it():
    found, ways = curvatures(PIPE, WALL), directions(PIPE, WALL)
    assert np.median(found.greatest[INSIDE]) == pytest.approx(2.0, rel=0.03)
    assert np.abs(np.median(found.least[INSIDE])) < 0.02
    assert np.median(np.abs(ways[INSIDE, 1, 2])) > 0.985  # the least along the axis
    assert np.median(np.abs(ways[INSIDE, 0, 2])) < 0.17
    assert np.allclose(np.einsum("nij,nkj->nik", ways[INSIDE], ways[INSIDE]), np.eye(2), atol=1e-12)
    rim = connect((WALL,), len(PIPE)).rim
    assert not found.greatest[rim].any()


def test_planes_have_none():
    points, faces, _ = square(200)
    found = curvatures(points, faces)
    assert max(np.abs(part).max() for part in (found.mean, found.gauss)) < 1e-9


def test_the_weights_are_those_of_the_paper():
    one = np.array([0.5, 3.0, 3.0, 3.0, 0.1, 4.0, 2.0])
    two = np.array([0.2, 2.0, 0.3, -0.9, -3.0, -3.0, 0.0])
    found = Curvatures((one + two) / 2, one * two, one, two)
    mean = found.mean
    expected = [
        1.0,  # noise
        0.0,  # a corner
        0.3 / mean[2],  # an edge: the least curvature
        -0.9 / mean[3],  # a bent edge, -0.857: towards the other side
        0.1 / mean[4],  # the same edge, dented
        1.0,  # a saddle, the mean is the least
        0.0,  # a cylinder
    ]
    assert np.allclose(anisotropy(found, 1.0), expected)
    assert np.abs(expected).max() <= 1


@pytest.mark.parametrize("stepper", ["auto", "explicit"])
def test_a_noisy_cylinder_keeps_its_radius_where_plain_curvature_draws_it_in(stepper):
    rng = np.random.default_rng(0)
    noisy = PIPE + 0.003 * rng.normal(size=(len(PIPE), 1)) * PIPE * [2, 2, 0]
    words = {"boundary": "fixed", "time": 0.02, "stepper": stepper}
    plain, kept = (
        np.linalg.norm(smooth((noisy, WALL), **w, **words)[0][INSIDE, :2], axis=1)
        for w in ({"method": "curvature"}, {"method": "principal", "contrast": 0.6})
    )
    assert abs(plain.mean() - 0.5) > 0.03
    assert abs(kept.mean() - 0.5) < 0.35 * abs(plain.mean() - 0.5)


def test_the_weighted_flow_clears_the_faces_of_a_noisy_cube_and_leaves_its_edges():
    shape = shapes.cube(20)
    noisy = shape.noisy("nrm", 0.1, 7)
    before, after = (
        mesh_quality(points, shape) for points in (noisy, smooth((noisy, shape.faces), method="principal")[0])
    )
    plain = mesh_quality(smooth((noisy, shape.faces), method="curvature", time=2 * shape.edge**2)[0], shape)
    assert after.normal_error < 0.3 * before.normal_error
    assert after.normal_error < 0.3 * plain.normal_error


def test_corners_of_a_cube_stay_and_its_edges_hardly_move():
    shape = shapes.cube(12)
    corner = (np.abs(np.abs(shape.points - shape.points.mean(axis=0)) - 0.5) < 1e-9).all(axis=1)
    assert corner.sum() == 8
    words = {"time": 2 * shape.edge**2}
    kept = smooth((shape.points, shape.faces), method="principal", contrast=4 * shape.edge, **words)[0]
    plain = smooth((shape.points, shape.faces), method="curvature", **words)[0]
    assert np.abs(kept - shape.points)[corner].max() < 1e-6
    assert np.abs(kept - shape.points).max() < 0.2 * np.abs(plain - shape.points).max()


def test_the_threshold_follows_from_the_noise_and_says_so():
    result = denoise((along_normals(BALL, FACES, 0.1), FACES), method="principal")
    assert result.parameters["contrast"].why == "h² / 6 sigma"
    assert result.parameters["time"].why == "2 squared edges"
    with pytest.raises(InputError, match="contrast: a positive"):
        smooth((BALL, FACES), method="principal", contrast=-1.0)


@pytest.mark.parametrize("kind", ["iso", "nrm"])
def test_normal_channels_keep_the_creases_of_a_cube_and_its_volume(kind):
    shape = shapes.cube(20)
    noisy = shape.noisy(kind, 0.2, 7)
    before = mesh_quality(noisy, shape)
    result = denoise((noisy, shape.faces), method="normal-channels")
    after = mesh_quality(result.noun.points, shape)
    assert after.normal_error < 0.15 * before.normal_error
    assert after.flipped == 0
    assert result.parameters["keep"].value == "volume"
    assert volume(result.noun.points, shape.faces) == pytest.approx(volume(noisy, shape.faces), rel=1e-10)
    assert result.end.area < result.start.area  # the area of the surface, not of its normals
    plain = smooth((noisy, shape.faces), method="curvature", time=5 * shape.edge**2)[0]
    assert mesh_quality(plain, shape).normal_error > 3 * after.normal_error


def test_normal_channels_shrink_a_sphere_where_its_volume_is_not_kept():
    points = sphere(600)[0]
    faces = sphere(600)[1]
    open_ball = faces[points[faces].mean(axis=1)[:, 2] < 0.8]
    result = denoise((points, open_ball), method="normal-channels")
    assert "keep" not in result.parameters
    assert np.linalg.norm(result.noun.points, axis=1).mean() < 0.995
    kept = smooth((points, faces), method="normal-channels")[0]
    assert np.linalg.norm(kept, axis=1).mean() == pytest.approx(1.0, abs=0.01)


def test_planes_rest_in_normal_channels_and_a_length_of_zero_is_refused():
    points, faces, _ = square(300)
    for method in ("normal-channels", "principal"):
        found = smooth((points, faces), method=method, contrast=0.5)[0]
        assert np.abs(found - points).max() < 1e-12
        for contrast in (0.0, -2.0):
            with pytest.raises(InputError, match="contrast: a positive"):
                smooth((points, faces), method=method, contrast=contrast)
    with pytest.raises(InputError, match="where the points of a mesh move only"):
        smooth((points, faces), channels=points[:, 0], method="normal-channels")


def test_lengths_in_normals_are_those_of_a_surface_in_six_dimensions():
    points, faces = sphere(200)
    flow = MeshFlow(Surface(points, (faces,)), normals=0.7)
    whole = np.column_stack([points, 0.7 * normals_at(points, faces)])
    assert np.allclose(flow.rate(points), -curvature_normal(whole, faces)[:, :3], atol=1e-12)
