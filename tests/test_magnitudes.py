"""Magnitudes of magnetic resonance: their noise is made the same at every signal, and the bias of Rice is taken away."""

import numpy as np
import pytest

import meshflow
from meshflow import InputError, MaxChange
from meshflow.estimate.magnitudes import Magnitudes, sigma_of_air
from meshflow.estimate.stabilizer import Stabilizer
from meshflow.synthetic import head

SIGMA = 0.1


def magnitudes(signal, sigma=SIGMA, seed=0):
    draw = np.random.default_rng(seed)
    return np.hypot(signal + sigma * draw.normal(size=signal.shape), sigma * draw.normal(size=signal.shape))


def rms(a):
    return float(np.sqrt(np.mean(np.square(a))))


@pytest.mark.parametrize("signal", [0.0, 0.05, 0.1, 0.2, 0.5, 2.0, 20.0])
def test_stabilized_noise_is_the_same_at_every_signal_and_comes_back_without_bias(signal):
    x = magnitudes(np.full(100_000, signal))
    by = Stabilizer.of((Magnitudes(SIGMA),))
    stable = by.stabilized(x)
    assert stable.std() == pytest.approx(SIGMA, rel=0.07)
    assert by.back(np.array([stable.mean()]))[0] == pytest.approx(signal, abs=0.03 * SIGMA if signal else 0.15 * SIGMA)
    assert Magnitudes(SIGMA).at(np.array([signal]))[0] == pytest.approx(x.std(), rel=0.02)


def test_the_noise_is_found_from_what_has_hardly_a_signal():
    x = magnitudes(np.where(np.arange(60_000) % 3 == 0, 0.5, 0.0))
    assert sigma_of_air(x, 1.3 * SIGMA) == pytest.approx(SIGMA, rel=0.03)
    assert sigma_of_air(np.ones(5), SIGMA) == 0.0


def test_a_volume_of_magnitudes_loses_its_bias_by_default():
    truth = head(24)
    x = magnitudes(truth, 0.06).astype(np.float32)
    found = meshflow.smooth(x, kind="volume", result=True)
    assert found.parameters["domain"].value == "magnitudes"
    assert found.parameters["domain"].origin == "estimated"
    assert found.noise.sigma == pytest.approx(0.06, rel=0.03)
    plain = meshflow.smooth(x, kind="volume", domain="length", method="quick")
    assert rms(found.data - truth) < 0.5 * rms(plain - truth)
    told = meshflow.smooth(x, kind="volume", noise=0.06, result=True)
    assert told.parameters["domain"].value == "magnitudes"
    assert rms(told.data - truth) < 1.05 * rms(found.data - truth)
    air = truth == 0
    assert max(rms(z.data[air]) for z in (found, told)) < 0.27 * 0.06
    assert found.data[air].mean() < 0.02 < 0.07 < plain[air].mean()
    assert isinstance(meshflow.estimate_noise(x, kind="volume").by_intensity[0], Magnitudes)


def test_noise_that_is_left_where_there_is_no_signal_comes_back_as_none_and_stronger_signals_as_they_are():
    by, left = Stabilizer.of((Magnitudes(SIGMA),)), 0.1 * SIGMA
    after = by.after((left,))
    none, half, strong = (Magnitudes(SIGMA).table()[2, 1 + i] for i in (0, 214, 443))
    assert after.back(np.array([none + 0.99 * left]))[0] == 0 < by.back(np.array([none + 0.99 * left]))[0]
    assert 0 < after.back(np.array([half]))[0] < by.back(np.array([half]))[0]
    assert after.back(np.array([strong]))[0] == pytest.approx(by.back(np.array([strong]))[0], rel=2e-3)


def test_a_noise_that_is_not_that_of_the_air_leaves_the_bias_with_a_warning():
    x = magnitudes(head(24), 0.06).astype(np.float32)
    found = meshflow.smooth(x, kind="volume", noise=0.02, method="quick", result=True)
    assert any("the air is that of magnitudes with noise 0.06" in one for one in found.warnings)


def test_magnitudes_of_which_the_air_was_cut_out_are_named_by_the_caller():
    inside, inner = (sum((axis - 9.5) ** 2 for axis in np.indices((20, 20, 20))) < r**2 for r in (9, 5))
    x = np.where(inside, magnitudes(np.full(inside.shape, 0.08), 0.06), 0.0)
    told = meshflow.smooth(x, kind="volume", domain="magnitudes", noise=0.06, method="quick", result=True)
    assert told.parameters["domain"].origin == "given"
    assert told.parameters["noise"].origin == "given"
    plain = meshflow.smooth(x, kind="volume", noise=0.06, method="quick")
    bias = [z[inner].mean() - 0.08 for z in (told.data, plain)]
    assert abs(bias[0]) < 0.2 * bias[1], f"{bias}"
    channels = meshflow.smooth(np.stack([x, x], -1), kind="volume", domain="magnitudes", noise=0.06, method="quick")
    assert abs(channels[inner, 1].mean() - 0.08) < 0.2 * bias[1]


def test_chunks_of_magnitudes_equal_the_whole_to_the_bit():
    dask = pytest.importorskip("dask.array")
    x = magnitudes(head(16), 0.06).astype(np.float32)
    options = {"kind": "volume", "domain": "magnitudes", "noise": 0.06, "method": "heat", "time": 0.5}
    lazy = meshflow.smooth(dask.from_array(x, chunks=(8, 16, 16)), **options)
    np.testing.assert_array_equal(lazy.compute(), meshflow.smooth(x, **options))


def test_what_is_no_magnitude_is_refused_and_so_is_what_is_in_the_unit_of_the_values():
    x = magnitudes(head(12), 0.06)
    for values, options, words in (
        (x - 1.0, {}, "domain='magnitudes': values of 0 or more expected, got -"),
        (x, {"constraints": MaxChange(0.1)}, "domain='magnitudes': MaxChange is in the unit of the original values"),
        (x[0], {"kind": "image"}, "domain='magnitudes': only for volumes, got"),
    ):
        with pytest.raises(InputError, match=words):
            meshflow.smooth(values, **{"kind": "volume", "domain": "magnitudes", **options})
