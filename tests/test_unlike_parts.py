"""Parts of one mesh that are unlike in size or noise are smoothed on their own. meshflow.results.unlike_parts."""

import numpy as np
import pytest

import meshflow
from meshflow.evaluate.metrics import normal_angle
from meshflow.synthetic import shapes

BALL = shapes.sphere(3)
COUNT = len(BALL.points)


def two(radius, level, other, seed=0):
    """Two balls of radii 1 and ``radius``, with noise in their own edges; clean and noisy points, and faces."""
    draw = np.random.default_rng(seed)
    off = BALL.edge * draw.normal(size=(2, COUNT, 1)) * np.array([level, other])[:, None, None]
    clean = np.concatenate([BALL.points, radius * BALL.points + [3, 0, 0]])
    noisy = clean + np.concatenate([off[0] * BALL.normals(), radius * off[1] * BALL.normals()])
    return clean, noisy, np.concatenate([BALL.faces, BALL.faces + COUNT])


@pytest.mark.parametrize(("radius", "level", "other"), [(0.4, 0.2, 0.2), (0.1, 0.2, 0.2), (1.0, 0.05, 0.3)])
def test_parts_of_unlike_size_or_noise_are_smoothed_as_if_each_were_alone(radius, level, other):
    clean, noisy, faces = two(radius, level, other)
    found = meshflow.smooth((noisy, faces), result=True)
    assert any("were smoothed on their own" in word for word in found.warnings)
    for place in (slice(0, COUNT), slice(COUNT, None)):
        alone = meshflow.smooth((noisy[place], BALL.faces))[0]
        np.testing.assert_allclose(found.data[0][place], alone, atol=1e-12)
        assert normal_angle(alone, clean[place], BALL.faces) < 0.25 * normal_angle(
            noisy[place], clean[place], BALL.faces
        )


def test_their_order_does_not_matter():
    _, noisy, faces = two(0.4, 0.2, 0.2)
    order = np.random.default_rng(1).permutation(len(noisy))
    number = np.argsort(order)
    expected = meshflow.smooth((noisy, faces))[0]
    found = meshflow.smooth((noisy[order], number[faces][::-1]))[0]
    np.testing.assert_allclose(found[number], expected, atol=1e-10)


def test_like_parts_and_what_the_caller_decides_go_together():
    _, noisy, faces = two(0.9, 0.2, 0.2)
    assert not any("on their own" in word for word in meshflow.smooth((noisy, faces), result=True).warnings)
    _, noisy, faces = two(0.4, 0.2, 0.2)
    for given in ({"noise": 0.02}, {"method": "fairing"}, {"constraints": meshflow.MaxChange(0.1)}):
        assert not any(
            "on their own" in word for word in meshflow.smooth((noisy, faces), result=True, **given).warnings
        )


def test_a_part_without_noise_stays_to_the_bit():
    _, noisy, faces = two(0.4, 0.2, 0.2)
    box = shapes.cube(6)
    points = np.concatenate([noisy, box.points + [0, 9, 0]])
    found = meshflow.smooth((points, np.concatenate([faces, box.faces + len(noisy)])))[0]
    assert np.array_equal(found[len(noisy) :], points[len(noisy) :])
