"""A mesh of which a region has no noise: it stays, and the noise of the other is found and goes."""

import numpy as np
import pytest

import meshflow
from meshflow.estimate.mesh_regions import clean_region
from meshflow.evaluate.metrics import normal_angle
from meshflow.synthetic import shapes

BALL, RING, CUBE, PART = shapes.sphere(4), shapes.ring(100, 40), shapes.cube(20), shapes.part(0.03)


def partly_noisy(shape, level, share, seed):
    """Points with noise along the normals on the share with the greatest x, and the mask of these."""
    x = shape.points[:, 0]
    noisy = x > np.quantile(x, 1.0 - share)
    off = level * shape.edge * np.random.default_rng(seed).normal(size=len(x)) * noisy
    return shape.points + off[:, None] * shape.normals(), noisy


@pytest.mark.parametrize("share", [0.2, 0.5])
@pytest.mark.parametrize("shape", [BALL, RING], ids=["ball", "ring"])
def test_the_clean_region_stays_and_the_noisy_one_gains(shape, share):
    points, noisy = partly_noisy(shape, 0.2, share, 1)
    result = meshflow.smooth((points, shape.faces), result=True)
    after = result.data[0]
    moved = np.linalg.norm(after - points, axis=1) / shape.edge
    assert np.mean(moved[~noisy] == 0) > 0.8
    assert moved[~noisy].max() < 0.1
    loud = shape.faces[noisy[shape.faces].all(axis=1)]
    before, left = (normal_angle(x, shape.points, loud) for x in (points, after))
    assert left < 0.1 * before
    assert result.plan is not None
    assert result.plan.noise.sigma == pytest.approx(0.2 * shape.edge, rel=0.15)


@pytest.mark.parametrize("shape", [BALL, RING, CUBE, PART], ids=["ball", "ring", "cube", "part"])
def test_no_region_is_clean_where_noise_is_everywhere_or_nowhere(shape):
    draw = np.random.default_rng(2)
    spikes = draw.normal(size=len(shape.points)) * (draw.random(len(shape.points)) < 0.05)
    of_spikes = shape.points + (0.5 * shape.edge * spikes)[:, None] * shape.normals()
    for points in (shape.points, shape.noisy("nrm", 0.1, 2), shape.noisy("iso", 0.4, 2), of_spikes):
        assert not np.any(clean_region(points, shape.faces)[0])
