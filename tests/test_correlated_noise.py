"""Noise that neighbours have in common, detail that only looks like it, and coordinates that were rounded."""

from itertools import pairwise

import numpy as np
import pytest
import trimesh

import meshflow
from meshflow.estimate.mesh_noise import PointNoise, noise_of_points
from meshflow.estimate.point_risk import PointRisk
from meshflow.estimate.rounded_points import quanta_of
from meshflow.evaluate.metrics import normal_angle
from meshflow.geometry.laplacians import neighbour_means
from meshflow.synthetic import shapes

BALL, RING, DOME, CUBE = shapes.sphere(4), shapes.ring(100, 40), shapes.dome(2000), shapes.cube(20)


def correlated(shape, rounds, level, seed):
    """Points with noise along the normals, over rounds of neighbour means, in mean edges."""
    mean = neighbour_means(shape.faces, len(shape.points), "free")
    off = np.random.default_rng(seed).normal(size=len(shape.points))
    for _ in range(rounds):
        off = 0.5 * (off + mean @ off)
    return shape.points + (level * shape.edge / off.std() * off)[:, None] * shape.normals()


def rough_body(seed):
    """A ball with detail of every length, less of the shorter ones, as scanned bodies have."""
    rng, body = np.random.default_rng(seed), trimesh.creation.icosphere(4)
    x, radius = np.asarray(body.vertices), np.ones(len(body.vertices))
    for frequency, size in ((1.5, 0.25), (3, 0.12), (6, 0.06), (12, 0.02)):
        waves = rng.normal(size=(14, 3)) * frequency
        radius += size / np.sqrt(14) * np.cos(x @ waves.T + rng.uniform(0, 6.28, 14)).sum(axis=1)
    return x * radius[:, None], np.asarray(body.faces)


@pytest.mark.parametrize(
    ("shape", "rounds"),
    [*((shape, rounds) for shape in (BALL, RING, DOME) for rounds in (2, 5, 10)), (CUBE, 2), (CUBE, 5)],
)
def test_sigma_and_rounds_of_correlated_noise_are_found(shape, rounds):
    found = noise_of_points(correlated(shape, rounds, 0.15, 3), shape.faces)
    assert found.spread == pytest.approx(rounds, abs=1, rel=0.25)
    assert found.sigma == pytest.approx(0.15 * shape.edge, rel=0.3)


@pytest.mark.parametrize(
    ("shape", "rounds", "most"),
    [(RING, 5, 0.1), (BALL, 10, 0.4), (DOME, 5, 0.45), (CUBE, 5, 0.15)],
    ids=["ring", "ball", "dome", "cube"],
)
def test_correlated_noise_goes_by_default(shape, rounds, most):
    points = correlated(shape, rounds, 0.15, 4)
    after = meshflow.smooth((points, shape.faces))[0]
    before, left = (normal_angle(x, shape.points, shape.faces) for x in (points, after))
    assert left < most * before


@pytest.mark.filterwarnings("ignore::meshflow.errors.MeshflowWarning")
def test_detail_of_every_length_is_hardly_ever_taken_for_noise():
    bodies = [rough_body(seed) for seed in range(1, 9)]
    moved = [seed for seed, body in enumerate(bodies, 1) if (meshflow.smooth(body)[0] != body[0]).any()]
    assert len(moved) <= 1, moved


def test_what_may_be_detail_moves_if_a_time_is_given():
    points, faces = rough_body(6)
    result = meshflow.smooth((points, faces), result=True)
    assert "may be detail of the shape" in str(result)
    assert (result.data[0] == points).all()
    step = shapes.mean_edge(points, faces)
    assert (meshflow.smooth((points, faces), method="fairing", time=step**2)[0] != points).any()


def test_a_ring_that_has_become_a_wire_is_no_less_wrong_for_having_moved_everywhere_alike():
    noise = PointNoise(0.15 * RING.edge, 0.0, spread=5)
    risk = PointRisk.of(RING.points, RING.faces, np.ones(len(RING.points), bool), noise)

    def moved(by):
        return tuple(start - by * noise.sigma * RING.normals() for start in risk.starts)

    assert risk.of_states(moved(0.1)) == pytest.approx(risk.of_states(moved(0.0)), abs=0.05 * noise.sigma**2)
    assert risk.of_states(moved(3.0)) == np.inf


@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("quantum", [(0.02, 0.02, 0.02), (0.001, 0.003, 0.0007), (0.37, 0.2, 0.11)])
def test_quanta_of_coordinates_are_found_whatever_the_shift_and_the_number_type(quantum, kind):
    points, quantum = 5.0 * BALL.points, np.array(quantum)
    rounded = np.rint(points / quantum) * quantum + (0.123, -7.77, 2.001)
    assert quanta_of(rounded.astype(kind)) == pytest.approx(quantum, rel=1e-3)
    assert quanta_of(points.astype(kind)) is None


@pytest.mark.parametrize("quantum", [0.05, 0.1, 0.2])
def test_rounded_points_stay_within_half_a_quantum_and_are_nearer_to_the_truth(quantum):
    quantum *= BALL.edge
    rounded = np.rint(BALL.points / quantum + 0.3) * quantum - 0.3 * quantum
    result = meshflow.smooth((rounded, BALL.faces), result=True)
    after = result.data[0]
    assert np.abs(after - rounded).max() <= 0.5 * quantum * (1 + 1e-9)
    before, left = (normal_angle(x, BALL.points, BALL.faces) for x in (rounded, after))
    assert left < 0.2 * before
    assert noise_of_points(rounded, BALL.faces).sigma == pytest.approx(quantum / np.sqrt(12))


@pytest.mark.parametrize("quantum", [0.02, 0.1])
def test_rounding_does_no_harm_to_parts(quantum):
    part = shapes.part(0.04)
    quantum *= part.edge
    rounded = np.rint(part.points / quantum) * quantum
    after = meshflow.smooth((rounded, part.faces))[0]
    before, left = (normal_angle(x, part.points, part.faces) for x in (rounded, after))
    assert left <= before


def test_correlated_noise_is_the_same_whatever_the_place_and_the_order():
    points, seed = correlated(RING, 5, 0.15, 5), np.random.default_rng(5)
    order = seed.permutation(len(points))
    place = np.argsort(order)
    moved = 3.0 * points[order] @ np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]) + 7.0
    one, other = noise_of_points(points, RING.faces), noise_of_points(moved, place[RING.faces[:, [1, 2, 0]]])
    assert (one.spread, one.left) == (other.spread, other.left)
    assert other.sigma == pytest.approx(3.0 * one.sigma, rel=1e-6)


def test_more_rounds_are_told_from_fewer():
    found = [noise_of_points(correlated(BALL, rounds, 0.2, 6), BALL.faces).spread for rounds in (0, 2, 4, 8)]
    assert all(one < other for one, other in pairwise(found))
    assert found[0] == 0
