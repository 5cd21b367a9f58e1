"""The maximum principle: weights of zero and above keep every value in its range. meshflow.geometry.delaunay.clamped."""

from pathlib import Path

import numpy as np
import pytest
from helpers.parts import parts
from helpers.shapes import sphere

from meshflow.errors import InputError
from meshflow.flow.blend import euler
from meshflow.flow.compute import Compute
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.engines.metric import Clamped
from meshflow.flow.family import Variant
from meshflow.flow.march import VANISHED
from meshflow.flow.methods import Fairing
from meshflow.geometry.connectivity import connect, shared_sides
from meshflow.geometry.delaunay import clamped
from meshflow.geometry.operator import cotangents, fill_stiffness, stiffness
from meshflow.io.files import read
from meshflow.smoothing import smooth
from meshflow.surfaces.surface import Surface


def obtuse():
    """A bumpy sheet whose triangles are twelve times as long as high, and a value on it that jumps from 0 to 1."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(16) * 6.0, np.arange(40) * 0.5))
    index = np.arange(640).reshape(40, 16)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    points = np.column_stack([x + 2.9 * (y % 1.0 > 0.2), y, 0.05 * np.sin(x)])
    return points, faces, ((x > 40) ^ (y > 9)).astype(float)


SHARED = Path(__file__).parents[2] / "shared" / "data"
POINTS, FACES, VALUES = obtuse()


@pytest.mark.parametrize("stepper", ["auto", "explicit", "semi-implicit"])
@pytest.mark.parametrize("time", [0.3, 20.0])
def test_values_never_leave_their_range_where_triangles_are_obtuse(stepper, time):
    words = {"channels": VALUES, "gamma": 0.0, "contrast": 0.1, "time": time}
    found = smooth((POINTS, FACES), **parts(triangles="clamped", stepper=stepper, **words))[2]
    assert found.min() >= -1e-9
    assert found.max() <= 1 + 1e-9
    assert np.abs(found - VALUES).max() > 0.05
    if stepper == "semi-implicit" and time < 1:  # later all is as good as even
        free = smooth((POINTS, FACES), **parts(stepper=stepper, boundary="neumann", twicing=0.0, **words))[2]
        assert free.max() > 1.001 or free.min() < -0.001


@pytest.mark.parametrize("gamma", [-1.0, 0.0, 1.0])
def test_the_largest_explicit_step_takes_each_value_to_a_mean_of_its_neighbours(gamma):
    surface = Surface(np.column_stack([POINTS, 3.0 * VALUES]), (FACES,), boundary="neumann")
    flow = MeshFlow(surface, Variant(gamma=gamma), metric=Clamped())
    u = flow.start()
    around = [set() for _ in u]
    for triangle in FACES:
        for i in triangle:
            around[i] |= set(triangle)
    new = flow.rate(u, 0, euler(2.0 / flow.bound(u)))
    for i, ring in enumerate(around):
        there = u[list(ring)]
        assert (new[i] >= there.min(axis=0) - 1e-12).all()
        assert (new[i] <= there.max(axis=0) + 1e-12).all()


def test_weights_that_are_above_zero_stay_as_they_are():
    cot = cotangents(POINTS, FACES)[0]
    found = clamped(cot, *shared_sides(FACES))
    before = stiffness(POINTS, FACES).tocoo()
    after = fill_stiffness(connect((FACES,), len(POINTS)), found).tocoo()
    off = before.row != before.col
    assert np.allclose(after.data[off], np.minimum(before.data[off], 0.0), atol=1e-12)
    assert (before.data[off] > 0.01).any()
    assert abs(after.sum(axis=1)).max() < 1e-9
    points, faces = sphere(300)  # a convex hull is all but Delaunay
    cot = cotangents(points, faces)[0]
    same = clamped(cot, *shared_sides(faces)) == cot
    assert same.mean() > 0.95


def test_points_stay_in_the_box_that_they_came_in():
    rng = np.random.default_rng(0)
    points = POINTS + 0.1 * rng.normal(size=POINTS.shape)
    result = smooth((points, FACES), time=3.0, compute=Compute(triangles="clamped"), result=True)
    found = result.data[0]
    assert (found >= points.min(axis=0) - 1e-9).all()
    assert (found <= points.max(axis=0) + 1e-9).all()
    words = {name: result.parameters[name].value for name in ("method", "triangles", "boundary")}
    assert words == {"method": "curvature", "triangles": "clamped", "boundary": "neumann"}
    assert "twicing" not in result.parameters  # which this method does not have
    assert (
        np.abs(
            smooth((points, FACES), method=Fairing(order=1), time=1.0, compute=Compute(triangles="clamped"))[0] - points
        ).max()
        > 0
    )


@pytest.mark.parametrize("stepper", ["auto", "semi-implicit"])
def test_lone_triangles_shrink_inside_the_range_and_no_system_of_nothing_is_left(stepper):
    rng = np.random.default_rng(0)
    corners = (rng.uniform(0, 4, (40, 1, 3)) + rng.uniform(0, 1, (40, 3, 3))).reshape(-1, 3)
    words = {"triangles": "clamped", "method": "curvature", "stepper": stepper}
    result = smooth((corners, np.arange(120).reshape(-1, 3)), **parts(time=0.1, **words), result=True)
    found = result.data[0].reshape(40, 3, 3)
    before = corners.reshape(40, 3, 3)
    slack = 1e-9 * np.ptp(corners)
    assert (found >= before.min(axis=1, keepdims=True) - slack).all()
    assert (found <= before.max(axis=1, keepdims=True) + slack).all()
    sizes = np.linalg.norm(np.ptp(found, axis=1), axis=1)
    assert (sizes < 1e-3).any()  # some have gone, and the others went on
    assert result.end.area < 0.2 * result.start.area


def test_with_nothing_else_given_the_time_is_searched_for_and_the_range_kept():
    ball, faces = sphere(600)
    points = ball + 0.03 * np.random.default_rng(1).normal(size=ball.shape)
    result = smooth((points, faces), compute=Compute(triangles="clamped"), result=True)
    words = {name: result.parameters[name].value for name in ("method", "order", "triangles")}
    assert words == {"method": "fairing", "order": 1, "triangles": "clamped"}
    assert result.parameters["time"].origin == "estimated"
    found = result.data[0]
    assert (found >= points.min(axis=0) - 1e-6).all()
    assert (found <= points.max(axis=0) + 1e-6).all()

    def off(x):
        return np.sqrt(np.mean(np.einsum("ij,ij->i", x - ball, ball) ** 2))

    fixed_time = smooth((points, faces), method="curvature", compute=Compute(triangles="clamped"))[0]
    assert off(found) < 0.9 * min(off(points), off(fixed_time))


def test_what_leaves_the_range_is_refused():
    for words in ({"boundary": "plane-preserving"}, {"mass": "voronoi"}, {"twicing": 0.5}, {"stepper": "super-time"}):
        with pytest.raises(InputError, match="triangles='clamped'"):
            smooth((POINTS, FACES), **parts(channels=VALUES, triangles="clamped", **words))
    with pytest.raises(InputError, match="triangles: only for meshes, got HeightField"):
        smooth(np.eye(4), compute=Compute(triangles="clamped"))
    with pytest.raises(InputError, match="'plane-preserving', which leaves the range"):
        MeshFlow(Surface(POINTS, (FACES,), boundary="plane-preserving"), metric=Clamped())
    with pytest.raises(InputError, match="'voronoi', which asks for all angles"):
        MeshFlow(Surface(POINTS, (FACES,)), Variant(mass="voronoi"), metric=Clamped())


@pytest.mark.parametrize("stepper", ["auto", "semi-implicit"])
def test_triangles_that_clamping_makes_segments_vanish_and_break_nothing(stepper):
    # Free and obtuse, with one weight clamped: flat before they are small, so that mass over stiffness falls below rounding.
    rng = np.random.default_rng(3)
    points = rng.normal(size=(60, 3, 3)).reshape(-1, 3)
    faces = np.arange(180).reshape(60, 3)
    result = smooth(
        (points, faces),
        method="curvature",
        time=10.0,
        compute=Compute(stepper=stepper, triangles="clamped"),
        result=True,
    )
    found = result.data[0]
    assert np.isfinite(found).all()
    assert VANISHED in result.stopped_because
    # Each is drawn to a point of its own, within the box that it came in.
    low, high = points.reshape(60, 3, 3).min(axis=1), points.reshape(60, 3, 3).max(axis=1)
    each = found.reshape(60, 3, 3)
    assert np.ptp(each, axis=1).max() < 1e-2
    assert ((each >= low[:, None] - 1e-6) & (each <= high[:, None] + 1e-6)).all()


@pytest.mark.shared
@pytest.mark.skipif(not SHARED.is_dir(), reason="../shared/data is not there")
@pytest.mark.parametrize("name", sorted(p.name for p in (SHARED / "meshes" / "messy").glob("*")))
def test_what_is_messy_is_smoothed_with_clamped_weights(name):
    assert np.isfinite(
        smooth(read(SHARED / "meshes" / "messy" / name).data, compute=Compute(triangles="clamped")).points
    ).all()
