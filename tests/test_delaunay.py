"""Lengths alone: mollified, and flipped until Delaunay. meshflow.geometry.delaunay."""

import igl
import numpy as np
import pytest
from helpers.shapes import soup, sphere, square

from meshflow.geometry import operator
from meshflow.geometry.connectivity import connect
from meshflow.geometry.delaunay import delaunay, length_cotangents, mollified
from meshflow.geometry.normals import side_lengths


def stretched(points):
    """A thing whose triangles are mostly obtuse."""
    return points * np.r_[1.0, 0.15, 1.0][: points.shape[1]]


def matrix(faces, lengths, n):
    return operator.fill_stiffness(connect((faces,), n), length_cotangents(lengths)[0])


@pytest.mark.parametrize("d", [2, 3, 4, 5])
def test_lengths_give_the_cotangents_of_points_in_every_dimension(d):
    points, faces = soup(d=d)[:2]
    cot, area = operator.cotangents(points, faces)
    by_lengths = length_cotangents(side_lengths(points, faces))
    assert np.allclose(by_lengths[0], cot, rtol=1e-7, atol=1e-9)
    assert np.allclose(by_lengths[1], area, rtol=1e-7)


@pytest.mark.parametrize("shape", [sphere, square])
def test_all_weights_are_above_zero_and_the_surface_is_the_same(shape):
    points, faces = shape(400)[:2]
    points = stretched(points)
    n, lengths = len(points), side_lengths(points, faces)
    before = matrix(faces, lengths, n)
    before.setdiag(0)
    assert before.data.max() > 0.1
    flipped, new = delaunay(faces, lengths)
    weights = matrix(flipped, new, n).tocoo()
    inner = weights.row != weights.col
    rim = np.zeros(n, bool)
    c = connect((faces,), n)
    for turn in (1, 2):
        rim[c.faces[c.border // 3, (c.border + turn) % 3]] = True
    inside = inner & ~(rim[weights.row] & rim[weights.col])
    assert weights.data[inside].max() < 1e-9
    assert length_cotangents(new)[1].sum() == pytest.approx(length_cotangents(lengths)[1].sum(), rel=1e-9)
    assert len(flipped) == len(faces)


def test_it_is_that_of_libigl():
    points, faces, *_ = sphere(300)
    points = stretched(points)
    ours = matrix(*delaunay(faces, side_lengths(points, faces)), len(points))
    lengths, flipped = igl.intrinsic_delaunay_triangulation(igl.edge_lengths(points, faces), faces)[:2]
    theirs = matrix(np.asarray(flipped), np.asarray(lengths), len(points))
    assert abs(ours - theirs).max() < 1e-8


def test_every_triangle_has_some_area_afterwards_and_good_ones_are_left_alone():
    points, faces, *_ = sphere(200)
    lengths = side_lengths(points, faces)
    assert np.array_equal(mollified(lengths), lengths)
    flat = np.array([[1.0, 2.0, 3.0], [0.0, 1.0, 1.0]])
    grown = mollified(flat)
    assert (length_cotangents(grown)[1] > 0).all()
    assert (grown - flat).max() < 2e-5 * flat.mean()


def test_borders_creases_of_three_and_turned_triangles_are_left_alone():
    faces = np.array([[0, 1, 2], [0, 1, 3], [1, 0, 4]])
    points = np.random.default_rng(0).normal(size=(5, 3))
    flipped, lengths = delaunay(faces, side_lengths(points, faces))
    assert np.array_equal(flipped, faces)
    assert np.array_equal(lengths, side_lengths(points, faces))
