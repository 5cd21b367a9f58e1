"""Volumes through the door: what smooth does with them, and what it refuses."""

import numpy as np
import pytest

import meshflow
from meshflow import DataWeights, Fixed, InputError, Mask, MaxChange, Mobility, PeronaMalik, Residual, Steps, Volume
from meshflow.estimate.volume_noise import noise_of_volume
from meshflow.synthetic import head, shepp_logan, thorax


def noisy(truth, sigma=0.09, seed=0, dtype=np.float32):
    return (truth + sigma * np.random.default_rng(seed).normal(size=truth.shape)).astype(dtype)


def error(found, truth):
    return float(np.sqrt(np.mean(np.square(found - truth))))


@pytest.mark.parametrize(("phantom", "most"), [(shepp_logan, 0.32), (head, 0.4), (thorax, 0.4)])
def test_the_default_removes_most_of_the_noise(phantom, most):
    truth = phantom(28)
    result = meshflow.smooth(noisy(truth), kind="volume", result=True)
    assert result.noise.sigma == pytest.approx(0.09, rel=0.15)
    assert error(result.data, truth) < most * 0.09
    assert result.data.dtype == np.float32
    assert result.data.shape == truth.shape
    assert isinstance(result.after, Volume)
    assert result.parameters["time"].unit == "voxels²"
    assert 0 < result.left < 0.09
    assert result.correlation < 0.2


@pytest.mark.parametrize("values", [np.zeros((9, 9, 9)), shepp_logan(20), np.mgrid[:20, :20, :20][1] * 1.5])
def test_a_clean_volume_is_unchanged_to_the_bit(values):
    result = meshflow.smooth(values, kind="volume", result=True)
    assert np.array_equal(result.data, values)
    assert "unchanged" in result.stopped_because or "nothing was changed" in result.stopped_because


def test_what_is_given_is_held():
    truth = shepp_logan(20)
    x = noisy(truth)
    result = meshflow.smooth(x, kind="volume", method=PeronaMalik(contrast=20.0), time=3.0, result=True)
    assert result.end.time == pytest.approx(3.0)
    assert float(result.parameters["contrast"]) == 20.0
    quick = meshflow.smooth(x, kind="volume", method="quick", result=True)
    assert not quick.candidates
    assert error(quick.data, truth) < 0.05
    found = meshflow.smooth(x, kind="volume", noise=0.05, result=True)
    assert found.noise.sigma == 0.05
    stopped = meshflow.smooth(x, kind="volume", stop=Residual(0.9), result=True)
    assert error(stopped.data, x) == pytest.approx(0.9 * stopped.noise.sigma, rel=0.1)
    assert meshflow.smooth(x, kind="volume", stop=Steps(3), result=True).end.step == 3
    scaled = meshflow.smooth(x, kind="volume", method="heat", scale=2.0, result=True)
    assert scaled.end.time == pytest.approx(2.0)


def test_constraints_hold():
    x = noisy(shepp_logan(16))
    mask = np.zeros(x.shape, bool)
    mask[4:12] = True
    for constraint, stays in ((Fixed(mask), mask), (Mask(mask), ~mask)):
        done = meshflow.smooth(x, kind="volume", constraints=constraint)
        assert np.array_equal(done[stays], x[stays])
        assert (done[~stays] != x[~stays]).mean() > 0.9
    done = meshflow.smooth(x, kind="volume", constraints=MaxChange(0.03))
    assert np.abs(done - x).max() <= 0.03 + 1e-6
    slow = meshflow.smooth(x, kind="volume", method="heat", time=1.0, constraints=Mobility(np.where(mask, 0.1, 1.0)))
    assert np.abs(slow - x)[6:10].mean() < 0.6 * np.abs(slow - x)[:3].mean()
    held = meshflow.smooth(x, kind="volume", constraints=DataWeights(1 / 0.09**2), method="quick")
    assert 0 < error(held, x) < 0.2


@pytest.mark.long
def test_missing_samples_stay_and_are_not_read():
    truth = head(22)
    x = noisy(truth)
    gone = np.zeros(x.shape, bool)
    gone[8:11, 4:16, 4:16] = True
    x[gone] = np.nan
    result = meshflow.smooth(x, kind="volume", result=True)
    assert np.isnan(result.data[gone]).all()
    assert error(result.data[~gone], truth[~gone]) < 0.06
    with_number = np.where(gone, -99.0, x).astype(np.float32)
    other = meshflow.smooth(with_number, kind="volume", nodata=-99.0)
    assert np.array_equal(other[~gone], result.data[~gone])
    masked = meshflow.smooth(np.ma.MaskedArray(np.where(gone, 5.0, x).astype(np.float32), gone), kind="volume")
    assert np.array_equal(np.ma.getdata(masked)[~gone], result.data[~gone])
    assert np.array_equal(np.ma.getmaskarray(masked), gone)


def test_channels_are_smoothed_together_and_thick_slices_as_their_spacing_says():
    truth = np.stack([head(20), shepp_logan(20)], axis=-1)
    x = noisy(truth)
    assert error(meshflow.smooth(x, kind="volume"), truth) < 0.07
    thick = head(40)[::4]
    result = meshflow.smooth(noisy(thick), kind="volume", spacing=(4.0, 1.0, 1.0), unit="mm", result=True)
    assert result.parameters["time"].unit == "mm²"
    assert error(result.data, thick) < 0.06
    flat = meshflow.smooth(
        noisy(np.zeros((8, 20, 20))), kind="volume", method="heat", time=1.0, spacing=(9.0, 1.0, 1.0)
    )
    assert abs(np.corrcoef(flat[3].ravel(), flat[4].ravel())[0, 1]) < 0.2


def test_a_data_object_comes_back_as_one_and_turned_data_gives_the_turned_result():
    x = noisy(shepp_logan(16), dtype=np.float64)
    options = {"method": PeronaMalik(contrast=15.0), "time": 2.0}
    done = meshflow.smooth(Volume(x, (2.0, 1.0, 1.5)), **options)
    assert isinstance(done, Volume)
    assert done.spacing == (2.0, 1.0, 1.5)
    turned = meshflow.smooth(Volume(x.transpose(2, 0, 1)[::-1], (1.5, 2.0, 1.0)), **options)
    assert np.abs(turned.values - done.values.transpose(2, 0, 1)[::-1]).max() < 1e-12


def test_the_noise_is_found_also_where_it_is_correlated_between_slices():
    truth, rng = head(40), np.random.default_rng(1)
    white = noise_of_volume(noisy(truth), np.zeros(truth.shape, bool), (1.0, 1.0, 1.0))
    assert white.correlation is None
    field = np.fft.ifftn(np.fft.fftn(rng.normal(size=truth.shape)) * np.exp(-8 * sum(
        np.square(np.fft.fftfreq(40))[(..., *(None,) * axis)] for axis in range(3)))).real  # fmt: skip
    noise = noise_of_volume(truth + 0.09 * field / field.std(), np.zeros(truth.shape, bool), (1.0, 1.0, 1.0))
    assert noise.sigma == pytest.approx(0.09, rel=0.25)
    assert noise.correlation is not None
    assert noise.correlation.ndim == 3
    middle = tuple(size // 2 for size in noise.correlation.shape)
    lag = float(np.mean(field[1:] * field[:-1]) / np.mean(field**2))
    assert noise.correlation[middle[0] + 1, middle[1], middle[2]] == pytest.approx(lag, abs=0.3)
    result = meshflow.smooth((truth + 0.09 * field / field.std()).astype(np.float32), kind="volume", result=True)
    assert error(result.data, truth) < 0.085
    assert meshflow.estimate_noise(noisy(truth), kind="volume").sigma == pytest.approx(0.09, rel=0.1)


def test_white_noise_of_magnitudes_is_told_by_the_air_and_not_taken_for_correlated():
    truth, draw = head(40), np.random.default_rng(0)
    for sigma in (0.01, 0.03):
        x = np.hypot(truth + sigma * draw.normal(size=truth.shape), sigma * draw.normal(size=truth.shape))
        found = noise_of_volume(x.astype(np.float32), np.zeros(truth.shape, bool), (1.0, 1.0, 1.0))
        assert found.sigma == pytest.approx(sigma, rel=0.1)  # it was 0.14, of the folds of the brain
        assert found.correlation is None


@pytest.mark.parametrize(
    ("values", "options", "words"),
    [
        (np.zeros((6, 7, 8)), {}, "looks like a volume.*kind='volume'"),
        (np.zeros((6, 7, 8, 9)), {}, "which axis is what.*kind='volume'"),
        (np.zeros((1, 7, 8)), {"kind": "volume"}, "single slice is an image"),
        (np.zeros((7, 8)), {"kind": "volume"}, r"\(d, h, w\)"),
        (np.zeros((6, 7, 8), bool), {"kind": "volume"}, "probability"),
        (np.kron(np.eye(4, dtype=np.uint8)[:, :, None], np.ones((4, 4, 8), np.uint8)), {"kind": "volume"}, "labels"),
        (np.zeros((6, 7, 8), complex), {"kind": "volume"}, "real"),
        (np.zeros((6, 7, 8)), {"kind": "volume", "missing": np.zeros((6, 7))}, r"shape \(6, 7, 8\) expected"),
        (np.zeros((6, 7, 8)), {"kind": "volume", "constraints": Fixed(np.ones((7, 8)))}, r"\(6, 7, 8\) expected"),
        (np.zeros((6, 7, 8)), {"kind": "volume", "spacing": (1.0, 2.0)}, r"\(dz, dy, dx\)"),
        (np.zeros((6, 7, 8)), {"kind": "volume", "camera": "kinect"}, "no option of a volume"),
        (np.zeros((6, 7, 8)), {"kind": "volume", "method": "shock"}, "not for volumes; methods for volumes are"),
        (np.zeros((6, 7, 8)), {"kind": "volume", "method": "patches"}, "not for volumes"),
        (np.zeros((6, 7, 8)), {"kind": "volume", "method": "fairing"}, "not for volumes"),
        (np.zeros((6, 7, 8)), {"kind": "volume", "boundary": "plane-preserving"}, "not for volumes"),
        (np.zeros((6, 7, 8)), {"kind": "volume", "domain": "luv"}, "of three colours"),
        (np.zeros((6, 7, 8)), {"kind": "volume", "level": "rows"}, "not for volumes"),
    ],
)  # fmt: skip
def test_what_is_no_volume_or_not_for_volumes_is_refused_with_the_way_out(values, options, words):
    with pytest.raises(InputError, match=words):
        meshflow.smooth(values, **options)


def test_the_noise_is_that_of_the_signal_also_where_air_is_cut_off_or_of_magnitudes():
    truth, rng = head(48), np.random.default_rng(0)
    one, other = 0.06 * rng.normal(size=(2, *truth.shape))
    for x in ((truth + one).clip(0), np.hypot(truth + one, other)):
        assert meshflow.estimate_noise(x, kind="volume").sigma == pytest.approx(0.06, rel=0.15)


def test_a_limit_of_each_value_lies_as_the_data_lies():
    values = np.random.default_rng(0).normal(size=(6, 7, 8, 1))
    for limit in (0.1, np.full((6, 7, 8), 0.1), np.full((6, 7, 8, 1), 0.1)):
        done = meshflow.smooth(Volume(values), constraints=meshflow.MaxChange(limit))
        assert 0 < np.abs(done.values - values).max() < 0.1 + 1e-12


@pytest.mark.parametrize("share", [0.1, 0.3])
def test_the_heat_equation_leaves_no_range_however_ragged_the_holes(share):
    draw = np.random.default_rng(1)
    z = draw.uniform(0.0, 11.0, (14, 16, 18))
    z[draw.random(z.shape) < share] = np.nan
    for end in (8.0, 100.0):
        done = meshflow.smooth(z, kind="volume", method="heat", time=end)
        assert np.nanmax(done) <= 11.0 + 1e-9
        assert np.nanmin(done) >= -1e-9
