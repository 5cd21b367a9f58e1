"""What a surface is like: curvature, edges, triangles, what is missing, with colours and units."""

from dataclasses import replace

import numpy as np
import pytest

from meshflow.errors import InputError
from meshflow.surfaces.camera import Pinhole
from meshflow.surfaces.discontinuities import Cuts
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.synthetic import shapes
from meshflow.view import measured, quantity
from meshflow.view.geometry import geometry_of
from meshflow.view.look import Look
from meshflow.view.scale import Scale, together

ROWS, COLUMNS = np.mgrid[:40, :50]
PLANE = HeightField(0.5 * COLUMNS - 2.0 * ROWS, unit="m")
CAMERA = Pinhole(100.0, 100.0, 24.5, 19.5)
SPHERE = shapes.sphere(3)


def ball(inwards=False):
    """The unit ball, 3 away from a camera that sees it, or the inside of its shell."""
    x, y = (COLUMNS - 24.5) / 100, (ROWS - 19.5) / 100
    squared = x * x + y * y + 1
    root = np.sqrt(np.maximum(9 - 8 * squared, 0))
    return RangeImage((3 + root if inwards else 3 - root) / squared, CAMERA)


def test_the_curvature_of_a_sphere_is_one_outwards_and_minus_one_inside_out():
    faces = SPHERE.faces
    for turned, sign in ((faces, 1.0), (faces[:, ::-1], -1.0)):
        values = measured(Mesh(2.0 * SPHERE.points, turned), "curvature").values
        np.testing.assert_allclose(values, sign / 2.0, rtol=1e-4)


def test_curvature_is_positive_towards_the_camera():
    for inwards, sign in ((False, 1.0), (True, -1.0)):
        values = measured(ball(inwards), "curvature").values[10:-10, 10:-10]
        assert np.abs(values - sign).max() < 0.01


def test_curvature_is_that_of_true_proportions_with_its_unit():
    hill = HeightField(-0.5 * ((COLUMNS - 25.0) ** 2 + (ROWS - 20.0) ** 2) * 4 / 1000, spacing=2.0, unit="m")
    scale = measured(hill, "curvature")
    assert scale.values[20, 25] == pytest.approx(1 / 1000, rel=1e-3)  # a paraboloid of radius 1000 m
    assert scale.label == "mean curvature [1/m]"


def test_planes_have_no_curvature_and_one_edge_indicator():
    np.testing.assert_allclose(measured(PLANE, "curvature").values, 0.0, atol=1e-12)
    np.testing.assert_allclose(measured(PLANE, "edges", 2.0).values, 1 / np.sqrt(1 + 4 * 4.25), rtol=1e-12)
    wall = RangeImage(np.full((40, 50), 2.0), CAMERA)
    assert measured(wall, "edges").values[20, 25] == pytest.approx(1.0, abs=1e-3)  # seen straight on


def test_the_edge_indicator_of_channels_falls_with_all_of_them():
    one, two = (Image(np.stack([COLUMNS * slope, ROWS * slope], axis=2) * 1.0) for slope in (1.0, 2.0))
    assert measured(one, "edges").values[5, 5] == pytest.approx(0.5)
    assert measured(two, "edges").values[5, 5] == pytest.approx(0.2)


def test_quality_is_one_for_equilateral_triangles_and_zero_without_area():
    points = np.array([[0, 0, 0], [1, 0, 0], [0.5, np.sqrt(3) / 2, 0], [1, 1, 0], [2, 0, 0]])
    mesh = Mesh(points, np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]]))
    scale = measured(mesh, "triangles")
    assert scale.of_triangles
    np.testing.assert_allclose(scale.values, [1.0, 4 * np.sqrt(3) * 0.5 / 4, 0.0], atol=1e-12)


def test_of_grids_the_worst_triangle_around_a_sample_counts():
    values = measured(HeightField(np.zeros((5, 5))), "triangles").values
    np.testing.assert_allclose(values, 4 * np.sqrt(3) * 0.5 / 4)


def test_samples_are_counted_by_kind():
    gone, held = np.zeros((40, 50), bool), np.zeros((40, 50), bool)
    gone[:10], held[-20:] = True, True
    scale = measured(HeightField(PLANE.z, missing=gone, fixed=held | gone), "samples")
    assert scale.names == ("move", "fixed", "missing")
    assert [int((scale.values == k).sum()) for k in range(3)] == [500, 1000, 500]
    assert "25 % move, 50 % fixed, 25 % missing" in scale.label
    assert scale.colour_map.N == 3
    assert measured(Mesh(SPHERE.points, SPHERE.faces), "samples").names == ("move", "fixed")


@pytest.mark.parametrize("kind", ["curvature", "edges", "triangles"])
def test_strips_are_as_good_as_the_whole(kind, monkeypatch):
    z = np.random.default_rng(0).normal(size=(40, 50))
    z[12:20, :] = np.nan  # whole strips of nothing
    z[30, 7] = np.nan
    widths = np.linspace(1.0, 1.2, 40)
    for data in (HeightField(z, spacing=(1.0, 2.0)), Image(np.stack([z, z * z], axis=2))):
        whole = measured(data, kind).values
        monkeypatch.setattr(quantity, "_STRIP", 150)
        np.testing.assert_array_equal(measured(data, kind).values, whole)
        monkeypatch.undo()
        assert np.isnan(whole[14]).all()
        assert np.isfinite(whole[30, 10])
    assert np.isfinite(measured(HeightField(np.ones((40, 50)), spacing=(widths, 2.0)), kind).values).all()


def test_two_scales_together_saturate_no_more_than_alone():
    one, other = measured(PLANE, "curvature"), measured(HeightField(PLANE.z + np.sin(COLUMNS)), "curvature")
    first, second = together(one, other)
    assert (first.low, first.high) == (second.low, second.high)
    assert first.low == min(one.low, other.low)
    assert first.high == max(one.high, other.high)


def test_a_thinned_grid_keeps_its_cuts_and_its_noise():
    cut = Cuts(np.zeros((40, 49), bool), np.zeros((39, 50), bool))
    cut.right[:, 24] = True
    body = geometry_of(replace(PLANE, cuts=cut), Look(), step=2)
    crossing = np.sort(body.samples[body.faces] % 25, axis=1)
    assert not ((crossing[:, 0] <= 12) & (crossing[:, 2] >= 13)).any()
    noisy = RangeImage(np.full((40, 50), 2.0), CAMERA, sigma=np.full((40, 50), 0.01))
    assert len(geometry_of(noisy, Look(), step=2).faces) == 2 * 19 * 24


@pytest.mark.parametrize(
    ("data", "word", "says"),
    [
        (PLANE, "colour", "one of curvature, edges, triangles, samples expected, got 'colour'"),
        (Mesh(SPHERE.points, SPHERE.faces), "edges", "all directions of a mesh are free"),
        (HeightField(np.where((ROWS + COLUMNS) % 2 == 0, 1.0, np.nan)), "curvature", "nothing to show"),
    ],
)
def test_a_quantity_that_makes_no_sense_is_refused(data, word, says):
    with pytest.raises(InputError, match=says):
        measured(data, word)


def test_an_unknown_colour_map_is_refused_with_those_that_are_like_it():
    with pytest.raises(InputError, match=r"got 'virids'; viridis"):
        measured(PLANE, "edges").wearing("virids")
    kinds = measured(PLANE, "samples")
    assert kinds.wearing("cividis") is kinds
    assert isinstance(measured(PLANE, "edges").wearing("cividis"), Scale)
