"""Meshes of binary volumes are recognized however their coordinates were stored, rods as well as balls, and blocks are left."""

import numpy as np
import pytest
from skimage.measure import marching_cubes

import meshflow
from meshflow import Fairing
from meshflow.estimate.voxels import voxels_of
from meshflow.geometry.crossings import new_crossings
from meshflow.geometry.folds import new_folds
from meshflow.geometry.volume import volume

X, Y, Z = GRID = np.mgrid[-1:1:44j, -1:1:44j, -1:1:44j]
BALL = np.linalg.norm(GRID, axis=0) < 0.8
ROD = (np.hypot(X, Y) < 0.5) & (np.abs(Z) < 0.8)
BLOCK = (np.abs(X) < 0.5) & (np.abs(Y) < 0.6) & (np.abs(Z) < 0.7)


# A turn, and one of the slices of a tilted gantry.
TURNED = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
TILTED = TURNED @ [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.3, 1.0]]


def torus_off(points):
    """Distances from a torus of which the larger circle is in the xy plane, and their directions."""
    ring = points * [1, 1, 0]
    ring *= 0.55 / np.linalg.norm(ring, axis=1, keepdims=True)
    away = points - ring
    length = np.linalg.norm(away, axis=1)
    return length - 0.25, away / length[:, None]


def torus_of_voxels(spacing, turned=True):
    """The torus, 44 cells across in the shortest direction, and its edges of a voxel as rows."""
    steps = 2.0 / 44 * np.array(spacing)
    way = TURNED if turned else np.eye(3)
    places = np.stack(np.meshgrid(*(np.arange(-1.0, 1.0 + 2 * s, s) for s in steps), indexing="ij"), axis=-1)
    inside = torus_off(places.reshape(-1, 3) @ way)[0].reshape(places.shape[:3]) < 0
    points, faces = surface(inside)
    return (points * steps - 1.0) @ way, faces, np.diag(steps) @ way


def angle_and_distance(points, faces):
    """Mean angle of the normals of the triangles with those of the torus, degrees, and mean distance of the points."""
    normals = np.cross(*(points[faces[:, i]] - points[faces[:, 0]] for i in (1, 2)))
    cosine = (normals * torus_off(points[faces].mean(axis=1))[1]).sum(axis=1) / np.linalg.norm(normals, axis=1)
    return np.degrees(np.arccos(np.clip(np.abs(cosine), -1, 1))).mean(), np.abs(torus_off(points)[0]).mean()


def surface(body):
    points, faces, _, _ = marching_cubes(body.astype(float), 0.5)
    return points.astype(np.float64), faces.astype(np.int64)


@pytest.mark.parametrize(
    ("stored", "edge"),
    [
        (lambda x: (0.4883 * x + [-123.4, -99.7, 512.5]).astype(np.float32), 0.4883),
        (lambda x: (0.4883 * x + [-123.4, -99.7, 512.5]).astype(np.float32).astype(np.float64), 0.4883),
        (lambda x: (0.02 * x + [1200.0, 900.0, 50.0]).astype(np.float32), 0.02),
        (lambda x: (x * [0.5, 0.7, 2.5] - 700.0).astype(np.float32), 0.5),
        (lambda x: np.round(0.4883 * x, 4), 0.4883),
        (lambda x: np.round(0.4883 * x, 3), 0.4883),
    ],
    ids=["millimetres", "in double", "small", "thick slices", "four decimals", "three decimals"],
)
def test_voxels_are_found_however_their_corners_were_rounded(stored, edge):
    points, faces = surface(BALL)
    found = voxels_of(stored(points), faces)
    assert found is not None
    assert found.shortest == pytest.approx(edge, rel=1e-3)


@pytest.mark.parametrize(("spacing", "most"), [((1, 1, 1), 2.0), ((1, 1, 2), 2.5), ((1, 3, 1), 3.5)])
def test_a_torus_of_voxels_loses_its_steps_whatever_their_proportions(spacing, most):
    points, faces, axes = torus_of_voxels(spacing)
    after = meshflow.smooth((points, faces))[0]
    angle, distance = angle_and_distance(after, faces)
    assert angle < most, f"{angle:.2f} degrees"
    assert distance < 0.1 * np.cbrt(np.linalg.det(axes)) * np.sign(np.linalg.det(axes))
    assert volume(after, faces) == pytest.approx(volume(points, faces), rel=1e-4)
    assert np.linalg.norm((after - points) @ np.linalg.inv(axes), axis=1).max() <= 0.5 + 1e-9


@pytest.mark.parametrize("spacing", [(1, 1, 1), (0.5, 0.7, 2.0)])
@pytest.mark.parametrize("way", [TURNED, TILTED], ids=["turned", "tilted"])
@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_voxels_are_found_along_any_axes(spacing, way, kind):
    points, faces = surface(BALL)
    axes = 0.4883 * np.diag(spacing) @ way.T
    found = voxels_of((points @ axes + [120.0, -70.0, 30.0]).astype(kind), faces)
    assert found is not None
    along = found.axes @ np.linalg.inv(axes)  # the same three, in any order and sense
    np.testing.assert_allclose(np.sort(np.abs(along).ravel()), [0, 0, 0, 0, 0, 0, 1, 1, 1], atol=1e-3)
    assert (found.odd.sum(axis=1) == 1).all()


def test_turned_voxels_are_smoothed_as_those_along_the_axes():
    points, faces, _ = torus_of_voxels((1, 1, 2), turned=False)
    after = meshflow.smooth((points, faces))[0]
    turned = meshflow.smooth((points @ TURNED * 3.0 + 40.0, faces))[0]
    np.testing.assert_allclose(turned, after @ TURNED * 3.0 + 40.0, atol=1e-10 * 6.0)


@pytest.mark.parametrize("way", [np.eye(3), TURNED, TILTED], ids=["straight", "turned", "tilted"])
def test_what_is_evenly_divided_is_no_volume_of_voxels(way):
    rng, faces = np.random.default_rng(6), sheet(30, 40)
    i, j = np.divmod(np.arange(1200), 40)
    stairs = np.cumsum(np.where(rng.random((30, 1)) < 0.5, [[1, 0]], [[0, 1]]), axis=0)
    for points in (
        np.stack([i, j, np.rint(3 * np.sin(i / 5) + 2 * np.cos(j / 7))], axis=1),
        np.stack([i, j + 0.5 * (i % 2), rng.integers(0, 3, 1200)], axis=1),
        np.column_stack([stairs[i], j]),
        np.column_stack([0.5 * stairs[i], j]),
    ):
        assert voxels_of(points.astype(float) @ way, faces) is None


def test_a_plate_of_three_voxels_keeps_its_volume_and_so_does_a_ball_beside_it():
    plate = (np.hypot(X, Y) < 0.9) & (np.abs(Z + 0.8) < 1.5 * 2 / 43)
    ball = np.linalg.norm(GRID - np.reshape([0, 0, 0.3], (3, 1, 1, 1)), axis=0) < 0.4
    for spacing in ([1.0, 1.0, 1.0], [0.5, 0.5, 2.0]):
        points, faces = surface(np.pad(plate | ball, 1))
        points *= spacing
        after = meshflow.smooth((points, faces))[0]
        below = points[faces[:, 0], 2] < 16 * spacing[2]
        for part in (faces[below], faces[~below]):
            assert volume(after, part) == pytest.approx(volume(points, part), rel=0.005)


def sheet(rows, columns):
    """The triangles of a grid of points."""
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    cells = np.stack([first, first + columns, first + columns + 1, first + 1], axis=1)
    return np.concatenate([cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]])


def test_a_rod_of_voxels_loses_its_steps():
    points, faces = surface(ROD)
    after = meshflow.smooth((points, faces))[0]
    assert np.linalg.norm(after - points, axis=1).max() <= 0.5 + 1e-9
    middle = after[faces].mean(axis=1) - 21.5
    side = (np.abs(middle[:, 2]) < 14) & (np.hypot(middle[:, 0], middle[:, 1]) > 5)
    normals = np.cross(*(after[faces[side, i]] - after[faces[side, 0]] for i in (1, 2)))
    outwards = middle[side] * [1, 1, 0]
    cosine = np.abs((normals * outwards).sum(1)) / np.linalg.norm(normals, axis=1) / np.linalg.norm(outwards, axis=1)
    assert np.degrees(np.arccos(np.clip(cosine, 0, 1))).mean() < 4.0  # 15 before


@pytest.mark.parametrize("body", [BLOCK, BLOCK & ((X < 0) | (Y < 0))], ids=["box", "angle"])
def test_blocks_along_the_axes_have_no_steps_and_stay(body):
    points, faces = surface(body)
    assert np.array_equal(meshflow.smooth((points, faces))[0], points)


def test_nothing_folds_or_crosses_where_sheets_of_voxels_are_thin():
    x, y, z = np.mgrid[-6:6:30j, -6:6:30j, -6:6:30j]
    gyroid = np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)
    points, faces = surface(np.abs(gyroid) < 0.4)
    after = meshflow.smooth((points, faces), result=True).data[0]
    assert (after != points).any()
    assert len(new_folds(points, after, faces)) == 0  # 34 by the method alone
    assert len(new_crossings(points, after, faces)) == 0
    assert np.linalg.norm(after - points, axis=1).max() <= 0.5 + 1e-9


def test_a_method_that_is_named_is_what_is_run_on_voxels_too():
    x, y, z = np.mgrid[-6:6:30j, -6:6:30j, -6:6:30j]
    gyroid = np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)
    points, faces = surface(np.abs(gyroid) < 0.4)
    named = Fairing(order=2, weights="cotangent", presmooth=2.0)
    result = meshflow.smooth((points, faces), method=named, time=3.0, result=True)
    assert len(new_folds(points, result.data[0], faces)) > 0
    assert not any("moved differently" in word for word in result.warnings)
