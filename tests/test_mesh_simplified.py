"""Clean surfaces that were simplified to few triangles: their edges follow the shape, which no noise does, and they stay."""

from pathlib import Path

import numpy as np
import pytest
import pyvista as pv
import trimesh

import meshflow
from meshflow.estimate.edge_noise import bent_like_noise
from meshflow.geometry.normals import normals_at
from meshflow.synthetic import shapes

BUNNY = Path(__file__).parents[2] / "shared" / "data" / "meshes" / "irregular" / "bunny_adaptive.off"


def simplified(points, faces, count):
    mesh = pv.make_tri_mesh(points, faces).decimate(1 - count / len(faces))
    return np.asarray(mesh.points, float), mesh.regular_faces.astype(np.int64)


def bumpy(seed):
    """A ball with bumps of many sizes."""
    ball, draw = shapes.sphere(5), np.random.default_rng(seed)
    points = ball.points / np.linalg.norm(ball.points, axis=1)[:, None]
    radius = np.ones(len(points))
    for frequency in (2.0, 4.0, 8.0):
        for _ in range(6):
            wave = np.sin(1.5 * frequency * points @ draw.normal(size=3) + draw.uniform(0, 2 * np.pi))
            radius += 0.12 / frequency * wave
    return points * radius[:, None], ball.faces


@pytest.mark.parametrize("seed", range(4))
def test_edges_of_a_simplified_shape_are_not_bent_against_each_other_and_those_of_noise_are(seed):
    points, faces = simplified(*bumpy(seed), 2000)
    draw, edge = np.random.default_rng(seed), np.linalg.norm(points[faces[:, 0]] - points[faces[:, 1]], axis=1).mean()
    made = draw.normal(size=(len(points), 2))
    assert bent_like_noise(points, faces, normals_at(points, faces), made) < 0.12
    noisy = points + 0.25 * edge * draw.normal(size=len(points))[:, None] * normals_at(points, faces)
    assert bent_like_noise(noisy, faces, normals_at(noisy, faces), made) > 0.7


def test_noise_alone_is_bent_like_noise():
    y, x = np.mgrid[:30, :30]
    flat = pv.StructuredGrid(x.astype(float), y.astype(float), np.zeros((30, 30))).extract_surface(algorithm=None)
    faces = flat.triangulate().regular_faces.astype(np.int64)
    draw = np.random.default_rng(0)
    points = np.asarray(flat.points, float) + 0.01 * draw.normal(size=(900, 1)) * [0, 0, 1]
    found = bent_like_noise(points, faces, normals_at(points, faces), draw.normal(size=(900, 4)))
    assert found == pytest.approx(1.0, abs=0.15)


@pytest.mark.skipif(not BUNNY.exists(), reason="no ../shared/data/meshes")
@pytest.mark.parametrize("count", [400, 2500, 6000])
def test_a_simplified_scan_comes_back_to_the_bit(count):
    bunny = trimesh.load(BUNNY, process=False)
    points, faces = simplified(np.array(bunny.vertices), np.array(bunny.faces), count)
    assert np.array_equal(meshflow.smooth((points, faces))[0], points)
