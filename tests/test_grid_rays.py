"""Range images on the grid: the fused loops along lines in space beside the coupled ones, the mesh engine, and dense truth."""

import itertools

import numpy as np
import pytest

from meshflow.flow.controls import Until
from meshflow.flow.engines.grid import GridFlow
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.family import Variant
from meshflow.flow.march import march
from meshflow.flow.steppers import SuperTime
from meshflow.surfaces.camera import Orthographic, Pinhole
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.range_image import RangeImage
from meshflow.surfaces.scanner import Spherical

H, W = 13, 17
GAMMAS, MASSES = (0.0, 1.0, -1.0, -2.0, 0.5), ("barycentric", "ring")
CAMERAS = {
    "pinhole": Pinhole(30, 28, 8.3, 6.2),
    "lens": Pinhole(30, 28, 8.3, 6.2, (0.1, -0.02, 0.001, 0.002)),
    "orthographic": Orthographic(0.07, 0.06),
    "spherical": Spherical((30.0, -30.0), (20.0, -20.0)),
}


def scene(camera, shape=(H, W), seed=0, noise=0.01):
    """Depths with ragged holes, a jump, and samples that stay."""
    rng = np.random.default_rng(seed)
    missing, fixed = rng.random(shape) < 0.06, rng.random(shape) < 0.05
    y, x = np.mgrid[0 : shape[0], 0 : shape[1]] / max(shape)
    depth = 2 / (1 + 0.3 * x - 0.2 * y) + noise * rng.normal(size=shape)
    depth[shape[0] // 2 :, : shape[1] // 3] += 1
    return RangeImage(depth, camera, missing, fixed)


def slowly(grid, variant):
    """The engine by way of its loops for any coordinates."""
    flow = GridFlow(grid, variant)
    assert flow._by_rays
    flow._by_rays, flow._by_forms = False, True
    return flow


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("boundary", ["neumann", "plane-preserving", "fixed"])
@pytest.mark.parametrize("diagonals", ["forward", "backward", "both", "alternate"])
def test_scalars_along_the_rays_are_what_whole_pulls_give(camera, boundary, diagonals):
    data, lift = scene(CAMERAS[camera]), Lift(1.0, diagonals, boundary)
    for gamma, mass in itertools.product(GAMMAS, MASSES):
        variant = Variant(gamma=gamma, mass=mass)
        ours, theirs = GridFlow(data.gridded(lift), variant), slowly(data.gridded(lift), variant)
        mesh, u = MeshFlow(data.lifted(lift), variant), ours.start()
        for turn in (0, 1):
            rate, other, truth = ours.rate(u, turn), theirs.rate(u, turn), mesh.rate(mesh.start(), turn)
            scale = np.abs(truth).max()
            assert np.abs(rate - truth).max() <= 1e-12 * scale, f"gamma {gamma}, {mass}"
            assert np.abs(rate - other).max() <= 1e-12 * scale, f"gamma {gamma}, {mass}"
            assert (rate[(data.missing | data.fixed).ravel()] == 0).all()
        assert ours.area(u) == pytest.approx(mesh.area(mesh.start()), rel=1e-12)


@pytest.mark.long
@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("noise", [0.0, 0.003, 0.02])
@pytest.mark.parametrize("mass", MASSES)
def test_the_bound_without_the_indicator_holds_and_is_tight(camera, noise, mass):
    for gamma, seed in itertools.product((0.0, 0.5, 1.0, -1.0), range(3)):
        data, variant = scene(CAMERAS[camera], (9, 11), seed, noise), Variant(gamma=gamma, mass=mass)
        for diagonals in ("alternate", "both"):
            grid = data.gridded(Lift(1.0, diagonals, "neumann"))
            flow, u = GridFlow(grid, variant), GridFlow(grid, variant).start()
            bound, measured = flow.bound(u), slowly(grid, variant).bound(u)
            for turn in (0, 1):
                system = flow.system(u, turn)
                matrix = (system.matrix(1.0) - system.matrix(0.0)).toarray() / system.mass[:, None]
                assert np.abs(np.linalg.eigvals(matrix)).max() <= bound * (1 + 1e-9)
            assert measured * (1 - 1e-9) <= bound
            assert bound <= 1.5 * measured
            if gamma <= 0:
                assert bound == pytest.approx(measured, rel=1e-9)


@pytest.mark.parametrize("gamma", GAMMAS)
@pytest.mark.parametrize("diagonals", ["alternate", "both"])
def test_planes_with_ragged_holes_rest_whatever_the_power(gamma, diagonals):
    camera, shape = Pinhole(120, 118, 40.3, 31.2), (60, 80)
    x, y = np.moveaxis(camera.rays(shape), 2, 0)[:2]
    depth = 2 / (1 + 0.5 * x - 0.3 * y)
    data = RangeImage(depth, camera, np.random.default_rng(0).random(shape) < 0.1)
    flow = GridFlow(data.gridded(Lift(1.0, diagonals, "plane-preserving")), Variant(gamma=gamma))
    for turn in (0, 1):
        dt = 2 / flow.bound(flow.start())
        assert dt * np.abs(flow.rate(flow.start(), turn)).max() < 1e-12 * depth.max()


def test_the_longest_explicit_step_is_asked_for_once_a_step():
    flow = GridFlow(scene(CAMERAS["pinhole"], (40, 50)).gridded(Lift()))
    calls, bound = [], flow.bound
    flow.bound = lambda u: calls.append(1) or bound(u)
    *_, last = march(flow, Until(time=15.0), SuperTime())
    assert last.step > 5
    assert len(calls) <= last.step + 3, f"{len(calls)} calls in {last.step} steps"


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("gamma", [0.0, 1.0, -1.0])
def test_bounds_areas_and_rates_have_the_same_bits_with_any_number_of_threads(dtype, gamma):
    data = scene(Pinhole(300, 300, 150, 120), (240, 300))  # several bands
    data = RangeImage(data.depth.astype(dtype), data.camera, data.missing)
    flows = [GridFlow(data.gridded(Lift()), Variant(gamma=gamma), threads) for threads in (1, 2, 5)]
    u = flows[0].start()
    assert len({(flow.bound(u), flow.area(u), flow.rate(u).tobytes()) for flow in flows}) == 1
