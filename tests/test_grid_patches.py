"""Lengths in the space of patches: the grid engine against the definition, written slowly, and what follows from it."""

import itertools

import naive
import numpy as np
import pytest
from scipy.ndimage import correlate1d

from meshflow.errors import InputError
from meshflow.flow.controls import Until
from meshflow.flow.engines.grid import GridFlow
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.family import Variant
from meshflow.flow.march import march
from meshflow.flow.steppers import Explicit
from meshflow.surfaces.camera import Pinhole
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.range_image import RangeImage


def scene(channels, holes, seed=0, shape=(9, 12)):
    rng = np.random.default_rng(seed)
    missing = rng.random(shape) < (0.12 if holes else 0.0)
    return Image(3 * rng.normal(size=(*shape, channels)), (1.3, 0.8), missing)


# The corners of the upper and of the lower triangle of a cell, the right-angled one first, of forward and backward diagonals.
UPPER = ((0, 0), (0, 1), (1, 0)), ((0, 1), (0, 0), (1, 1))
LOWER = ((1, 1), (1, 0), (0, 1)), ((1, 0), (1, 1), (0, 0))


def counted(there, which):
    """Of what each sample has in this triangulation, over that by which it counts in both: their mean, or 3/4 of the larger."""
    counts = []
    for corners in (UPPER[which], LOWER[which], UPPER[1 - which], LOWER[1 - which]):
        at = [np.s_[c[0] : there.shape[0] - 1 + c[0], c[1] : there.shape[1] - 1 + c[1]] for c in corners]
        present = np.logical_and.reduce([there[s] for s in at])
        counts.append(np.zeros(there.shape))
        for s in at:
            counts[-1][s] += present
    own, other = counts[0] + counts[1], counts[2] + counts[3]
    area = np.maximum((own + other) / 2, 0.75 * np.maximum(own, other))
    return np.where(area > 0, own / np.where(area > 0, area, 1), 1)


def slowly(image, alpha, variant, which):
    """du/dt (h, w, k) on one triangulation, each triangle measured in the space of patches, one after the other."""
    z, there = np.where(image.missing[..., None], 0.0, image.values), ~image.missing
    (hx, hy), (h, w, k) = image.spacing, image.values.shape
    taps = np.concatenate([variant.taps[:0:-1], variant.taps])
    pull, mass, flat = np.zeros((h, w, k)), np.zeros((h, w)), np.zeros((h, w))
    for lower in (False, True):
        p, q, r = (LOWER if lower else UPPER)[which]
        at = [np.s_[c[0] : h - 1 + c[0], c[1] : w - 1 + c[1]] for c in (p, q, r)]
        present = np.logical_and.reduce([there[s] for s in at]).astype(float)
        a, b = z[at[1]] - z[at[0]], z[at[2]] - z[at[0]]

        def mean(field, present=present):
            over = [correlate1d(correlate1d(f * present, taps, 0, mode="constant"), taps, 1, mode="constant")
                    for f in (field, np.ones_like(field))]  # fmt: skip
            return over[0] / np.where(over[1] > 0, over[1], 1)

        uu, vv, uv = (mean((x * y).sum(axis=2)) for x, y in ((a, a), (b, b), (a, b)))
        for i, j in np.argwhere(present > 0):
            slope2 = alpha**2 * (uu[i, j] / hx**2 + vv[i, j] / hy**2)
            by = alpha**2 * naive.stretch(slope2, variant.sharpness)
            x, y, xy = hx**2 + by * uu[i, j], hy**2 + by * vv[i, j], by * uv[i, j]
            cot_p, cot_q, cot_r, area = naive.cotangents_of_dots(xy, x - xy, y - xy, x * y - xy * xy)
            corners = [(i + c[0], j + c[1]) for c in (p, q, r)]
            for (m, n), cot in (((1, 2), cot_p), ((2, 0), cot_q), ((0, 1), cot_r)):
                force = 0.5 * cot * (z[corners[m]] - z[corners[n]])
                pull[corners[m]] += force
                pull[corners[n]] -= force
            for corner in corners:
                mass[corner] += area / 3
                flat[corner] += hx * hy / 6
    speed = np.where(mass > 0, flat / np.where(mass > 0, mass, 1), 1) ** variant.gamma
    if variant.gamma == -1:  # then a mean is conserved
        speed = speed * counted(there, which)
    return -pull * np.where(mass > 0, speed / np.where(mass > 0, mass, 1), 0)[..., None]


@pytest.mark.parametrize("holes", [False, True])
@pytest.mark.parametrize(("channels", "rho"), [(1, 0.3), (1, 0.7), (3, 1.0), (5, 0.7), (2, 2.1)])
def test_the_rate_is_that_of_triangles_measured_in_patches(channels, rho, holes):
    image = scene(channels, holes)
    for gamma, sharpness in itertools.product((0.0, -1.0, 0.5), (1.0, 1.5)):
        variant = Variant(gamma=gamma, sharpness=sharpness, patch=rho)
        flow = GridFlow(image.gridded(Lift(1.7)), variant)
        for turn in (0, 1):
            ours = flow.rate(flow.start(), turn).reshape(image.values.shape)
            theirs = slowly(image, 1.7, variant, turn)
            assert np.abs(ours - theirs).max() <= 1e-11 * np.abs(theirs).max()


@pytest.mark.parametrize("diagonals", ["alternate", "both"])
def test_a_patch_of_no_width_is_a_sample(diagonals):
    grid = scene(2, True).gridded(Lift(1.7, diagonals))
    plain, narrow = GridFlow(grid, Variant()), GridFlow(grid, Variant(patch=0.05))
    rates = [flow.rate(flow.start()) for flow in (plain, narrow)]
    assert np.abs(rates[0] - rates[1]).max() < 1e-13 * np.abs(rates[0]).max()


@pytest.mark.parametrize("gamma", [0.0, 1.0, -1.0])
def test_steps_as_long_as_the_bound_allows_stay_within_the_data(gamma):
    image = scene(3, True, shape=(40, 40))
    flow = GridFlow(image.gridded(Lift(5.0)), Variant(gamma=gamma, patch=0.8))
    assert gamma < 0 or flow.bound(flow.start()) == pytest.approx(max(6 / 1.3**2 + 6 / 0.8**2, 9 / 0.8**2))
    *_, last = march(flow, Until(steps=60), Explicit())
    there = ~image.missing.ravel()
    assert np.ptp(last.u[there]) <= np.ptp(flow.start()[there])
    assert last.u[there].std() < flow.start()[there].std()


@pytest.mark.parametrize("mass", ["barycentric", "ring"])
@pytest.mark.parametrize("diagonals", ["forward", "alternate", "both"])
@pytest.mark.parametrize("holes", [False, True])
def test_one_channel_is_measured_as_the_sweep_of_several_measures_it(holes, diagonals, mass):
    image = scene(1, holes, shape=(40, 30))
    beside = Image(np.concatenate([image.values, np.zeros_like(image.values)], axis=2), image.spacing, image.missing)
    for gamma, sharpness in itertools.product((-1.0, -0.5, 0.3), (1.0, 1.5)):
        variant = Variant(gamma=gamma, sharpness=sharpness, patch=0.7, mass=mass)
        one, two = (GridFlow(data.gridded(Lift(1.7, diagonals)), variant) for data in (image, beside))
        assert one.area(one.start()) == two.area(two.start())
        assert one.bound(one.start()) == two.bound(two.start())


def test_planes_with_holes_rest_in_the_space_of_patches():
    rng = np.random.default_rng(0)
    plane = 3.0 * np.mgrid[0:30, 0:40][0] - 2.0 * np.mgrid[0:30, 0:40][1]
    data = HeightField(plane, missing=rng.random((30, 40)) < 0.1)
    flow = GridFlow(data.gridded(Lift(2.0)), Variant(patch=1.0))
    assert np.abs(flow.rate(flow.start())).max() < 1e-13 * np.abs(plane).max()


def test_bands_and_threads_do_not_show():
    z = np.random.default_rng(0).normal(size=(400, 300)).astype(np.float32)
    grid = HeightField(z, missing=z > 2).gridded(Lift(2.0))
    one, two = (GridFlow(grid, Variant(patch=0.7), threads) for threads in (1, 2))
    assert np.array_equal(one.rate(one.start()), two.rate(two.start()))
    part = HeightField(z[:260], missing=z[:260] > 2).gridded(Lift(2.0))  # another height, other bands
    cut = GridFlow(part, Variant(patch=0.7))
    rates = [flow.rate(flow.start()).reshape(-1, 300)[:250] for flow in (one, cut)]
    assert np.array_equal(*rates)


def test_patches_lower_the_error_of_the_flow_on_a_noisy_terrain():
    rng = np.random.default_rng(0)
    r, c = np.mgrid[0:128, 0:128] / 128
    truth = 30 * np.sin(9 * r) * np.cos(7 * c)
    image = Image(truth + 2 * rng.normal(size=truth.shape))
    errors = []
    for rho in (0.0, 0.7):
        flow = GridFlow(image.gridded(Lift(1.0)), Variant(patch=rho))
        errors.append(min(np.std(s.u.reshape(truth.shape) - truth) for s in march(flow, Until(time=5.0))))
    assert errors[1] < 0.85 * errors[0], f"rms error {errors[0]:.3f} of samples, {errors[1]:.3f} of patches"


@pytest.mark.parametrize("rho", [-1.0, np.nan, np.inf, 7.0])
def test_a_patch_that_is_none_is_refused(rho):
    with pytest.raises(InputError, match="patch: a (width between 0 and 6 samples|finite number)"):
        Variant(patch=rho)


def test_patches_are_refused_where_there_are_none():
    image = scene(2, False)
    with pytest.raises(InputError, match="on a mesh samples have no patches"):
        MeshFlow(image.lifted(Lift()), Variant(patch=1.0))
    depth = RangeImage(np.ones((5, 5)), Pinhole(10, 10, 2, 2))
    with pytest.raises(InputError, match="along rays samples have no patches"):
        GridFlow(depth.gridded(Lift()), Variant(patch=1.0))
