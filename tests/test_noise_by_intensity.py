"""Noise that depends on the intensity is found, and is removed alike in the light and in the dark."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

import meshflow
from meshflow.errors import InputError
from meshflow.estimate.noise_by_intensity import noise_by_intensity
from meshflow.estimate.stabilizer import Stabilizer
from meshflow.surfaces.image import Image
from meshflow.surfaces.vectors import Vectors
from meshflow.synthetic import shapes

data = pytest.importorskip("skimage.data")


def subject(name, size=128):
    picture = getattr(data, name)()[60 : 60 + size, 60 : 60 + size]
    return (picture if picture.ndim == 2 else picture[..., 1]).astype(float)


def photons(truth, most, seed=0):
    """A picture of up to ``most`` photons at 255, in grey levels."""
    return np.random.default_rng(seed).poisson(truth * most / 255.0) * (255.0 / most)


def found_in(z, quantum=0.0):
    return noise_by_intensity([(z, np.ones(z.shape, bool))], quantum)


@pytest.mark.parametrize("name", ["camera", "coffee"])
@pytest.mark.parametrize(
    "sigma",
    [
        lambda v: np.sqrt(25.0 + 2.0 * v),  # read noise and photons
        lambda v: 2.0 + 0.1 * v,  # speckle
        lambda v: 14.0 - 0.04 * v,  # after a tone curve
    ],
    ids=["photons", "speckle", "falling"],
)
def test_the_noise_at_each_intensity_is_found(name, sigma):
    truth = subject(name, 192)
    z = truth + sigma(truth) * np.random.default_rng(2).normal(size=truth.shape)
    found, at = found_in(z), np.quantile(truth, [0.1, 0.3, 0.5, 0.7, 0.9])
    assert found is not None
    assert not found.photons
    assert np.allclose(found.at(at) / sigma(at), 1.0, atol=0.25)


@pytest.mark.parametrize("name", ["camera", "astronaut", "chelsea", "moon", "brick"])
@pytest.mark.parametrize("sigma", [5.0, 20.0])
def test_noise_that_is_the_same_everywhere_is_not_taken_for_such(name, sigma):
    truth = subject(name, 192)
    assert found_in(truth + sigma * np.random.default_rng(3).normal(size=truth.shape)) is None


@pytest.mark.parametrize("most", [1, 4, 30])
def test_numbers_of_photons_are_recognised(most):
    found = found_in(photons(subject("camera"), most, 1), 255.0 / most)
    assert found is not None
    assert found.photons
    assert found.b == 255.0 / most


def test_the_negative_of_a_picture_of_few_photons_is_smoothed_as_the_picture_is():
    truth = subject("coins", 96) * (4.0 / 255.0)
    z = np.random.default_rng(1).poisson(truth).astype(float)
    found = found_in(500.0 - z, 1.0)
    assert found is not None
    assert found.photons
    assert not found.rising
    assert np.allclose(found.at(500.0 - truth[::8]), found_in(z, 1.0).at(truth[::8]))
    errors = [np.std(meshflow.smooth(a, kind="image") - b) for a, b in ((z, truth), (500.0 - z, 500.0 - truth))]
    assert errors[1] < 1.1 * errors[0]


@pytest.mark.parametrize("spread", [0.0, 40.0])
@pytest.mark.parametrize("sigma", [3.0, 5.0, 8.0])
def test_white_noise_in_whole_numbers_is_no_negative_of_photons(spread, sigma):
    y, x = np.mgrid[:128, :128]
    z = 200.0 + spread * np.sin(x / 20.0) * np.cos(y / 17.0) + sigma * np.random.default_rng(0).normal(size=x.shape)
    found = found_in(np.rint(z), 1.0)
    assert found is None or not found.photons


@pytest.mark.parametrize("level", [0.5, 2.0, 10.0, 200.0])
def test_the_way_back_has_no_bias(level):
    truth = np.linspace(0.2, 250.0, 256)[:, None] * np.ones(256)
    by = Stabilizer.of((found_in(np.random.default_rng(0).poisson(truth).astype(float), 1.0),))
    drawn = np.random.default_rng(5).poisson(level, (400, 400)).astype(float)
    mean = by.back(np.full((1, 1), by.stabilized(drawn).mean()))[0, 0]
    assert abs(mean - level) < 4.0 * np.sqrt(level) / 400 + 1e-3 * level


@pytest.mark.long
@pytest.mark.parametrize(("most", "share"), [(3, 0.5), (100, 0.6)])
def test_a_picture_of_few_photons_is_smoothed_far_better_than_as_if_its_noise_were_one_number(most, share):
    truth = data.camera()[150:246, 180:276].astype(float)
    z = photons(truth, most, 4)
    errors = [np.std(meshflow.smooth(z, kind="image", domain=word) - truth) for word in ("auto", "length")]
    assert errors[0] < share * errors[1]
    result = meshflow.smooth(z, kind="image", result=True)
    assert result.parameters["domain"].value == "stabilized"
    assert any("the noise depends on the intensity" in one for one in result.noise.sentences())
    assert result.to_dict()["noise"]["by_intensity"][0]["photons"]


@pytest.mark.parametrize("background", [0.1, 0.3])
def test_a_dark_background_keeps_its_few_photons(background):
    y, x = np.mgrid[0:112, 0:112]
    truth = background + 150.0 * np.exp(-((x - 60) ** 2 + (y - 50) ** 2) / 300.0)
    done = meshflow.smooth(np.random.default_rng(0).poisson(truth).astype(float), kind="image")
    dark = truth < background + 0.01
    assert done[dark].mean() == pytest.approx(truth[dark].mean(), rel=0.2)
    assert done.mean() == pytest.approx(truth.mean(), rel=0.01)
    assert done.min() >= 0.0


def test_the_result_does_not_depend_on_how_the_picture_lies():
    z = photons(subject("coffee", 77)[:, :61], 40)
    once = meshflow.smooth(z, kind="image")
    assert (np.rot90(once) == meshflow.smooth(np.ascontiguousarray(np.rot90(z)), kind="image")).all()
    assert (meshflow.smooth(np.ascontiguousarray(z.T), kind="image") == once.T).all()


def test_what_is_fixed_or_missing_keeps_its_bits():
    z = photons(subject("coffee", 96), 40).astype(np.float32)
    fixed, missing = np.zeros(z.shape, bool), np.zeros(z.shape, bool)
    fixed[:20], missing[-9:, :9] = True, True
    done = meshflow.smooth(Image(z, missing=missing, fixed=fixed), result=True)
    assert done.parameters["domain"].value == "stabilized"
    assert done.after.values.dtype == z.dtype
    assert (done.after.values[fixed | missing] == z[fixed | missing]).all()
    assert not (done.after.values == z)[~(fixed | missing)].any()


def test_the_expected_error_is_larger_where_there_is_more_light():
    truth = np.where(np.arange(128) < 64, 10.0, 200.0) * np.ones((128, 1))
    result = meshflow.smooth(photons(truth, 100, 6), kind="image", result=True)
    error = meshflow.expected_error(result)
    assert error[:, 72:].mean() > 2.0 * error[:, :56].mean()


def test_chunks_have_the_bits_of_the_whole():
    dask = pytest.importorskip("dask.array")
    z = photons(subject("camera", 96), 40).astype(np.float32)
    lazy = meshflow.smooth(
        dask.from_array(z, chunks=(40, 96)), kind="image", method="patches", domain="stabilized", time=0.5
    )
    assert (np.asarray(lazy) == meshflow.smooth(z, kind="image", method="patches", domain="stabilized", time=0.5)).all()


def test_it_is_refused_where_it_has_no_meaning():
    ball = shapes.sphere(2)
    with pytest.raises(InputError, match="does not clearly depend"):
        meshflow.smooth(np.random.default_rng(0).normal(size=(64, 64)), kind="image", domain="stabilized")
    with pytest.raises(InputError, match="only for height fields and images"):
        meshflow.smooth(meshflow.Mesh(ball.points, ball.faces), domain="stabilized")


def test_what_a_caller_gives_in_the_unit_of_the_values_keeps_them_as_they_are():
    z = photons(subject("coffee", 96), 40)
    for given in ({"noise": 20.0}, {"time": 2.0}, {"method": "beltrami"}, {"constraints": meshflow.MaxChange(9.0)}):
        assert "domain" not in meshflow.smooth(z, kind="image", result=True, **given).parameters


def test_one_number_for_noise_that_depends_on_the_intensity_is_a_warning():
    z = photons(subject("coffee", 96), 40)
    for given, name in (({"noise": 6.0}, "noise"), ({"constraints": meshflow.MaxChange(9.0)}, "MaxChange")):
        with pytest.warns(meshflow.MeshflowWarning, match=f"as one number, since {name} is given"):
            meshflow.smooth(z, kind="image", **given)
        with pytest.raises(InputError, match=f"{name} is in the unit of the original values"):
            meshflow.smooth(z, kind="image", domain="stabilized", **given)


@pytest.mark.parametrize("seed", range(4))
def test_a_chart_of_a_few_levels_shows_photons(seed):
    """Of its blocks, those across an edge scatter."""
    chart = np.tile(np.repeat([0.1, 0.3, 1, 3, 10, 100], 32), (192, 1))
    z = np.random.default_rng(seed).poisson(chart).astype(float)
    found = found_in(z, 1.0)
    assert found is not None
    assert found.photons


def test_white_noise_rounded_to_whole_numbers_is_rarely_taken_for_photons():
    """Where its square is by chance near the median of the intensities."""
    seen = [
        np.rint(np.maximum(subject(name, 192) + np.random.default_rng(k).normal(0, sigma, (192, 192)), 0))
        for name in ("camera", "coins", "coffee")
        for k, sigma in enumerate((8.0, 10.0, 12.0))
    ]
    found = [found_in(z, 1.0) for z in seen]
    assert sum(one is not None and one.photons for one in found) <= 1


def test_components_of_vectors_are_no_intensities():
    z = photons(subject("coffee", 96), 40)
    done = meshflow.smooth(Vectors(np.stack([z, z.T], axis=2)), result=True)
    assert "domain" not in done.parameters


def body():
    """A ball with a bright core, up to 100 photons."""
    z, y, x = np.mgrid[0:32, 0:40, 0:44]
    ball, core = (z - 16) ** 2 + (y - 20) ** 2 + (x - 22) ** 2 < 150, (z - 16) ** 2 + (y - 14) ** 2 + (x - 26) ** 2 < 30
    return 2.0 + 0.2 * x + 28.0 * ball + 60.0 * core


def test_a_volume_of_photons_is_smoothed_far_better_than_as_if_its_noise_were_one_number():
    counts = np.random.default_rng(0).poisson(body()).astype(np.float32)
    errors = [np.std(meshflow.smooth(counts, kind="volume", domain=word) - body()) for word in ("auto", "length")]
    assert errors[0] < 0.6 * errors[1]
    assert meshflow.estimate_noise(counts, kind="volume").by_intensity[0].photons


def test_blocks_of_a_volume_have_the_bits_of_the_whole():
    dask = pytest.importorskip("dask.array")
    counts = np.random.default_rng(0).poisson(body()).astype(np.float32)
    options = {"kind": "volume", "method": meshflow.Beltrami(contrast=0.2), "domain": "stabilized", "time": 0.2}
    lazy = meshflow.smooth(dask.from_array(counts, chunks=(32, 20, 44)), **options)
    assert (np.asarray(lazy) == meshflow.smooth(counts, **options)).all()


def test_correlated_noise_that_depends_on_the_intensity_is_said_to_be_taken_as_one_number():
    truth = subject("camera")
    noise = gaussian_filter(np.random.default_rng(0).normal(size=truth.shape), 0.7)
    z = truth + 1.5 * np.sqrt(truth + 4.0) * noise / noise.std()
    with pytest.warns(meshflow.errors.MeshflowWarning, match="correlated, and seems to depend on the intensity"):
        meshflow.smooth(z, kind="image", method=meshflow.Search(second_stage=False))
