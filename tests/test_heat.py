"""The heat equation is linear, and is the Gaussian up to the discretisation: on grids, images and meshes."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.ndimage import gaussian_filter
from scipy.spatial import Delaunay

import meshflow
from meshflow.errors import InputError
from meshflow.flow.compute import Compute
from meshflow.flow.engines.grid import GridFlow
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.family import Variant
from meshflow.geometry.operator import mass, stiffness
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.image import Image

FINE = Compute(stepper="explicit", dt=0.05)


def rms(a):
    return float(np.sqrt(np.mean(np.square(a))))


def step(height, size=96):
    y, x = np.mgrid[0:size, 0:size]
    return height * (x + 0.3 * y > 0.6 * size) + np.random.default_rng(0).normal(size=(size, size))


@pytest.mark.parametrize("height", [0.0, 200.0, 1e6])
def test_after_time_eight_it_is_the_gaussian_up_to_the_discretisation(height):
    z, inner = step(height), (slice(20, -20), slice(20, -20))
    found = meshflow.smooth(z, method="heat", time=8.0, boundary="neumann", compute=FINE)
    gauss = gaussian_filter(z, 4.0, mode="nearest", truncate=8.0)
    assert rms((found - gauss)[inner]) < 0.02 * rms((z - gauss)[inner])
    # The stencil itself, exactly: exp(8 Laplacian) of the five points.
    k = np.fft.fftfreq(128)
    symbol = -4 * np.sin(np.pi * k) ** 2
    spread = np.zeros((128, 128))
    spread[16:112, 16:112] = z
    exact = np.fft.ifft2(np.fft.fft2(spread) * np.exp(8.0 * (symbol[:, None] + symbol[None]))).real[16:112, 16:112]
    deep = (slice(40, -40), slice(40, -40))
    assert rms((found - exact)[deep]) < 0.005 * rms((z - exact)[deep]) + 1e-3


@pytest.mark.parametrize("shape", [(20, 24), (20, 24, 3)])
@pytest.mark.parametrize("boundary", ["neumann", "plane-preserving"])
def test_it_is_linear_on_grids(shape, boundary):
    draw = np.random.default_rng(1)
    one, other = draw.normal(size=shape), 50 * (draw.random(shape) > 0.5)
    grid = {"diagonals": "both", "boundary": boundary}

    def run(values):
        flow = GridFlow(Image(values).gridded(Lift(**grid)), Variant(linear=True))
        return flow.rate(flow.start())

    assert np.allclose(run(2 * one - 3 * other), 2 * run(one) - 3 * run(other), atol=1e-10)
    surface = Image(one).lifted(Lift(contrast=7.0, **grid))
    assert np.allclose(MeshFlow(surface, Variant(linear=True)).rate(surface.start), run(one), atol=1e-12)


def test_the_contrast_and_the_other_channels_make_no_difference():
    draw = np.random.default_rng(2)
    image = draw.normal(size=(20, 20, 3)) * [1, 100, 1e4]
    found = meshflow.smooth(image, method="heat", time=2.0)
    for i in range(3):
        # A channel alone may be laid down turned, and is then moved on the other diagonals; the stencil has none.
        alone = meshflow.smooth(image[..., i : i + 1], method="heat", time=2.0)
        assert np.allclose(found[..., i], alone[..., 0], rtol=1e-2, atol=0.01 * 100**i)


def test_on_a_mesh_it_is_the_heat_equation_of_the_surface():
    draw = np.random.default_rng(3)
    flat = draw.random((60, 2))
    points, faces = np.column_stack([flat, 0.1 * np.sin(5 * flat[:, 0])]), Delaunay(flat).simplices
    values = 100.0 * draw.normal(size=60)
    exact = expm(-0.01 * stiffness(points, faces).toarray() / mass(points, faces)[:, None]) @ values
    found = meshflow.smooth(
        (points, faces), channels=values, method="heat", time=0.01, boundary="neumann",
        compute=Compute(stepper="semi-implicit", dt=2e-5),
    )[2]  # fmt: skip
    assert rms(found - exact) < 5e-3 * rms(values - exact)


def test_it_refuses_a_contrast_and_rays_and_reports_none():
    z = step(1.0, 24)
    with pytest.raises(InputError, match="no contrast, got 2"):
        meshflow.Heat(contrast=2.0)
    found = meshflow.smooth(z, method="heat", result=True)
    assert "contrast" not in found.parameters
    depth = 2.0 + 0.01 * z
    words = {"camera": meshflow.Pinhole(30.0, 30.0, 12.0, 12.0)}
    with pytest.raises(InputError, match="domain='disparity'"):
        meshflow.smooth(depth, method="heat", time=1.0, **words)
    meshflow.smooth(depth, method="heat", time=1.0, domain="disparity", **words)
