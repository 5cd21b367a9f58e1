"""Borders of meshes whose points move: as a curve, free, fixed, linear; holes and what is no manifold."""

import numpy as np
import pytest
from helpers.parts import parts
from helpers.shapes import sphere, square
from scipy.linalg import expm
from scipy.spatial import Delaunay

from meshflow.errors import InputError
from meshflow.flow.blend import euler
from meshflow.flow.compute import Compute
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.methods import NormalChannels, NormalFilter, PrincipalFlow
from meshflow.flow.methods.border_curve import Bordered
from meshflow.flow.methods.points import PointSetting
from meshflow.geometry.connectivity import connect
from meshflow.smoothing import smooth
from meshflow.surfaces.surface import Surface

BORDERS = ("border-curve", "neumann", "fixed", "plane-preserving")


def disc(around=60, inside=300, seed=0):
    """A flat unit disc with an irregular rim; points, faces, and the mask of the rim."""
    rng = np.random.default_rng(seed)
    angles = 2 * np.pi * (np.arange(around) + rng.uniform(-0.3, 0.3, around)) / around
    i = np.arange(inside) + 0.5
    radii, turns = 0.88 * np.sqrt(i / inside), np.pi * (1 + 5**0.5) * i + rng.uniform(-0.02, 0.02, inside)
    rim = np.stack([np.cos(angles), np.sin(angles)], 1)
    flat = np.concatenate([rim, radii[:, None] * np.stack([np.cos(turns), np.sin(turns)], 1)])
    faces = Delaunay(flat).simplices
    return np.column_stack([flat, np.zeros(len(flat))]), faces, np.arange(len(flat)) < around


def bow_tie():
    """Two sheets that touch in one vertex, 0."""
    one, two = np.array([[0, 0], [1, 1], [2, 0.5], [1, 0], [2, 1.5], [0.5, 1.5]]), None
    two = -one[1:]
    points = np.column_stack([np.concatenate([one, two]), np.zeros(11)])
    faces = np.array([[0, 3, 1], [3, 2, 1], [1, 2, 4], [0, 1, 5], [0, 8, 6], [8, 7, 6], [6, 7, 9], [0, 6, 10]])
    return points, faces


def book():
    """Three pages of two triangles at one edge, 0 1."""
    points = [[0, 0, 0], [0, 0, 1]]
    faces = []
    for angle in (0.0, 2.0, 4.0):
        out = np.array([np.cos(angle), np.sin(angle), 0.0])
        points += [out * 1.1, out + [0, 0, 1.2]]
        faces += [[0, len(points) - 2, 1], [1, len(points) - 2, len(points) - 1]]
    return np.array(points, float), np.array(faces)


@pytest.mark.parametrize("stepper", ["explicit", "super-time", "semi-implicit"])
def test_a_round_border_shrinks_as_a_curve_does(stepper):
    points, faces, rim = disc()
    step = {"dt": 0.001} if stepper == "semi-implicit" else {}
    found = smooth(
        (points, faces), **parts(method="curvature", boundary="border-curve", time=0.05, stepper=stepper, **step)
    )[0]
    radii = np.linalg.norm(found[rim], axis=1)
    assert radii == pytest.approx(np.sqrt(1 - 0.1), rel=4e-3)
    assert np.abs(found[:, 2]).max() == 0


@pytest.mark.parametrize(
    "way", [{"method": "curvature"}, {"method": "fairing", "search": False}, {"method": "conformal"}]
)
def test_a_straight_border_rests_however_irregular(way):
    points, faces, _ = square(300)
    rng = np.random.default_rng(1)
    corner = (np.abs(points[:, :2] - 0.5) > 0.4999).all(axis=1)
    slid = points.copy()
    for axis in (0, 1):  # along the sides, the order kept
        on = (np.abs(points[:, 1 - axis] - 0.5) > 0.4999) & ~corner
        slid[on, axis] += rng.uniform(-0.3, 0.3, on.sum()) / 19
    found = smooth((slid, faces), **parts(boundary="border-curve", time=0.01, fixed=corner, **way))[0]
    assert np.abs(found - slid).max() < 1e-12


def test_a_noisy_border_becomes_smooth_where_a_natural_one_gives_way():
    points, faces, rim = disc(120, 1500)
    noisy = points.copy()
    noisy[rim] *= 1 + 0.01 * np.random.default_rng(2).normal(size=(120, 1))

    z = noisy[rim, 0] + 1j * noisy[rim, 1]

    def drawn(z):
        """The curvature vector -A z of a closed curve, as a matrix."""
        lengths, i = np.abs(np.roll(z, -1) - z), np.arange(len(z))
        stiff = np.zeros((len(z), len(z)))
        stiff[i, (i + 1) % len(z)] = stiff[(i + 1) % len(z), i] = -1.0 / lengths
        stiff -= np.diag(stiff.sum(axis=1))
        return stiff / (0.5 * (lengths + np.roll(lengths, 1)))[:, None]

    def rough(x):
        radii = np.linalg.norm(x[rim], axis=1)
        return radii.std(), radii.mean()

    free, curve = (
        smooth((noisy, faces), method="curvature", time=0.004, boundary=b)[0] for b in ("neumann", "border-curve")
    )
    linear = smooth((noisy, faces), method="curvature", time=0.004, boundary="plane-preserving")[0]
    # What a curve of these points keeps of white noise: exp(-t A) of a round one, up to what the noise adds to its lengths.
    kept = np.abs(expm(-0.004 * drawn(points[rim, 0] + 1j * points[rim, 1])) @ z).std()
    assert kept / rough(noisy)[0] == pytest.approx(0.365, abs=1e-3)
    assert rough(curve)[0] == pytest.approx(kept, rel=0.04)
    assert rough(linear)[0] == pytest.approx(rough(noisy)[0], rel=1e-6)  # a flat sheet rests, outline and all
    assert rough(free)[1] < rough(curve)[1] < rough(noisy)[1]
    faired = smooth(
        (noisy, faces), method="fairing", time=0.004, boundary="border-curve", compute=Compute(search=False)
    )[0]
    # A filter is linear: 1 / (1 + (t A)^2) of the curve as it came.
    filtered = np.linalg.solve(np.eye(120) + np.linalg.matrix_power(0.004 * drawn(z), 2), z)
    assert rough(faired)[0] == pytest.approx(np.abs(filtered).std(), rel=1e-6)


def test_the_rate_of_what_is_inside_is_that_of_the_flow_and_a_step_that_of_the_rate():
    points, faces, rim = disc()
    points = points + 0.05 * np.random.default_rng(3).normal(size=points.shape)
    surface = Surface(points, (faces,), boundary="fixed")
    inside = MeshFlow(surface)
    flow = Bordered(inside, surface)
    rate, dt = flow.rate(points), 1.0 / flow.bound(points)
    assert np.array_equal(rate[~rim], inside.rate(points)[~rim])
    assert (np.abs(rate[rim]).max(axis=1) > 0).all()
    assert np.allclose(flow.rate(points, 0, euler(dt)), points + dt * rate, atol=1e-14)
    assert np.allclose(flow.generator(points, "cotangent") @ points, -rate, atol=1e-9)
    # The stiffness is symmetric, and its rows at the border are those of the rate but for what stays.
    system = flow.system(points)
    stiffness = system.matrix(1.0) - system.matrix(0.0)
    assert abs(stiffness - stiffness.T).max() < 1e-12
    assert np.allclose(-(stiffness @ points)[rim] / system.mass[rim, None], rate[rim], atol=1e-8)


@pytest.mark.parametrize("boundary", BORDERS)
@pytest.mark.parametrize(
    "way", [{"method": "curvature"}, {"method": "fairing", "search": False}], ids=["curvature", "fairing"]
)
def test_holes_stay_holes(boundary, way):
    points, faces = sphere(600)
    faces = faces[(np.abs(points[faces].mean(axis=1)) < 0.9).all(axis=1)]  # six holes
    before = len(connect((faces,), len(points)).border)
    found, after = smooth((points, faces), **parts(boundary=boundary, time=0.003, **way))
    assert before > 30
    assert np.array_equal(after, faces)
    assert np.isfinite(found).all()
    if boundary == "fixed":
        rim = connect((faces,), len(points)).rim
        assert np.array_equal(found[rim], points[rim])


@pytest.mark.parametrize("boundary", BORDERS)
@pytest.mark.parametrize("make", [bow_tie, book])
@pytest.mark.parametrize("stepper", ["explicit", "semi-implicit"])
def test_borders_that_are_no_manifold_stay_finite(boundary, make, stepper):
    points, faces = make()
    shaken = points + 0.02 * np.random.default_rng(4).normal(size=points.shape)
    found = smooth((shaken, faces), method="curvature", time=0.02, boundary=boundary, compute=Compute(stepper=stepper))[
        0
    ]
    assert np.isfinite(found).all()
    assert np.abs(found - shaken).max() < 0.5
    flat = smooth(
        (points, faces), method="curvature", time=0.02, boundary="plane-preserving", compute=Compute(stepper=stepper)
    )[0]
    if make is bow_tie:
        assert np.abs(flat - points).max() < 1e-12  # planes rest, touched in a vertex or not


def test_where_no_curve_passes_the_border_stays():
    points, faces = bow_tie()
    found = smooth((points, faces), method="curvature", time=0.02, boundary="border-curve")[0]
    assert np.array_equal(found[0], points[0])
    assert (np.abs(found - points).max(axis=1)[1:] > 0).sum() >= 6
    points, faces = book()
    found = smooth((points, faces), method="curvature", time=0.02, boundary="border-curve")[0]
    assert np.array_equal(
        found[:2], points[:2]
    )  # three edges of the border meet in each end of the edge of three triangles
    assert (np.abs(found - points).max(axis=1)[2:] > 0).all()


def test_the_default_with_such_a_border_is_a_fairing_and_says_curve():
    points, faces, _ = disc()
    noisy = points + 0.01 * np.random.default_rng(5).normal(size=points.shape)
    result = smooth((noisy, faces), boundary="border-curve", result=True)
    assert result.parameters["method"].value == "fairing"
    assert result.parameters["boundary"].value == "border-curve"
    assert (
        smooth((noisy, faces), method="curvature", boundary="border-curve", result=True).parameters["boundary"].value
        == "border-curve"
    )


def test_a_curve_is_refused_where_there_is_none():
    z = np.random.default_rng(0).normal(size=(8, 8))
    points, faces, rim = disc()
    for call in (
        lambda: smooth(z, boundary="border-curve"),
        lambda: smooth((points, faces), boundary="border-curve", channels=rim * 1.0),
    ):
        with pytest.raises(InputError, match="boundary='border-curve': only for a mesh whose points move"):
            call()
    with pytest.raises(InputError, match="got method='normal-filter'"):
        smooth((points, faces), method="normal-filter", boundary="border-curve")
    flat = Surface(points, (faces,))
    for method in (NormalFilter(), PrincipalFlow(), NormalChannels()):
        with pytest.raises(InputError, match=f"got method='{method.word}'"):
            method.engine(flat, PointSetting(curve=True))
    with pytest.raises(InputError, match="neumann, .*border-curve .of meshes. expected"):
        smooth((points, faces), boundary="round")
