"""The noise of meshes that are not evenly sampled: long triangles, coarse models, diagonals that the noise has chosen."""

import numpy as np
import pytest
import trimesh

import meshflow
from meshflow.estimate.edge_noise import noise_at_edges
from meshflow.estimate.mesh_noise import noise_of_points
from meshflow.evaluate.metrics import normal_angle
from meshflow.synthetic.shapes import mean_edge

MAKE = trimesh.creation
COARSE = {
    "box": MAKE.box((1, 0.7, 0.4)).subdivide().subdivide().subdivide(),
    "cylinder of long triangles": MAKE.cylinder(1, 3, sections=64).subdivide().subdivide(),
    "cone of long triangles": MAKE.cone(1, 2, sections=40).subdivide().subdivide(),
    "ring of long triangles": MAKE.annulus(0.5, 1, 1, sections=32).subdivide().subdivide(),
}


def sheet(side, sigma, choose, seed):
    """Points of a plane with noise along z, its quadrilaterals cut along the diagonal that is chosen by the lengths of both."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(side), np.arange(side), indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), sigma * rng.normal(size=side * side)]).astype(float)
    number = np.arange(side * side).reshape(side, side)
    a, b, c, d = (number[i : side - 1 + i, j : side - 1 + j].ravel() for i, j in ((0, 0), (0, 1), (1, 1), (1, 0)))
    one, other = (np.linalg.norm(points[p] - points[q], axis=1) for p, q in ((a, c), (b, d)))
    first = choose(one, other)[:, None]
    halves = np.where(first, np.c_[a, b, c], np.c_[a, b, d]), np.where(first, np.c_[a, c, d], np.c_[b, c, d])
    return points, np.concatenate(halves)


@pytest.mark.parametrize("choose", [np.less, np.greater, np.equal], ids=["shorter", "longer", "one way"])
@pytest.mark.parametrize("sigma", [0.1, 0.4])
def test_sigma_does_not_depend_on_which_diagonals_the_noise_has_chosen(choose, sigma):
    found = [noise_of_points(*sheet(40, sigma, choose, seed)) for seed in (1, 2)]
    assert [one.spread for one in found] == [0, 0]
    assert np.mean([one.sigma for one in found]) == pytest.approx(sigma, rel=0.1)


@pytest.mark.parametrize("name", COARSE)
def test_creases_of_coarse_models_are_not_taken_for_noise(name):
    points, faces = np.array(COARSE[name].vertices), np.array(COARSE[name].faces)
    sigma = 0.01 * mean_edge(points, faces)
    noisy = points + sigma * np.random.default_rng(3).normal(size=points.shape)
    found = noise_of_points(noisy, faces)
    assert found.is_plain
    assert found.sigma == pytest.approx(sigma, rel=0.3)
    after = meshflow.smooth((noisy, faces))[0]
    assert np.linalg.norm(after - points) < 1.2 * np.linalg.norm(noisy - points)


def test_the_noise_at_an_edge_is_the_volume_of_its_tetrahedron_over_the_response_of_that():
    rng = np.random.default_rng(1)
    points, faces = rng.normal(size=(4, 3)), np.array([[0, 1, 2], [1, 0, 3]])

    def signed(p):
        return float(np.linalg.det(p[1:] - p[0]))

    step, slopes = 1e-6, []
    for vertex in range(4):
        for axis in range(3):
            moved = points.copy()
            moved[vertex, axis] += step
            slopes.append((signed(moved) - signed(points)) / step)
    expected = abs(signed(points)) / np.linalg.norm(slopes) / 0.3186394
    assert noise_at_edges(points, faces, np.ones(4, bool)) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("level", [1e-4, 1e-3, 1e-2])
@pytest.mark.parametrize(("extents", "edge"), [((10, 6, 3), 1.0), ((4, 4, 1), 0.3)])
def test_creases_of_a_coarse_part_with_little_noise_are_no_impulses(extents, edge, level, seed):
    part = trimesh.creation.box(extents).subdivide_to_size(edge)
    points, faces = np.array(part.vertices), np.asarray(part.faces)
    off = level * mean_edge(points, faces)
    noisy = points + off * np.random.default_rng(seed).normal(size=points.shape)
    found = meshflow.smooth((noisy, faces), result=True)
    assert found.noise.sigma < (4 if level < 5e-3 else 6) * off
    assert normal_angle(found.data[0], points, faces) <= normal_angle(noisy, points, faces)
