"""Noise that is made has the deviation, the correlation and the places that it is said to have."""

import numpy as np
import pytest

from meshflow.errors import InputError
from meshflow.synthetic import Camera, CorrelatedNoise, picture, spiked, striped


def measured(noise, reach):
    """The correlation by lag of what was drawn."""
    centred = noise - noise.mean()
    power = np.abs(np.fft.fft2(centred)) ** 2
    lags = np.fft.ifft2(power).real
    lags /= lags[0, 0]
    return np.roll(lags, (reach, reach), (0, 1))[: 2 * reach + 1, : 2 * reach + 1]


@pytest.mark.parametrize("kind", ["blur", "linear", "cubic"])
@pytest.mark.parametrize(("length", "white"), [(0.0, 0.0), (0.7, 0.0), (2.0, 0.0), ((0.0, 1.5), 0.0), (1.5, 0.5)])
def test_correlated_noise_has_deviation_1_and_the_correlation_it_states(kind, length, white):
    noise = CorrelatedNoise(length, white, kind)
    drawn = np.stack([noise.drawn((400, 400), seed) for seed in range(3)])
    assert drawn.std() == pytest.approx(1, rel=0.03)
    stated, found = noise.correlation(6), np.mean([measured(one, 6) for one in drawn], axis=0)
    assert stated[6, 6] == 1
    assert np.abs(stated - found).max() < 0.035
    assert (noise.drawn((20, 30), 5) == noise.drawn((20, 30), 5)).all()


def test_a_camera_leaves_noise_that_grows_with_light_and_is_correlated():
    scene = np.full((128, 128, 3), 120.0)
    scene[:, 64:] = 30.0
    photograph, clean = Camera(shot=0.01, quality=None, seed=2).photograph(scene)
    assert (photograph == np.rint(photograph)).all()
    assert np.abs(clean[:, :60] - 120).max() < 1e-9
    noise = (photograph - clean)[4:-4, 4:60]
    red = measured(noise[..., 0], 1)
    assert 0.3 < red[1, 2] < 0.8
    still, same = Camera(shot=0.0, reading=0.0, quality=None).photograph(picture().truth)
    assert np.abs(still - same).max() <= 0.5
    again = Camera(quality=80, seed=1).photograph(scene)[0]
    assert (again == Camera(quality=80, seed=1).photograph(scene)[0]).all()
    assert again.shape == scene.shape


def test_stripes_and_spikes_are_where_and_as_large_as_stated():
    flat = np.zeros((300, 500))
    lines = striped(flat, rows=2.0, columns=0.5, seed=3)
    assert lines.mean(axis=1).std() == pytest.approx(2.0, rel=0.15)
    assert lines.mean(axis=0).std() == pytest.approx(0.5, rel=0.15)
    assert np.ptp(lines - lines[:1] - lines[:, :1] + lines[0, 0]) < 1e-12
    made, hit = spiked(flat, 0.02, -7.0, 9.0, seed=4)
    assert hit.mean() == pytest.approx(0.02, rel=0.1)
    assert set(made[hit]) == {-7.0, 9.0}
    assert not made[~hit].any()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: CorrelatedNoise(-1.0), "length: zero or more"),
        (lambda: CorrelatedNoise(1.0, 1.5), "white: a share between 0 and 1"),
        (lambda: CorrelatedNoise(kind="wide"), "kind: blur, linear or cubic"),
        (lambda: Camera(shot=-0.1), "shot, reading: zero or more"),
        (lambda: Camera(quality=99), "quality: 1 to 95"),
        (lambda: Camera().photograph(np.zeros((8, 8))), r"scene: \(h, w, 3\) expected, got \(8, 8\)"),
        (lambda: striped(np.zeros((4, 4)), rows=-1.0), "rows, columns: zero or more"),
        (lambda: spiked(np.zeros((4, 4)), 2.0, 0.0, 1.0), "share: between 0 and 1"),
    ],
)
def test_what_no_instrument_can_be_is_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()
