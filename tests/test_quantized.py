"""Where rounding is the noise, what comes back was recorded as these steps, is smooth, and never worse than what went in."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

import meshflow
from meshflow.estimate.plateaus import plateaus_of
from meshflow.estimate.quantized import UNCHANGED
from meshflow.estimate.request import Request
from meshflow.estimate.unrounding import unrounded
from meshflow.results.run import states
from meshflow.surfaces.height_field import HeightField
from meshflow.synthetic.scenes import fractal_terrain, mesas, ramps

WIDTHS = (0.3, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6)


def rms(a):
    return float(np.sqrt(np.mean(np.square(a))))


def slopes(a, b):
    """The root mean square error of the slope."""
    return rms(np.hypot(*(x - y for x, y in zip(np.gradient(a), np.gradient(b), strict=True))))


def pits(z):
    """Samples below all eight neighbours."""
    h, w = z.shape
    inner = z[1:-1, 1:-1]
    around = [z[1 + r : h - 1 + r, 1 + c : w - 1 + c] for r in (-1, 0, 1) for c in (-1, 0, 1) if r or c]
    return int(np.logical_and.reduce([inner < other for other in around]).sum())


def hills(n=80):
    y, x = np.mgrid[0:n, 0:n] / n
    return 40.0 * np.sin(4 * x + 1) * np.cos(5 * y) + 20.0 * x


def bowl(n=80):
    y, x = np.mgrid[0:n, 0:n] - n / 2
    return 60.0 * (x * x + y * y) / n**2


def plains(n=80, seed=7, width=9, relief=6.0):
    z = gaussian_filter(np.random.default_rng(seed).normal(size=(n, n)), width, mode="wrap")
    return relief * (z - z.min()) / np.ptp(z)


def lakes(n=112):
    """Flat land with a lake that is exactly level, and the lake."""
    y, x = np.mgrid[0:n, 0:n]
    away = np.hypot(x - 0.45 * n, y - 0.5 * n)
    shore = np.maximum(away - 0.22 * n, 0.0)
    return 4.0 + 0.06 * shore + 0.0012 * shore**2, away < 0.22 * n


SCENES = {
    "fractal": lambda: fractal_terrain(80), "ramps": lambda: ramps(80), "mesas": lambda: mesas(80), "hills": hills, "bowl": bowl,
    "plains": plains,
}  # fmt: skip


def recorded(truth, share, noise, seed=1):
    quantum = np.ptp(truth) / share
    z = truth + noise * quantum * np.random.default_rng(seed).normal(size=truth.shape)
    return np.rint(z / quantum) * quantum, quantum


def peers(z, truth):
    """The best of Gaussians, tuned on the truth: error, and error of the slope."""
    tried = [gaussian_filter(z, width, mode="nearest") for width in WIDTHS]
    return min(rms(t - truth) for t in tried), min(slopes(t, truth) for t in tried)


@pytest.mark.long
@pytest.mark.parametrize("noise", [0.0, 0.15])
@pytest.mark.parametrize("scene", list(SCENES))
def test_whole_numbers_come_back_no_worse_than_they_went_in(scene, noise):
    truth = SCENES[scene]()
    shares = []
    for share in (200, 60, 20, 8):
        z, _ = recorded(truth, share, noise)
        error = rms(meshflow.smooth(z) - truth)
        assert error <= 1.0 * rms(z - truth), f"{share}: {error / rms(z - truth):.3f} of what went in"
        shares.append(error / min(peers(z, truth)[0], rms(z - truth)))
    mean = float(np.exp(np.mean(np.log(shares))))
    assert mean < 1.03, f"{mean:.3f} of the best Gaussian"


def test_the_slope_of_flat_land_is_better_than_that_of_the_best_gaussian_and_has_no_new_pits():
    for seed, width in ((7, 9), (2, 12)):
        truth = plains(96, seed, width, 8.0)
        z, _ = recorded(truth, 8, 0.0)
        found = meshflow.smooth(z)
        assert rms(found - truth) < peers(z, truth)[0]
        assert slopes(found, truth) < peers(z, truth)[1]
        assert pits(found) <= pits(truth) + 6


def test_a_lake_that_is_level_stays_to_the_bit_and_is_said():
    truth, lake = lakes()
    z = np.rint(truth)
    found = meshflow.smooth(z, result=True)
    np.testing.assert_array_equal(found.data[lake], z[lake])
    assert "level regions" in " ".join(found.warnings)
    assert rms(found.data - truth) < peers(z, truth)[0]
    assert slopes(found.data, truth) < peers(z, truth)[1]
    assert pits(found.data) == 0


def test_the_bottom_of_a_bowl_that_was_rounded_is_no_lake():
    z, quantum = recorded(bowl(), 8, 0.0)
    assert not plateaus_of(z, np.zeros(z.shape, bool), quantum).any()


def test_what_was_rounded_stays_within_half_a_step():
    truth = hills()
    z, quantum = recorded(truth, 30, 0.0)
    found = meshflow.smooth(z, result=True)
    assert np.abs(found.data - z).max() <= quantum / 2.0 * (1 + 1e-6)
    assert found.parameters["max_change"].value == pytest.approx(quantum / 2.0)
    assert found.parameters["method"].value == "least-bending"
    assert "rounding is the noise" in found.stopped_because


def test_a_plane_in_steps_is_a_plane_again():
    y, x = np.mgrid[0:64, 0:64]
    truth = 0.13 * x + 0.07 * y
    z = np.rint(truth)
    found = unrounded(z, np.zeros(z.shape, bool), np.zeros(z.shape, bool), 1.0)
    assert rms(found.values - truth) < 0.2 * rms(z - truth)


def test_missing_and_fixed_samples_stay_and_steps_are_counted_from_any_value():
    truth = hills()
    z, quantum = recorded(truth, 30, 0.0)
    z = z + 0.37 * quantum
    z[20:30, 40:44] = np.nan
    fixed = np.zeros(z.shape, bool)
    fixed[::9, ::7] = True
    found = meshflow.smooth(z, constraints=meshflow.Fixed(fixed))
    np.testing.assert_array_equal(np.isnan(found), np.isnan(z))
    np.testing.assert_array_equal(found[fixed], z[fixed])
    free = ~fixed & np.isfinite(z)
    assert rms((found - truth - 0.37 * quantum)[free]) < 0.6 * rms((z - truth - 0.37 * quantum)[free])


def test_turned_and_transposed_steps_give_the_same_surface():
    z, quantum = recorded(hills(64), 20, 0.0)
    none = np.zeros(z.shape, bool)
    found = unrounded(z, none, none, quantum).values
    for change in (np.transpose, np.rot90, np.fliplr):
        other = unrounded(np.ascontiguousarray(change(z)), none, none, quantum).values
        np.testing.assert_allclose(other, change(found), atol=0.02 * quantum)


def test_land_that_no_smoothing_helps_is_left_as_it_is():
    rough = np.random.default_rng(3).normal(0.0, 3.0, (64, 64))
    z = np.rint(rough)
    none = np.zeros(z.shape, bool)
    found = unrounded(z, none, none, 1.0)
    assert rms(found.values - rough) <= 1.02 * rms(z - rough)


def test_levels_of_a_drawing_with_less_noise_than_rounding_makes_were_not_rounded():
    z = np.kron(np.random.default_rng(0).integers(0, 3, (24, 24)) * 40.0, np.ones((3, 3)))
    found = meshflow.smooth(z, noise=0.5, result=True)
    assert found.parameters["method"].value != "least-bending"
    assert rms(found.data - z) < 1.0


def test_strength_is_that_of_a_flow_also_for_whole_numbers():
    z, _ = recorded(hills(), 20, 0.0)
    removed = [rms(meshflow.smooth(z, strength=strength) - z) for strength in (0.25, 4.0)]
    assert removed[0] < removed[1]


def test_where_edges_matter_the_flow_that_keeps_them_is_taken_and_lakes_stay():
    truth = mesas(96)
    z, quantum = recorded(truth, 20, 0.0)
    found = meshflow.smooth(z, result=True)
    assert found.parameters["patch"].value == 1.0
    assert found.end.step > 0
    assert np.abs(found.data - z).max() <= quantum / 2.0 * (1 + 1e-6)
    none = np.zeros(z.shape, bool)
    bent = unrounded(z, none, none, quantum).values
    assert rms(found.data - truth) < 0.95 * rms(bent - truth)


def test_what_shows_states_on_the_way_shows_a_flow():
    z, _ = recorded(hills(), 20, 0.0)
    shown = list(states(HeightField(z), Request(), 4))
    assert len(shown) == 4
    assert shown[-1][0] > 0
    assert UNCHANGED.startswith("data left unchanged")


@pytest.mark.parametrize("size", [8, 16, 64, 200])
def test_planes_of_whole_numbers_are_not_rounded_and_stay_to_the_bit(size):
    x = np.arange(float(size)) + np.zeros((size, 1))
    kinked = (np.maximum(x, size // 2), np.minimum(x, size - 1 - x)) if size > 100 else ()
    for z in (x, x.T.astype(np.int16), x + 2 * x.T, 0.5 * x, *kinked):
        np.testing.assert_array_equal(meshflow.smooth(z), z)
