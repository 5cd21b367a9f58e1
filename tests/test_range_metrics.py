"""Measures of range images: what they are of errors that are known."""

import numpy as np
import pytest
from peers.range_images import SpaceFlow, range_peers

from meshflow.errors import InputError, MissingPackage
from meshflow.evaluate.range_images import jumps_of, range_quality
from meshflow.surfaces.camera import Pinhole

CAMERA = Pinhole(120.0, 120.0, 39.5, 29.5)
SHAPE = (60, 80)
WALL = np.full(SHAPE, 2.0)


def leaning(slope):
    """A plane z = 2 + slope x, seen through the camera."""
    column = (np.arange(SHAPE[1]) - 39.5) / 120.0
    return np.broadcast_to(2.0 / (1.0 - slope * column), SHAPE)


def test_the_truth_is_no_error_away():
    found = range_quality(WALL, WALL, CAMERA)
    assert (found.normal_error, found.fine, found.median, found.rms, found.inverse_rms) == (0, 0, 0, 0, 0)
    assert found.kept == 1


def test_a_plane_that_leans_errs_by_its_angle():
    assert range_quality(leaning(0.3), WALL, CAMERA).normal_error == pytest.approx(np.degrees(np.arctan(0.3)), abs=1e-6)


def test_a_broad_error_is_not_a_fine_one():
    found = range_quality(WALL + 0.01, WALL, CAMERA)
    assert found.fine < 1e-9
    assert found.median == pytest.approx(0.01)
    assert found.rms == pytest.approx(0.01)


def test_noise_is_fine_and_as_large_as_it_is():
    noise = 0.01 * np.random.default_rng(0).normal(size=SHAPE)
    found = range_quality(WALL + noise, WALL, CAMERA)
    assert found.fine == pytest.approx(0.01, rel=0.03)
    assert found.rms == pytest.approx(0.01, rel=0.03)
    assert found.inverse_rms == pytest.approx(0.01 / 4.0, rel=0.03)


def test_what_is_out_of_reach_counts_in_the_median_and_the_disparity_alone():
    found = WALL.copy()
    found[10, 10] = 3.0
    reported = range_quality(found, WALL, CAMERA)
    assert (reported.fine, reported.rms) == (0, 0)
    assert reported.inverse_rms == pytest.approx((1 / 2 - 1 / 3) / np.sqrt(WALL.size))
    assert range_quality(found, WALL, CAMERA, np.full(SHAPE, 2.0)).rms == pytest.approx(1 / np.sqrt(WALL.size))


def test_missing_pixels_do_not_count_and_are_told():
    found, truth = WALL.copy(), WALL.copy()
    found[:6], truth[-6:] = np.nan, 0.0
    reported = range_quality(found, truth, CAMERA)
    assert (reported.normal_error, reported.rms) == (0, 0)
    assert reported.kept == pytest.approx(48 / 54)


def test_both_sides_of_a_jump_are_a_jump_and_normals_there_do_not_count():
    truth = np.where(np.arange(SHAPE[1]) < 40, 2.0, 3.0) * np.ones(SHAPE)
    jumps = jumps_of(truth)
    assert jumps[:, 39:41].all()
    assert jumps.sum() == 2 * SHAPE[0]
    bent = truth + 0.04 * (np.abs(np.arange(SHAPE[1]) - 39.5) < 1)
    assert range_quality(bent, truth, CAMERA).normal_error == 0


@pytest.mark.parametrize(
    ("found", "truth", "reach", "words"),
    [
        (np.ones((3, 4)), np.ones((4, 3)), 1.0, "one shape"),
        (np.ones(4), np.ones(4), 1.0, "one shape"),
        (WALL, WALL, 0.0, "reach"),
        (WALL, 0 * WALL, 1.0, "a depth in both"),
    ],
)
def test_what_cannot_be_measured_is_refused(found, truth, reach, words):
    with pytest.raises(InputError, match=words):
        range_quality(found, truth, CAMERA, reach)


def noisy():
    """A wall with noise of 2 mm, and a hole."""
    z = WALL + 0.002 * np.random.default_rng(1).normal(size=SHAPE)
    z[20:24, 30:36] = np.nan
    return z


@pytest.mark.parametrize("peer", range_peers(CAMERA), ids=lambda peer: peer.name)
def test_every_peer_smooths_a_wall_and_leaves_its_hole(peer):
    # A middle number of each range, and each word of its first parameter that has words.
    choice = {
        name: values[0] if isinstance(values[0], str) else values[len(values) // 2]
        for name, values in peer.grid.items()
    }
    z = noisy()
    for domain in peer.grid.get("domain", (None,)):
        chosen = choice | ({"domain": domain} if domain else {})
        try:
            found = peer.run(z, 0.002, **chosen)
        except MissingPackage as cause:
            pytest.skip(str(cause))
        assert not np.isfinite(found[np.isnan(z)]).any()
        assert range_quality(found, np.where(np.isfinite(z), WALL, 0), CAMERA).kept > 0.9
        assert range_quality(found, WALL, CAMERA).normal_error < 0.7 * range_quality(z, WALL, CAMERA).normal_error, (
            chosen
        )


def test_the_flow_in_space_may_be_asked_for_any_time_first():
    z, times = noisy(), (1.0, 2.0)
    late = SpaceFlow(CAMERA, times)
    late(z, 0.002, 2.0, "0.05")
    assert np.array_equal(late(z, 0.002, 1.0, "0.05"), SpaceFlow(CAMERA, times)(z, 0.002, 1.0, "0.05"), equal_nan=True)
