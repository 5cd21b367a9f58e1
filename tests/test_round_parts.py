"""Round parts come from a short run where a long one leaves facets; flat parts and creases stay as the long run left them."""

import numpy as np
import pytest

import meshflow
from meshflow.flow.round_parts import with_round_parts
from meshflow.geometry.normals import measured
from meshflow.synthetic import shapes

PART, CUBE = shapes.part(0.03), shapes.cube(16)
SIGMA = 0.3


def moved(shape, along):
    """The points of a shape, moved along its normals by some mean edges."""
    return shape.points + (shape.edge * along)[:, None] * shape.normals()


def of_walls(shape, kind):
    """Masks of the vertices of the round walls of the part and of no others (``round``), or of its flat sides alone."""
    normals, _ = measured(shape.points, shape.faces)
    around = np.abs(normals).max(axis=1) < 1.0 - 1e-6
    counts = [np.bincount(shape.faces[mask].ravel(), minlength=len(shape.points)) for mask in (around, ~around)]
    return (counts[0] > 0) & (counts[1] == 0) if kind == "round" else counts[0] == 0


def noise(shape, seed, size):
    return size * np.random.default_rng(seed).normal(size=len(shape.points))


def test_what_a_long_run_has_moved_on_round_walls_is_taken_from_the_short_one_and_nothing_on_flat_sides():
    around, flat = of_walls(PART, "round"), of_walls(PART, "flat")
    long = moved(PART, np.where(around, 0.8 * SIGMA, 0.0))
    short, data = (moved(PART, noise(PART, seed, size)) for seed, size in ((1, 0.1 * SIGMA), (2, SIGMA)))
    found = with_round_parts(long, short, data, PART.faces, SIGMA * PART.edge)
    off = [np.sqrt(np.mean(np.square(PART.distance(points[around])))) for points in (long, found)]
    assert off[1] < 0.5 * off[0]
    assert np.mean(np.any(found != long, axis=1)[flat]) < 0.1
    assert np.array_equal(with_round_parts(long, long, data, PART.faces, SIGMA * PART.edge), long)


def test_where_the_short_run_is_farther_from_the_data_as_at_creases_it_is_not_taken():
    beside = np.sum(np.abs(CUBE.points) > 0.43, axis=1) > 1
    short, data = moved(CUBE, np.where(beside, -0.8 * SIGMA, 0.0)), moved(CUBE, noise(CUBE, 3, SIGMA))
    found = with_round_parts(CUBE.points, short, data, CUBE.faces, SIGMA * CUBE.edge)
    assert np.sqrt(np.mean(np.square(CUBE.distance(found)))) < 0.02 * SIGMA * CUBE.edge


@pytest.mark.parametrize("seed", [2, 4])
def test_by_default_the_walls_of_a_noisy_part_are_nearer_to_the_truth_than_by_the_long_run_alone(seed, monkeypatch):
    points, around, off = PART.noisy("nrm", 0.2, seed), of_walls(PART, "round"), []
    for alone in (False, True):
        if alone:
            monkeypatch.setattr("meshflow.results.run.with_round_parts", lambda long, *others: long)
        after = meshflow.smooth((points, PART.faces))[0]
        off.append(np.sqrt(np.mean(np.square(PART.distance(after[around])))))
    assert off[0] < 0.8 * off[1]
