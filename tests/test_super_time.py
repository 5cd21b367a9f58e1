"""Super-time-stepping: its orders, its reach, its embedded error, and that it arrives where small steps do."""

import numpy as np
import pytest

import meshflow
from meshflow.errors import InputError
from meshflow.flow.compute import Compute
from meshflow.flow.controls import AreaChange, Embedded, FixedStep, Until
from meshflow.flow.engines.grid import GridFlow
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.family import Variant
from meshflow.flow.march import march
from meshflow.flow.methods import Search
from meshflow.flow.steppers import Explicit, SemiImplicit, SuperTime, stepper_for
from meshflow.flow.super_time import reach, schedule, stages
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.mesh import Mesh


def waves(n=40):
    x, y = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n))
    return 0.4 * np.sin(7 * x) * np.cos(5 * y) + 0.2 * x * y, 1.0 / (n - 1)


def end(flow, time, stepper, dt):
    *_, last = march(flow, Until(time=time), stepper, FixedStep(dt))
    return last.u


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("engine", [GridFlow, MeshFlow])
def test_the_observed_order_is_that_of_the_scheme(order, engine):
    z, h = waves(16)
    data, lift = HeightField(z, h), Lift(diagonals="both")
    grid = GridFlow(data.gridded(lift))
    flow = grid if engine is GridFlow else MeshFlow(data.lifted(lift))
    time = 30 * h**2
    truth = end(grid, time, SuperTime(2), time / 512)  # of the engine that is fast; both agree to rounding
    errors = [np.abs(end(flow, time, SuperTime(order), time / n) - truth).max() for n in (8, 16, 32)]
    observed = np.log2(errors[0] / errors[2]) / 2
    assert order - 0.15 < observed < order + 0.4, f"errors {errors}, observed order {observed:.2f}, expected {order}"


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("s", [3, 4, 7, 15, 30])
@pytest.mark.parametrize("diagonals", ["forward", "both", "alternate"])
def test_steps_as_long_as_the_stages_claim_are_stable_on_white_noise(order, s, diagonals):
    z = 3 * np.random.default_rng(0).normal(size=(48, 48))
    for variant in (Variant(), Variant(1.0), Variant(-1.0, 1.5), Variant(-1.0, 2.0)):
        flow = GridFlow(HeightField(z).gridded(Lift(1.0, diagonals, "neumann")), variant)
        dt = Explicit().largest(flow, flow.start()) * reach(order, s)
        states = list(march(flow, Until(steps=8), SuperTime(order, s), FixedStep(dt)))
        spread = [np.std(state.u) for state in states]
        # Legendre polynomials stay below 1 on their whole interval: nothing grows, however far a step reaches.
        assert all(b <= a * (1 + 1e-9) for a, b in zip(spread, spread[1:], strict=False)), spread
        assert spread[-1] < 0.95 * spread[0]
        with pytest.raises(InputError, match="the largest stable step is"):
            list(march(flow, Until(steps=1), SuperTime(order, s), FixedStep(dt * 1.01)))


def test_beyond_their_reach_the_stages_would_indeed_be_unstable():
    z = 1e-3 * np.random.default_rng(0).normal(size=(32, 32))
    flow = GridFlow(HeightField(z).gridded(Lift(1.0, "forward", "neumann")))
    system = flow.system(flow.start())
    stiffness = system.matrix(1.0).toarray() - np.diag(system.mass)
    fastest = np.abs(np.linalg.eigvals(stiffness / system.mass[:, None])).max()
    plan, s = schedule(1, 5), 5
    growth = []
    for stretch in (1.0, 1.3):
        x = -2 * reach(1, s) * stretch  # fastest * dt, where dt = reach * 2 / fastest
        before, last = 1.0, 1.0 + plan.first * x
        for back, rate in zip(plan.back, plan.rate, strict=True):
            before, last = last, last + back * (before - last) + rate * x * last
        growth.append(abs(last))
    assert growth[0] <= 1 + 1e-12 < growth[1]
    assert fastest <= flow.bound(flow.start())


@pytest.mark.parametrize("order", [1, 2])
def test_as_few_stages_are_taken_as_reach_the_step(order):
    for steps in (1.0, 2.9, 3.0, 6.0, 6.1, 44.9, 45.0, 300.0):
        s = stages(order, steps)
        assert reach(order, s) >= steps * (1 - 1e-9)
        assert s == (1 if order == 1 else 2) or reach(order, s - 1) < steps


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("s", [3, 5, 12])
def test_the_embedded_error_is_the_error_to_its_order(order, s):
    plan = schedule(order, s)
    for z in (-1e-1, -1e-2):
        before, last = 1.0, 1.0 + plan.first * z
        for back, home, rate, begin in zip(plan.back, plan.home, plan.rate, plan.begin, strict=True):
            before, last = last, last + back * (before - last) + home * (1 - last) + rate * z * last + begin * z
        found = plan.error[0] * last + plan.error[1] * before + plan.error[2] + plan.error[3] * z
        assert found == pytest.approx(np.exp(z) - last, rel=0.6 * abs(z))


@pytest.mark.parametrize("variant", [Variant(), Variant(1.0), Variant(-1.0, 1.5), Variant(-1.0, 2.0)], ids=str)
def test_super_time_arrives_where_small_explicit_steps_do(variant):
    rng = np.random.default_rng(1)
    truth = np.kron(rng.integers(0, 6, (6, 6)) * 12.0, np.ones((16, 16)))
    z = truth + rng.normal(size=truth.shape)
    flow = GridFlow(HeightField(z).gridded(Lift(1.5)), variant)
    states = list(march(flow, Until(time=7.5), "super-time"))
    small = end(flow, 7.5, Explicit(), 1 / 24)
    away = np.std(states[-1].u - small)
    assert sum(stages(1, state.dt * 6) for state in states[1:]) < 60  # rates, instead of 180
    assert away < 0.04, f"{away:.4f} sigma"
    closer = list(march(flow, Until(time=7.5), SuperTime(), FixedStep(0.25)))[-1].u
    assert np.std(closer - small) < away


def test_steps_grow_as_the_flow_slows_down():
    z = np.random.default_rng(2).normal(size=(64, 64))
    flow = GridFlow(HeightField(z).gridded(Lift(3.0)), Variant(-1.0, 1.5))
    states = list(march(flow, Until(time=60.0), "super-time"))
    dts = [state.dt for state in states[1:]]
    assert dts[0] == pytest.approx(1 / 6)
    assert max(dts) > 5.0
    assert sum(stages(1, dt / (1 / 6)) for dt in dts) < 130  # rates; explicit steps would be 360
    small = end(flow, 60.0, Explicit(), 1 / 12)
    assert np.std(states[-1].u - small) < 0.01


def test_automatic_choice_takes_super_time_where_it_saves_steps():
    flow = GridFlow(HeightField(np.random.default_rng(0).normal(size=(9, 9))).gridded(Lift()))
    assert stepper_for("auto", flow, 7.9).name == "explicit"
    assert stepper_for("auto", flow, 12.0).name == "super-time"
    assert stepper_for("auto", flow, 1e6).name == "super-time"  # a grid has no slivers


def test_a_mesh_that_collapses_on_the_way_is_given_shorter_steps():
    z = 3 * np.random.default_rng(0).normal(size=(20, 20))
    surface = HeightField(z).lifted(Lift(diagonals="forward"))
    flow = MeshFlow(Mesh(surface.points, surface.triangulations[0]).lifted(Lift(boundary="neumann")))
    first = Explicit().largest(flow, flow.start())
    states = list(march(flow, Until(steps=6), SuperTime()))
    assert states[1].dt < 6 * first  # not the six explicit steps that were tried
    areas = [state.area for state in states]
    assert all(b < a for a, b in zip(areas, areas[1:], strict=False))


def test_the_area_may_choose_the_step_as_well():
    z = np.random.default_rng(3).normal(size=(32, 32))
    flow = GridFlow(HeightField(z).gridded(Lift()))
    states = list(march(flow, Until(time=4.0), SuperTime(), AreaChange(0.1, 1.0)))
    assert states[-1].time == pytest.approx(4.0)
    assert len({state.dt for state in states[1:]}) > 1


def test_the_front_door_takes_it_by_name_and_says_so():
    z = np.random.default_rng(4).normal(size=(20, 20))
    by_name = meshflow.smooth(z, method=Search(contrast=1.0), time=20.0, compute=Compute(stepper="super-time"))
    assert np.array_equal(by_name, meshflow.smooth(z, method=Search(contrast=1.0), time=20.0))
    second = meshflow.smooth(
        z, method=Search(contrast=1.0), time=20.0, compute=Compute(stepper=meshflow.SuperTime(order=2), dt=0.5)
    )
    assert 0 < np.std(second - by_name) < 0.1


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: SuperTime(order=3), "order: 1 or 2 expected, got 3"),
        (lambda: SuperTime(stages=2), "stages: a whole number, 3 or more"),
        (lambda: SuperTime(stages=4.5), "got 4.5"),
        (lambda: Embedded(tolerance=0), "tolerance: a positive"),
        (lambda: Embedded(dt=-1), "dt: a positive"),
        (
            lambda: meshflow.smooth(np.eye(5), time=1.0, compute=Compute(stepper=SemiImplicit(), control=Embedded())),
            "does not know its error",
        ),
    ],
)
def test_options_without_meaning_are_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()
