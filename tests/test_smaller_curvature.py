"""The flow by the smaller principal curvature: its limits on cylinder, cone, saddle, ridge, corner and level ground."""

import numpy as np
import pytest

import meshflow
from meshflow import SmallerCurvature
from meshflow.flow.engines.samples import Samples
from meshflow.flow.methods.smaller_curvature import SmallerCurvatureScheme

N, H = 65, 1 / 32
Y, X = np.mgrid[-1 : 1 : N * 1j, -1 : 1 : N * 1j]
INSIDE = np.s_[8:-8, 8:-8]
THERE = np.ones((N, N), bool)


def rate(u, feature=1e3):
    """The rate (h, w) with curvatures as they are; a long feature length makes every curvature a large one."""
    scheme = SmallerCurvatureScheme(contrast=1.0, presmoothing=0.0, feature_length=feature)
    samples = Samples(u[None], THERE, (H, H))
    return scheme.rate(samples, samples)[0]


def turned(angle):
    """Coordinates turned by an angle."""
    return np.cos(angle) * X + np.sin(angle) * Y, np.cos(angle) * Y - np.sin(angle) * X


@pytest.mark.parametrize("angle", [0.0, 0.3, np.pi / 4])
def test_a_cylinder_stays(angle):
    across, _ = turned(angle)
    u = np.sqrt(4.0 - across**2)
    assert np.abs(rate(u)[INSIDE]).max() < 1e-3  # of the differences; mean curvature motion: 0.5 and more
    assert np.abs(rate(u, feature=1e-6)[INSIDE]).min() > 0.4


def test_a_cone_stays_away_from_its_tip():
    radius = np.hypot(X, Y)
    ring = (radius > 0.4) & (radius < 0.7)
    assert np.abs(rate(radius)[ring]).max() < 0.02
    assert rate(radius, feature=1e-6)[ring].min() > 0.5


def test_a_saddle_stays_and_one_that_bends_more_in_one_direction_follows_the_smaller_curvature():
    middle = N // 2, N // 2
    assert abs(rate(X**2 - Y**2)[middle]) < 1e-9
    assert rate(2.0 * X**2 - 0.1 * Y**2)[middle] == pytest.approx(-0.2, abs=0.02)  # -0.2 + 4 r^2, r = 0.05
    assert rate(0.1 * X**2 - 2.0 * Y**2)[middle] == pytest.approx(0.2, abs=0.02)


def test_a_straight_ridge_stays_and_one_that_undulates_becomes_straight():
    def ridge(wave):
        return -np.sqrt(0.01 + Y**2) + wave * np.cos(6 * X)

    crest = np.s_[N // 2, 8:-8]
    assert np.abs(rate(ridge(0.0))[crest]).max() < 0.05
    moved = rate(ridge(0.02))[crest]
    wave = np.cos(6 * X)[crest]
    decay = float(moved @ wave / (wave @ wave)) / 0.02
    assert decay == pytest.approx(-36.0, rel=0.1)  # of the heat equation along the crest
    assert rate(ridge(0.0), feature=1e-6)[crest].max() < -5  # mean curvature motion takes the crest down


def test_a_corner_stays_and_level_ground_moves_by_its_mean_curvature():
    middle = N // 2, N // 2
    ball = -2.0 * (X**2 + Y**2)
    assert abs(rate(ball)[middle]) < 1e-3
    assert rate(ball, feature=1e-6)[middle] == pytest.approx(-8.0)
    smooth = 1e-4 * np.sin(3 * X) * np.cos(2 * Y)
    assert rate(smooth, feature=1e-6)[INSIDE] == pytest.approx(-13.0 * smooth[INSIDE], rel=0.02, abs=1e-6)


@pytest.mark.parametrize("turn", [np.rot90, np.fliplr, np.flipud, np.transpose])
def test_the_frame_makes_no_difference(turn):
    u = np.random.default_rng(0).normal(size=(N, N))
    for presmoothing in (0.0, 1.0):
        scheme = SmallerCurvatureScheme(0.5, presmoothing, 0.1)
        one, two = (Samples(v[None], THERE, (H, H)) for v in (u, np.ascontiguousarray(turn(u))))
        assert np.abs(turn(scheme.rate(one, one)[0]) - scheme.rate(two, two)[0]).max() < 1e-8 / H**2


@pytest.mark.parametrize("angle", [0.0, 0.5])
def test_noise_is_removed_and_a_crease_keeps_its_height(angle):
    y, x = np.mgrid[0:64, 0:64]
    roof = 20.0 - 0.8 * np.abs(np.cos(angle) * (y - 31.5) + np.sin(angle) * (x - 31.5))
    noisy = roof + np.random.default_rng(1).normal(size=roof.shape)
    crest = np.abs(roof - 20.0) < 0.8
    inside = np.s_[8:-8, 8:-8]
    errors = {}
    for method in (SmallerCurvature(contrast=1.0), meshflow.GraphFlow(contrast=1.0)):
        done = meshflow.smooth(noisy, method=method, time=6.0)
        errors[method.word] = [np.std((done - roof)[inside]), abs((done - roof)[inside][crest[inside]].mean())]
    assert errors["smaller-curvature"][0] < min(0.2, 0.5 * errors["graph"][0])
    assert errors["smaller-curvature"][1] < 0.1 * errors["graph"][1], errors


def test_channels_missing_samples_and_refusals():
    z = np.random.default_rng(2).normal(size=(20, 22, 3))
    z[4, 5, 1] = np.nan
    done = meshflow.smooth(z, method="smaller-curvature", time=1.0)
    assert np.array_equal(done[4, 5], z[4, 5], equal_nan=True)
    gone = np.isnan(z).any(axis=2)
    assert np.std(done[~gone]) < 0.8 * np.std(z[~gone])
    assert np.std(meshflow.smooth(z[..., 0], method="principal curvature")[~gone]) < 0.8 * np.std(z[..., 0][~gone])
    for option in ({"feature": 0.0}, {"presmoothing": -1.0}):
        with pytest.raises(meshflow.InputError, match=next(iter(option))):
            SmallerCurvature(**option)
    with pytest.raises(meshflow.InputError, match="only for height fields and images"):
        meshflow.smooth(
            meshflow.Scattered(np.random.default_rng(3).uniform(size=(30, 2)), np.zeros(30)), method=SmallerCurvature()
        )
