"""Laws of the classics: what shrinks, what does not, and that a border knows no left and right."""

import numpy as np
import pytest

from meshflow import classics
from meshflow.errors import InputError
from meshflow.evaluate.metrics import volume
from meshflow.synthetic.shapes import cube, dome, plate, sphere

ALL = {
    "umbrella": lambda p, f, **k: classics.umbrella(p, f, 0.5, 10, **k),
    "taubin": lambda p, f, **k: classics.taubin(p, f, 0.5, 0.1, 10, **k),
    "hc": lambda p, f, **k: classics.hc(p, f, 0.1, 0.6, 10, **k),
    "scale-dependent": lambda p, f, **k: classics.scale_dependent(p, f, 2.0, 2, **k),
}
BORDERS = ("curve", "free", "fixed")


def drift(found, shape):
    return volume(found, shape.faces) / volume(shape.points, shape.faces) - 1


def test_taubin_keeps_the_volume_of_a_sphere_and_the_umbrella_does_not():
    ball = sphere(4)
    kept = drift(classics.taubin(ball.points, ball.faces, steps=30), ball)
    lost = drift(classics.umbrella(ball.points, ball.faces, steps=60), ball)
    assert abs(kept) < 0.01, kept
    assert lost < -0.1, lost


def test_hc_keeps_more_of_a_cube_than_the_umbrella():
    body = cube(12)
    hc, umbrella = (drift(call(body.points, body.faces), body) for call in (ALL["hc"], ALL["umbrella"]))
    assert umbrella < hc < 0.01, (umbrella, hc)


def test_the_umbrella_brings_a_closed_mesh_to_a_point():
    body = plate(20)
    found = classics.umbrella(body.points, body.faces, 1.0, 3000)
    assert np.ptp(found, axis=0).max() < 0.05


def test_the_scale_dependent_umbrella_shrinks_a_sphere_half_as_fast_as_curvature_flow():
    # On even triangles L is half the Laplacian, whose flow is dR/dt = -2 / R.
    ball = sphere(4)
    time = 1.0
    found = classics.scale_dependent(ball.points, ball.faces, time, 20)
    radius = np.linalg.norm(found, axis=1).mean()
    expected = np.sqrt(1 - 2 * time * ball.edge**2)
    assert abs((1 - radius) / (1 - expected) - 1) < 0.1, (radius, expected)


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize("name", ALL)
def test_the_mirror_image_of_a_mesh_gives_the_mirror_image_of_the_result(name, border):
    body = dome(400)
    points, mirror = body.noisy("iso", 0.2), np.array([-1.0, 1.0, 1.0])
    found = ALL[name](points, body.faces, border=border)
    other = ALL[name](points * mirror, body.faces[:, ::-1], border=border)
    assert np.abs(found * mirror - other).max() < 1e-7


@pytest.mark.parametrize("name", ALL)
def test_the_order_of_the_triangles_has_no_say_at_borders(name):
    body = dome(400)
    points = body.noisy("iso", 0.2)
    order = np.random.default_rng(0).permutation(len(body.faces))
    rolled = np.roll(body.faces[order], 1, axis=1)
    assert np.abs(ALL[name](points, body.faces) - ALL[name](points, rolled)).max() < 1e-7


@pytest.mark.parametrize("name", ALL)
def test_fixed_borders_stay_and_curves_stay_in_their_plane(name):
    body = dome(400)
    rim = body.points[:, 2] == 0
    points = body.noisy("iso", 0.2)
    assert np.abs(ALL[name](points, body.faces, border="fixed") - points)[rim].max() < 1e-12
    assert np.abs(ALL[name](body.points, body.faces, border="curve")[rim, 2]).max() < 1e-9


@pytest.mark.parametrize("name", ALL)
def test_nothing_of_the_callers_is_changed_and_loose_points_stay(name):
    body = sphere(2)
    points, faces = np.concatenate([body.points, [[3.0, 0, 0]]]), body.faces.copy()
    before = points.copy()
    found = ALL[name](points, faces)
    assert np.array_equal(points, before)
    assert np.array_equal(faces, body.faces)
    assert np.array_equal(found[-1], points[-1])


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda p, f: classics.umbrella(p, f, weight=1.5), "at most 1"),
        (lambda p, f: classics.taubin(p, f, weight=0.5, passband=2.0), "passband"),
        (lambda p, f: classics.hc(p, f, beta=2.0), "from 0 to 1"),
        (lambda p, f: classics.umbrella(p, f, steps=-1), "0 or more"),
        (lambda p, f: classics.umbrella(p, f + 1), "indices below"),
        (lambda p, f: classics.umbrella(p, f[:, :2]), "faces"),
        (lambda p, f: classics.umbrella(p * np.nan, f), "finite"),
        (lambda p, f: classics.hc(p, f, border="open"), "curve, free, fixed"),
        (lambda p, f: classics.scale_dependent(p, f, time=0), "above 0"),
        (lambda p, f: classics.scale_dependent(p * 0, f), "without"),
    ],
)
def test_refusals_say_what_was_expected(call, says):
    body = sphere(1)
    with pytest.raises(InputError, match=says):
        call(body.points, body.faces)
