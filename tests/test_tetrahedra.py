"""Meshes of tetrahedra: the operator, the flow, and what smooth does with them."""

import igl
import naive_volumes as naive
import numpy as np
import pytest
from scipy.spatial import Delaunay

import meshflow
from meshflow import Fixed, InputError, Mask, MaxChange, Mobility, Residual, Steps, TetMesh, Volume
from meshflow.flow.controls import FixedStep, Until
from meshflow.flow.engines.tetrahedra import TetFlow
from meshflow.flow.engines.volume import VolumeFlow
from meshflow.flow.family import Variant
from meshflow.flow.march import march
from meshflow.flow.steppers import Explicit, SemiImplicit, SuperTime
from meshflow.geometry.splitting import split
from meshflow.geometry.tetrahedra import Tetrahedra, skin_of
from meshflow.surfaces.grid import Lift

VARIANTS = [Variant(), Variant(-1.0), Variant(-1.0, 2.0), Variant(0.3, 1.7), Variant(-2.0, 3.0)]


def boxes(shape):
    """The corners (m, 8) of the cells of a grid, as VTK orders those of a hexahedron."""
    number = np.arange(np.prod(shape)).reshape(shape)
    d, h, w = shape
    places = [(z, y, x) for z in (0, 1) for y, x in ((0, 0), (0, 1), (1, 1), (1, 0))]
    return np.stack([number[z : d - 1 + z, y : h - 1 + y, x : w - 1 + x].ravel() for z, y, x in places], axis=1)


def grid_points(shape, spacing=(1.0, 1.0, 1.0)):
    """Points (n, 3), x first."""
    along = [np.arange(n) * s for n, s in zip(shape, spacing, strict=True)]
    return np.stack(np.meshgrid(*along, indexing="ij")[::-1], -1).reshape(-1, 3)


def body(shape=(9, 8, 7), shake=0.25, channels=1, seed=0, values=None):
    """A block whose points are shaken."""
    rng = np.random.default_rng(seed)
    points = grid_points(shape)
    points += shake * rng.uniform(-1, 1, points.shape)
    found = rng.normal(size=(len(points), channels)) if values is None else values(points)
    return TetMesh(points, split("hexahedron", boxes(shape)), found[:, 0] if found.shape[1:] == (1,) else found)


def test_the_operator_is_that_of_libigl_and_needs_lengths_only():
    data = body()
    found = data.spanned.stiffness()
    theirs = igl.cotmatrix(data.points, data.tetrahedra.astype(np.int64))
    assert abs(found + theirs).max() < 1e-12 * abs(theirs).max()
    assert np.abs(found @ np.ones(len(data.points))).max() < 1e-12
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(6, 3)))[0]
    elsewhere = Tetrahedra.of(data.points @ turn.T + 3.0, data.tetrahedra[:, [2, 0, 3, 1]])
    assert abs(elsewhere.stiffness() - found).max() < 1e-12 * abs(found).max()


@pytest.mark.parametrize("channels", [1, 3])
def test_the_lifted_tetrahedra_are_those_of_points_in_a_space_of_more_dimensions(channels):
    data, alpha = body((4, 4, 4), channels=channels), 0.7
    columns = data.columns(Lift())
    lifted = np.column_stack([data.points, alpha * columns])
    flow = TetFlow(data, Lift(alpha))
    slow = sum(naive.tetrahedron_volume(lifted[corners]) for corners in data.tetrahedra)
    assert flow.area(columns) == pytest.approx(slow, rel=1e-13)
    weights, volumes = data.spanned.measured(columns, alpha**2, 1.0)
    pull, mass = data.spanned.gathered(weights, volumes, columns)
    gradient = naive.volume_gradient(lifted, data.tetrahedra)[:, 3:] / alpha
    assert np.abs(pull - gradient).max() < 1e-12 * np.abs(gradient).max()
    assert mass.sum() == pytest.approx(slow, rel=1e-13)
    assert np.abs(flow.rate(columns) + pull / mass[:, None]).max() < 1e-12 * np.abs(pull / mass[:, None]).max()


@pytest.mark.parametrize("variant", VARIANTS, ids=str)
@pytest.mark.parametrize("channels", [1, 3])
def test_on_a_grid_the_flow_is_that_of_volumes(variant, channels):
    shape, spacing = (4, 5, 6), (2.0, 0.8, 1.3)
    values = np.random.default_rng(0).normal(size=(*shape, channels))
    values[1, 2, 3] = np.nan
    volume = Volume(values[..., 0] if channels == 1 else values, spacing)
    same = TetMesh(grid_points(shape, spacing), split("hexahedron", boxes(shape)), values.reshape(-1, channels))
    theirs = VolumeFlow(volume.gridded(Lift(0.4, diagonals="forward")), variant)
    ours = TetFlow(same, Lift(0.4), variant)
    expected = theirs.rate(theirs.start())
    assert np.abs(ours.rate(ours.start()) - expected).max() < 1e-11 * np.abs(expected).max()
    assert ours.area(ours.start()) == pytest.approx(theirs.area(theirs.start()), rel=1e-12)
    assert 0 < ours.bound(ours.start()) <= theirs.bound(theirs.start()) * (1 + 1e-12)


@pytest.mark.parametrize("kind", ["hexahedron", "wedge", "pyramid"])
def test_cells_are_split_so_that_neighbours_agree_and_no_volume_is_lost(kind):
    rng = np.random.default_rng(2)
    cubes = boxes((4, 4, 4))
    parts = {
        "hexahedron": [range(8)],
        "wedge": [(0, 1, 2, 4, 5, 6), (0, 2, 3, 4, 6, 7)],
        "pyramid": [
            (*face, 8) for face in ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))
        ],
    }[kind]
    points = grid_points((4, 4, 4))
    middles = points[cubes].mean(axis=1)
    cubes = np.column_stack([cubes, len(points) + np.arange(len(cubes))])
    points = np.concatenate([points, middles])
    relabelled = rng.permutation(len(points))  # the cut may not depend on the order
    cells = relabelled[np.concatenate([cubes[:, list(part)] for part in parts])]
    places = np.empty_like(points)
    places[relabelled] = points
    found = split(kind, cells)
    assert Tetrahedra.of(places, found).volumes.sum() == pytest.approx(27.0)
    assert len(found) == {"hexahedron": 6, "wedge": 3, "pyramid": 2}[kind] * len(cells)
    skin = skin_of(found)
    assert len(skin) == 2 * 6 * 9  # two triangles for each square outside, and none inside
    on = np.isclose(places[skin], 0.0) | np.isclose(places[skin], 3.0)
    assert on.all(axis=1).any(axis=1).all()


def test_the_heat_equation_conserves_the_mean_and_every_stepper_reaches_the_same():
    data = body((7, 7, 7))
    flow = TetFlow(data, Lift(), Variant(linear=True))
    mass = data.spanned.ground[1]
    ends = []
    for stepper, dt in ((Explicit(), 0.001), (SuperTime(), 0.01), (SemiImplicit(), 0.001)):
        *_, end = march(flow, Until(time=0.1), stepper, FixedStep(dt))
        ends.append(end.u)
        assert mass @ end.u == pytest.approx(mass @ flow.start(), abs=1e-9)
        assert np.ptp(end.u) < np.ptp(flow.start())
    assert all(np.abs(one - ends[0]).max() < 0.05 * np.abs(ends[0]).max() for one in ends)


@pytest.mark.parametrize("variant", VARIANTS[:4], ids=str)
def test_linear_functions_rest_inside_and_steps_within_the_bound_lower_the_volume(variant):
    data = body((6, 6, 6), values=lambda p: (p @ [0.3, -0.2, 0.5])[:, None])
    flow = TetFlow(data, Lift(0.5), variant)
    inside = ~(data.spanned.rim | (data.spanned.stiffness() != 0) @ data.spanned.rim)
    assert np.abs(flow.rate(flow.start())[inside]).max() < 1e-12
    rough = TetFlow(body((6, 6, 6)), Lift(0.5), variant)
    *_, end = march(rough, Until(steps=5), Explicit())
    assert rough.area(end.u) < rough.area(rough.start())


def test_implicit_steps_on_slivers_are_positive_definite_and_keep_the_range():
    draw = np.random.default_rng(0)
    points = draw.random((400, 3))
    values = np.where(points[:, :1] > 0.5, 1.0, 0.0) + 0.2 * draw.normal(size=(400, 1))
    data = TetMesh(points, Delaunay(points).simplices, values)
    for sharpness in (1.5, 3.0):
        flow = TetFlow(data, Lift(3.0), Variant(-1.0, sharpness))
        assert np.linalg.eigvalsh(flow.system(flow.start()).matrix(0.01).toarray()).min() > 0
        after = SemiImplicit().step(flow, flow.start(), 0.01)
        assert np.ptp(after) < np.ptp(values)


def test_order_orientation_place_and_threads_do_not_matter():
    data = body((5, 5, 5), channels=2)
    options = {"method": "beltrami", "time": 0.3}
    expected = meshflow.smooth(data, **options).values
    rng = np.random.default_rng(3)
    order = rng.permutation(len(data.points))
    back = np.argsort(order)
    cells = np.take_along_axis(
        back[data.tetrahedra], rng.permuted(np.tile(np.arange(4), (len(data.tetrahedra), 1)), axis=1), 1
    )
    turned = data.points[order] @ np.linalg.qr(rng.normal(size=(3, 3)))[0] + 7.0
    other = meshflow.smooth(TetMesh(turned, cells, data.values[order]), **options).values
    assert np.abs(other - expected[order]).max() < 1e-10
    one = meshflow.smooth(data, compute=meshflow.Compute(threads=1), **options).values
    assert np.array_equal(one, expected)


def step_in(points):
    return np.where(points[:, 0] < 4.5, 0.0, 1.0)[:, None]


def noisy_body(sigma=0.1, shape=(10, 10, 10), dtype=np.float32):
    data = body(shape, 0.2, values=step_in)
    noise = np.random.default_rng(4).normal(0, sigma, len(data.points))
    return TetMesh(data.points, data.tetrahedra, (data.values + noise).astype(dtype)), data.values


def test_the_default_removes_most_of_the_noise_and_keeps_the_step():
    noisy, truth = noisy_body()
    result = meshflow.smooth(noisy, result=True)
    assert result.noise.sigma == pytest.approx(0.1, rel=0.15)
    assert np.std(result.data.values - truth) < 0.45 * 0.1
    assert result.data.values.dtype == np.float32
    assert isinstance(result.data, TetMesh)
    assert result.parameters["time"].unit == "squared length"
    assert 0 < result.left < 0.1
    assert "risk" in result.parameters
    assert result.correlation is None
    assert result.to_dict()["removed"]["rms"] == pytest.approx(0.1, rel=0.15)
    clean = meshflow.smooth(TetMesh(noisy.points, noisy.tetrahedra, truth), result=True)
    assert np.array_equal(clean.data.values, truth)
    assert meshflow.estimate_noise(noisy).sigma == pytest.approx(0.1, rel=0.15)


def test_constraints_stops_and_missing_vertices():
    noisy, truth = noisy_body(shape=(7, 7, 7))
    quick = {"method": "quick"}
    some = np.arange(len(truth)) % 3 == 0
    for constraint, stays in ((Fixed(some), some), (Mask(some), ~some)):
        done = meshflow.smooth(noisy, constraints=constraint, **quick).values
        assert np.array_equal(done[stays], noisy.values[stays])
        assert (done[~stays] != noisy.values[~stays]).mean() > 0.9
    assert (
        np.abs(meshflow.smooth(noisy, constraints=MaxChange(0.03), **quick).values - noisy.values).max() <= 0.03 + 1e-6
    )
    slow = meshflow.smooth(noisy, method="heat", time=0.5, constraints=Mobility(np.where(some, 0.1, 1.0))).values
    assert np.abs(slow - noisy.values)[some].mean() < 0.5 * np.abs(slow - noisy.values)[~some].mean()
    assert meshflow.smooth(noisy, stop=Steps(3), result=True, **quick).end.step == 3
    stopped = meshflow.smooth(noisy, stop=Residual(0.8), result=True, **quick)
    assert np.std(stopped.data.values - noisy.values) == pytest.approx(0.8 * stopped.noise.sigma, rel=0.15)
    some = np.arange(len(truth)) % 17 == 0
    holes = np.where(some, np.nan, noisy.values)
    done = meshflow.smooth(TetMesh(noisy.points, noisy.tetrahedra, holes), method="heat", time=0.3).values
    assert np.isnan(done[some]).all()
    assert np.isfinite(done[~some]).all()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"tetrahedra": np.zeros((3, 3), int)}, r"\(m, 4\)"),
        ({"tetrahedra": np.array([[0, 1, 2, 99_999]])}, "99999"),
        ({"tetrahedra": np.array([[0.5, 1, 2, 3]])}, "whole numbers"),
        ({"tetrahedra": np.array([[0, 1, 1, 2]])}, "with volume"),
        ({"values": np.zeros(5)}, "one row for each point"),
        ({"values": np.full(27, np.nan)}, "all 27 are missing"),
        ({"points": np.zeros((27, 2))}, "d >= 3"),
        ({"points": np.full((27, 3), np.inf)}, "NaN or infinity"),
        ({"values": np.zeros(27, complex)}, "real"),
    ],
)
def test_what_is_no_body_is_refused(change, words):
    whole = {
        "points": grid_points((3, 3, 3)),
        "tetrahedra": split("hexahedron", boxes((3, 3, 3))),
        "values": np.zeros(27),
    }
    with pytest.raises(InputError, match=words):
        TetMesh(**{**whole, **change})


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"method": "patches"}, "not for meshes of tetrahedra; methods for meshes of tetrahedra are"),
        ({"method": "fairing"}, "not for meshes of tetrahedra"),
        ({"boundary": "plane-preserving"}, "not for meshes of tetrahedra"),
        ({"outliers": "keep"}, "outliers: not for meshes of tetrahedra"),
        ({"constraints": meshflow.PreserveVolume()}, "PreserveVolume"),
        ({"kind": "volume"}, "TetMesh already says"),
    ],
)
def test_options_of_other_data_are_refused(options, words):
    with pytest.raises(InputError, match=words):
        meshflow.smooth(body((3, 3, 3)), **options)
