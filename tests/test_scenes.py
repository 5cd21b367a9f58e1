"""Scenes, what is measured of a denoised one, and the search that finds the best parameters of a peer."""

import numpy as np
import pytest
from helpers.photographs import SCENES
from peers.grids import PEERS
from peers.search import Peer, tuned

from meshflow.errors import InputError
from meshflow.evaluate.grids import edges_of, grid_quality
from meshflow.evaluate.similarity import structural_similarity
from meshflow.synthetic import scenes

SMALL = {
    "steps": lambda: scenes.steps(32),
    "mesas": lambda: scenes.mesas(64),
    "ramps": lambda: scenes.ramps(64),
    "fractal": lambda: scenes.fractal_terrain(64),
}
PACKAGES = {"scikit-image": "skimage", "opencv-contrib-python-headless": "cv2", "MedPy": "medpy"}


def rms(error):
    return float(np.sqrt(np.mean(np.square(error))))


@pytest.mark.parametrize("name", SMALL)
def test_a_scene_is_the_same_every_time(name):
    assert np.array_equal(SMALL[name](), SMALL[name]())
    assert np.isfinite(SMALL[name]()).all()


def test_noise_is_that_of_its_seed_and_its_level():
    truth = scenes.mesas(128)
    noise = scenes.noisy(truth, 2.0) - truth
    assert np.array_equal(scenes.noisy(truth, 2.0), scenes.noisy(truth, 2.0, seed=7))
    assert not np.array_equal(scenes.noisy(truth, 2.0), scenes.noisy(truth, 2.0, seed=8))
    assert rms(noise) == pytest.approx(2.0, rel=0.02)
    assert np.allclose(scenes.noisy(truth, 4.0) - truth, 2 * noise)
    assert np.array_equal(scenes.noisy(truth, 0.0), truth)


def test_steps_are_flat_blocks_of_multiples_of_12():
    z = scenes.steps(64)
    assert set(np.unique(z)) <= {12.0 * k for k in range(8)}
    assert np.ptp(z.reshape(8, 8, 8, 8), axis=(1, 3)).max() == 0


def test_rounding_moves_no_height_by_more_than_half_a_quantum():
    subject = scenes.SCENES["quantised"]
    truth = scenes.fractal_terrain(64)
    coarse = subject.measured(truth, subject.quantum)
    assert np.abs(coarse - truth).max() <= subject.quantum / 2
    assert np.array_equal(coarse % subject.quantum, np.zeros_like(coarse))


def test_every_scene_is_either_noisy_or_rounded():
    for name, subject in SCENES.items():
        assert subject.name == name
        assert bool(subject.levels) != bool(subject.quantum)
        assert list(subject.levels) == sorted(subject.levels)
        assert (subject.kind == "image") == (subject.peak is not None)


@pytest.mark.parametrize(
    ("name", "package"), [("jacksboro", "matplotlib"), ("camera", "skimage"), ("astronaut", "skimage")]
)
def test_scenes_of_other_packages_fill_the_range_that_they_state(name, package):
    pytest.importorskip(package)
    truth = SCENES[name].truth()
    assert truth.dtype == np.float64
    assert (truth.min(), truth.max()) == ((236, 1076) if name == "jacksboro" else (0, 255))


def test_the_quality_of_the_truth_is_perfect():
    truth = scenes.mesas(64)
    same = grid_quality(truth, truth)
    assert (same.rms, same.rms_near_edges, same.normal_error, same.ssim, same.psnr) == (0, 0, 0, None, np.inf)
    for picture in (truth, np.stack([truth, -truth], axis=-1)):
        same = grid_quality(picture, picture, "image")
        assert (same.rms, same.normal_error, same.psnr) == (0, None, np.inf)
        assert same.ssim == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("shape", [(7, 7), (40, 53), (64, 48, 3)])
def test_structural_similarity_is_that_of_scikit_image(shape):
    measured = pytest.importorskip("skimage.metrics").structural_similarity
    rng = np.random.default_rng(0)
    truth = 255 * rng.random(shape)
    for found in (truth, truth + rng.normal(size=shape), 255 - truth, np.zeros(shape)):
        expected = measured(truth, found, data_range=255, channel_axis=2 if len(shape) == 3 else None)
        assert structural_similarity(found, truth, 255) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ("found", "truth", "peak", "message"),
    [
        (np.zeros((8, 8)), np.zeros((8, 9)), 1.0, r"one shape expected, got \(8, 8, 1\) and \(8, 9, 1\)"),
        (np.zeros((6, 8)), np.zeros((6, 8)), 1.0, r"7 x 7 samples or more expected, got \(6, 8\)"),
        (np.full((8, 8), np.nan), np.zeros((8, 8)), 1.0, "finite samples expected"),
        (np.zeros(8), np.zeros(8), 1.0, r"images \(h, w\) or \(h, w, k\) expected"),
        (np.zeros((8, 8)), np.zeros((8, 8)), 0.0, "peak: a positive finite number expected"),
    ],
)
def test_structural_similarity_refuses_what_it_cannot_measure(found, truth, peak, message):
    with pytest.raises(InputError, match=message):
        structural_similarity(found, truth, peak)


def test_a_height_that_is_off_everywhere_has_no_error_of_its_normals():
    truth = scenes.mesas(64)
    found = grid_quality(truth + 3.0, truth, peak=300.0)
    assert found.rms == pytest.approx(3.0)
    assert found.rms_near_edges == pytest.approx(3.0)
    assert found.normal_error == pytest.approx(0.0, abs=1e-5)
    assert found.psnr == pytest.approx(40.0)


def test_normals_of_a_tilted_plane_err_by_its_tilt_whatever_the_spacing():
    flat, columns = np.zeros((8, 9)), np.mgrid[0:8, 0:9][1]
    for spacing in (1.0, (5.0, 2.0)):
        dx = np.broadcast_to(spacing, 2)[0]
        found = grid_quality(np.tan(np.radians(20)) * dx * columns, flat, spacing=spacing, peak=1.0)
        assert found.normal_error == pytest.approx(20.0)
        assert np.isnan(found.rms_near_edges)


def test_edges_lie_within_two_samples_of_a_cliff():
    cliff = np.repeat(np.where(np.arange(40) < 20, 0.0, 10.0)[None], 30, axis=0)
    assert np.array_equal(np.flatnonzero(edges_of(cliff).all(axis=0)), [17, 18, 19, 20, 21, 22])
    assert np.array_equal(edges_of(np.stack([cliff, cliff], axis=-1)), edges_of(cliff))
    assert not edges_of(np.full((5, 6), 3.0)).any()


def test_a_missing_sample_counts_nowhere():
    truth = scenes.mesas(64)
    truth[5, 6] = np.nan
    found = grid_quality(np.where(np.isnan(truth), 0.0, truth), truth)
    assert (found.rms, found.normal_error) == (0, 0)


def _reported(z, sigma, factor, power, way):
    return sigma * np.array([factor, power, 1.0 if way == "up" else -1.0])


ECHO = Peer(
    "echo",
    "numpy",
    _reported,
    {"factor": tuple(range(1, 22)), "power": (0.5, 1.0, 1.5, 2.0), "way": ("down", "up")},
    frozenset({("factor", 21)}),
)


def test_a_search_finds_the_best_of_its_grid_and_says_when_that_is_on_the_edge():
    def found(factor, power):
        return tuned(ECHO, np.ones((2, 2)), 2.0, lambda reported: rms(reported / 2 - [factor, power, 1.0]))

    inside = found(14, 1.0)
    assert (inside.error, inside.choice, inside.edge) == (0, {"factor": 14, "power": 1.0, "way": "up"}, ())
    assert inside.runs < 21 * 4
    assert np.array_equal(inside.result, [28, 2, 2])
    assert found(0, 9).edge == ("factor", "power")
    assert found(99, 1.5).edge == ()  # factor 21 is the end of what there is


@pytest.mark.parametrize("peer", PEERS, ids=lambda peer: peer.name)
def test_every_range_of_a_peer_ascends_and_holds_the_ends_that_are_stated(peer):
    for values in peer.grid.values():
        assert isinstance(values[0], str) or list(values) == sorted(set(values))
    assert all(value in (peer.grid[name][0], peer.grid[name][-1]) for name, value in peer.ends)


@pytest.mark.parametrize("peer", [p for p in PEERS if p.name != "BM3D"], ids=lambda peer: peer.name)
def test_every_peer_gives_back_the_shape_and_the_unit_that_it_got(peer):
    pytest.importorskip(PACKAGES.get(peer.package, peer.package.replace("-", "_")))
    middle = {name: values[len(values) // 2] for name, values in peer.grid.items()}
    truth = np.full((24, 20), 100.0)
    z = scenes.noisy(truth, 1.0)
    result = peer.run(z, 1.0, **middle)
    assert result.shape == z.shape
    assert rms(result - truth) < rms(z - truth)
    if peer.channels:
        assert peer.run(np.stack([z, z, z], axis=-1), 1.0, **middle).shape == (24, 20, 3)
    else:
        with pytest.raises(InputError, match="one value per sample expected"):
            tuned(peer, np.stack([z, z, z], axis=-1), 1.0, lambda result: 0.0)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: scenes.steps(20), "a multiple of 8 expected, got 20; 16 is one"),
        (lambda: scenes.mesas(4), "side: a whole number, 8 or more, expected, got 4"),
        (lambda: scenes.ramps(9.5), "side: a whole number, 8 or more, expected, got 9.5"),
        (lambda: scenes.fractal_terrain(0), "side: a whole number, 8 or more, expected, got 0"),
        (lambda: scenes.noisy(np.zeros(3), -1.0), "sigma: a finite number, zero or more, expected, got -1"),
        (lambda: scenes.noisy(np.zeros(3), np.nan), "sigma: a finite number, zero or more, expected, got nan"),
        (lambda: scenes.quantised(np.zeros(3), 0.0), "quantum: a positive finite number expected, got 0"),
        (lambda: grid_quality(np.zeros((3, 3)), np.eye(3), "mesh"), "kind terrain or image expected, got 'mesh'"),
        (lambda: grid_quality(np.zeros((3, 3)), np.eye(4)), r"one shape expected, got \(3, 3\) and \(4, 4\)"),
        (lambda: grid_quality(np.eye(3), np.zeros((3, 3))), "peak: a positive finite number expected, got"),
        (lambda: tuned(ECHO, np.ones((2, 2)), 1.0, lambda result: np.nan), "no choice .* gave a finite error"),
    ],
)
def test_what_cannot_be_made_or_measured_is_refused_by_name(call, words):
    with pytest.raises(InputError, match=words):
        call()
