"""The filter of frequencies on meshes. meshflow.flow.low_pass."""

import numpy as np
import pytest
from helpers.shapes import sphere, square

from meshflow.errors import InputError
from meshflow.flow import low_pass
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.low_pass import LowPass
from meshflow.flow.methods import Fairing
from meshflow.flow.methods.normal_filter import NormalFilterFlow
from meshflow.flow.steppers import SemiImplicit
from meshflow.geometry.normals import mean_edge
from meshflow.smoothing import smooth
from meshflow.surfaces.surface import Surface

BALL, FACES, *_ = sphere(300)


def flow(points, faces, **more):
    return MeshFlow(Surface(points, (faces,), **more))


def noisy(points, share=0.1, seed=3):
    return points + share * np.sqrt(4 * np.pi / len(points)) * np.random.default_rng(seed).normal(size=points.shape)


def test_order_one_is_implicit_fairing():
    engine = flow(noisy(BALL), FACES)
    one = LowPass(1).step(engine, engine.start(), 0.02, 0)
    other = SemiImplicit("direct").step(engine, engine.start(), 0.02, 0)
    assert np.abs(one - other).max() < 1e-5 * np.abs(BALL).max()


@pytest.mark.parametrize("order", [1, 2, 3, 5, 10])
@pytest.mark.parametrize("weights", ["cotangent", "uniform"])
def test_a_polynomial_and_factorizations_are_one_filter(order, weights):
    engine = flow(noisy(BALL), FACES)
    generator, u = engine.generator(engine.start(), weights), engine.start()
    one = low_pass.filtered(generator, u, 0.03, order)
    other = u.mean(axis=0) + low_pass._solved(generator, u - u.mean(axis=0), 0.03, order)
    assert np.abs(one - other).max() < 1e-5


def test_filters_of_several_times_and_orders_are_those_one_by_one_to_the_bit():
    engine = flow(noisy(BALL), FACES, fixed=np.arange(len(BALL)) < 5)
    generator, u = engine.generator(engine.start(), "uniform"), engine.start()
    asked = [(0.03, 2), (0.001, 10), (0.0, 3), (0.1, 1)]
    for (time, order), found in zip(asked, low_pass.filtered_by_all(generator, u, asked), strict=True):
        assert found is not None
        assert np.array_equal(found, low_pass.filtered(generator, u, time, order))
    long = 3e3 / float(np.abs(generator).sum(axis=1).max())
    assert low_pass.filtered_by_all(generator, u, [(long, 10)])[0] is None


@pytest.mark.parametrize("order", [2, 10])
def test_a_response_is_what_is_said(order):
    # A pure frequency of the operator leaves as 1 / (1 + (t lambda)^p) of itself.
    engine = flow(BALL, FACES)
    generator = engine.generator(engine.start(), "cotangent").toarray()
    values, vectors = np.linalg.eig(generator)
    at = int(np.argsort(values.real)[40])
    vector, value = vectors[:, at].real, values[at].real
    for share in (0.3, 1.0, 2.0):
        time = share / value
        found = low_pass.filtered(engine.generator(engine.start(), "cotangent"), vector[:, None], time, order)[:, 0]
        assert vector @ found / (vector @ vector) == pytest.approx(1 / (1 + share**order), abs=1e-4)


@pytest.mark.parametrize("order", [1, 2, 4])
@pytest.mark.parametrize("boundary", ["plane-preserving", "fixed"])
def test_flat_irregular_meshes_rest_with_cotangents(order, boundary):
    points, faces, _ = square(400)
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    points = points @ turn + 100.0
    engine = flow(points, faces, boundary=boundary)
    found = LowPass(order).step(engine, engine.start(), 0.05, 0)
    assert np.abs(found - points).max() < 1e-12 * 100


def test_fixed_vertices_stay_and_isolated_ones_too():
    points = np.vstack([noisy(BALL), [[5.0, 5.0, 5.0]]])
    fixed = np.arange(len(points)) % 7 == 0
    for weights in ("cotangent", "uniform"):
        engine = flow(points, FACES, fixed=fixed)
        found = LowPass(2, weights).step(engine, engine.start(), 0.05, 0)
        assert np.abs(found - points)[fixed].max() < 1e-14
        assert np.abs(found - points)[-1].max() < 1e-14
        assert np.abs(found - points)[~fixed].max() > 1e-3


def test_a_ball_shrinks_the_less_the_higher_the_order():
    # Of a unit sphere the coordinates are eigenfunctions of eigenvalue 2: the radius becomes 1 / (1 + (2 t)^p).
    for order in (1, 2, 4):
        found = smooth((BALL, FACES), method=Fairing(order=order, weights="cotangent"), time=0.1)[0]
        assert np.linalg.norm(found, axis=1).mean() == pytest.approx(1 / (1 + 0.2**order), rel=0.01)


def test_cotangents_of_a_smoothed_copy_do_not_take_noise_for_the_surface():
    noisy = BALL + 0.3 * mean_edge(BALL, FACES) * np.random.default_rng(2).normal(size=BALL.shape)
    time, off = 8 * mean_edge(BALL, FACES) ** 2, {}
    for presmooth in (0.0, 1.0):
        how = Fairing(order=4, weights="cotangent", presmooth=presmooth * mean_edge(BALL, FACES) ** 2)
        found = smooth((noisy, FACES), method=how, time=time)[0]
        off[presmooth] = np.linalg.norm(found, axis=1).std()
    assert off[1.0] < 0.5 * off[0.0], off
    with pytest.raises(InputError, match="presmooth: a squared length, zero or more"):
        Fairing(presmooth=-1.0)


def test_a_flow_without_a_matrix_is_refused():
    facets = NormalFilterFlow(Surface(BALL, (FACES,)))
    with pytest.raises(InputError, match="low-pass: the matrix of an operator expected, NormalFilterFlow has none"):
        LowPass(2).step(facets, facets.start(), 0.1, 0)


def test_orders_and_weights_are_checked():
    with pytest.raises(InputError, match="order: a whole number from 1 to 20"):
        LowPass(21)
    with pytest.raises(InputError, match="order"):
        LowPass(0)
    with pytest.raises(InputError, match="weights: cotangent or uniform"):
        LowPass(2, "round")
