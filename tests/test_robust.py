"""Samples that are not of the data do no harm to the others, lines are levelled on request, and a far datum costs no digits."""

import numpy as np
import pytest

import meshflow
from meshflow.errors import InputError
from meshflow.estimate.impulse_values import impulse_values
from meshflow.estimate.outliers import outliers_of
from meshflow.estimate.ring_fill import filled_from_ring
from meshflow.estimate.stripes import offsets_to_level
from meshflow.flow.stops import When
from meshflow.synthetic.scenes import fractal_terrain, mesas, ramps, steps


def rms(a):
    return float(np.sqrt(np.mean(np.square(a))))


def terrain(n=48, sigma=2.0, seed=4):
    truth = fractal_terrain(n) + 1000.0
    return truth, truth + sigma * np.random.default_rng(seed).normal(size=truth.shape)


def hills(n=64):
    """Heights that are smooth from sample to sample."""
    y, x = np.mgrid[0:n, 0:n] / n
    return 1000.0 + 40.0 * np.sin(4 * x + 1) * np.cos(5 * y) + 20.0 * x


def picture(n=64, sigma=4.0, seed=5):
    """Shades and an edge, with noise."""
    y, x = np.mgrid[0:n, 0:n] / n
    truth = 90.0 + 60.0 * np.sin(5 * x + 3 * y) + 50.0 * (x + 0.3 * y > 0.6)
    return truth, truth + sigma * np.random.default_rng(seed).normal(size=truth.shape)


def impulses(z, share, seed=6):
    """Salt and pepper."""
    rng = np.random.default_rng(seed)
    hit = rng.random(z.shape) < share
    return np.where(hit, rng.choice([0.0, 255.0], z.shape), z), hit


@pytest.mark.parametrize("value", [1e30, -3.4e38, -9999.0, -32768.0])
def test_a_sample_far_outside_is_smoothed_around_as_if_it_were_missing(value):
    _, z = terrain()
    spoilt, gone = z.copy(), z.copy()
    spoilt[20, 31], gone[20, 31] = value, np.nan
    found, beside = meshflow.smooth(spoilt, result=True), meshflow.smooth(gone)
    assert found.data[20, 31] == value
    others = np.isfinite(gone)
    np.testing.assert_array_equal(found.data[others], beside[others])
    assert f"{value:.9g}" in found.warnings[0]
    assert "nodata" in found.warnings[0]


def test_a_region_of_undeclared_nodata_stays_and_is_named():
    truth, z = terrain()
    z[:20, :25] = -9999.0
    found = meshflow.smooth(z, method="quick", result=True)
    assert (found.data[:20, :25] == -9999.0).all()
    assert "500 samples of the value -9999" in found.warnings[0]
    assert rms((found.data - truth)[20:]) < rms((z - truth)[20:])


@pytest.mark.parametrize("word", ["repair", "include"])
def test_outliers_are_replaced_or_taken_for_data_by_name(word):
    truth, z = terrain()
    z[20, 31] = 2e4
    found = meshflow.smooth(z, method="quick", outliers=word, result=True)
    if word == "repair":
        assert abs(found.data[20, 31] - truth[20, 31]) < 30.0
    else:
        assert found.data[20, 31] > 1e4
        assert found.warnings == ()


@pytest.mark.parametrize("share", [0.01, 0.05, 0.2])
def test_impulses_are_found_and_what_is_beside_them_is_not(share):
    _, z = picture()
    spoilt, hit = impulses(z, share)
    found = outliers_of(spoilt, np.zeros(z.shape, bool))
    missed, false = (hit & ~found.mask).sum() / hit.sum(), (found.mask & ~hit).sum() / (~hit).sum()
    assert found.dense
    assert missed < 0.06, f"{missed:.1%} missed"
    assert false < 0.004, f"{false:.2%} of the others"


@pytest.mark.parametrize("share", [0.01, 0.05, 0.2])
def test_impulses_of_an_image_are_replaced_and_the_noise_is_that_of_the_others(share):
    truth, z = picture()
    spoilt, _ = impulses(z, share)
    clean = meshflow.smooth(z, kind="image", method="quick", result=True)
    found = meshflow.smooth(spoilt, kind="image", method="quick", result=True)
    assert found.noise.sigma == pytest.approx(clean.noise.sigma, rel=0.15)
    assert rms(found.data - truth) < rms(clean.data - truth) * (1.0 + 5.0 * share) + 25.0 * share
    assert "unlike all neighbours" in found.warnings[0]


@pytest.mark.parametrize("share", [0.25, 0.3, 0.4, 0.5])
@pytest.mark.parametrize("make", [lambda: picture(96), lambda: picture(96, sigma=8.0)])
@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_half_of_an_image_may_be_impulses(make, share):
    truth, z = (shades.clip(1.0, 254.0) for shades in make())
    spoilt, hit = impulses(z, share)
    found = outliers_of(spoilt, np.zeros(z.shape, bool))
    assert found.dense
    assert (hit & ~found.mask).sum() / hit.sum() < 0.06
    assert (found.mask & ~hit).sum() / (~hit).sum() < 0.004
    assert (outliers_of(spoilt / 255.0, np.zeros(z.shape, bool)).mask == found.mask).all()
    colours = outliers_of(np.dstack([spoilt, np.where(hit, spoilt, 200.0 - 0.5 * z)]), np.zeros(z.shape, bool))
    assert (found.mask & ~colours.mask).sum() == 0
    smooth = meshflow.smooth(spoilt, kind="image", method="quick", result=True)
    assert "unlike all neighbours" in smooth.warnings[0]
    assert rms(smooth.data - truth) < 0.15 * rms(spoilt - truth)


@pytest.mark.parametrize("mean", [128.0, 240.0, 250.0, 255.0])
@pytest.mark.parametrize("sigma", [5.0, 20.0, 60.0])
def test_noise_that_is_clipped_at_the_ends_has_no_impulses(mean, sigma):
    z = np.clip(np.random.default_rng(3).normal(mean, sigma, (96, 96)), 0.0, 255.0)
    for values in (z, np.rint(z)):
        found = outliers_of(values, np.zeros(z.shape, bool))
        assert found is None or not found.dense


def test_black_and_white_parts_lines_and_dots_are_not_spread_as_impulses_are():
    rng = np.random.default_rng(4)
    z = rng.normal(128.0, 5.0, (96, 96))
    regular, hatched, half = z.copy(), z.copy(), z.copy()
    regular[::4, ::4] = 255.0
    hatched[:, ::3] = 0.0
    half[:, 40:] = 0.0
    for values in (regular, hatched, half, rng.poisson(2.0, (96, 96)).astype(float)):
        assert impulse_values(values, np.ones(z.shape, bool)) == []
    salted, hit = impulses(half, 0.3)
    assert not outliers_of(salted, np.zeros(z.shape, bool)).impulses[(half == 0) & (salted == 0)].any()


def test_a_hot_pixel_of_a_stiff_image_costs_no_time():
    values = np.random.default_rng(0).normal(0.5, 0.1, (40, 40, 3))
    values[20, 20, 1] = 1e3
    found = meshflow.smooth(values, method="quick", result=True)
    assert found.end.step < 60
    assert np.abs(found.data[20, 20] - 0.5).max() < 0.2


def test_points_of_light_are_data_and_hot_pixels_of_their_height_are_none():
    rng, (y, x) = np.random.default_rng(0), np.mgrid[0:128, 0:128]
    noise, hot, stars = 5.0 * rng.normal(size=(128, 128)), np.zeros((128, 128)), np.zeros((128, 128))
    for row, column in rng.integers(4, 124, (20, 2)):
        hot[row, column] = 150.0
        stars += 150.0 * np.exp(-((y - row) ** 2 + (x - column) ** 2) / (2 * 0.65**2))
    found = outliers_of(20.0 + hot + noise, np.zeros(hot.shape, bool))
    assert found is not None
    assert found.mask[hot > 0].mean() > 0.9
    assert outliers_of(20.0 + stars + noise, np.zeros(hot.shape, bool)) is None


def test_thin_lines_blocks_and_dots_of_a_drawing_are_data():
    page = np.zeros((64, 64))
    page[10, 5:50] = page[20:40, 12] = 200.0
    page[30:34, 30:34] = 90.0
    for i in range(15):
        page[45 + i, 20 + i] = 255.0
    page[6, 6] = page[50, 9] = 255.0
    np.testing.assert_array_equal(meshflow.smooth(page, kind="image"), page)


@pytest.mark.parametrize("make", [fractal_terrain, mesas, ramps, steps])
def test_nothing_of_clean_terrain_or_of_its_noise_is_an_outlier(make):
    z = make(96)
    noisy = z + np.random.default_rng(1).normal(size=z.shape)
    for values in (z, noisy):
        found = outliers_of(values, np.zeros(z.shape, bool))
        assert found is None or found.mask.sum() <= 2
        assert "shifted" not in " ".join(meshflow.smooth(values, method="quick", result=True).warnings)


def test_a_ring_fills_its_middle_and_no_wide_hole():
    z = np.full((20, 20), 7.0)
    out = np.zeros(z.shape, bool)
    out[5, 5] = True
    out[8:20, 8:20] = True
    z[out] = 99.0
    filled, done = filled_from_ring(z, out, np.zeros(z.shape, bool))
    assert filled[5, 5] == 7.0
    assert done[5, 5]
    assert not done[14, 14]
    assert filled[14, 14] == 99.0
    np.testing.assert_array_equal(filled[~out], 7.0)


@pytest.mark.parametrize("along", ["rows", "columns"])
def test_shifted_lines_are_told_and_levelled_on_request(along):
    truth = ramps(96)
    rng = np.random.default_rng(8)
    offsets = rng.normal(0.0, 0.5, (96, 1))
    offsets = (offsets - offsets.mean()) if along == "rows" else (offsets - offsets.mean()).T
    z = truth + 0.3 * rng.normal(size=truth.shape) + offsets
    left = rms(offsets - offsets_to_level(z, np.zeros(z.shape, bool), along))
    assert left < 0.5 * rms(offsets), f"{left:.3f} of {rms(offsets):.3f} is left"
    seen = meshflow.smooth(z, method="quick", result=True)
    levelled = meshflow.smooth(z, method="quick", level=along)
    assert f"level={along!r}" in seen.warnings[0]
    assert rms(levelled - truth) < 0.8 * rms(seen.data - truth)


@pytest.mark.parametrize("make", [fractal_terrain, mesas, ramps, steps])
def test_levelling_harms_no_terrain_that_has_no_stripes(make):
    z = make(96)
    for along in ("rows", "columns"):
        np.testing.assert_allclose(offsets_to_level(z, np.zeros(z.shape, bool), along), 0.0, atol=1e-9)


@pytest.mark.parametrize("far", [1e5, 1e6])
def test_heights_far_from_zero_lose_no_digits_in_single_precision(far):
    _, z = terrain()
    single = (z + far).astype(np.float32)
    exact = meshflow.smooth(single.astype(np.float64), method="quick")
    found = meshflow.smooth(single, method="quick")
    assert found.dtype == np.float32
    assert np.abs(found - exact).max() <= 1.01 * np.spacing(np.float32(far))


def test_noise_of_one_at_ten_million_is_removed_in_single_precision():
    truth = hills()
    z = truth + np.random.default_rng(3).normal(size=truth.shape)
    single = (z + 1e7).astype(np.float32)
    exact = meshflow.smooth(single.astype(np.float64) - 1e7, method="quick")
    found = meshflow.smooth(single, method="quick").astype(np.float64) - 1e7
    before, after, best = (rms(values - truth) for values in (single - 1e7, found, exact))
    assert after < 0.8 * before, f"{before:.3f} to {after:.3f}"
    assert after**2 < 1.1 * (best**2 + 1.0 / 12.0), f"{after:.3f}, in double precision {best:.3f}"


def test_what_is_not_moved_far_from_zero_comes_back_to_the_bit():
    _, z = terrain()
    single = (z + 1e6).astype(np.float32)
    fixed = np.random.default_rng(2).random(z.shape) < 0.3
    found = meshflow.smooth(single, method="quick", constraints=meshflow.Fixed(fixed))
    np.testing.assert_array_equal(found[fixed], single[fixed])
    assert (found[~fixed] != single[~fixed]).any()
    clean = (hills() + 1e6).astype(np.float32)
    np.testing.assert_array_equal(meshflow.smooth(clean), clean)


def test_a_stop_of_the_callers_sees_values_with_their_datum():
    _, z = terrain()
    seen = []
    stop = When(lambda values, time: seen.append(float(values.mean())) or False)
    meshflow.smooth((z + 1e6).astype(np.float32), method="quick", time=1.0, stop=stop)
    assert seen
    assert seen[-1] == pytest.approx(1e6 + z.mean(), abs=1.0)


def test_words_for_outliers_and_levels_are_refused_where_they_mean_nothing():
    _, z = terrain()
    with pytest.raises(InputError, match="outliers: keep, repair or include expected, got 'drop'"):
        meshflow.smooth(z, outliers="drop")
    with pytest.raises(InputError, match="level: rows or columns expected, got 'all'"):
        meshflow.smooth(z, level="all")
    points, faces = np.eye(3), np.array([[0, 1, 2]])
    with pytest.raises(InputError, match="only for height fields and images, got Mesh"):
        meshflow.smooth((points, faces), level="rows")
    with pytest.raises(InputError, match="outliers: of .* values of vertices only, got a mesh whose points move"):
        meshflow.smooth((points, faces), outliers="keep")


def test_the_largest_of_many_samples_of_white_noise_is_no_impulse():
    z = np.random.default_rng(41).standard_normal((2000, 2000), np.float32)  # one of them is 5.98 deviations off
    assert outliers_of(z, np.zeros(z.shape, bool)) is None
    z[1000, 1000] = 12.0
    found = outliers_of(z, np.zeros(z.shape, bool))
    assert found is not None
    assert found.impulses.sum() == 1
    assert found.impulses[1000, 1000]


@pytest.mark.parametrize("sigma", [0.3, 1.0, 5.0])
def test_the_quick_method_of_colours_stays_in_range_where_noise_is_weak(sigma):
    rng = np.random.default_rng(2)
    y, x = np.mgrid[:64, :64]
    edges = np.where((x // 9 + y // 7) % 2, 200.0, 30.0)[..., None] * [1.0, 0.7, 0.4]
    z = edges + sigma * rng.normal(size=edges.shape)
    done = meshflow.smooth(z, kind="image", method="quick")
    assert done.min() > z.min() - 3 * sigma
    assert done.max() < z.max() + 3 * sigma
    assert np.mean(np.square(done - edges)) < np.mean(np.square(z - edges))
