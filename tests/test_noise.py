"""The noise of data, found in the data: how well, and what is said where there is none."""

import numpy as np
import pytest
from helpers import shapes

import meshflow
from meshflow.estimate.mesh_noise import noise_on
from meshflow.estimate.noise import Lines, noise_of
from meshflow.estimate.noise_growth import noise_growth
from meshflow.estimate.patch_noise import patch_noise
from meshflow.estimate.planner import noise_in
from meshflow.smoothing import noise_facts
from meshflow.surfaces.mesh import Mesh
from meshflow.synthetic.instruments import Camera, CorrelatedNoise, spiked, striped
from meshflow.synthetic.samples import fractal, picture
from meshflow.synthetic.scenes import fractal_terrain, mesas, ramps, steps

NONE = np.zeros((256, 256), bool)


def smooth_surface(n=256):
    r, c = np.mgrid[0:n, 0:n] / n
    return 40 * np.sin(7 * r) * np.cos(9 * c) + 30 * r


@pytest.mark.parametrize("sigma", [1e-3, 0.3, 3.0, 30.0])
@pytest.mark.parametrize(
    "make", [smooth_surface, lambda: mesas(256), lambda: ramps(256)], ids=["smooth", "mesas", "ramps"]
)
def test_white_noise_is_found_within_five_percent(make, sigma):
    z = make() + sigma * np.random.default_rng(0).normal(size=(256, 256))
    found = noise_of(z, NONE)
    assert found.sigma == pytest.approx(sigma, rel=0.05)
    assert found.how == "patches"


SURFACES = {"smooth": smooth_surface, "fractal": lambda: fractal_terrain(256), "mesas": lambda: mesas(256)}


@pytest.mark.parametrize(
    ("kind", "width"), [("blur", 0.5), ("blur", 0.7), ("blur", 1.2), ("blur", 2.0), ("linear", 2.0), ("cubic", 2.0)]
)
@pytest.mark.parametrize("surface", SURFACES)
def test_correlated_noise_is_found_with_its_deviation_and_its_correlation(surface, kind, width):
    truth, noise = SURFACES[surface](), CorrelatedNoise(width, kind=kind)
    for seed, part in ((11, 0.03), (12, 0.08)):
        sigma = part * np.ptp(truth)
        found = noise_of(truth + sigma * noise.drawn(truth.shape, seed), NONE)
        assert found.how == "spectrum"
        assert found.sigma == pytest.approx(sigma, rel=0.12)
        reach = found.correlation.shape[0] // 2
        assert (found.correlation == found.correlation[::-1, ::-1]).all()
        assert found.correlation[reach, reach] == 1
        # Of noise two samples wide a tile holds few waves, and the steps of mesas look like it.
        assert np.abs(found.correlation - noise.correlation(reach)).max() < (0.1 if width < 1.5 else 0.2)
        if kind == "blur":
            assert found.length == pytest.approx(width, rel=0.2)


def test_what_is_correlated_along_rows_alone_is_told_apart():
    for lengths in ((0.0, 1.2), (1.2, 0.0), (0.6, 1.5)):
        z = fractal_terrain(256) + 15 * CorrelatedNoise(lengths).drawn((256, 256), 3)
        found = noise_of(z, NONE)
        assert found.sigma == pytest.approx(15, rel=0.1)
        assert found.lengths == pytest.approx(lengths, abs=0.35)
    assert noise_of(fractal_terrain(256) + 15 * CorrelatedNoise(0).drawn((256, 256), 3), NONE).correlation is None


def test_correlated_noise_is_found_beside_impulses_stripes_undeclared_nodata_and_all_of_them():
    truth = fractal_terrain(256)
    noise = 8 * CorrelatedNoise(1.0).drawn(truth.shape, 4)
    spikes, _ = spiked(truth + noise, 0.02, -900.0, 900.0, seed=5)
    lines = striped(truth + noise, rows=3.0, columns=1.0, seed=6)
    hole = truth + noise
    hole[40:70, 100:160] = -9999
    every = striped(spikes, rows=3.0, seed=6)
    every[40:70, 100:160] = -9999
    for z in (spikes, lines, hole, every):
        found = meshflow.estimate_noise(z)
        assert found.sigma == pytest.approx(8, rel=0.1)
        assert found.length == pytest.approx(1, rel=0.1)
        assert found.doubt == ""
        assert "correlated over about" in found.sentences()[0]
    found = meshflow.estimate_noise(lines).lines
    assert (found.rows, found.columns) == pytest.approx((3, 1), rel=0.2)


@pytest.mark.parametrize("value", [1e30, -3.4e38, -9999.0, 7e5])
def test_a_single_sample_that_is_none_hides_no_noise(value):
    z = smooth_surface() + 0.3 * np.random.default_rng(9).normal(size=(256, 256))
    z[100, 57] = value
    for dtype in (np.float64, np.float32):
        assert meshflow.estimate_noise(z.astype(dtype)).sigma == pytest.approx(0.3, rel=0.03)


@pytest.mark.parametrize("seed", range(3))
def test_stripes_are_seen_and_surfaces_have_none(seed):
    for make in SURFACES.values():
        truth = make()
        size = 0.02 * np.ptp(truth)
        z = truth + size * np.random.default_rng(seed).normal(size=truth.shape)
        assert noise_of(z, NONE).lines == Lines()
        found = noise_of(striped(z, rows=size, seed=seed), NONE)
        assert found.lines.rows == pytest.approx(size, rel=0.15)
        assert found.lines.columns == 0
        assert found.sigma == pytest.approx(size, rel=0.1)


def test_a_photograph_shows_the_noise_of_its_camera_and_how_it_is_correlated():
    scene = picture((256, 256), seed=3).truth
    for quality in (None, 90):
        photograph, clean = Camera(shot=0.006, quality=quality, seed=7).photograph(scene)
        noise = photograph - clean
        found = noise_of(photograph, NONE)
        assert found.sigma == pytest.approx(noise.std(), rel=0.15)
        beside = np.mean([np.corrcoef(noise[:, 1:, k].ravel(), noise[:, :-1, k].ravel())[0, 1] for k in range(3)])
        reach = found.correlation.shape[0] // 2
        assert found.correlation[reach, reach + 1] == pytest.approx(beside, abs=0.1)
        assert found.between == pytest.approx(np.corrcoef(noise.reshape(-1, 3).T), abs=0.15)


def test_channels_say_together_what_each_of_them_leaves_in_doubt():
    found, alone = [], []
    for seed in range(6):
        scene = picture((64, 64), seed=seed).truth
        photograph, clean = Camera(shot=0.01, reading=0.006, quality=92, seed=seed).photograph(scene)
        missing = np.zeros(scene.shape[:2], bool)
        found.append(noise_of(photograph, missing).sigma / np.std(photograph - clean))
        alone += [noise_of(photograph[..., k], missing).correlation is not None for k in range(3)]
        white = scene + 8.0 * np.random.default_rng(seed).normal(size=scene.shape)
        assert noise_of(white, missing).correlation is None
    assert np.mean(alone) < 0.8
    assert min(found) > 0.7
    assert max(found) < 1.4


def test_a_channel_in_doubt_follows_one_whose_noise_is_correlated_beyond_doubt():
    land, missing = fractal_terrain(128), np.zeros((128, 128), bool)
    land = land / np.ptp(land)
    for seed in range(4):
        noise = np.stack([CorrelatedNoise(0.8).drawn((128, 128), 3 * seed + k) for k in range(3)], axis=-1)
        rough = np.stack([10 * land, 200 * land, 200 * land[::-1]], axis=-1) + noise
        assert noise_of(rough[..., 1], missing).correlation is None
        assert noise_of(rough, missing).channels == pytest.approx((1, 1, 1), rel=0.4)
        noise[..., 1] = np.random.default_rng(seed).normal(size=(128, 128))
        assert noise_of(10 * land[..., None] + noise, missing).channels == pytest.approx((1, 1, 1), rel=0.1)


def test_correlated_noise_that_is_the_same_in_all_channels_is_doubted():
    own, missing = [CorrelatedNoise(1.0).drawn((96, 96), seed) for seed in range(4)], np.zeros((96, 96), bool)
    assert noise_of(np.stack(own[:3], axis=-1), missing).doubt == ""
    common = np.stack([own[3] + 0.5 * one for one in own[:3]], axis=-1)
    assert "nearly the same in all channels" in noise_of(common, missing).warning


def test_noise_common_to_all_channels_is_told_from_noise_of_each():
    rng = np.random.default_rng(2)
    common, own = rng.normal(size=(256, 256, 1)), rng.normal(size=(256, 256, 3))
    found = noise_of(smooth_surface()[..., None] + 3 * common + np.array([1.0, 3.0, 3.0]) * own, NONE)
    stated = 9 / np.sqrt(np.outer([10, 18, 18], [10, 18, 18]))
    np.fill_diagonal(stated, 1)
    assert found.between == pytest.approx(stated, abs=0.05)


@pytest.mark.parametrize("length", [0.0, 1.0])
def test_noise_scales_with_the_values_and_no_offset_changes_it(length):
    z = fractal_terrain(256) + 10 * CorrelatedNoise(length).drawn((256, 256), 8)
    found = noise_of(z, NONE)
    assert noise_of(1000 * z, NONE).sigma == pytest.approx(1000 * found.sigma, rel=1e-5)
    assert noise_of(z + 1e6, NONE).sigma == pytest.approx(found.sigma, rel=1e-5)
    assert noise_of(z.astype(np.float32), NONE).sigma == pytest.approx(found.sigma, rel=1e-3)
    for turn in (np.rot90, np.transpose, np.fliplr):
        turned = noise_of(np.ascontiguousarray(turn(z)), NONE)
        assert turned.sigma == pytest.approx(found.sigma, rel=0.02)
        assert turned.length == pytest.approx(found.length, rel=0.02)


@pytest.mark.long
@pytest.mark.parametrize("power", [-200, -100, 66, 100, 200])
@pytest.mark.parametrize("shape", [(32, 36), (24, 24, 3)])
def test_a_power_of_two_times_the_values_gives_that_times_the_noise_and_the_result_to_the_bit(power, shape):
    y, x = np.mgrid[: shape[0], : shape[1]]
    surface = (5 * np.sin(x / 7) + np.cos(y / 5)).reshape(shape[:2] + (1,) * (len(shape) - 2))
    z = surface + np.random.default_rng(0).normal(0, 0.5, shape)
    noise = meshflow.estimate_noise(np.ldexp(z, power))
    assert noise.sigma > 0
    assert noise.sigma == np.ldexp(meshflow.estimate_noise(z).sigma, power)
    if abs(power) <= 100:  # beyond, values of a tile of the search do not fit into single precision
        np.testing.assert_array_equal(meshflow.smooth(np.ldexp(z, power)), np.ldexp(meshflow.smooth(z), power))
        assert meshflow.estimate_noise(np.ldexp(z, power).astype(np.float32)).sigma > 0


@pytest.mark.long
@pytest.mark.parametrize("factor", [1e-30, 1e20, 1e25, 1e35])
@pytest.mark.parametrize("number", [np.float32, np.float64])
@pytest.mark.parametrize("method", [None, "quick"])
@pytest.mark.filterwarnings("error")
def test_values_as_large_or_small_as_single_precision_holds_are_smoothed_as_others_are(factor, number, method):
    y, x = np.mgrid[:32, :36]
    z = 5 * np.sin(x / 7) + np.cos(y / 5) + np.random.default_rng(0).normal(0, 0.5, x.shape)
    found = meshflow.smooth((z * factor).astype(number), method=method).astype(np.float64) / factor
    np.testing.assert_allclose(found, meshflow.smooth(z, method=method), rtol=0, atol=2e-5)


@pytest.mark.parametrize(("slope", "length"), [(1.6, 1.2), (1.7, 1.6), (1.8, 2.0)])
def test_correlated_noise_weaker_than_a_rough_surface_at_every_frequency_is_found_on_it(slope, length):
    land = 100 * fractal(256, slope, np.random.default_rng(0))
    found = noise_of(land + 10 * CorrelatedNoise(length).drawn((256, 256), 9), NONE)
    assert abs(found.sigma / 10 - 1) < 0.15
    assert abs(found.length / length - 1) < 0.25


@pytest.mark.parametrize("exponent", [1.5, 2.0, 2.5])
def test_a_rough_surface_without_noise_is_not_taken_for_correlated_noise(exponent):
    for seed in range(3):
        found = noise_of(60 * fractal(256, exponent, np.random.default_rng(seed)), NONE)
        assert (found.correlation, found.length) == (None, 0)


@pytest.mark.parametrize("quantum", [0.0, 1.0])
def test_clean_data_rounded_or_not_has_no_correlated_noise(quantum):
    makes = (smooth_surface, lambda: mesas(256), lambda: ramps(256), lambda: steps(256), lambda: fractal_terrain(256))
    for make in makes:
        z = make()
        found = noise_of(np.rint(z / quantum) * quantum if quantum else z, NONE)
        assert found.correlation is None
        assert found.lines == Lines()
    assert noise_of(picture((256, 256)).truth, NONE).correlation is None


@pytest.mark.parametrize("length", [0.0, 1.2])
def test_a_large_grid_is_looked_at_in_parts_and_says_the_same(length):
    z = fractal_terrain(1024) + 12 * CorrelatedNoise(length).drawn((1024, 1024), 2)
    found = noise_of(z.astype(np.float32), np.zeros(z.shape, bool))
    assert found.sigma == pytest.approx(12, rel=0.04)
    assert found.length == pytest.approx(length, rel=0.06)
    assert found.doubt == ""


def test_holes_and_what_lies_in_them_do_not_count():
    rng = np.random.default_rng(1)
    z, missing = smooth_surface() + 2 * rng.normal(size=(256, 256)), rng.random((256, 256)) < 0.02
    z[missing] = 1e6
    assert noise_of(z, missing).sigma == pytest.approx(2, rel=0.05)


def test_what_is_clipped_hides_the_noise_of_the_rest_no_more():
    z = np.clip(smooth_surface() + 3 * np.random.default_rng(2).normal(size=(256, 256)), 0, None)  # a third is zero
    assert (z == 0).mean() > 0.25
    assert noise_of(z, NONE).sigma == pytest.approx(3, rel=0.1)


def test_each_channel_has_its_own_noise_and_the_whole_their_mean_square():
    rng = np.random.default_rng(3)
    sigmas = np.array([1.0, 2.0, 4.0])
    found = noise_of(smooth_surface()[..., None] + sigmas * rng.normal(size=(256, 256, 3)), NONE)
    assert found.channels == pytest.approx(tuple(sigmas), rel=0.05)
    assert found.sigma == pytest.approx(np.sqrt(np.mean(sigmas**2)), rel=0.05)


@pytest.mark.parametrize("shape", [(2, 400), (400, 2), (5, 90), (3, 3000)])
def test_a_strip_too_narrow_for_patches_is_measured_along_itself(shape):
    z = 2 * np.random.default_rng(4).normal(size=shape)
    found = noise_of(z, np.zeros(shape, bool))
    assert found.sigma == pytest.approx(2, rel=0.25)
    assert found.how == "differences"


def test_constant_data_clean_blocks_and_four_samples_have_no_noise_to_tell():
    blocks = np.random.default_rng(0).integers(0, 9, (8, 8)) * 12.0
    assert noise_of(np.full((64, 64), 7.25), NONE[:64, :64]).sigma == 0
    assert noise_of(np.kron(blocks, np.ones((16, 16))), NONE[:128, :128]).sigma == 0
    tiny = noise_of(np.array([[1.0, 5.0], [2.0, 9.0]]), np.zeros((2, 2), bool))
    assert (tiny.sigma, tiny.how) == (0, "nothing")


def test_rounding_is_found_with_its_quantum_and_the_share_of_samples_on_it():
    z = np.round(smooth_surface() / 4) * 4
    found = noise_of(z, NONE)
    assert (found.quantum, found.share) == (4.0, 1.0)
    assert found.sigma == pytest.approx(4 / np.sqrt(12), rel=0.2)
    z[:3, :50] += 0.37  # a few samples that were corrected by hand
    found = noise_of(z, NONE)
    assert found.quantum == 4.0
    assert 0.99 < found.share < 1.0


def test_noise_that_grows_with_depth_is_found_as_a_polynomial():
    rng = np.random.default_rng(5)
    depth = 0.5 + 4.5 * np.mgrid[0:240, 0:320][1] / 320
    depth[100:, 150:] += 1.0  # something stands before something else
    z = depth + (0.001 + 0.002 * depth**2) * rng.normal(size=depth.shape)
    found = noise_growth(z, np.zeros(z.shape, bool))
    for x in (1.0, 3.0, 5.0):
        assert found.at(np.array(x)) == pytest.approx(0.001 + 0.002 * x**2, rel=0.15)
    camera = meshflow.Pinhole(300, 300, 160, 120)
    assert noise_facts(meshflow.RangeImage(z, camera))["noise c (per depth²)"] == pytest.approx(0.002, rel=0.25)


def test_a_band_of_one_depth_says_nothing_of_the_noise_of_others():
    z = 2.0 + 0.004 * np.mgrid[0:120, 0:160][1] + 0.02 * np.random.default_rng(9).normal(size=(120, 160))
    z[:10] = 10.0  # where a sensor ends
    found = noise_growth(z, np.zeros(z.shape, bool))
    assert found.at(np.array(2.3)) == pytest.approx(0.02, rel=0.15)
    constant = noise_growth(np.full((64, 64), 3.0), np.zeros((64, 64), bool))
    assert constant.at(np.array(3.0)) == 0.0


def test_noise_that_grows_with_intensity_is_found_where_asked():
    rng = np.random.default_rng(6)
    level = 20 + 200 * np.mgrid[0:256, 0:256][1] / 256
    z = level + np.sqrt(level) * rng.normal(size=level.shape)
    found = noise_growth(z, NONE, level)
    assert found.at(np.array(120.0)) == pytest.approx(np.sqrt(120), rel=0.1)


def test_noise_of_a_mesh_is_that_along_its_normals():
    points, faces = shapes.sphere(4000, shake=0.1)
    sigma = 0.004
    shaken = points * (1 + sigma * np.random.default_rng(7).normal(size=(len(points), 1)))
    assert noise_in(Mesh(shaken, faces)).sigma == pytest.approx(sigma, rel=0.15)
    heat = points[:, 2] + 0.2 * np.random.default_rng(8).normal(size=len(points))
    assert noise_on(heat[:, None], faces).sigma == pytest.approx(0.2, rel=0.05)


def test_the_noise_that_is_told_lies_as_the_data_lies():
    z = fractal_terrain(128) + 15 * CorrelatedNoise((0.5, 1.5)).drawn((128, 128), 3)
    z = striped(z, rows=20.0, seed=1)
    told = [(meshflow.estimate_noise(turned), swapped) for turned, swapped in ((z, False), (z.T, True))]
    told += [(meshflow.estimate_noise(np.rot90(z)), True), (meshflow.estimate_noise(z[::-1, ::-1]), False)]
    steps = meshflow.Steps(1)
    told += [(meshflow.smooth(z.T, method="beltrami", stop=steps, result=True).noise, True)]
    for found, swapped in told:
        rows, columns = found.lengths[::-1] if swapped else found.lengths
        assert rows < columns
        along = (found.lines.columns, found.lines.rows) if swapped else (found.lines.rows, found.lines.columns)
        assert along[0] == pytest.approx(20, rel=0.2)
        assert along[1] == 0
        middle = len(found.correlation) // 2
        beside, below = found.correlation[middle, middle + 1], found.correlation[middle + 1, middle]
        assert (beside > below) != swapped


@pytest.mark.parametrize("exponent", [1.3, 1.6])
def test_the_roughness_of_a_fractal_surface_is_not_its_noise(exponent):
    rng, n = np.random.default_rng(4), 128
    radius = np.hypot(*np.meshgrid(np.fft.fftfreq(2 * n), np.fft.fftfreq(2 * n)))
    radius[0, 0] = 1.0
    rough = np.real(np.fft.ifft2(np.fft.fft2(rng.normal(size=(2 * n, 2 * n))) * radius**-exponent))[:n, :n]
    rough *= 100.0 / rough.std()
    missing = np.zeros((n, n), bool)
    assert noise_of(rough, missing).sigma < 0.6 * patch_noise([(rough, ~missing)])
    noisy = rough + 10.0 * rng.normal(size=(n, n))
    assert noise_of(noisy, missing).sigma == pytest.approx(10.0, rel=0.3)


def test_whole_numbers_have_no_offsets_of_lines_as_small_as_rounding():
    rng = np.random.default_rng(0)
    rows, columns = np.mgrid[0:96, 0:96].astype(float)
    for surface in (((rows - 48) ** 2 + (columns - 48) ** 2) / 1200, columns / 7, rows / 3 + columns):
        for quantum in (0.1, 0.3, 1.0):
            values = np.round(surface / quantum + 0.3 * rng.normal(size=rows.shape)) * quantum
            assert noise_of(values, np.zeros(rows.shape, bool)).lines == Lines()


def test_terraces_of_a_rounded_surface_are_no_correlated_noise():
    rows, columns = np.mgrid[0:128, 0:128] / 128
    for waves in (20.0, 30.0):
        dunes = 3 * np.sin(waves * columns + 4 * np.sin(6 * rows)) + 5 * rows
        for quantum in np.ptp(dunes) * np.array([0.03, 0.04, 0.05, 0.06, 0.08, 0.12]):
            found = noise_of(np.round(dunes / quantum) * quantum, np.zeros(dunes.shape, bool))
            assert found.sigma < 0.4 * quantum
            assert found.correlation is None


@pytest.mark.long
@pytest.mark.parametrize(("size", "period"), [(200, 4), (256, 5), (300, 6), (256, 9), (200, 11)])
def test_the_waves_of_a_smooth_surface_are_no_correlated_noise(size, period):
    y, x = np.mgrid[:size, :size].astype(float)
    hills = 100 + 40 * np.sin(x / 23) * np.cos(y / 31)
    for waves in (15 * np.sin((x + 2 * y) / period), 30 * np.sin(x / period) * np.cos(y / period / 1.3)):
        assert meshflow.estimate_noise(hills + waves).sigma == 0
        assert meshflow.estimate_noise((100 + waves).astype(np.float32)).sigma == 0


@pytest.mark.parametrize("sigma", [3.0, 10.0])
def test_lines_of_text_are_no_noise(sigma):
    """They fill every tile, but leave quiet places between them."""
    page = pytest.importorskip("skimage.data").page()[:150, :180].astype(float)
    found = noise_of(page + sigma * np.random.default_rng(0).normal(size=page.shape), np.zeros(page.shape, bool))
    assert found.correlation is None
    assert found.sigma == pytest.approx(sigma, rel=0.1)
