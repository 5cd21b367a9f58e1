"""Blocks of triangles agree with the operator that they compute faster."""

import numpy as np
import pytest

from meshflow.flow.blend import euler
from meshflow.flow.conjugate_gradients import conjugate_gradients
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.engines.metric import metric_of
from meshflow.flow.family import Variant
from meshflow.flow.steppers import SemiImplicit
from meshflow.geometry import operator
from meshflow.geometry.blocks import blocked
from meshflow.geometry.connectivity import connect
from meshflow.surfaces.surface import Surface
from meshflow.synthetic.shapes import sphere


def scrambled(rng, open_border=True):
    """A noisy sphere of many blocks, in no order, with a hole, a fan, a flat triangle, and a vertex that has none."""
    ball = sphere(4)
    points = np.concatenate([ball.noisy("iso", 0.2, 3), [[5.0, 5.0, 5.0], [0.0, 0.0, 3.0]]])
    faces = ball.faces[40:] if open_border else ball.faces
    apex = len(points) - 1
    faces = np.concatenate([faces, [[i, i + 1, apex] for i in range(300)], [[7, 7, 9]]])
    order = rng.permutation(len(points))
    return points[order], rng.permutation(np.argsort(order)[faces])


@pytest.mark.parametrize("boundary", ["neumann", "plane-preserving"])
@pytest.mark.parametrize("mass", ["barycentric", "voronoi", "ring"])
def test_blocks_move_points_as_the_operator_says(mass, boundary):
    rng = np.random.default_rng(5)
    points, faces = scrambled(rng)
    held = rng.random(len(points)) < 0.1
    flow = MeshFlow(Surface(points, (faces,), boundary=boundary, fixed=held), Variant(mass=mass))
    blocks = blocked(points, faces, operator.mass_kind(mass), held)
    assert blocks is not None
    assert len(blocks.owned) > 4
    own = [blocks.vertices[a : a + k] for a, k in zip(blocks.start[:-1], blocks.owned, strict=True)]
    assert np.array_equal(np.sort(np.concatenate(own)), np.arange(len(points)))
    truth = -operator.curvature_normal(points, faces, mass, boundary)
    truth[held] = 0.0
    scale = np.abs(truth).max()
    assert np.abs(flow.rate(points) - truth).max() < 1e-12 * scale
    assert np.abs(flow.rate(points, 0, euler(1e-4)) - (points + 1e-4 * truth)).max() < 1e-12
    assert np.array_equal(flow.rate(points, 0, euler(1e-4))[held], points[held])


def test_where_a_triangle_is_all_but_flat_blocks_leave_the_step_to_delaunay():
    ball = sphere(3)
    points = ball.points.copy()
    points[ball.faces[5, 0]] = 0.5 * (points[ball.faces[5, 1]] + points[ball.faces[5, 2]])
    surface = Surface(points, (ball.faces,))
    auto, named, given = (
        MeshFlow(surface, metric=metric_of(word)).rate(points) for word in ("auto", "delaunay", "given")
    )
    assert np.array_equal(auto, named)
    assert not np.allclose(auto, given)


def test_a_system_in_an_order_of_its_own_is_the_same_system(monkeypatch):
    points, faces = scrambled(np.random.default_rng(7))
    held = np.random.default_rng(8).random(len(points)) < 0.1
    surface, dt, steps = Surface(points, (faces,), boundary="plane-preserving", fixed=held), 1e-3, {}
    for name, least in (("as it is", len(points)), ("in order", 100)):
        monkeypatch.setattr("meshflow.flow.engines.mesh.LARGE", least)
        flow = MeshFlow(surface)
        order = flow.system(points).order
        assert (order is None) == (name == "as it is")
        if order is not None:
            assert np.array_equal(np.sort(order), np.arange(len(points)))
        steps[name] = SemiImplicit("cg", 1e-13).step(flow, points, dt)
    assert np.abs(steps["in order"] - steps["as it is"]).max() < 1e-11
    assert np.array_equal(steps["in order"][held], points[held])


@pytest.mark.parametrize("columns", [1, 2, 3, 5])
def test_conjugate_gradients_solve_all_columns_of_a_system(columns):
    ball, rng = sphere(4), np.random.default_rng(2)
    matrix = operator.stiffness(ball.points, ball.faces)
    matrix.setdiag(matrix.diagonal() + operator.mass(ball.points, ball.faces))
    truth = rng.normal(size=(len(ball.points), columns))
    right = matrix @ truth
    x, iterations = conjugate_gradients(matrix, right, None, 1e-12, 1000)
    assert 0 < iterations < 1000
    assert np.abs(x - truth).max() < 1e-10
    again, none = conjugate_gradients(matrix, right, truth, 1e-12, 1000)
    assert none == 0
    assert np.array_equal(again, truth)


def test_a_wide_fan_costs_no_more_than_its_triangles():
    n = 200_000  # pairs of triangles around the apex would be 4e10
    ring = np.arange(1, n)
    faces = np.stack([np.zeros(n - 1, int), ring, np.roll(ring, -1)], axis=1)
    connectivity = connect((faces,), n)
    assert len(connectivity.border) == n - 1
    assert np.diff(connectivity.pattern.indptr)[0] == n
    angles = np.linspace(0, 2 * np.pi, n)
    points = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    flow = MeshFlow(Surface(points, (faces,), boundary="neumann"))
    assert np.isfinite(flow.rate(points)).all()
