"""The noise of data, found in the data: how well, and what is said where there is none."""

import numpy as np
import pytest
from helpers import shapes
from scipy.ndimage import gaussian_filter

import meshflow
from meshflow.estimate.noise import noise_growth, noise_of, noise_on
from meshflow.estimate.planner import noise_in
from meshflow.smoothing import noise_facts
from meshflow.surfaces.mesh import Mesh
from meshflow.synthetic.samples import fractal
from meshflow.synthetic.scenes import fractal_terrain, mesas, ramps

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


def blurred_noise(shape, width, seed):
    noise = gaussian_filter(np.random.default_rng(seed).normal(size=(shape[0] + 20, shape[1] + 20)), width)[
        10:-10, 10:-10
    ]
    return noise / noise.std()


@pytest.mark.parametrize("width", [0.5, 0.7, 1.2, 2.0])
@pytest.mark.parametrize(
    "make", [smooth_surface, lambda: fractal_terrain(256), lambda: mesas(256)], ids=["smooth", "fractal", "mesas"]
)
def test_correlated_noise_is_found_with_its_deviation_and_its_length(make, width):
    truth = make()
    for seed, part in ((11, 0.03), (12, 0.08)):
        sigma = part * np.ptp(truth)
        found = noise_of(truth + sigma * blurred_noise(truth.shape, width, seed), NONE)
        assert found.how == "spectrum"
        assert found.sigma == pytest.approx(sigma, rel=0.1)
        assert found.length == pytest.approx(width, rel=0.2)
        middle = found.correlation.shape[0] // 2
        assert found.correlation[middle, middle] == 1
        assert (found.correlation == found.correlation[::-1, ::-1]).all()


@pytest.mark.parametrize("exponent", [1.5, 2.0, 2.5])
def test_a_rough_surface_without_noise_is_not_taken_for_correlated_noise(exponent):
    for seed in range(3):
        found = noise_of(60 * fractal(256, exponent, np.random.default_rng(seed)), NONE)
        assert (found.correlation, found.length) == (None, 0)
    for make in (smooth_surface, lambda: mesas(256), lambda: ramps(256)):
        assert noise_of(make(), NONE).correlation is None


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
