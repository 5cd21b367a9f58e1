"""Meshes of binary volumes are recognized however their coordinates were stored, rods as well as balls, and blocks are left."""

import numpy as np
import pytest
from skimage.measure import marching_cubes

import meshflow
from meshflow import Fairing
from meshflow.estimate.voxels import voxel_edge
from meshflow.geometry.crossings import new_crossings
from meshflow.geometry.folds import new_folds

X, Y, Z = GRID = np.mgrid[-1:1:44j, -1:1:44j, -1:1:44j]
BALL = np.linalg.norm(GRID, axis=0) < 0.8
ROD = (np.hypot(X, Y) < 0.5) & (np.abs(Z) < 0.8)
BLOCK = (np.abs(X) < 0.5) & (np.abs(Y) < 0.6) & (np.abs(Z) < 0.7)


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
    assert voxel_edge(stored(surface(BALL)[0])) == pytest.approx(edge, rel=1e-3)


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
