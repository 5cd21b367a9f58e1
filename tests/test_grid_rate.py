"""The grid engine computes exactly the rate of the mesh engine, whatever the options and the data."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meshflow.flow.engines.grid import GridFlow
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.family import Variant
from meshflow.flow.steppers import SemiImplicit
from meshflow.surfaces.camera import Pinhole
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.range_image import RangeImage

GAMMAS, INDICATORS, MASSES = (-2.0, -1.0, 0.0, 0.3, 1.0), ("metric", "projection"), ("barycentric", "voronoi", "ring")
BOUNDARIES, DIAGONALS, SHARPNESSES = (
    ("neumann", "plane-preserving", "fixed"),
    ("forward", "backward", "both", "alternate"),
    (0.7, 1.0, 1.5, 2.0),
)
H, W = 13, 17
CAMERA = Pinhole(30, 28, 8.3, 6.2)


def scene(kind, seed=0):
    """A data object with ragged holes and samples that stay, and the contrast that it takes."""
    rng = np.random.default_rng(seed)
    missing, fixed = rng.random((H, W)) < 0.06, rng.random((H, W)) < 0.05
    missing[4:8, 5:9] |= rng.random((4, 4)) < 0.7
    if kind == "range":
        x, y = np.moveaxis(CAMERA.rays((H, W)), 2, 0)[:2]
        depth = 2 / (1 + 0.3 * x - 0.2 * y) + 0.01 * rng.normal(size=(H, W))
        depth[7:, :5] += 1  # a jump, across which no triangle reaches
        return RangeImage(depth, CAMERA, missing, fixed), 1.0
    if kind in ("one", "rows"):
        spacing = (1.3, 0.8) if kind == "one" else (np.linspace(1, 2, H), 0.8)
        return HeightField(1.5 * rng.normal(size=(H, W)), spacing, missing, fixed), 1.7
    return Image(1.5 * rng.normal(size=(H, W, int(kind))), (1.3, 0.8), missing, fixed), 1.7


def engines(data, lift, variant):
    return GridFlow(data.gridded(lift), variant), MeshFlow(data.lifted(lift), variant)


def agree(data, lift, variant, tolerance=1e-12):
    grid, mesh = engines(data, lift, variant)
    assert np.array_equal(grid.start(), mesh.start())
    for turn in (0, 1):
        ours, theirs = grid.rate(grid.start(), turn), mesh.rate(mesh.start(), turn)
        scale = np.abs(theirs).max()
        assert np.abs(ours - theirs).max() <= tolerance * scale, f"{np.abs(ours - theirs).max() / scale:.1e} relative"
        assert (ours[(data.missing | data.fixed).ravel()] == 0).all()
    assert grid.area(grid.start()) == pytest.approx(mesh.area(mesh.start()), rel=1e-12)


@pytest.mark.parametrize("kind", ["one", "rows", "1", "2", "3", "5", "range"])
@pytest.mark.parametrize("diagonals", DIAGONALS)
@pytest.mark.parametrize("boundary", BOUNDARIES)
def test_the_rate_on_the_grid_is_the_rate_on_its_triangles(kind, diagonals, boundary):
    data, contrast = scene(kind)
    sharpnesses = (1.0,) if kind == "range" else SHARPNESSES
    for gamma, indicator, mass, sharpness in itertools.product(GAMMAS, INDICATORS, MASSES, sharpnesses):
        if gamma == 0.0 and indicator == "projection":
            continue  # without gamma there is no indicator
        variant = Variant(gamma=gamma, sharpness=sharpness, indicator=indicator, mass=mass)
        # Of one steep channel with Voronoi masses the cotangents themselves are taken, which nearly cancel, in both engines.
        agree(data, Lift(contrast, diagonals, boundary), variant, 5e-12 if mass == "voronoi" else 1e-12)


shapes = st.tuples(st.integers(2, 9), st.integers(2, 9))


@settings(max_examples=120, deadline=None)
@given(data=st.data(), shape=shapes, channels=st.sampled_from([1, 1, 2, 3, 4]))
def test_the_rates_agree_on_any_data(data, shape, channels):
    numbers = st.floats(-50, 50, width=32)
    flat = data.draw(
        st.lists(numbers, min_size=channels * shape[0] * shape[1], max_size=channels * shape[0] * shape[1])
    )
    values = np.array(flat).reshape(*shape, channels)
    gone = np.array(data.draw(st.lists(st.booleans(), min_size=values[..., 0].size, max_size=values[..., 0].size)))
    gone = gone.reshape(shape) & (np.random.default_rng(0).random(shape) < 0.5)
    gone[0, 0] = False
    spacing = data.draw(st.sampled_from([1.0, (0.5, 2.0), (np.linspace(1.0, 1.5, shape[0]), 1.0)]))
    variant = data.draw(
        st.builds(
            Variant,
            gamma=st.sampled_from([-1.0, 0.0, 1.0]),
            sharpness=st.sampled_from([1.0, 1.5, 2.0]),
            mass=st.sampled_from(["barycentric", "ring"]),
        )
    )
    lift = Lift(
        data.draw(st.sampled_from([0.1, 1.0])),
        data.draw(st.sampled_from(DIAGONALS)),
        data.draw(st.sampled_from(BOUNDARIES)),
    )
    image = Image(values, spacing, gone) if channels > 1 else HeightField(values[..., 0], spacing, gone)
    grid, mesh = engines(image, lift, variant)
    for turn in (0, 1):
        ours, theirs = grid.rate(grid.start(), turn), mesh.rate(mesh.start(), turn)
        # Slopes up to 100 make single terms of a sum as much larger than the sum.
        # Where the truth is zero, rounding is a share of the values.
        assert np.abs(ours - theirs).max() <= 1e-9 * max(np.abs(theirs).max(), 1e-5 * np.abs(values).max())


@pytest.mark.parametrize("kind", ["one", "rows", "3", "range"])
@pytest.mark.parametrize("diagonals", DIAGONALS)
def test_the_seven_point_weights_are_the_stiffness_and_cg_on_the_grid_equals_the_sparse_solve(kind, diagonals):
    data, contrast = scene(kind)
    for variant in (Variant(), Variant(gamma=1.0), Variant(gamma=-1.0, indicator="projection")):
        lift = Lift(contrast, diagonals, "plane-preserving")
        grid, mesh = engines(data, lift, variant)
        for turn in (0, 1):
            ours, theirs = grid.system(grid.start(), turn).matrix(0.7), mesh.system(mesh.start(), turn).matrix(0.7)
            assert abs(ours - theirs).max() < 1e-12 * abs(theirs).max()
            truth = SemiImplicit("direct").step(mesh, mesh.start(), 0.7, turn)
            scale = np.abs(truth - mesh.start()).max()
            for solver in ("cg", "direct"):
                found = SemiImplicit(solver, 1e-12).step(grid, grid.start(), 0.7, turn)
                assert np.abs(found - truth).max() < 1e-9 * scale, solver


@pytest.mark.long
@pytest.mark.parametrize("kind", ["one", "3", "range"])
@pytest.mark.parametrize("gamma", GAMMAS)
def test_the_bound_on_the_grid_is_no_lower_than_the_fastest_decay(kind, gamma):
    data, contrast = scene(kind)
    for mass, indicator in itertools.product(MASSES, INDICATORS):
        for sharpness in (1.0,) if kind == "range" else (1.0, 1.5, 2.0):
            lift = Lift(contrast, "alternate", "neumann")
            grid = GridFlow(data.gridded(lift), Variant(gamma, sharpness, indicator, mass))
            u = grid.start()
            for turn in (0, 1):
                # The Jacobian of the rate itself, one column at a time: what an explicit step must be stable for. Where s and M
                # change with u it is not symmetric, and its eigenvalues may be complex; the metric is held, as in the proof.
                system = grid.system(u, turn)
                if kind == "one" and indicator == "metric" and mass != "voronoi":
                    jacobian = area_hessian(grid, u, turn) / system.mass[:, None]
                else:
                    jacobian = (system.matrix(1.0) - system.matrix(0.0)).toarray() / system.mass[:, None]
                fastest = np.abs(np.linalg.eigvals(jacobian)).max()
                assert fastest <= grid.bound(u) * (1 + 1e-6), (
                    f"{fastest:.4g} > {grid.bound(u):.4g}, {mass}, {indicator}"
                )


def area_hessian(grid, u, turn):
    """Minus the derivative of the pulls M / s rate with M / s held, by central differences: the Hessian of the area of W^q."""
    mass, eps = grid.system(u, turn).mass[:, None], 1e-5
    rows = []
    for i in range(len(u)):
        pulls = []
        for sign in (1, -1):
            v = u.copy()
            v[i] += sign * eps
            held = grid.system(v, turn).mass[:, None]
            pulls.append(-held * grid.rate(v, turn))
        rows.append((pulls[0] - pulls[1])[:, 0] / (2 * eps))
    hessian = np.stack(rows, axis=1)
    still = (mass == 1.0)[:, 0] & (grid.rate(u, turn) == 0)[:, 0]
    hessian[still] = 0
    return hessian
