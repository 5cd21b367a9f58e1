"""Turned, mirrored and relabelled data gives the turned, mirrored and relabelled result, in every method."""

import numpy as np
import pytest
from helpers.shapes import sphere
from scipy.spatial import Delaunay

import meshflow
from meshflow.estimate.vertex_numbers import signs_of
from meshflow.flow.methods import HEIGHT_METHODS, METHODS, POINT_METHODS
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.orientation import Orientation

# Every other way is one of these after another.
WAYS = [
    Orientation(True, False, False),
    Orientation(False, True, False),
    Orientation(False, False, True),
    Orientation(True, True, False),
]
OF_GRIDS = ["search", "quick", *(kind.word for kind in HEIGHT_METHODS)]
OF_CHANNELS = ["search", "quick", *(kind.word for kind in HEIGHT_METHODS if not kind().misfit(False, False))]
OF_POINTS = ["search", "quick", *(kind.word for kind in POINT_METHODS)]
# Rounding, as a share of the largest change: sums run in another order, and methods with thresholds carry it on.
ROUNDING = 2e-9


def test_every_method_is_looked_at():
    assert set(OF_GRIDS) | set(OF_POINTS) == set(METHODS)


def same(here, there, start):
    moved = np.nanmax(np.abs(here - start)) or 1.0  # a search may leave the data as it is: then both ways
    worst = np.nanmax(np.abs(here - there)) / moved
    assert worst < ROUNDING, f"{worst:.1e} of the largest change"


@pytest.mark.long
@pytest.mark.parametrize("method", OF_GRIDS)
@pytest.mark.parametrize("channels", [0, 3])
def test_a_grid_may_lie_any_way(method, channels):
    draw = np.random.default_rng(0)
    y, x = np.mgrid[0:18, 0:23]
    z = 10.0 * (x + 2 * y > 30) + 0.2 * x + draw.normal(size=(18, 23))
    z = z[..., None] * np.linspace(0.5, 1.0, channels) + draw.normal(size=(18, 23, channels)) if channels else z
    z[5:8, 10:12] = np.nan
    here = meshflow.smooth(z, method=method, noise=1.0)
    for way in WAYS:
        there = meshflow.smooth(np.ascontiguousarray(way.of(z)), method=method, noise=1.0)
        same(here, way.inverse.of(there), z)


def relabelled(points, faces, draw):
    """The same surface with other numbers of its vertices and faces, other first corners, and the other winding."""
    order = draw.permutation(len(points))
    number = np.argsort(order)
    other = number[faces][draw.permutation(len(faces))]
    other = np.stack([np.roll(face, draw.integers(3)) for face in other])[:, ::-1]
    return order, points[order], np.ascontiguousarray(other)


def shapes():
    """A closed ball and an open sheet with an edge and irregular triangles."""
    draw = np.random.default_rng(1)
    points, faces = sphere(250)
    yield points * (1 + 0.02 * draw.normal(size=(len(points), 1))), faces
    flat = np.vstack([draw.random((200, 2)), [(0, 0), (0, 1), (1, 0), (1, 1)]])
    height = 0.3 * np.abs(flat[:, 0] - 0.5) + 0.01 * draw.normal(size=len(flat))
    yield np.column_stack([flat, height]), Delaunay(flat).simplices


SHAPES = list(shapes())


@pytest.mark.long
@pytest.mark.parametrize("method", OF_POINTS)
@pytest.mark.parametrize(("points", "faces"), SHAPES, ids=["ball", "sheet"])
def test_vertices_and_faces_of_a_mesh_may_have_any_number_and_winding(method, points, faces):
    order, moved, other = relabelled(points, faces, np.random.default_rng(2))
    here = meshflow.smooth((points, faces), method=method)[0]
    there = meshflow.smooth((moved, other), method=method)[0]
    same(here[order], there, moved)


@pytest.mark.long
@pytest.mark.parametrize("method", OF_CHANNELS)
@pytest.mark.parametrize(("points", "faces"), SHAPES, ids=["ball", "sheet"])
def test_so_may_those_of_a_mesh_whose_channels_move(method, points, faces):
    values = np.column_stack([points[:, 0] > 0.4, points[:, 1]]) + 0.1 * np.random.default_rng(3).normal(
        size=(len(points), 2)
    )
    order, moved, other = relabelled(points, faces, np.random.default_rng(4))
    here = meshflow.smooth(Mesh(points, faces, values), method=method).channels
    there = meshflow.smooth(Mesh(moved, other, values[order]), method=method).channels
    same(here[order], there, values[order])


@pytest.mark.parametrize("even", [False, True])
def test_the_signs_of_a_probe_are_as_random_as_they_should_be(even):
    draw = np.random.default_rng(5)
    y, x = np.mgrid[0:60, 0:60] + (0.0 if even else 0.2 * draw.normal(size=(2, 60, 60)))
    points = np.column_stack([x.ravel(), y.ravel()])
    faces = Delaunay(points).simplices
    signs = signs_of(points, faces, draw.normal(size=(len(points), 20)))
    few = 4.0 / np.sqrt(len(points))  # four standard errors
    assert np.abs(signs.mean(axis=0)).max() < few
    between = np.abs(signs.T @ signs / len(points) - np.eye(20))
    assert np.delete(between, [16, 17, 18, 19], axis=0)[:, :16].max() < few
    assert np.abs((signs[faces[:, 0]] * signs[faces[:, 1]]).mean(axis=0)).max() < few
