"""The mean offsets of a smoothed mesh from its data are put back, and with them its volume and its distance from the truth."""

import numpy as np
import pytest

import meshflow
from meshflow.evaluate.metrics import normal_angle, volume
from meshflow.flow.offsets import without_offsets
from meshflow.geometry.normals import measured
from meshflow.synthetic import shapes


def free(shape):
    return np.zeros(len(shape.points), bool)


@pytest.mark.parametrize("shape", [shapes.cube(12), shapes.plate(30), shapes.sphere(3)], ids=["cube", "plate", "ball"])
def test_a_shape_that_shrank_gets_its_size_back(shape):
    edges = np.ptp(shape.points, axis=0)
    shrunk = shape.points * ((edges - 0.2 * shape.edge) / edges)
    after = without_offsets(shrunk, shape.points, shape.faces, free(shape))
    assert np.sqrt(np.mean(np.square(shape.distance(after)))) < 0.03 * np.sqrt(
        np.mean(np.square(shape.distance(shrunk)))
    )
    assert abs(volume(shape.points, shape.faces) - volume(after, shape.faces)) < 0.05 * abs(
        volume(shape.points, shape.faces) - volume(shrunk, shape.faces)
    )


def test_offsets_of_several_edges_are_put_back_to_a_hundredth_of_an_edge():
    shape = shapes.sphere(3)
    after = without_offsets(0.7 * shape.points, shape.points, shape.faces, free(shape))
    assert np.abs(np.linalg.norm(after, axis=1) - 1.0).max() < 0.02 * shape.edge


def test_noise_is_not_put_back_and_flat_sides_stay_flat():
    shape = shapes.cube(16)
    after = without_offsets(shape.points, shape.noisy("nrm", 0.3), shape.faces, free(shape))
    assert normal_angle(after, shape.points, shape.faces) < 0.3
    assert np.sqrt(np.mean(np.square(shape.distance(after)))) < 0.03 * shape.edge


def test_held_points_stay_to_the_bit_and_what_has_no_offset_stays_at_rest():
    shape = shapes.part(0.05)
    rng = np.random.default_rng(0)
    held = rng.random(len(shape.points)) < 0.3
    shrunk = 0.98 * shape.points
    after = without_offsets(shrunk, shape.points, shape.faces, held)
    assert np.array_equal(after[held], shrunk[held])
    assert not np.array_equal(after[~held], shrunk[~held])
    assert np.array_equal(without_offsets(shape.points, shape.points, shape.faces, free(shape)), shape.points)


def test_triangles_without_area_and_open_borders_give_finite_points():
    shape = shapes.dome(300)
    points = shape.points.copy()
    points[shape.faces[0]] = points[shape.faces[0, 0]]
    after = without_offsets(points, shape.points, shape.faces, free(shape))
    assert np.isfinite(after).all()
    assert (measured(after, shape.faces)[1] > 0).mean() > 0.98


# Noise in mean edges, and how far the volume may be from that of the noisy mesh, whose own is 0.6 % off for the cube and 1.4 %
# for the plate, which is thinner than an edge (deviations over 12 seeds). Before they were 0.7 % and 5 % too small.
VOLUMES = [
    (shapes.cube(16), "iso", 0.3, 0.003),
    (shapes.plate(30), "iso", 0.3, 0.012),
    (shapes.plate(30), "nrm", 0.3, 0.006),
    (shapes.sphere(3), "iso", 0.3, 0.003),
]


@pytest.mark.long
@pytest.mark.parametrize(("shape", "kind", "level", "most"), VOLUMES)
def test_by_default_the_volume_is_that_of_the_noisy_mesh(shape, kind, level, most):
    points = shape.noisy(kind, level, 11)
    result = meshflow.smooth((points, shape.faces), result=True)
    assert result.parameters["offsets"].value == "removed"
    change = volume(result.data[0], shape.faces) / volume(points, shape.faces) - 1.0
    assert abs(change) < most, f"{100 * change:.2f} %"


@pytest.mark.parametrize("constraint", [meshflow.PreserveVolume(), meshflow.MaxChange(0.002)], ids=["volume", "change"])
def test_constraints_of_the_caller_come_before_offsets_and_folds(constraint):
    shape = shapes.cube(10)
    points = shape.noisy("iso", 0.2)
    after = meshflow.smooth((points, shape.faces), constraints=[constraint])[0]
    if isinstance(constraint, meshflow.MaxChange):
        assert np.linalg.norm(after - points, axis=1).max() <= 0.002 * (1 + 1e-9)
    else:
        assert volume(after, shape.faces) == pytest.approx(volume(points, shape.faces), rel=1e-9)
