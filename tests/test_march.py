"""Steps, their control, solvers, and the loop that ends with a sentence."""

import re

import numpy as np
import pytest
import scipy.sparse as sparse
from helpers import shapes

from meshflow.errors import InputError, NotConverged
from meshflow.flow.controls import AreaChange, FixedStep, Until
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.linear_solve import solve
from meshflow.flow.march import march
from meshflow.flow.steppers import Explicit, SemiImplicit, stepper_for
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.surface import Surface


def noisy(n=24, sigma=2.0, seed=0, **lift):
    z = sigma * np.random.default_rng(seed).normal(size=(n, n))
    return MeshFlow(HeightField(z).lifted(Lift(**lift)))


def test_the_run_ends_at_the_time_asked_for_and_says_so():
    states = list(march(noisy(), Until(time=1.0)))
    assert states[0].step == 0
    assert states[0].time == 0.0
    assert states[-1].time == pytest.approx(1.0, rel=1e-12)
    assert re.fullmatch(r"reached time 1 in \d+ steps", states[-1].reason)
    assert all(s.reason is None for s in states[:-1])
    assert all(b.area < a.area and b.largest > 0 for a, b in zip(states, states[1:], strict=False))


def test_the_run_ends_after_the_steps_asked_for_and_says_so():
    *_, last = march(noisy(), Until(steps=3))
    assert last.step == 3
    assert last.reason.startswith("took all 3 steps asked for")
    *_, last = march(noisy(), Until(steps=0))
    assert last.step == 0
    assert np.array_equal(last.u, noisy().start())


def test_an_unstable_explicit_dt_is_refused_with_the_largest_stable_one_named():
    flow = noisy()
    largest = Explicit().largest(flow, flow.start())
    with pytest.raises(InputError, match=rf"largest stable step is {largest:.6g}".replace(".", r"\.")):
        list(march(flow, Until(time=1.0), Explicit(), FixedStep(largest * 1.01)))
    list(march(flow, Until(steps=2), Explicit(), FixedStep(largest)))


def test_a_step_beyond_the_bound_would_indeed_be_unstable():
    flow = noisy(sigma=0.01)
    dt, u = 4 * Explicit().largest(flow, flow.start()), flow.start()
    before = flow.area(u)
    for turn in range(60):
        u = Explicit().step(flow, u, dt, turn)
    assert flow.area(u) > before


def test_the_step_grows_with_the_area_lost_and_shrinks_when_little_is():
    states = list(march(noisy(), Until(steps=60), Explicit(), AreaChange(target=0.03, dt=0.1)))
    assert states[1].dt == pytest.approx(0.1)
    for a, b, c in zip(states, states[1:], states[2:], strict=False):
        loss_in_a_full_step = (a.area - b.area) / a.area * 0.1 / b.dt
        assert c.dt == pytest.approx(0.1 * min(loss_in_a_full_step / 0.03, 1.0))
    dts = [s.dt for s in states[1:]]
    assert max(dts) == pytest.approx(0.1)
    assert dts[-1] < 0.05


@pytest.mark.parametrize("solver", ["cg", "multigrid"])
def test_every_solver_finds_what_the_direct_one_finds(solver):
    points, faces = shapes.sphere(4000, shake=0.1)
    for dt in (1e-4, 1e-2):
        flow = MeshFlow(Mesh(points, faces).lifted(Lift()))
        truth = SemiImplicit("direct").step(flow, points, dt, 0)
        assert (
            np.abs(SemiImplicit(solver).step(flow, points, dt, 0) - truth).max() < 1e-7 * np.abs(truth - points).max()
        )


@pytest.mark.parametrize("method", ["direct", "cg", "multigrid"])
def test_a_system_that_is_not_finite_is_refused_by_every_solver(method):
    with pytest.raises(NotConverged, match=f"solver {method}: the system holds NaN"):
        solve(sparse.csr_matrix(np.diag([1.0, 1.0, np.nan])), np.ones((3, 1)), np.zeros((3, 1)), method)


def test_multigrid_gives_the_same_bits_each_time_and_leaves_the_random_numbers_of_the_caller():
    chain = sparse.diags([-np.ones(3999), 2.001 * np.ones(4000), -np.ones(3999)], [-1, 0, 1]).tocsr()
    right = np.random.default_rng(0).normal(size=(4000, 1))
    before = np.random.get_state()[1].tolist()  # noqa: NPY002
    first, second = (solve(chain, right, None, "multigrid", 1e-8) for _ in range(2))
    assert np.array_equal(first, second)
    assert np.random.get_state()[1].tolist() == before  # noqa: NPY002


def test_a_solver_that_does_not_converge_says_how_far_it_came_and_what_to_try():
    indefinite = sparse.csr_matrix(np.array([[1.0, 2.0], [2.0, 1.0]]))
    with pytest.raises(
        NotConverged,
        match=r"cg: relative residual .* after \d+ iterations, 1.0e-09 was asked for .* try solver='direct'",
    ):
        solve(indefinite, np.array([[1.0], [-1.0]]), np.zeros((2, 1)), "cg")
    with pytest.raises(NotConverged, match="solver direct"):
        solve(
            sparse.csr_matrix(np.array([[1.0, 1.0], [1.0, 1.0]])), np.array([[1.0], [-1.0]]), np.zeros((2, 1)), "direct"
        )


def test_automatic_choice_takes_the_implicit_step_where_slivers_make_the_explicit_one_hopeless():
    points, faces, _ = shapes.square(100)
    points[:, 2] = 0.01 * np.sin(9 * points[:, 0])
    flow = MeshFlow(Mesh(points, faces).lifted(Lift()))
    assert stepper_for("auto", flow, 1e-9).name == "explicit"
    assert stepper_for("auto", flow, 1e-3).name == "super-time"
    assert stepper_for("auto", flow, 10.0).name == "semi-implicit"


def collapsing():
    """Steep noise as a mesh that moves in space: its triangles become slivers, and explicit steps ever shorter."""
    z = 3 * np.random.default_rng(0).normal(size=(20, 20))
    surface = HeightField(z).lifted(Lift(diagonals="forward"))
    return MeshFlow(Surface(surface.points, surface.triangulations, boundary="plane-preserving"))


def test_automatic_choice_changes_to_the_implicit_step_when_triangles_become_slivers():
    flow = collapsing()
    assert stepper_for("auto", flow, 2.0).name == "explicit"
    states = list(march(flow, Until(time=2.0), "auto"))
    assert states[-1].time == pytest.approx(2.0)
    assert states[1].stepper == "explicit"
    assert states[-1].stepper == "semi-implicit"
    assert len(states) < 600


def test_explicit_steps_by_name_that_would_not_arrive_are_given_up_with_the_way_out(monkeypatch):
    monkeypatch.setattr("meshflow.flow.march.HOPELESS", 1000)
    with pytest.raises(NotConverged, match=r"so thin that explicit steps are at most .* take stepper='semi-implicit'"):
        list(march(collapsing(), Until(time=2.0), "explicit"))


def test_progress_is_told_and_may_end_the_run():
    reported = []
    list(march(noisy(), Until(steps=4), progress=lambda done, total: reported.append((done, total))))
    assert reported == [(0.25, 1.0), (0.5, 1.0), (0.75, 1.0), (1.0, 1.0)]

    def stop(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        list(march(noisy(), Until(steps=4), progress=stop))


def test_progress_true_writes_nothing_where_nobody_looks(capfd):
    list(march(noisy(), Until(steps=4), progress=True))
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Until(), "a time or a number of steps expected"),
        (lambda: Until(time=-1), "zero or more, expected .* got -1"),
        (lambda: Until(time=np.inf), "got inf"),
        (lambda: Until(steps=-2), "got -2"),
        (lambda: Until(steps=1.5), "got 1.5"),
        (lambda: FixedStep(0), "dt: a positive finite number"),
        (lambda: FixedStep(-1), "dt: a positive finite number"),
        (lambda: AreaChange(target=0), "target: a positive"),
        (lambda: SemiImplicit("qr"), "solver: auto, direct, cg or multigrid expected, got 'qr'"),
        (lambda: SemiImplicit(tolerance=-1), "tolerance: a positive"),
        (lambda: stepper_for("midpoint", noisy(), 1.0), "semi-implicit or super-time expected, got 'midpoint'"),
        (lambda: list(march(noisy(), Until(steps=1), progress="yes")), "progress: None, True or a callable"),
        (lambda: list(march(noisy(), Until(steps=1), SemiImplicit())), "give dt beside steps"),
    ],
)
def test_options_that_make_no_sense_are_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()
