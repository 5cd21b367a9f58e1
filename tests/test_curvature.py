"""Principal curvatures, the flow that they weigh, lengths measured in normals. meshflow.geometry.curvature, flow.principal."""

from pathlib import Path

import numpy as np
import pytest
from helpers.parts import parts
from helpers.shapes import along_normals, sphere, square, tube

from meshflow.errors import InputError
from meshflow.estimate.constraints import Mobility
from meshflow.evaluate.meshes import mesh_quality
from meshflow.evaluate.metrics import normal_angle, volume
from meshflow.flow.compute import Compute
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.engines.metric import Given
from meshflow.flow.engines.metric import NormalChannels as NormalMetric
from meshflow.flow.methods import NormalChannels, PrincipalFlow
from meshflow.flow.methods.principal import Principal
from meshflow.geometry.connectivity import connect
from meshflow.geometry.curvature import curvatures, directed, directions
from meshflow.geometry.normals import mean_edge, normals_at
from meshflow.geometry.operator import cotangents, curvature_normal, fill_stiffness, gather_mass
from meshflow.io.files import read
from meshflow.smoothing import smooth
from meshflow.surfaces.surface import Surface
from meshflow.synthetic import shapes

SHARED = Path(__file__).parents[2] / "shared" / "data"
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
    # The least along the axis. What is left is of third order of the surface over an edge: (h / r)^2, 2 degrees, at most.
    off = np.degrees(np.arccos(np.minimum(np.abs(ways[INSIDE, 1, 2]), 1.0)))
    assert np.median(off) < 1.0
    assert np.percentile(off, 90) < 2.0
    assert np.allclose(np.einsum("nij,nkj->nik", ways[INSIDE], ways[INSIDE]), np.eye(2), atol=1e-12)
    rim = connect((WALL,), len(PIPE)).rim
    assert not found.greatest[rim].any()


def test_planes_have_none():
    points, faces, _ = square(200)
    found = curvatures(points, faces)
    assert max(np.abs(part).max() for part in (found.mean, found.gauss)) < 1e-9


def test_weights_along_directions_are_the_cotangents_where_nothing_is_bent_and_never_more():
    rng = np.random.default_rng(1)
    noisy = BALL + 0.02 * rng.normal(size=BALL.shape)
    cot = cotangents(noisy, FACES)[0]
    assert np.allclose(directed(noisy, FACES, 1e6), cot, atol=1e-12)
    connectivity = connect((FACES,), len(BALL))
    whole = fill_stiffness(connectivity, cot).toarray()
    for threshold in (0.1, 0.5, 2.0):
        part = fill_stiffness(connectivity, directed(noisy, FACES, threshold)).toarray()
        assert np.abs(part.sum(axis=1)).max() < 1e-12
        assert np.linalg.eigvalsh(part).min() > -1e-10
        assert np.linalg.eigvalsh(whole - part).min() > -1e-10


def test_a_cylinder_rests_and_ripples_along_it_go_as_fast_as_they_would():
    deep = INSIDE & (np.abs(PIPE[:, 2] - PIPE[:, 2].mean()) < 1.0)
    outwards = PIPE[deep] * [2, 2, 0]
    surface = Surface(PIPE, (WALL,))
    plain, rest = (flow.rate(PIPE)[deep] for flow in (MeshFlow(surface), Principal(surface, None, 1.0)))
    assert np.einsum("ij,ij->i", plain, outwards).mean() == pytest.approx(-2.0, rel=0.05)  # 1 / r
    # Directions on these uneven triangles are 0.1 to 0.15 off: of the curvature their squares come through, 1 to 2 %.
    assert abs(np.einsum("ij,ij->i", rest, outwards).mean()) < 0.025 * 2.0
    # 0.01 sin(4 z), of which the second derivative is -16 times it.
    ripple = 0.01 * np.sin(4 * PIPE[:, 2])
    waved = PIPE + ripple[:, None] * PIPE * [2, 2, 0]
    rate = np.einsum("ij,ij->i", Principal(surface, None, 1.0).rate(waved)[deep] - rest, outwards)
    assert -np.polyfit(ripple[deep], rate, 1)[0] == pytest.approx(16.0, rel=0.1)


@pytest.mark.long
@pytest.mark.parametrize(
    ("level", "stepper"), [(0.03, "auto"), (0.1, "auto"), (0.1, "explicit"), (0.2, "auto"), (0.3, "auto")]
)
def test_a_noisy_cylinder_loses_its_noise_and_keeps_its_radius(level, stepper):
    edge, inner = mean_edge(PIPE, WALL), WALL[INSIDE[WALL].all(axis=1)]
    noisy = PIPE + level * edge * np.random.default_rng(0).normal(size=(len(PIPE), 1)) * PIPE * [2, 2, 0]
    words = {"boundary": "fixed", "time": 5 * edge**2}
    found = {
        way: smooth(
            (noisy, WALL), **parts(method=way, **words, **({"stepper": stepper} if way == "principal" else {}))
        )[0]
        for way in ("curvature", "principal")
    }
    before, after = normal_angle(noisy, PIPE, inner), normal_angle(found["principal"], PIPE, inner)
    assert after < (0.55 if level == 0.03 else 0.22) * before
    radii = {way: np.linalg.norm(points[INSIDE, :2], axis=1).mean() for way, points in found.items()}
    assert abs(radii["principal"] - 0.5) < 0.01 * 0.5
    assert radii["curvature"] < 0.5 * (
        1 - 0.1
    )  # curvature takes sqrt(1 - 2 t / r^2), 18 %, less what the held ends keep


@pytest.mark.parametrize("level", [0.05, 0.1, 0.2, 0.3])
def test_the_flow_along_directions_clears_a_noisy_cube_and_keeps_its_creases(level):
    shape = shapes.cube(20)
    noisy = shape.noisy("nrm", level, 7)
    found = smooth((noisy, shape.faces), method="principal", result=True)
    before, after = mesh_quality(noisy, shape), mesh_quality(found.after.points, shape)
    plain = mesh_quality(smooth((noisy, shape.faces), method="curvature", time=5 * shape.edge**2)[0], shape)
    assert after.normal_error < 0.12 * before.normal_error
    assert after.normal_error < 0.5 * plain.normal_error
    assert after.flipped == 0
    assert abs(after.drift) < 0.005


def test_corners_of_a_cube_stay_and_its_edges_hardly_move():
    shape = shapes.cube(12)
    corner = (np.abs(np.abs(shape.points - shape.points.mean(axis=0)) - 0.5) < 1e-9).all(axis=1)
    assert corner.sum() == 8
    words = {"time": 5 * shape.edge**2}
    kept = smooth((shape.points, shape.faces), **parts(method="principal", feature_length=20 * shape.edge, **words))[0]
    plain = smooth((shape.points, shape.faces), **parts(method="curvature", **words))[0]
    assert np.abs(kept - shape.points)[corner].max() < 1e-3 * shape.edge
    assert np.abs(kept - shape.points).max() < 0.01 * shape.edge
    assert np.abs(plain - shape.points).max() > shape.edge


def test_the_threshold_follows_from_the_noise_and_says_so():
    result = smooth((along_normals(BALL, FACES, 0.1), FACES), method="principal", result=True)
    assert "h / (0.05 + 0.3 sigma / h)" in result.parameters["feature_length"].why
    assert result.parameters["time"].why == "5 squared edges"
    with pytest.raises(InputError, match="feature_length: a positive"):
        smooth((BALL, FACES), method=PrincipalFlow(feature_length=-1.0))
    with pytest.raises(InputError, match="principal measures directions on the triangles as they are"):
        smooth((BALL, FACES), method="principal", compute=Compute(triangles="delaunay"))


@pytest.mark.shared
@pytest.mark.skipif(not SHARED.is_dir(), reason="../shared/data is not there")
@pytest.mark.parametrize("name", sorted(p.name for p in (SHARED / "meshes" / "messy").glob("*")))
def test_what_is_messy_stays_finite_along_directions(name):
    data = read(SHARED / "meshes" / "messy" / name).data
    assert np.isfinite(smooth(data, method="principal").points).all()


@pytest.mark.parametrize("kind", ["iso", "nrm"])
def test_normal_channels_keep_the_creases_of_a_cube_and_its_volume(kind):
    shape = shapes.cube(20)
    noisy = shape.noisy(kind, 0.2, 7)
    before = mesh_quality(noisy, shape)
    result = smooth((noisy, shape.faces), method="normal-channels", result=True)
    after = mesh_quality(result.after.points, shape)
    assert after.normal_error < 0.15 * before.normal_error
    assert after.flipped == 0
    assert result.parameters["preserve"].value == "volume"
    assert volume(result.after.points, shape.faces) == pytest.approx(volume(noisy, shape.faces), rel=1e-10)
    assert result.end.area < result.start.area  # the area of the surface, not of its normals
    plain = smooth((noisy, shape.faces), method="curvature", time=5 * shape.edge**2)[0]
    assert mesh_quality(plain, shape).normal_error > 3 * after.normal_error


def test_normal_channels_shrink_a_sphere_where_its_volume_is_not_kept():
    points = sphere(600)[0]
    faces = sphere(600)[1]
    open_ball = faces[points[faces].mean(axis=1)[:, 2] < 0.8]
    result = smooth((points, open_ball), method="normal-channels", result=True)
    assert "preserve" not in result.parameters
    assert np.linalg.norm(result.after.points, axis=1).mean() < 0.995
    kept = smooth((points, faces), method="normal-channels")[0]
    assert np.linalg.norm(kept, axis=1).mean() == pytest.approx(1.0, abs=0.01)


def test_planes_rest_in_normal_channels_and_a_length_of_zero_is_refused():
    points, faces, _ = square(300)
    for method, length in ((NormalChannels, "normal_weight"), (PrincipalFlow, "feature_length")):
        found = smooth((points, faces), method=method(**{length: 0.5}))[0]
        assert np.abs(found - points).max() < 1e-12
        for wrong in (0.0, -2.0):
            with pytest.raises(InputError, match=f"{length}: a positive"):
                method(**{length: wrong})
    with pytest.raises(InputError, match="only for a mesh whose points move"):
        smooth((points, faces), method="normal-channels", channels=points[:, 0])


def test_lengths_in_normals_are_those_of_a_surface_in_six_dimensions():
    points, faces = sphere(200)
    flow = MeshFlow(Surface(points, (faces,)), metric=NormalMetric(0.7, Given()))
    whole = np.column_stack([points, 0.7 * normals_at(points, faces)])
    assert np.allclose(flow.rate(points), -curvature_normal(whole, faces)[:, :3], atol=1e-12)


@pytest.mark.parametrize("level", [0.2, 0.3])
def test_noise_along_the_surface_is_evened_out_before_directions_are_measured(level):
    shape = shapes.cube(14)
    noisy = shape.noisy("iso", level, 3)
    found = {
        time: mesh_quality(smooth((noisy, shape.faces), method=PrincipalFlow(regularize=time))[0], shape)
        for time in (None, 0.0)
    }
    assert found[None].normal_error < (0.8 if level == 0.2 else 0.5) * found[0.0].normal_error
    assert abs(found[None].drift) < 0.02


def test_what_is_fixed_or_moves_less_is_evened_out_by_as_much():
    shape = shapes.cube(6)
    noisy = shape.noisy("iso", 0.2, 3)
    mobility = np.where(noisy[:, 0] > 0, 1.0, 0.0)
    moved = smooth((noisy, shape.faces), method="principal", constraints=Mobility(mobility))[0]
    np.testing.assert_array_equal(moved[mobility == 0], noisy[mobility == 0])
    assert (moved[mobility == 1] != noisy[mobility == 1]).any()
