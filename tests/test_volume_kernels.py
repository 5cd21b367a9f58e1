"""The flow of volumes: equal to the tetrahedra written out, and the laws that hold whatever the data."""

import itertools

import igl
import naive_volumes as naive
import numpy as np
import pytest

from meshflow.errors import InputError
from meshflow.flow.blend import Blend, euler
from meshflow.flow.controls import FixedStep, Until
from meshflow.flow.engines.volume import VolumeFlow
from meshflow.flow.family import Variant
from meshflow.flow.march import march
from meshflow.flow.steppers import Explicit, SemiImplicit, SuperTime
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.volume import Volume, diagonal_order

VARIANTS = [
    Variant(),
    Variant(-1.0),
    Variant(-1.0, 2.0),
    Variant(-1.0, 1.5),
    Variant(0.3, 1.7),
    Variant(-2.0, 3.0),
    Variant(1.0, 4.0),
]
SPACING = (2.0, 0.8, 1.3)


def volume(shape=(5, 6, 7), channels=1, holes=True, dtype=np.float64, seed=0, spacing=SPACING):
    rng = np.random.default_rng(seed)
    values = 1.5 * rng.normal(size=(*shape, channels))
    values[rng.random(shape) < 0.1 * holes] = np.nan
    return Volume((values[..., 0] if channels == 1 else values).astype(dtype), spacing)


def flow_of(data, variant=None, contrast=0.7, threads=None, **lift):
    return VolumeFlow(data.gridded(Lift(contrast, **lift)), variant, threads)


def rates(flow, turn=0):
    """The rate (d, h, w, k)."""
    k, *shape = flow.shape
    return flow.rate(flow.start(), turn).reshape(*shape, k)


@pytest.mark.parametrize("variant", VARIANTS, ids=str)
@pytest.mark.parametrize("channels", [1, 2, 4])
def test_the_rate_is_that_of_tetrahedra_written_out(variant, channels):
    data, contrast = volume((3, 4, 5), channels), 0.7 if variant.sharpness < 3 else 0.25
    for diagonals in ("alternate", "both", "forward"):
        flow = flow_of(data, variant, contrast, diagonals=diagonals)
        for turn, (first, last) in enumerate(flow.block.spans[: 2 if channels == 1 else 1]):
            slow = naive.volume_rate(
                data.values.reshape(*data.missing.shape, channels), SPACING, contrast, range(first, last),
                gamma=variant.gamma, sharpness=variant.sharpness,
            )  # fmt: skip
            assert np.abs(rates(flow, turn) - slow).max() <= 1e-12 * np.abs(slow).max(), (diagonals, turn)


@pytest.mark.parametrize("variant", VARIANTS[:5], ids=str)
def test_one_channel_by_the_loop_for_several_is_the_same(variant):
    for holes in (False, True):
        flow = flow_of(volume((4, 9, 70), holes=holes), variant)
        fast, fast_area = rates(flow), flow.area(flow.start())
        flow._by_forms = True
        slow = rates(flow)
        assert np.abs(fast - slow).max() <= 1e-12 * np.abs(slow).max()
        assert flow.area(flow.start()) == pytest.approx(fast_area, rel=1e-13)


def test_weights_of_a_tetrahedron_are_those_of_libigl_in_space():
    rng = np.random.default_rng(1)
    for _ in range(20):
        corners = rng.normal(size=(4, 3))
        theirs = igl.cotmatrix(corners, np.array([[0, 1, 2, 3]])).toarray()
        assert np.allclose(
            naive.tetrahedron_weights(corners), theirs - np.diag(np.diag(theirs)), rtol=1e-11, atol=1e-12
        )


@pytest.mark.parametrize("dimension", [4, 5, 6])
def test_weights_give_the_gradient_of_the_volume_in_every_dimension(dimension):
    rng = np.random.default_rng(dimension)
    corners, step = rng.normal(size=(4, dimension)), 1e-6
    gradient = naive.volume_gradient(corners, [[0, 1, 2, 3]])
    for at in np.ndindex(corners.shape):
        moved = np.zeros_like(corners)
        moved[at] = step
        change = naive.tetrahedron_volume(corners + moved) - naive.tetrahedron_volume(corners - moved)
        assert gradient[at] == pytest.approx(change / (2 * step), abs=1e-7)


def test_the_area_is_the_volume_of_the_lifted_tetrahedra():
    data = volume((3, 4, 5), 2, holes=False)
    flow = flow_of(data, diagonals="forward")
    points = np.stack(
        np.meshgrid(*(np.arange(n) * s for n, s in zip((3, 4, 5), SPACING, strict=True)), indexing="ij"), -1
    )
    points = np.concatenate([points, 0.7 * data.values], axis=-1).reshape(-1, 5)
    slow = sum(naive.tetrahedron_volume(points[corners]) for corners in naive.freudenthal((3, 4, 5), 0))
    assert flow.area(flow.start()) == pytest.approx(slow, rel=1e-13)


@pytest.mark.parametrize("variant", VARIANTS, ids=str)
@pytest.mark.parametrize("channels", [1, 3])
def test_constants_and_linear_functions_are_at_rest_inside(variant, channels):
    shape = (6, 7, 8)
    z, y, x = np.mgrid[:6, :7, :8]
    for values in (np.full(shape, 3.7), 0.3 * z - 2.0 * y + 0.7 * x):
        data = Volume(np.stack([values * (1 + c) for c in range(channels)], -1), SPACING)
        found = rates(flow_of(data, variant, contrast=0.2))
        assert np.abs(found[1:-1, 1:-1, 1:-1]).max() < 1e-12
        assert np.ptp(values) > 0 or not found.any()


@pytest.mark.parametrize("variant", VARIANTS[:5], ids=str)
def test_explicit_steps_keep_the_range_and_gamma_minus_one_the_mean(variant):
    for holes, dtype in itertools.product((False, True), (np.float32, np.float64)):
        data = volume((6, 7, 8), holes=holes, dtype=dtype)
        flow = flow_of(data, variant, contrast=2.0)
        u, most, least = flow.start(), np.nanmax(data.values), np.nanmin(data.values)
        for count in range(20):
            u = flow.rate(u, count, euler(Explicit().largest(flow, u)))
            there = u[~data.missing.ravel()]
            assert there.max() <= most + 1e-6
            assert there.min() >= least - 1e-6
        if variant.gamma == -1.0 and not holes:
            block = flow_of(data, variant, contrast=1e-9, diagonals="both")
            mass = block.system(block.start()).mass
            mean = [
                float((mass[:, None] * v).sum() / mass.sum())
                for v in (flow_of(data, variant, diagonals="both").start(), u)
            ]
            both = flow_of(data, variant, contrast=2.0, diagonals="both")
            moved = both.rate(both.start(), 0, euler(0.01))
            assert float((mass[:, None] * moved).sum() / mass.sum()) == pytest.approx(mean[0], abs=1e-6)


def test_flat_data_follows_the_heat_equation():
    n = 24
    wave = np.cos(np.pi * (np.arange(n) + 0.5) / n)[:, None, None] * np.ones((n, n, n))
    flow = flow_of(Volume(wave), Variant(linear=True))
    found = rates(flow)[2:-2, 2:-2, 2:-2, 0]
    expected = -(2 - 2 * np.cos(np.pi / n)) * wave[2:-2, 2:-2, 2:-2]
    assert np.abs(found - expected).max() < 1e-13


def test_results_do_not_depend_on_threads_or_on_what_else_is_in_the_volume():
    for channels, dtype in ((1, np.float32), (1, np.float64), (2, np.float64)):
        data = volume((40, 70, 50), channels, dtype=dtype)
        one, two = (flow_of(data, Variant(0.0, 1.5), threads=threads) for threads in (1, 2))
        u = one.start()
        assert np.array_equal(one.rate(u, 1), two.rate(u, 1))
        assert one.area(u) == two.area(u)
        part = Volume(data.values[3:31, 10:60, 7:40], SPACING)
        cut = VolumeFlow(part.gridded(Lift(0.7, diagonals="forward")), Variant(0.0, 1.5))
        whole = VolumeFlow(data.gridded(Lift(0.7, diagonals="forward")), Variant(0.0, 1.5))
        inside = rates(whole)[3:31, 10:60, 7:40][1:-1, 1:-1, 1:-1]
        assert np.array_equal(rates(cut)[1:-1, 1:-1, 1:-1], inside)


def turns():
    """All turns and reflections of a volume, on arrays (d, h, w, ...)."""
    for axes in itertools.permutations(range(3)):
        for flips in itertools.product((1, -1), repeat=3):
            yield axes, flips


def turned(array, axes, flips):
    array = array.transpose(*axes, *range(3, array.ndim))
    return array[tuple(slice(None, None, flip) for flip in flips)]


@pytest.mark.parametrize("channels", [1, 2])
def test_turned_and_mirrored_volumes_give_the_turned_and_mirrored_result(channels):
    data = volume((5, 6, 7), channels)
    ends = march(flow_of(data, Variant(-1.0, 2.0) if channels == 1 else None), Until(time=1.0), SuperTime())
    *_, end = ends
    result = end.u.reshape(*data.missing.shape, channels)
    for axes, flips in turns():
        other = Volume(turned(data.values, axes, flips), tuple(SPACING[i] for i in axes))
        *_, state = march(flow_of(other, Variant(-1.0, 2.0) if channels == 1 else None), Until(time=1.0), SuperTime())
        found = state.u.reshape(*other.missing.shape, channels)
        assert np.abs(found - turned(result, axes, flips)).max() < 1e-12, (axes, flips)


def test_the_order_of_diagonals_has_each_of_them_once():
    for seed in range(5):
        data = volume(seed=seed)
        assert sorted(diagonal_order(data.values[None], data.missing)) == [0, 1, 2, 3]


@pytest.mark.parametrize("channels", [1, 3])
def test_an_implicit_step_is_that_of_its_matrix_and_converges_with_small_steps(channels):
    data = volume((5, 6, 7), channels)
    flow = flow_of(data, Variant(0.0, 1.5), diagonals="both")
    u, dt = flow.start(), 0.7
    system = flow.system(u)
    matrix = system.matrix(dt)
    assert abs(matrix - matrix.T).max() < 1e-12
    stiffness = (matrix - system.matrix(0.0)) / dt
    assert np.abs(stiffness @ np.ones(matrix.shape[0])).max() < 1e-11
    rate = flow.rate(u)
    right = system.mass[:, None] * rate
    assert np.abs(stiffness @ u + right).max() < 1e-10 * np.abs(right).max()
    direct, free = (SemiImplicit(solver=solver).step(flow, u, dt) for solver in ("direct", "cg"))
    assert np.abs(direct - free).max() < 1e-8
    *_, fine = march(flow, Until(time=0.2), Explicit(), FixedStep(1e-3))
    errors = []
    for count in (10, 20):
        v = u
        for _ in range(count):
            v = SemiImplicit(solver="direct").step(flow, v, 0.2 / count)
        errors.append(np.abs(v - fine.u).max())
    assert errors[1] < 0.6 * errors[0]


def test_what_is_fixed_or_missing_stays_to_the_bit():
    data = volume((6, 7, 8))
    fixed = np.random.default_rng(3).random(data.missing.shape) < 0.2
    flow = flow_of(Volume(data.values, SPACING, fixed=fixed))
    *_, end = march(flow, Until(time=1.0), SuperTime())
    done = data.lowered(end.u)
    stays = fixed | data.missing
    assert np.array_equal(done.values[stays], data.values[stays], equal_nan=True)
    assert (done.values[~stays] != data.values[~stays]).any()
    edge = flow_of(data, boundary="fixed")
    still = rates(edge)[..., 0] == 0
    assert still[0].all()
    assert still[:, :, -1].all()
    assert not still.all()


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("gamma", [-2.0, -0.5])
def test_steps_within_the_bound_are_stable_where_it_depends_on_the_data(gamma, channels):
    flow = flow_of(volume((6, 7, 8), channels), Variant(gamma), contrast=3.0)
    u, size = flow.start(), np.abs(flow.start()).max()
    for count in range(40):
        u = flow.rate(u, count, euler(Explicit().largest(flow, u)))
        assert np.abs(u).max() < 1.01 * size


def test_a_blend_is_what_its_parts_are():
    flow = flow_of(volume(holes=False))
    u = flow.start()
    a, b, c = (np.ascontiguousarray(v).T.reshape(-1, 1) for v in np.random.default_rng(2).normal(size=(3, 1, len(u))))
    found = flow.rate(u, 0, Blend(0.5, 0.1, ((0.3, a), (0.2, b)), (0.7, c)))
    expected = 0.5 * u + 0.1 * flow.rate(u) + 0.3 * (a - u) + 0.2 * (b - u) + 0.7 * c
    assert np.abs(found - expected).max() < 1e-13


def test_what_has_no_meaning_in_a_volume_is_refused():
    block = volume().gridded(Lift())
    for variant in (Variant(patch=1.0), Variant(mass="voronoi"), Variant(-1.0, indicator="projection")):
        with pytest.raises(InputError, match="not defined for volumes"):
            VolumeFlow(block, variant)
    with pytest.raises(InputError, match="up to 256 channels"):
        VolumeFlow(Volume(np.zeros((2, 2, 2, 257))).gridded(Lift()))
    with pytest.raises(InputError, match="neumann or fixed"):
        volume().gridded(Lift(boundary="plane-preserving"))
    for values, words in (
        (np.zeros((4, 4, 1)), "single slice is an image"),
        (np.zeros((4, 4)), r"\(d, h, w\) or"),
        (np.zeros((4, 4, 4), bool), "probability"),
        (np.zeros((4, 4, 4), complex), "real numbers"),
        (np.full((4, 4, 4), np.nan), "all 64 samples are missing"),
    ):
        with pytest.raises(InputError, match=words):
            Volume(values)
    with pytest.raises(InputError, match="dz, dy, dx"):
        Volume(np.zeros((4, 4, 4)), spacing=(1.0, 2.0))
