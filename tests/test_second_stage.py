"""A second stage for images and height fields: what it does to noise, to what may not move, and who decides on it."""

import numpy as np
import pytest

import meshflow
from meshflow import Beltrami, Fixed, MaxChange, Mobility, Search
from meshflow.errors import InputError
from meshflow.flow.patch_groups import PatchGroups


def stripes(shape=(48, 56), dtype=np.float64):
    """Texture that repeats, (h, w)."""
    r, c = np.mgrid[: shape[0], : shape[1]]
    return (100 + 40 * ((r + c) % 6 < 3) + 20 * np.sin(0.3 * c)).astype(dtype)


def noisy(truth, sigma=10.0, seed=0):
    return (truth + np.random.default_rng(seed).normal(0, sigma, truth.shape)).astype(truth.dtype)


def rms(a, b):
    return float(np.sqrt(np.mean((np.asarray(a, np.float64) - b) ** 2)))


WHOLE = np.zeros((48, 56), bool)


def test_texture_that_repeats_comes_back():
    truth = stripes()
    run = [
        meshflow.smooth(noisy(truth), kind="image", noise=10.0, method=Search(second_stage=word))
        for word in (False, True, None)
    ]
    flow, groups, default = (rms(z, truth) for z in run)
    assert groups < 0.75 * flow, f"{groups:.3g} {flow:.3g}"
    assert default == groups


def test_a_named_method_has_no_second_stage_but_where_it_is_named():
    z = noisy(stripes())
    named = meshflow.smooth(z, kind="image", noise=10.0, method="beltrami", result=True)
    assert "second_stage" not in named.parameters
    asked = meshflow.smooth(z, kind="image", noise=10.0, method=Beltrami(second_stage=True), result=True)
    assert str(asked.parameters["second_stage"]) == "yes (given)"
    assert "groups of similar patches" in asked.stopped_because
    refused = meshflow.smooth(z, kind="image", noise=10.0, method=Search(second_stage=False), result=True)
    assert str(refused.parameters["second_stage"]) == "no (given)"
    assert "groups" not in refused.stopped_because


def test_a_default_run_says_that_there_was_a_second_stage_and_why():
    found = meshflow.smooth(noisy(stripes()), kind="image", noise=10.0, result=True)
    assert found.parameters["second_stage"].value == "yes"
    assert found.parameters["second_stage"].origin == "estimated"
    assert "falls by" in found.parameters["second_stage"].why


def test_time_given_by_the_caller_has_no_second_stage():
    found = meshflow.smooth(noisy(stripes()), kind="image", noise=10.0, time=1.0, result=True)
    assert "second_stage" not in found.parameters


def test_missing_samples_keep_their_bits_and_reach_nobody():
    truth = stripes()
    z, missing = noisy(truth), WHOLE.copy()
    missing[10:13, 20:40] = missing[40, 5] = True
    out = []
    for filler in (0.0, 1e30):
        held = np.where(missing, filler, z)
        out.append(PatchGroups.of([10.0]).filtered(held[None], np.where(missing, filler, truth)[None], missing)[0])
        assert (out[-1][missing] == filler).all()
    np.testing.assert_array_equal(out[0][~missing], out[1][~missing])


def test_fixed_samples_stay_and_limits_hold():
    z = noisy(stripes())
    fixed = WHOLE.copy()
    fixed[5:9, 5:30] = True
    out = meshflow.smooth(
        z, kind="image", noise=10.0, method=Search(second_stage=True), constraints=[Fixed(fixed), MaxChange(6.0)]
    )
    np.testing.assert_array_equal(out[fixed], z[fixed])
    assert np.abs(out - z).max() <= 6.0 * (1 + 1e-12)
    assert (np.abs(out - z) == 6.0).sum() < out.size / 2


def test_channels_without_noise_stay_as_their_pilot():
    truth = np.stack([stripes(), stripes().T[:48, :48].repeat(2, 1)[:, :56]])
    out = PatchGroups.of([10.0, 0.0]).filtered(noisy(truth), truth, WHOLE)
    np.testing.assert_array_equal(out[1], truth[1])
    assert np.abs(out[0] - truth[0]).max() > 0
    np.testing.assert_array_equal(PatchGroups.of([0.0, 0.0]).filtered(noisy(truth), truth, WHOLE), truth)


def test_channels_may_be_mixed_by_any_invertible_matrix():
    truth = np.stack([stripes(), 0.5 * stripes(), 255 - stripes()])
    z, mix = noisy(truth), np.array([[1.0, 0.2, 0.0], [0.0, 2.0, 0.3], [0.4, 0.0, 0.7]])
    pilot = truth + np.random.default_rng(5).normal(0, 3, truth.shape)
    plain = PatchGroups(100.0 * np.eye(3)).along(z, WHOLE).filtered(z, pilot, WHOLE)
    turned = np.tensordot(mix, z, 1)
    groups = PatchGroups(100.0 * mix @ mix.T).along(turned, WHOLE)
    mixed = groups.filtered(turned, np.tensordot(mix, pilot, 1), WHOLE)
    np.testing.assert_allclose(mixed, np.tensordot(mix, plain, 1), rtol=1e-8)


def test_scale_and_offset_of_the_values_do_not_matter():
    truth = stripes()
    z, pilot = noisy(truth)[None], truth[None] + 1.0
    plain = PatchGroups.of([10.0]).filtered(z, pilot, WHOLE)
    other = PatchGroups.of([0.01]).filtered(z / 1000 + 50, pilot / 1000 + 50, WHOLE)
    np.testing.assert_allclose(1000 * (other - 50), plain, rtol=1e-9)


def test_noise_that_is_known_to_be_correlated_is_removed_better():
    draw, truth = np.random.default_rng(1), stripes()
    white = draw.normal(size=(50, 58))
    noise = 10.0 * sum(white[r : r + 48, c : c + 56] for r in range(3) for c in range(3)) / 3.0
    lags = np.outer(tent := np.array([1, 2, 3, 2, 1]) / 3, tent)
    pilot = truth + 0.3 * noise
    blind, told = (
        rms(PatchGroups.of([10.0], correlation=c).filtered((truth + noise)[None], pilot[None], WHOLE)[0], truth)
        for c in (None, lags)
    )
    assert told < 0.9 * blind, f"{told:.3g} {blind:.3g}"


def test_small_grids_are_their_pilot():
    z = np.arange(12.0).reshape(1, 4, 3)
    np.testing.assert_array_equal(PatchGroups.of([1.0]).filtered(z, z + 1, np.zeros((4, 3), bool)), z + 1)


def test_no_noise_no_change_with_a_second_stage_too():
    truth = stripes()
    np.testing.assert_array_equal(meshflow.smooth(truth, kind="image", method=Search(second_stage=True)), truth)


def test_a_second_stage_that_cannot_be_had_is_refused():
    z = noisy(stripes())
    with pytest.raises(InputError, match="second_stage: not possible with mobility or data weights"):
        meshflow.smooth(z, kind="image", method=Search(second_stage=True), constraints=Mobility(np.full(z.shape, 0.5)))
    with pytest.raises(InputError, match="second_stage: True, False or None expected, got the text 'yes'"):
        Search(second_stage="yes")


def test_a_volume_has_a_second_stage_where_it_lowers_the_error():
    truth = np.stack([100 + np.roll(stripes((24, 26)), z // 3, axis=1) for z in range(22)]).astype(np.float32)
    z = noisy(truth, 20.0)
    flow = meshflow.smooth(z, kind="volume", noise=20.0, method=Search(second_stage=False))
    found = meshflow.smooth(z, kind="volume", noise=20.0, result=True)
    assert "falls by" in found.parameters["second_stage"].why
    assert rms(found.data, truth) < 0.8 * rms(flow, truth), f"{rms(found.data, truth):.3g} {rms(flow, truth):.3g}"
    plain = meshflow.smooth(z, kind="volume", method="heat", time=1.0, result=True)
    assert "second_stage" not in plain.parameters


def test_patches_of_a_volume_of_few_slices_have_all_of_them_and_leave_what_is_missing_or_fixed():
    truth = np.stack([stripes((20, 22))] * 3)
    z, missing = noisy(truth), np.zeros(truth.shape, bool)
    missing[1, 3:6, 4] = True
    out = [
        PatchGroups.of([10.0]).filtered(*(np.where(missing, filler, a)[None] for a in (z, truth + 2.0)), missing)[0]
        for filler in (0.0, 1e30)
    ]
    assert (out[1][missing] == 1e30).all()
    np.testing.assert_array_equal(out[0][~missing], out[1][~missing])
    fixed = np.zeros(truth.shape, bool)
    fixed[0, :8] = True
    done = meshflow.smooth(
        z, kind="volume", noise=10.0, method=Search(second_stage=True), constraints=[Fixed(fixed), MaxChange(6.0)]
    )
    np.testing.assert_array_equal(done[fixed], z[fixed])
    assert np.abs(done - z).max() <= 6.0 * (1 + 1e-12)


def test_correlated_noise_of_a_volume_is_removed_better_where_it_is_known():
    draw, truth = np.random.default_rng(1), np.stack([stripes((20, 22))] * 12)
    white = draw.normal(size=(14, 22, 24))
    noise = (
        10.0
        / 27**0.5
        * sum(white[z : z + 12, r : r + 20, c : c + 22] for z in range(3) for r in range(3) for c in range(3))
    )
    tent = np.array([1, 2, 3, 2, 1]) / 3
    lags = tent[:, None, None] * np.outer(tent, tent)
    blind, told = (
        rms(
            PatchGroups.of([10.0], correlation=c).filtered(
                (truth + noise)[None], (truth + 0.3 * noise)[None], np.zeros(truth.shape, bool)
            )[0],
            truth,
        )
        for c in (None, lags)
    )
    assert told < 0.9 * blind, f"{told:.3g} {blind:.3g}"


def test_tetrahedra_have_no_second_stage():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    mesh = meshflow.TetMesh(points, np.array([[0, 1, 2, 3]]), np.arange(4.0))
    with pytest.raises(InputError, match="second_stage: only for height fields, images and volumes, got TetMesh"):
        meshflow.smooth(mesh, noise=0.1, method=Search(second_stage=True))
