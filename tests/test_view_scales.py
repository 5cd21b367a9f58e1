"""Scales of two, and histograms: both of a pair are seen, and so is what is rare."""

import numpy as np
import pytest

from meshflow.surfaces.height_field import HeightField
from meshflow.view import page
from meshflow.view.look import Look
from meshflow.view.scale import Scale, showing, showing_both, symmetric, together
from meshflow.view.scene import of_two

RNG = np.random.default_rng(0)
ROUGH, FAINT = (symmetric(size * RNG.normal(size=4000), "curvature", "1/m", "flat") for size in (10.0, 0.3))


def colour(scale, value):
    share = (value - scale.low) / (scale.high - scale.low)
    return np.array(scale.colour_map(share))[:3]


def test_beside_what_is_rough_what_is_faint_keeps_its_colour():
    plain, bent = together(ROUGH, FAINT)[1], showing_both(ROUGH, FAINT)[1]
    white, value = colour(bent, 0.0), float(np.median(np.abs(FAINT.values)))
    assert np.abs(colour(plain, value) - colour(plain, 0.0)).max() < 0.03
    assert np.abs(colour(bent, value) - white).max() > 0.1
    for end in (-1.0, 1.0):  # the ends are where they were, and the middle is
        np.testing.assert_allclose(colour(bent, end * bent.high), colour(plain, end * plain.high), atol=0.01)
    np.testing.assert_allclose(white, colour(plain, 0.0), atol=0.02)
    assert "more colours near 0, so that both are visible" in bent.ends
    # Evenly near 0: there is no jump between what is all but flat upwards and downwards.
    np.testing.assert_allclose(colour(bent, 0.01 * value), colour(bent, -0.01 * value), atol=0.05)


def test_a_bent_map_keeps_the_order_of_what_it_shows():
    bent = showing_both(ROUGH, FAINT)[0]
    red = [colour(bent, value)[2] for value in np.linspace(0.0, bent.high, 60)]
    assert (np.diff(red) <= 1e-9).all()


def test_two_that_are_alike_have_an_even_scale():
    other = symmetric(9.0 * RNG.normal(size=4000), "curvature", "1/m", "flat")
    assert [scale.bend for scale in showing_both(ROUGH, other)] == [None, None]
    nothing = symmetric(np.zeros(4000), "curvature", "1/m", "flat")
    assert showing_both(ROUGH, nothing)[0].bend is None


def test_curvature_of_a_pair_is_shown_so_that_both_are_seen_and_shares_are_not_bent():
    x = np.linspace(0.0, 6.0, 64)
    smooth = 5.0 * np.sin(x)[None, :] * np.ones((48, 1))
    pair = HeightField(smooth + RNG.normal(size=smooth.shape)), HeightField(smooth)
    for quantity, bends in (("curvature", True), ("triangles", False)):
        sight = of_two(*pair, Look(renderer="hillshade"), quantity, window=False)
        assert [scale.bend is not None for _, scale in sight.counted] == [bends, bends]


@pytest.mark.parametrize(("values", "kind"), [(RNG.normal(size=4000), "linear"), (RNG.standard_cauchy(4000), "log")])
def test_a_histogram_with_a_peak_counts_by_powers_of_ten_and_says_so(values, kind):
    scale = symmetric(values * 1.0, "height", "m", "nothing was removed")
    look = Look(size=(800, 600))
    panels = [("", np.zeros((4, 4, 3), np.uint8))] * 3
    figure = page.compared_page(page.layout(look, 1.0), panels, (("", scale),), page.Foot(""))
    axes = next(axes for axes in figure.axes if axes.patches)
    assert axes.get_yscale() == kind
    assert any("logarithmic" in text.get_text() for text in axes.texts) == (kind == "log")
    tall = np.array([bar.get_height() for bar in axes.patches])
    low, high = axes.get_ylim()
    assert high > tall.max()
    assert (tall > low).sum() == (tall > 0).sum()  # not even one of a kind is lost


def test_of_a_two_sided_scale_and_a_one_sided_one_both_become_two_sided():
    two = Scale(np.array([-3.0, 1.0]), -3.0, 3.0, "RdBu_r", "h")
    one = Scale(np.array([0.0, 5.0]), 0.0, 5.0, "viridis", "h")
    for pair in (together(two, one), together(one, two)):
        assert {(scale.low, scale.high, scale.colours) for scale in pair} == {(-5.0, 5.0, "RdBu_r")}, "white is 0"


def test_a_broken_corner_does_not_make_all_the_rest_pale():
    values = np.random.default_rng(0).normal(size=1000)
    even, broken = symmetric(values, "", "", ""), symmetric(np.r_[values, np.full(20, 300.0)], "", "", "")
    assert showing(even) == even
    bent = showing(broken)
    assert "more colours near 0" in bent.ends
    assert (bent.low, bent.high) == (broken.low, broken.high)
    at = [int(round((1.0 + one.high) / (2 * one.high) * (one.colour_map.N - 1))) for one in (broken, bent)]
    pale, seen = (np.ptp(one.colour_map(k)[:3]) for one, k in zip((broken, bent), at, strict=True))
    assert seen > 2 * pale
