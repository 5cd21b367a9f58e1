"""The estimated risk of what a mesh gets by default is its error, and the least one that was looked at is chosen."""

import numpy as np
import pytest

import meshflow
from meshflow.estimate.mesh_noise import noise_of_points
from meshflow.estimate.point_risk import WEIGHT, PointCandidate, PointRisk, folded
from meshflow.estimate.point_search import configurations
from meshflow.flow.methods.fairing import Fairing
from meshflow.flow.methods.normal_filter import NormalFilter
from meshflow.flow.methods.points import PointSetting
from meshflow.surfaces.surface import Surface
from meshflow.synthetic import shapes

BALL = shapes.sphere(3)
RISKY = [
    (shapes.sphere(4), "nrm", 0.3),
    (shapes.ring(80, 32), "iso", 0.2),
    (shapes.cube(18, irregular=True), "impulses", 0.3),
]


def test_no_least_risk_is_chosen_that_was_not_looked_at():
    result = meshflow.smooth((BALL.noisy("nrm", 0.3), BALL.faces), result=True)
    for candidate in result.candidates:
        assert candidate.least[0] in candidate.times
        assert candidate.least[1] == min(candidate.squares)
    assert result.parameters["time"].value in result.candidates[0].times
    assert {type(method).__name__ for method in configurations(1.0, 0.8, 0.3)} == {"NormalFilter", "Fairing"}


def test_strong_noise_and_flat_triangles_are_regularized_for_longer_up_to_a_limit():
    def shortest(altitude, sigma):
        methods = configurations(2.0, altitude, sigma)
        return min(method.regularize for method in methods if isinstance(method, NormalFilter)) / 2.0**2

    assert (
        0
        < shortest(1.5, 0.1)
        < shortest(1.5, 0.3)
        < shortest(1.5, 0.5)
        < shortest(1.5, 5.0)
        == shortest(0.1, 5.0)
        == 1.0
    )
    assert shortest(0.5, 0.1) == pytest.approx(9.0 * shortest(1.5, 0.1))
    assert shortest(1.5, 0.0) == 0.0


def noisy(shape, kind, level):
    """Points with noise, white or on a share of the vertices alone."""
    if kind != "impulses":
        return shape.noisy(kind, level)
    draw, n = np.random.default_rng(5), len(shape.points)
    off = 0.5 * draw.normal(size=n) * (draw.random(n) < level)
    return shape.points + (shape.edge * off)[:, None] * shape.normals()


@pytest.mark.parametrize(("shape", "kind", "level"), RISKY, ids=["ball", "ring", "impulses"])
def test_the_estimated_risk_of_a_method_is_its_error_on_what_it_was_given(shape, kind, level):
    points, edge = noisy(shape, kind, level), shape.edge
    noise = noise_of_points(points, shape.faces)
    risk = PointRisk.of(points, shape.faces, np.ones(len(points), bool), noise)
    methods = [(Fairing(order=4, weights="uniform"), 1.0), (Fairing(order=2, weights="uniform"), 4.0)]
    methods += [
        (NormalFilter(crease_contrast=c, crease_sharpness=4.0, regularize=0.3 * edge**2), 20.0) for c in (1.0, 8.0)
    ]
    surface, off = Surface(points, (shape.faces,)), []
    for method, time in methods:
        flow = method.engine(surface, PointSetting())
        states = tuple(next(method.states(flow, start, (time * edge**2,))) for start in risk.starts)
        along = [np.einsum("ij,ij->i", state - shape.points, risk.normals) for state in states]
        since = [
            np.einsum("ij,ij->i", *at)
            for at in ((s - o, risk.normals) for s, o in zip(states, risk.starts, strict=True))
        ]
        away = [
            one - other.mean() for one, other in zip(along, since, strict=True)
        ]  # mean offsets are removed in the end
        true = np.mean(np.square(away))
        folds = WEIGHT * np.mean([folded(state, shape.faces, risk.across) for state in states])
        off.append(risk.of_states(states) / noise.sigma**2 - folds - true / noise.sigma**2)
    assert np.ptp(off) < 0.15, off
    assert np.abs(np.mean(off)) < 0.1, off


def test_a_run_continues_while_its_risk_is_hardly_greater_and_is_ranked_by_its_least():
    one = PointCandidate(NormalFilter(), (0.0, 1.0, 2.0, 3.0), (1.0, 0.2, 0.21, 0.3), alike=0.02)
    assert one.least == (2.0, 0.2)
    assert PointCandidate(NormalFilter(), one.times, one.squares).least == (1.0, 0.2)
    assert PointCandidate(NormalFilter(), (0.0, 1.0), (1.0, 1.01), alike=0.02).least == (0.0, 1.0)
