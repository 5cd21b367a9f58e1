"""What is exactly level beside noise, such as a lake or the sea, stays to the bit and says nothing of the noise."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.windows import by_windows, same
from scipy.ndimage import binary_dilation, gaussian_filter

import meshflow
from meshflow import Beltrami
from meshflow.errors import MeshflowWarning
from meshflow.estimate.plateaus import level_of, level_rule
from meshflow.estimate.request import Request
from meshflow.results.expected_error import expected_error
from meshflow.results.run import run
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image


def land_and_lake(seed, sigma, n=96):
    """Noisy land (n, n) of relief 20 around level water; the truth; the water."""
    rng = np.random.default_rng(seed)
    truth = gaussian_filter(rng.normal(size=(n, n)), 10, mode="wrap")
    truth *= 20 / truth.std()
    water = truth < np.quantile(truth, 0.3)
    truth[water] = truth[water].max()
    return np.where(water, truth, truth + sigma * rng.normal(size=(n, n))).astype(np.float32), truth, water


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.long
@pytest.mark.parametrize("seed", [11, 12])
@pytest.mark.parametrize("sigma", [0.3, 3.0])
def test_level_water_beside_noisy_land_stays_and_the_land_is_smoothed(seed, sigma):
    z, truth, water = land_and_lake(seed, sigma)
    found = meshflow.smooth(HeightField(z, (10.0, 10.0)), result=True)
    level = found.after.z == z
    assert water[level].mean() > 0.99
    assert level[water].mean() > 0.99
    assert "level regions" in " ".join(found.warnings)
    assert abs(found.noise.sigma / sigma - 1) < 0.05
    gauss = min(rms((np.where(water, z, gaussian_filter(z, s)) - truth)[~water]) for s in (0.7, 1, 1.4, 2, 2.8))
    assert rms((found.after.z - truth)[~water]) < 0.9 * gauss


@pytest.mark.long
@pytest.mark.parametrize("wide", [1, 2, 3, 5])
def test_rivers_and_ponds_of_level_water_stay_however_narrow_and_no_shore_is_an_impulse(wide):
    z, truth, _ = land_and_lake(4, 1.5)
    y, x = np.mgrid[:96, :96]
    water = np.abs(x - 48 - 20 * np.sin(y / 15)) <= wide / 2
    water |= np.hypot(y - 30, x - 10) < 1.2
    z = np.where(water, np.float32(5.25), (truth + np.random.default_rng(9).normal(size=z.shape)).astype(np.float32))
    found = meshflow.smooth(HeightField(z, (10.0, 10.0)), result=True)
    # Where it runs steeply, the narrowest one is cut into pieces of one or two samples.
    assert (found.after.z == z)[water].mean() >= (0.95 if wide == 1 else 1.0)
    assert "impulses" not in " ".join(found.warnings)


def test_the_shore_of_a_sea_is_smoothed_as_the_land_behind_it_is():
    z, truth, water = land_and_lake(4, 2.0, 160)
    found = meshflow.smooth(HeightField(z, (10.0, 10.0)), result=True)
    shore = binary_dilation(water, iterations=2) & ~water
    assert "impulses" not in " ".join(found.warnings)
    assert rms((found.after.z - truth)[shore]) < 0.6 * 2.0


def test_the_expected_error_of_level_water_is_zero():
    z, _, water = land_and_lake(3, 1.0)
    found = meshflow.smooth(HeightField(z, (10.0, 10.0)), result=True)
    inside = water & (found.after.z == z)
    error = expected_error(found, runs=3)
    assert (error[inside] == 0).all()
    assert np.median(error[~water]) > 0.05


def test_coarse_steps_have_no_level_regions_beside_noise():
    rng = np.random.default_rng(0)
    none = np.zeros((64, 64), bool)
    coarse = np.rint(rng.normal(size=(64, 64)) * 0.7)
    assert level_rule(coarse, none, narrow=True) == ""
    coarse[:10, :10] = 0.0
    assert level_rule(coarse, none, narrow=True) == ""
    centimetres = np.rint(8 * rng.normal(size=(64, 64)))
    assert level_rule(centimetres, none, narrow=True) == "squares"
    assert not level_of(centimetres, none, "squares").any()
    assert not level_of(rng.normal(size=(64, 64)), none, "pieces").any()


def test_all_channels_must_be_level_and_missing_samples_are_not():
    rng = np.random.default_rng(1)
    values, missing = rng.normal(size=(40, 40, 2)), np.zeros((40, 40), bool)
    values[4:12, 4:12, 0] = 1.0
    assert not level_of(values, missing, "squares").any()
    values[4:12, 4:12, 1] = 2.0
    assert level_of(values, missing, "squares").sum() == level_of(values, missing, "pieces").sum() == 64
    missing[4:12, 4:12] = True
    assert not level_of(values, missing, "squares").any()


def test_a_named_method_moves_level_regions_as_its_equation_says():
    z, _, water = land_and_lake(5, 1.0)
    found = meshflow.smooth(HeightField(z, (10.0, 10.0)), method=Beltrami(contrast=3.0), time=100.0)
    assert (found.z[water] != z[water]).any()


def test_nothing_is_said_of_level_regions_where_nothing_was_smoothed(recwarn):
    _, truth, _ = land_and_lake(6, 1.0)
    clean = HeightField(truth, (10.0, 10.0))
    np.testing.assert_array_equal(meshflow.smooth(clean).z, truth)
    assert not [one for one in recwarn if issubclass(one.category, MeshflowWarning) and "level" in str(one.message)]


@pytest.mark.parametrize("sides", [(31, 96), (40, 27)])
@pytest.mark.parametrize("channels", [0, 2])
def test_windows_keep_the_same_level_regions_as_the_whole(sides, channels):
    z, _, water = land_and_lake(8, 1.0)
    if channels:
        noise = np.random.default_rng(2).normal(size=z.shape).astype(np.float32)
        data = Image(np.stack([z, np.where(water, 0, z + noise)], 2))
    else:
        data = HeightField(z, (10.0, 10.0))
    request = Request(method=meshflow.Quick(), outliers="include")
    found, planned = by_windows(data, request, sides)
    assert planned.local.still
    whole = run(replace(data), request).after
    whole = whole.values if channels else whole.z
    same(found, whole)
    assert (found[water] == (data.values if channels else z)[water]).mean() > 0.99
