"""The classic schemes on grids and the flow visualization: what they equal, what they keep, and what they are for."""

import naive
import numpy as np
import pytest

from meshflow import classics
from meshflow.errors import InputError
from meshflow.synthetic.shapes import sphere


def rms(a):
    return float(np.sqrt(np.mean(np.square(a))))


def noisy(shape=(24, 30), seed=0):
    truth = 20.0 * (np.arange(shape[1]) > shape[1] // 2) * np.ones(shape)
    return truth, truth + np.random.default_rng(seed).normal(size=shape)


def test_the_four_neighbours_of_perona_and_malik_are_their_equation():
    _, u = noisy((7, 9))
    step = classics.perona_malik(u, contrast=0.5, dt=0.2, steps=1)
    assert np.allclose(step, u + 0.2 * naive.perona_malik(u, alpha=4.0), atol=1e-14)


@pytest.mark.parametrize("conductance", ["rational", "exponential", "tukey"])
def test_no_value_leaves_its_range_the_mean_stays_and_the_error_falls(conductance):
    truth, u = noisy()
    found = classics.perona_malik(u, 0.5 if conductance == "rational" else 0.25, conductance, 0.25, 30)
    assert u.min() <= found.min() <= found.max() <= u.max()
    assert found.mean() == pytest.approx(u.mean(), abs=1e-12)
    assert rms(found - truth) < 0.6 * rms(u - truth)


def test_the_beltrami_scheme_converges_to_the_flow_of_section_two_at_first_order():
    errors = []
    for n in (20, 40, 80):
        h = 4.0 / n
        y, x = np.mgrid[0:n, 0:n] * h
        u = np.sin(x) * np.cos(0.5 * y)
        # Samples of distance 1 instead of h: heights over h, and times over h^2.
        dt = 1e-6
        rate = (classics.beltrami(u / h, dt=dt, steps=1) - u / h) / dt / h
        truth = naive.flow_of_section_3(u, h, 1.0)
        errors.append(np.abs(rate[1:-1, 1:-1] - truth)[2:-2, 2:-2].max() / np.abs(truth).max())
    order = np.log2(errors[0] / errors[2]) / 2
    assert order > 0.8, f"relative errors {errors}, observed order {order:.2f}, expected 1"


@pytest.mark.parametrize("channels", [0, 3])
def test_the_beltrami_scheme_lowers_the_error_of_a_cliff(channels):
    truth, u = noisy()
    if channels:
        truth = np.repeat(truth[..., None], channels, axis=2)
        u = truth + np.random.default_rng(1).normal(size=truth.shape)
    found = classics.beltrami(u, contrast=3.0, dt=0.2, steps=60)
    assert rms(found - truth) < 0.6 * rms(u - truth)
    assert np.abs(classics.beltrami(np.full_like(u, 3.0)) - 3.0).max() == 0


def test_a_hierarchy_adds_up_and_compression_keeps_the_details():
    y, x = np.mgrid[0:32, 0:40]
    detail = 0.05 * np.sin(2.1 * x) * np.sin(1.7 * y)
    image = 5.0 * (x > 20) + 0.02 * x + detail
    base, *details = classics.hierarchy(image, (10.0, 100.0), time=4.0)
    assert np.allclose(base + sum(details), image, atol=1e-12)
    flat = classics.compressed(image, (10.0, 100.0), base=0.2, time=4.0)
    assert np.ptp(flat) < 0.4 * np.ptp(image)
    inner = (slice(6, -6), slice(4, 14))  # away from the edge
    assert np.corrcoef(np.diff(flat[inner]).ravel(), np.diff(image[inner]).ravel())[0, 1] > 0.9


def variation(picture, angle):
    """Mean squared difference along and across a direction."""
    gy, gx = np.gradient(picture)
    along = np.cos(angle) * gx + np.sin(angle) * gy
    across = -np.sin(angle) * gx + np.cos(angle) * gy
    return rms(along), rms(across)


@pytest.mark.parametrize("angle", [0.0, 0.5, np.pi / 4, 2.0])
def test_stripes_lie_along_the_field(angle):
    field = np.broadcast_to([np.cos(angle), np.sin(angle)], (40, 44, 2))
    found = classics.field_picture(field)
    along, across = variation(found, angle)
    assert along < 0.4 * across, f"{along:.3f} along, {across:.3f} across"
    assert 0 <= found.min() <= found.max() <= 1
    assert found.std() > 0.2
    holes = np.array(field)
    holes[5:9, 5:9] = np.nan
    assert (classics.field_picture(holes)[5:9, 5:9] == 0.5).all()


def test_stripes_lie_along_a_field_on_a_surface():
    ball = sphere(3)
    spin = np.cross([0.0, 0.0, 1.0], ball.points)
    found = classics.field_diffusion(ball.points, ball.faces, spin, time=40.0)
    edges = np.concatenate([ball.faces[:, [0, 1]], ball.faces[:, [1, 2]], ball.faces[:, [2, 0]]])
    way = ball.points[edges[:, 1]] - ball.points[edges[:, 0]]
    level = np.abs(way[:, 2]) / np.linalg.norm(way, axis=1)
    change = np.abs(found[edges[:, 1]] - found[edges[:, 0]])
    assert change[level < 0.3].mean() < 0.6 * change[level > 0.8].mean()


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: classics.perona_malik(np.ones((3, 3)), 1.0, dt=0.3), "dt above 0 and up to 1/4"),
        (lambda: classics.perona_malik(np.ones(3), 1.0), "finite values"),
        (lambda: classics.beltrami(np.ones((3, 3)), dt=1.0), "dt above 0 and up to 1/4"),
        (lambda: classics.hierarchy(np.ones((4, 4)), (2.0, 1.0)), "rising contrasts"),
        (lambda: classics.compressed(np.ones((4, 4)), (1.0,), base=2.0), "a factor above 0"),
        (lambda: classics.field_picture(np.ones((4, 4))), r"vectors \(h, w, 2\)"),
        (lambda: classics.field_picture(np.ones((4, 4, 2)), across=0.0), "a share above 0"),
        (
            lambda: classics.field_diffusion(np.zeros((3, 2)), np.array([[0, 1, 2]]), np.ones((3, 2))),
            "triangles with area",
        ),
    ],
)
def test_what_makes_no_sense_is_refused_in_words(call, words):
    with pytest.raises(InputError, match=words):
        call()
