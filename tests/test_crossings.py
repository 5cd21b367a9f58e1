"""Triangles that cross each other, and motions that make none. meshflow.geometry.crossings."""

from itertools import combinations

import numpy as np
import pytest
from scipy.spatial import Delaunay

import meshflow
from meshflow.estimate.point_limits import MOST
from meshflow.geometry.crossings import crossing_pairs, moved_without_harm, new_crossings
from meshflow.geometry.folds import new_folds
from meshflow.geometry.normals import mean_edge
from meshflow.smoothing import smooth
from meshflow.synthetic import shapes


def crosses(x, p, q, triangle):
    """Whether the segment from p to q crosses a triangle, by the volumes of tetrahedra."""
    a, b, c = x[triangle]
    normal = np.cross(b - a, c - a)
    if (normal @ (x[p] - a)) * (normal @ (x[q] - a)) >= 0:
        return False
    sides = [np.linalg.det([x[q] - x[p], s - x[p], e - x[p]]) for s, e in ((a, b), (b, c), (c, a))]
    return min(sides) > 0 or max(sides) < 0


def naive(x, faces):
    """All pairs of triangles without a common edge of which a side of one crosses the other."""
    found = set()
    for one, other in combinations(range(len(faces)), 2):
        common = set(faces[one]) & set(faces[other])
        if len(common) > 1:
            continue
        for triangle, beyond in ((faces[one], faces[other]), (faces[other], faces[one])):
            sides = [side for side in combinations(triangle, 2) if not common & set(side)]
            if any(crosses(x, p, q, beyond) for p, q in sides):
                found.add((one, other))
    return found


@pytest.mark.parametrize(("n", "m", "flat"), [(30, 40, 1.0), (60, 100, 1.0), (20, 60, 0.01), (8, 20, 1.0)])
def test_crossings_are_those_of_all_pairs(n, m, flat):
    rng = np.random.default_rng(n)
    x = rng.normal(size=(n, 3)) * [1.0, 1.0, flat]
    faces = np.array([rng.choice(n, 3, replace=False) for _ in range(m)])
    found = [tuple(sorted(pair)) for pair in crossing_pairs(x, faces).tolist()]
    assert len(found) == len(set(found))
    assert set(found) == naive(x, faces)


def test_touching_triangles_and_meshes_of_no_size_do_not_cross():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.2, 0], [0.3, 0.2, 1], [0.2, 0.3, 1.0]])
    assert len(crossing_pairs(points, np.array([[0, 1, 2], [3, 4, 5]]))) == 0
    assert len(crossing_pairs(points, np.zeros((0, 3), int))) == 0
    assert len(crossing_pairs(np.zeros((6, 3)), np.array([[0, 1, 2], [3, 4, 5]]))) == 0
    assert len(crossing_pairs(shapes.cube(6).points, shapes.cube(6).faces)) == 0


def test_a_triangle_much_larger_than_the_others_is_found():
    ball = shapes.sphere(3)
    far = np.array([[-300.0, -300, 0.011], [300, -300, 0.013], [0, 400, 0.012]])
    points = np.concatenate([ball.points, far])
    faces = np.concatenate([ball.faces, [[len(points) - 3, len(points) - 2, len(points) - 1]]])
    found = crossing_pairs(points, faces)
    low, high = ball.points[ball.faces][:, :, 2].min(axis=1), ball.points[ball.faces][:, :, 2].max(axis=1)
    assert (found.max(axis=1) == len(faces) - 1).all()
    assert len(found) == ((low < 0.0115) & (high > 0.0125)).sum() > 10


def test_what_would_cross_moves_less_and_nothing_else_does():
    plate = shapes.plate(40)
    before, after = plate.points, plate.points.copy()
    top = before[:, 2] > 0
    dent = top & (np.linalg.norm(before[:, :2], axis=1) < 0.1)
    after[dent, 2] -= 0.05  # through the lower side
    after[~dent, 0] += 0.001
    assert len(new_crossings(before, after, plate.faces)) > 0
    found, less = moved_without_harm(before, after, plate.faces, np.zeros(len(before), bool))
    assert len(new_crossings(before, found, plate.faces)) == 0
    assert len(new_folds(before, found, plate.faces)) == 0
    assert 0 < less < 0.2 * len(before)
    beyond = np.linalg.norm(before[:, :2], axis=1) > 0.3
    assert np.array_equal(found[beyond], after[beyond])


@pytest.mark.long
@pytest.mark.parametrize(("kind", "level"), [("nrm", 0.3), ("iso", 0.7)])
@pytest.mark.parametrize("shape", [shapes.part(0.04), shapes.plate(40)], ids=["part", "plate"])
def test_the_default_makes_no_crossings_and_moves_no_point_farther_than_noise_goes(shape, kind, level):
    points = shape.noisy(kind, level)
    result = meshflow.smooth((points, shape.faces), result=True)
    assert len(new_crossings(points, result.data[0], shape.faces)) == 0
    assert np.linalg.norm(result.data[0] - points, axis=1).max() <= MOST * result.noise.sigma * (1 + 1e-12)


def test_the_sampling_of_a_mesh_with_little_noise_goes_no_farther_than_the_noise():
    dome = shapes.dome(1500)
    points = dome.noisy("nrm", 0.03)
    result = meshflow.smooth((points, dome.faces), result=True)
    assert result.parameters["max_change"].value == pytest.approx(MOST * result.noise.sigma)
    assert np.linalg.norm(result.data[0] - points, axis=1).max() <= MOST * result.noise.sigma * (1 + 1e-12)


def test_what_is_mended_at_a_crease_follows_the_planes_beside_it():
    cube = shapes.cube(10)
    at_crease = np.flatnonzero((np.abs(np.abs(cube.points) - 0.5) < 1e-9).sum(axis=1) == 2)
    middle = at_crease[np.argmin(np.abs(cube.points[at_crease] - [0.5, 0.5, 0.0]).sum(axis=1))]
    after = cube.points.copy()
    after[middle] += [0.0, 0.0, 0.16]  # along the crease, beyond its neighbour
    assert len(new_folds(cube.points, after, cube.faces)) > 0
    found, less = moved_without_harm(cube.points, after, cube.faces, np.zeros(len(after), bool))
    assert len(new_folds(cube.points, found, cube.faces)) == 0
    assert 0 < less < 30
    assert cube.distance(found).max() < 0.05 * cube.edge  # 0.29 edges where the mended corners do not follow


@pytest.mark.parametrize("seed", [3, 4])
def test_no_point_of_slivers_moves_farther_than_is_said_and_nothing_folds_or_crosses(seed):
    draw = np.random.default_rng(seed)
    plane = draw.random((1500, 2))
    faces, edge = Delaunay(plane).simplices, 1.2 / np.sqrt(1500)
    before = np.c_[plane, np.abs(plane[:, 0] - 0.5) + draw.normal(0, 0.1 * edge, 1500)]
    result = meshflow.smooth((before, faces), result=True)
    after = result.data[0]
    most = result.parameters["max_change"].value
    assert np.linalg.norm(after - before, axis=1).max() <= most * (1 + 1e-9)
    assert len(new_folds(before, after, faces)) == 0
    assert len(new_crossings(before, after, faces)) == 0


def test_a_few_slivers_along_the_rim_do_not_undo_the_whole():
    draw = np.random.default_rng(0)
    ground = draw.random((6000, 2))
    faces = Delaunay(ground).simplices
    land = np.column_stack([ground, 0.1 * np.sin(8 * ground[:, 0]) * np.cos(6 * ground[:, 1])])
    off = 0.1 * mean_edge(land, faces) * draw.normal(size=len(land))
    found = smooth((land + off[:, None] * [0, 0, 1], faces))[0]
    assert np.std(found[:, 2] - land[:, 2]) < 0.45 * off.std()


@pytest.mark.parametrize("seed", [0, 3])
def test_spikes_that_were_moved_back_do_not_return_for_a_fold(seed):
    shape, draw = shapes.cube(18), np.random.default_rng(seed)
    noisy, high = shape.noisy("nrm", 0.1, seed), draw.choice(len(shape.points), 15, replace=False)
    noisy[high] += 10 * shape.edge * draw.choice([-1, 1], (15, 1)) * shape.normals()[high]
    found = smooth((noisy, shape.faces))[0]
    assert np.abs(shape.distance(found)).max() < 4.5 * shape.edge
