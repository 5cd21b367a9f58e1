"""Each system that the paper cites, by name: it is what its equation says, literally, and does what it is for."""

import naive
import numpy as np
import pytest
from helpers.cliffs import cliff
from scipy.ndimage import gaussian_filter
from scipy.spatial import Delaunay

import meshflow
from meshflow.errors import InputError
from meshflow.flow.blend import euler
from meshflow.flow.compute import Compute
from meshflow.flow.conductances import CONDUCTANCES, power_of
from meshflow.flow.engines.conducting import Conducting
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.engines.samples import SampleFlow
from meshflow.flow.methods import HEIGHT_METHODS
from meshflow.flow.methods.lcis import LowCurvatureScheme
from meshflow.flow.methods.min_max import MinMaxScheme
from meshflow.flow.methods.ring import RingScheme
from meshflow.flow.methods.selective import SelectiveScheme
from meshflow.flow.methods.shared_edges import SharedEdgesScheme
from meshflow.flow.methods.shock import ShockScheme
from meshflow.flow.stops import Steps
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh


def rms(a):
    return float(np.sqrt(np.mean(np.square(a))))


def rough(seed=0, shape=(9, 11)):
    draw = np.random.default_rng(seed)
    return draw.normal(size=shape) + 3.0 * (np.arange(shape[1]) > shape[1] // 2)


def rate_of(scheme, values):
    """The rate of a scheme as the engine has it, (h, w) or (h, w, k)."""
    flow = SampleFlow(Image(values).gridded(Lift()), scheme, "tested")
    return np.moveaxis(flow.rate(flow.start()).T.reshape(-1, *values.shape[:2]), 0, -1).reshape(values.shape)


def close(ours, literal, digits=1e-12):
    assert np.abs(ours - literal).max() <= digits * np.abs(literal).max()


# --- each scheme is its literal form ------------------------------------------------------------------------------------


def test_selective_smoothing_is_its_equation():
    u = rough()
    smooth = gaussian_filter(u, 1.0, mode="nearest")
    literal = naive.selective_smoothing(u, smooth, 0.7)
    close(rate_of(SelectiveScheme(0.7, 1.0), u), naive.in_range(u, literal, 8.0))


@pytest.mark.parametrize(("shock", "switch"), [(0.0, 0.0), (0.3, 0.0), (0.3, 0.8), (0.0, 0.8)])
def test_the_shock_filter_is_its_equation(shock, switch):
    u = rough()
    smooth = gaussian_filter(u, 1.0, mode="nearest")
    literal = naive.shock_filter(u, u, smooth, 0.7, 0.2, shock, switch)
    close(rate_of(ShockScheme(0.7, 0.2, shock, 1.0, switch), u), naive.in_range(u, literal, 8.2 + 4.0 * shock, u))


@pytest.mark.parametrize("radius", [1.0, 2.5])
def test_min_max_flow_is_its_equation(radius):
    u = rough()
    close(rate_of(MinMaxScheme(radius), u), naive.in_range(u, naive.min_max(u, radius), 8.0))


KEEPING = (
    meshflow.MinMax(),
    meshflow.SelectiveSmoothing(contrast=0.1),
    meshflow.ShockFilter(),
    meshflow.ShockFilter(shock=1.0, fidelity=0.1),
    meshflow.SmallerCurvature(),
)


@pytest.mark.long
@pytest.mark.parametrize("method", KEEPING, ids=lambda one: one.word)
def test_what_keeps_the_range_keeps_it_at_any_time(method):
    """Super-time steps took a disc of +-50 to +-1e3 by min-max flow; central differences to +-66 by the shock filter."""
    y, x = np.mgrid[:33, :33] - 16.0
    disc = 50.0 * np.tanh((9.0 - np.hypot(y, x)) / 2.0)
    disc[::5, ::7] *= -1.0
    for time in (5.0, 60.0):
        found = meshflow.smooth(disc, spacing=1.0, method=method, time=time, outliers="include")
        assert disc.min() - 1e-9 <= found.min()
        assert found.max() <= disc.max() + 1e-9
    with pytest.raises(InputError, match="only explicit steps keep the range"):
        meshflow.smooth(disc, method=method, time=60.0, compute=meshflow.Compute(stepper="super-time"))


def test_the_low_curvature_simplifier_is_its_equation():
    u = rough()
    close(rate_of(LowCurvatureScheme(0.5), u), naive.low_curvature(u, 0.5))


@pytest.mark.parametrize("power", [1, 2])
def test_shared_edges_are_their_equation(power):
    u = rough()
    field = naive.edge_field(u, 0.5, 2.0, power)
    close(rate_of(SharedEdgesScheme(0.5, 0.0, 2.0, power), u), naive.over_links(u, field**2), 1e-10)


@pytest.mark.parametrize("channels", [1, 3])
def test_the_ring_of_the_paper_is_equation_14_as_printed(channels):
    values = np.random.default_rng(3).normal(size=(7, 8, channels))
    y, x = np.mgrid[0:7, 0:8].astype(float)
    points = np.column_stack([x.ravel(), y.ravel(), 1.5 * values.reshape(-1, channels)])
    literal = naive.ring(points, (7, 8))[1:-1, 1:-1, 2:] / 1.5
    close(rate_of(RingScheme(1.5), values)[1:-1, 1:-1], literal)


@pytest.mark.parametrize("word", CONDUCTANCES)
def test_a_conductance_per_triangle_is_its_equation_and_lowers_its_energy(word):
    draw, g = np.random.default_rng(4), CONDUCTANCES[word].of
    flat, values = draw.random((30, 2)), draw.normal(size=(30, 2))
    faces = Delaunay(flat).simplices
    surface = Mesh(np.column_stack([flat]), faces, values).lifted(Lift(contrast=0.3, boundary="neumann"))
    flow = MeshFlow(surface, metric=Conducting(CONDUCTANCES[word]))
    literal = naive.conducting(flat, values, faces, lambda s2: g(0.09 * s2))
    close(flow.rate(values), literal, 1e-10)
    # The energy of the contrast's lengths is descended: its derivative is -contrast^2 M rate.
    mass = flow.system(values).mass[:, None]
    step = 1e-6 * draw.normal(size=values.shape)
    change = (flow.area(values + step) - flow.area(values - step)) / 2
    assert change == pytest.approx(-(0.09 * mass * literal * step).sum(), rel=1e-5)
    u, energy, dt = values, flow.area(values), 2.0 / flow.bound(values)
    for _ in range(30):
        u = flow.rate(u, 0, euler(dt))
        assert flow.area(u) <= energy * (1 + 1e-12)
        energy = flow.area(u)


# --- what they are for ----------------------------------------------------------------------------------------------------

OWN = [kind for kind in HEIGHT_METHODS if not kind().searches]


@pytest.mark.parametrize("kind", HEIGHT_METHODS, ids=lambda kind: kind.word)
def test_each_name_runs_on_a_small_input_and_lowers_the_error_of_a_cliff(kind):
    truth, noisy = cliff()
    found = meshflow.smooth(noisy, method=kind.word, result=True)
    assert found.parameters["method"].value == kind.word
    left = rms(found.data - truth) / rms(noisy - truth)
    assert left < 0.75, f"{left:.2f} of the error is left"


@pytest.mark.parametrize("kind", HEIGHT_METHODS, ids=lambda kind: kind.word)
def test_each_name_leaves_constants_and_missing_samples(kind):
    z = np.full((16, 18), 7.0)
    z[4:6, 7:11] = np.nan
    found = meshflow.smooth(z, method=kind.word, time=2.0, noise=1.0)
    assert np.array_equal(np.isnan(found), np.isnan(z))
    assert np.nanmax(np.abs(found - 7.0)) < 1e-12


@pytest.mark.parametrize("kind", OWN, ids=lambda kind: kind.word)
@pytest.mark.parametrize("channels", [0, 2])
def test_each_scheme_is_turned_transposed_and_mirrored_with_its_data(kind, channels):
    draw = np.random.default_rng(5)
    z = draw.normal(size=(14, 17, channels) if channels else (14, 17)) + 2.0
    run = {"method": kind(contrast=0.5), "time": 1.0, "boundary": "neumann", "compute": Compute(diagonals="both")}
    here = meshflow.smooth(z, kind="image", **run)
    for way in (np.rot90, lambda a: np.swapaxes(a, 0, 1), lambda a: a[::-1], lambda a: a[:, ::-1]):
        there = meshflow.smooth(np.ascontiguousarray(way(z)), kind="image", **run)
        assert np.abs(there - way(here)).max() < 1e-9 * np.abs(here).max()


@pytest.mark.parametrize("kind", OWN, ids=lambda kind: kind.word)
def test_each_scheme_refuses_rays_and_what_it_has_not_in_words(kind):
    depth = 2.0 + 0.01 * rough(0, (16, 16))
    with pytest.raises(InputError, match=r"range image|values above a base|only for heights and channels"):
        meshflow.smooth(depth, method=kind.word, time=1.0, camera=meshflow.Pinhole(20.0, 20.0, 8.0, 8.0))


def test_the_papers_three_hundred_steps_of_dt_one_run_as_printed_and_never_leave_the_range():
    truth, noisy = cliff(24)
    words = {"stop": Steps(300), "compute": Compute(stepper="explicit", dt=1.0)}
    found = meshflow.smooth(noisy, method=meshflow.PaperScheme(contrast=1.0), **words)
    assert noisy.min() <= found.min() <= found.max() <= noisy.max()
    colours = np.random.default_rng(6).normal(size=(16, 16, 3))
    end = meshflow.smooth(colours, method=meshflow.PaperScheme(contrast=1.0), **words)
    assert np.isfinite(end).all()
    assert end.std() < colours.std()
    for contrast in (0.01, 100.0):  # every step is a weighted mean for one channel, whatever the slopes
        flow = SampleFlow(Image(noisy).gridded(Lift()), RingScheme(contrast), "paper")
        u = flow.start()
        stepped = flow.rate(u, 0, euler(1.0))
        assert u.min() - 1e-12 <= stepped.min() <= stepped.max() <= u.max() + 1e-12


@pytest.mark.parametrize("method", ["half-quadratic", "rof"])
def test_the_fidelity_of_a_restoration_follows_from_the_noise(method):
    truth, noisy = cliff()
    found = meshflow.smooth(noisy, method=method, noise=1.0)
    assert rms(found - noisy) == pytest.approx(1.0, rel=0.03)


@pytest.mark.parametrize(("q", "word"), [(1.0, "hypersurface"), (2.0, "rational"), (4.0, "geman-mcclure")])
def test_the_potential_of_every_sharpness_joins_those_that_have_names(q, word):
    s2 = np.linspace(0, 30, 200)
    for near, tolerance in ((q, 1e-12), (q + 1e-7, 1e-5)):
        found, known = power_of(near), CONDUCTANCES[word]
        np.testing.assert_allclose(found.of(s2), known.of(s2), rtol=tolerance)
        np.testing.assert_allclose(found.potential(s2), known.potential(s2), rtol=tolerance, atol=tolerance)


@pytest.mark.parametrize("q", [0.5, 1.5, 3.0])
def test_the_variational_way_of_every_sharpness_is_the_limit_of_its_flow_with_a_fidelity(q):
    truth, noisy = cliff(16)
    method = meshflow.HalfQuadratic(sharpness=q, contrast=0.5)
    found = meshflow.smooth(noisy, method=method, time=2.0, boundary="neumann", compute=Compute(diagonals="forward"))
    flow = MeshFlow(
        Image(noisy).lifted(Lift(contrast=0.5, diagonals="forward", boundary="neumann")), metric=Conducting(power_of(q))
    )
    start = flow.start()
    at_rest = flow.rate(found.reshape(-1, 1)) + (start - found.reshape(-1, 1)) / 2.0
    assert np.abs(at_rest).max() < 1e-3 * np.abs(start - found.reshape(-1, 1)).max()
    assert rms(meshflow.smooth(noisy, method=meshflow.HalfQuadratic(sharpness=q), noise=1.0) - truth) < 1.0
    with pytest.raises(InputError, match="give one of them"):
        meshflow.HalfQuadratic(potential="lorentz", sharpness=q)


def test_total_variation_at_rest_is_the_minimum_of_its_functional():
    from scipy.optimize import minimize

    truth, noisy = cliff(12)
    contrast, time = 8.0, 4.0
    found = meshflow.smooth(
        noisy, method=meshflow.RudinOsherFatemi(contrast=contrast), time=time, boundary="neumann",
        compute=Compute(diagonals="forward"),
    )  # fmt: skip
    surface = Image(noisy).lifted(Lift(contrast=contrast, diagonals="forward", boundary="neumann"))
    flow = MeshFlow(surface, metric=Conducting(CONDUCTANCES["hypersurface"]))
    mass = flow.system(surface.start).mass

    def energy(u):
        u = u[:, None]
        gradient = -mass[:, None] * flow.rate(u) + mass[:, None] * (u - surface.start) / time
        fidelity = 0.5 * (mass * (u - surface.start)[:, 0] ** 2).sum() / time
        return flow.area(u) / contrast**2 + fidelity, gradient[:, 0]

    least = minimize(energy, noisy.ravel(), jac=True, method="L-BFGS-B", options={"maxiter": 3000, "ftol": 1e-14})
    assert energy(found.ravel())[0] <= least.fun * 1.001


def test_the_regularization_of_total_variation_is_the_slope_below_which_it_diffuses():
    truth, noisy = cliff(24)
    named = meshflow.smooth(noisy, method=meshflow.TotalVariation(regularization=0.25), time=3.0)
    same = meshflow.smooth(noisy, method=meshflow.MeanCurvatureDiffusion(contrast=4.0), time=3.0)
    assert np.array_equal(named, same)
    with pytest.raises(InputError, match="one of them expected"):
        meshflow.TotalVariation(regularization=0.25, contrast=2.0)


@pytest.mark.parametrize(("time", "error"), [(0.3, 0.02), (2.0, 0.01), (60.0, 0.005)])
def test_the_heat_equation_is_linear_and_exact_at_any_time(time, error):
    one, other = np.random.default_rng(0).normal(size=(2, 40, 40))
    run = {"method": "heat", "time": time, "noise": 1.0, "outliers": "include", "kind": "image"}
    warm, hot = meshflow.smooth(one, **run), meshflow.smooth(other**3, **run)
    assert np.abs(meshflow.smooth(2 * one + other**3, **run) - (2 * warm + hot)).max() < 1e-12
    short = meshflow.smooth(one, compute=meshflow.Compute(stepper="explicit", dt=min(0.02, time / 400)), **run)
    assert rms(warm - short) < error * rms(short)


def test_min_max_flow_removes_speckles_smaller_than_its_window():
    y, x = np.mgrid[0:40, 0:40]
    shape = 1.0 * ((x - 20) ** 2 + (y - 20) ** 2 < 120)
    noisy = shape.copy()
    speckles = np.random.default_rng(7).random(shape.shape) < 0.03
    noisy[speckles] = 1 - noisy[speckles]
    noisy += 0.01 * np.random.default_rng(8).normal(
        size=shape.shape
    )  # without it, zeros and ones are steps of rounding

    found = meshflow.smooth(noisy, method=meshflow.MinMax(radius=2.0), time=5.0, noise=0.1, outliers="include")
    assert rms(found - shape) < 0.7 * rms(noisy - shape)
    flow = SampleFlow(Image(noisy).gridded(Lift()), MinMaxScheme(2.0), "min-max")
    rate, peak = flow.rate(flow.start())[:, 0], noisy.argmax()
    assert rate[peak] <= 0 <= rate[noisy.argmin()]


def test_shared_edges_stop_all_channels_where_one_has_an_edge():
    draw = np.random.default_rng(8)
    image = 0.3 * draw.normal(size=(24, 24, 2))
    image[:, 12:, 0] += 10.0  # the edge of the first channel holds the faint one of the second
    image[:, 12:, 1] += 1.0
    both = meshflow.smooth(image, method="shared-edges", time=10.0, noise=0.3)
    alone = meshflow.smooth(image[..., 1:], method="shared-edges", time=10.0, noise=0.3)

    def jump(z):
        return (z[:, 12] - z[:, 11]).mean()

    assert jump(both[..., 1]) > 1.2 * jump(alone[..., 0])


def test_a_shock_filter_makes_ramps_steeper():
    ramp = np.tile(np.clip(np.arange(40) - 15.0, 0, 8), (20, 1))
    found = meshflow.smooth(ramp, method=meshflow.ShockFilter(shock=0.5, contrast=10.0), time=3.0, noise=0.1)
    assert np.abs(np.diff(found[10])).max() > 1.5


def test_with_a_switch_the_shock_filter_sharpens_edges_and_no_noise():
    ramp = np.tile(np.clip(np.arange(40) - 15.0, 0, 8), (20, 1))
    noisy = ramp + 0.2 * np.random.default_rng(0).normal(size=ramp.shape)
    run = {"time": 3.0, "noise": 0.2}
    plain, switched = (
        meshflow.smooth(noisy, method=meshflow.ShockFilter(shock=1.0, contrast=4.0, switch=switch), **run)
        for switch in (0.0, 0.5)
    )
    assert np.std(switched[:, :10]) < 0.7 * np.std(plain[:, :10])
    assert np.abs(np.diff(switched[10])).max() > 1.5


@pytest.mark.long
@pytest.mark.parametrize("method", [meshflow.RudinOsherFatemi, meshflow.HalfQuadratic])
def test_the_fidelity_of_least_estimated_risk_is_near_the_least_error(method):
    truth, noisy = cliff()
    found = meshflow.smooth(noisy, method=method(balance="risk"), noise=1.0, result=True)
    assert "least estimated risk" in found.parameters["time"].why
    time, contrast = float(found.parameters["time"]), float(found.parameters["contrast"])
    errors = [
        rms(meshflow.smooth(noisy, method=method(contrast=contrast), time=time * factor, noise=1.0) - truth)
        for factor in 2.0 ** np.arange(-4, 5)
    ]
    assert rms(found.data - truth) < 1.1 * min(errors)
    by_constraint = meshflow.smooth(noisy, method=method(), noise=1.0)
    assert rms(found.data - truth) < rms(by_constraint - truth)
