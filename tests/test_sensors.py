"""Simulated sensors: cast exactly, noisy as their model says, missing where their light does not come."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from meshflow.errors import InputError
from meshflow.surfaces.camera import Pinhole
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.surfaces.visibility import Sight
from meshflow.synthetic.samples import CAMERA, SCENE, depth_scene
from meshflow.synthetic.sensors import StructuredLight, TimeOfFlight, observe, seen
from meshflow.synthetic.solids import Ball, Block, Panel

SHAPE = (120, 160)
SIGHT = Sight.through(Pinhole(150.0, 150.0, 79.5, 59.5), SHAPE)
FULL = Sight.through(CAMERA, (240, 320))
WALL = (Panel((0.0, 0.0, 1.0), 2.0),)
BEFORE_A_WALL = (Ball((0.0, 0.0, 1.2), 0.25), *WALL)
QUIET = StructuredLight(sigma=0.0, flying=0.0)


def test_solids_are_seen_where_the_scene_of_the_samples_has_them():
    found, scene = seen(SCENE, FULL), depth_scene()
    # Sines of numpy differ in the last bit between machines, and between arrays of other lengths.
    np.testing.assert_allclose(found.depth, scene.truth, rtol=1e-14)
    assert np.array_equal(found.part, scene.seen)


def test_normals_are_of_length_one_and_point_towards_the_camera():
    found = seen(SCENE, FULL)
    there = found.part >= 0
    assert np.allclose(np.linalg.norm(found.normals[there], axis=1), 1.0)
    assert (np.einsum("ni,ni->n", found.normals[there], FULL.directions[there]) < 0).all()
    ball = found.part == 2
    assert np.allclose(found.normals[ball], (FULL.at(found.depth)[ball] - SCENE[2].centre) / SCENE[2].radius)


def test_a_mesh_is_seen_as_the_solid_that_it_is_made_of():
    block = Block((0.1, 0.05, 1.5), 0.3, (40.0, 35.0))
    corners = trimesh.creation.box((0.6, 0.6, 0.6))
    mesh = Mesh(corners.vertices @ block._turn.T + block.centre, corners.faces)
    one, two = seen((block,), SIGHT), seen(mesh, SIGHT)
    both = (one.part >= 0) & (two.part >= 0)
    assert ((one.part >= 0) ^ (two.part >= 0)).sum() <= 2  # rays that graze an edge
    assert np.abs(one.depth - two.depth)[both].max() < 1e-12
    assert np.abs(one.normals - two.normals)[both].max() < 1e-12


def test_rays_from_many_origins_see_what_rays_from_one_see_of_a_body_moved_the_other_way():
    shift = np.array([0.3, -0.2, 0.1])
    moved = (Ball((0.0, 0.1, 1.2), 0.25), Block((0.1, 0.0, 2.0), 0.5, (20.0, 10.0)), Panel((0.6, 0.0, 0.8), 2.5))
    back = (
        replace(moved[0], centre=tuple(moved[0].centre - shift)),
        replace(moved[1], centre=tuple(moved[1].centre - shift)),
        replace(moved[2], offset=moved[2].offset - float(shift @ moved[2].normal)),
    )
    one, two = seen(moved, Sight(shift, SIGHT.directions)), seen(back, SIGHT)
    assert np.array_equal(one.part, two.part)
    assert np.nanmax(np.abs(one.depth - two.depth)) < 1e-12


def test_without_noise_time_of_flight_is_true_and_structured_light_true_to_its_steps():
    exact = observe(WALL, SIGHT, TimeOfFlight(sigma=0.0, growth=0.0, flying=0.0))
    assert np.array_equal(exact.depth, exact.truth)
    for step in (None, 0.125):
        frame = observe(WALL, SIGHT, replace(QUIET, step=step))
        half = 0.5 * (step or 1e-12) / (QUIET.focal * QUIET.baseline)
        assert np.nanmax(np.abs(1 / frame.depth - 1 / frame.truth)) <= half * (1 + 1e-9)


def test_the_noise_of_structured_light_is_that_of_its_model_and_grows_as_the_square_of_depth():
    found = []
    for z in (1.0, 2.0, 4.0):
        frame = observe((Panel((0.0, 0.0, 1.0), z),), FULL, StructuredLight(sigma=0.05, step=None, seed=1))
        found.append(np.nanstd(frame.depth))
        assert found[-1] == pytest.approx(frame.sigma[0, 0], rel=0.02)
    order = np.log2(found[2] / found[0]) / 2
    assert order == pytest.approx(2.0, abs=0.02), f"noise grows as z^{order:.3f}"


def test_the_noise_of_time_of_flight_grows_with_depth_and_where_less_light_comes_back():
    for z in (1.0, 3.0):
        frame = observe((Panel((0.0, 0.0, 1.0), z),), FULL, TimeOfFlight(0.003, 0.002, seed=1))
        assert np.std(frame.depth) == pytest.approx(0.003 + 0.002 * z, rel=0.02)
    frame = observe((Panel((0.6, 0.0, 0.8), 2.0),), FULL, TimeOfFlight(0.003, 0.002, lambert=True))
    cosine = np.cos(np.radians(FULL.tilt(frame.normals)))
    expected = (0.003 + 0.002 * frame.truth) / cosine
    assert np.nanstd((frame.depth - frame.truth) / expected) == pytest.approx(1.0, rel=0.02)


def test_what_is_seen_at_too_grazing_an_angle_is_missing_and_nothing_else_of_a_plane():
    floor = (Panel((0.0, 1.0, 0.0), 0.2, high=np.inf),)
    for sensor in (replace(QUIET, grazing=75.0), TimeOfFlight(grazing=75.0, flying=0.0)):
        frame = observe(floor, SIGHT, sensor)
        there = np.isfinite(frame.truth)
        tilt = SIGHT.tilt(frame.normals)
        assert 100 < (tilt[there] >= 75).sum() < there.sum()
        assert np.array_equal(np.isfinite(frame.depth), there & (tilt < 75))


def test_the_projector_throws_a_shadow_on_its_far_side_as_wide_as_the_disparities_differ():
    frame = observe(BEFORE_A_WALL, SIGHT, QUIET)
    assert np.isnan(frame.depth[frame.dark]).all()
    on_wall = frame.dark & (frame.truth == 2.0)
    row, columns = 60, np.flatnonzero(on_wall[60])
    assert columns.max() < 79  # the projector stands to the right
    edge = np.flatnonzero(frame.truth[row] < 2.0).min()
    assert columns.max() == edge - 1
    z = frame.truth[row, edge]
    assert len(columns) == pytest.approx(150.0 * QUIET.baseline * (1 / z - 1 / 2.0), abs=1.5)


def test_flying_pixels_lie_between_the_two_sides_of_a_jump_and_nowhere_else():
    for sensor in (TimeOfFlight(0.0, 0.0, flying=0.5), StructuredLight(sigma=0.0, step=None, flying=0.5)):
        frame = observe(BEFORE_A_WALL, SIGHT, sensor)
        assert frame.flying.sum() > 50
        depth = frame.depth[frame.flying]
        assert ((depth > 0.95) & (depth < 2.0)).all()
        assert (np.abs(depth - frame.truth[frame.flying]) > 0.02).all()
        still = np.isfinite(frame.depth) & ~frame.flying
        assert np.allclose(frame.depth[still], frame.truth[still], rtol=1e-12)
        assert not observe(WALL, SIGHT, sensor).flying.any()


def test_a_slanted_plane_has_no_jumps_however_steep():
    steep = (Panel((np.sin(1.4), 0.0, np.cos(1.4)), 0.5),)
    frame = observe(steep, SIGHT, TimeOfFlight(flying=1.0, grazing=90.0))
    assert np.nanmax(np.abs(np.diff(frame.truth, axis=1)) / frame.truth[:, 1:]) > 0.05
    assert not frame.flying.any()


def test_one_seed_is_one_frame():
    for sensor in (StructuredLight(seed=3), TimeOfFlight(seed=3)):
        one, same = (observe(SCENE, FULL, sensor).depth for _ in range(2))
        assert np.array_equal(one, same, equal_nan=True)
        assert not np.array_equal(one, observe(SCENE, FULL, replace(sensor, seed=4)).depth, equal_nan=True)


def test_a_surface_rendered_from_its_own_pixels_gives_its_depths_back():
    scene = depth_scene()
    surface = RangeImage(scene.noisy, CAMERA).lifted(Lift(diagonals="forward"))
    used = np.isin(np.arange(scene.noisy.size), surface.triangulations[0]).reshape(scene.noisy.shape)
    depth = FULL.rendered(surface.points, surface.triangulations[0])
    assert np.array_equal(np.isfinite(depth), used)
    assert np.abs(depth - scene.noisy)[used].max() < 1e-12


def test_points_are_seen_in_the_pixels_of_the_pinhole_wherever_they_went():
    points = SIGHT.at(np.full(SHAPE, 1.5)).reshape(-1, 3) * 1.1 + (0.02, -0.05, 0.03)
    pixels, depth = SIGHT.pixels(points)
    expected = 150.0 * points[:, :2] / points[:, 2:] + (79.5, 59.5)
    assert np.abs(pixels - expected).max() < 1e-9
    assert np.abs(depth - points[:, 2]).max() < 1e-12


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: StructuredLight(baseline=0.0), "baseline: a positive finite number expected, got 0.0"),
        (lambda: StructuredLight(focal=-1.0), "focal: a positive finite number of pixels expected"),
        (lambda: StructuredLight(step=0.0), "step: a positive finite number of pixels expected"),
        (lambda: StructuredLight(sigma=-1.0), "sigma: a standard deviation of zero or more expected, got -1.0"),
        (lambda: TimeOfFlight(growth=-1.0), "growth: a standard deviation of zero or more expected"),
        (lambda: TimeOfFlight(grazing=91.0), "grazing: an angle above 0 and up to 90 degrees expected, got 91.0"),
        (lambda: TimeOfFlight(flying=1.5), "flying: a share between 0 and 1 expected, got 1.5"),
        (lambda: TimeOfFlight(jump=0.0), "jump: a positive finite number expected"),
        (lambda: TimeOfFlight(seed=-1), "seed: a whole number, 0 or more, expected"),
        (lambda: seen((), SIGHT), "at least one solid expected, got none"),
        (lambda: seen(Mesh(np.eye(4), [[0, 1, 2]]), SIGHT), r"a mesh in R\^3 expected, got points in R\^4"),
        (lambda: observe((Ball((0, 0, -2.0), 0.5),), SIGHT, QUIET), "none of the rays meets the body"),
        (lambda: Sight(np.zeros(3), np.ones((4, 3))), r"directions \(h, w, 3\) of 2 x 2 pixels or more expected"),
        (lambda: Sight(np.zeros(3), np.zeros((4, 4, 3))), "finite and not zero expected, 16 pixels have none"),
        (lambda: Sight(np.zeros((2, 3)), np.ones((4, 4, 3))), r"origins that fit directions \(4, 4, 3\) expected"),
    ],
)
def test_what_no_sensor_is_is_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()
