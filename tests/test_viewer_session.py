"""The viewer through time: what is kept, what the command line makes, and what bad input is told."""

import shlex

import numpy as np
import pytest
import trimesh
from helpers.parts import parts

import meshflow
from meshflow.cli.commands import app
from meshflow.errors import FormatError, InputError
from meshflow.estimate.request import Request
from meshflow.flow.compute import Compute
from meshflow.flow.methods import Beltrami
from meshflow.flow.offsets import without_offsets
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.mesh import Mesh
from meshflow.synthetic.shapes import sphere
from meshflow.viewer.controls import Page, States
from meshflow.viewer.curves import curves, summary
from meshflow.viewer.session import Desk, Saving, Session, view
from meshflow.viewer.timeline import recorded

QUICK = Request.of(
    method=Beltrami(gamma=0.0, sharpness=1.0, patch=0.0, contrast=2.0), time=4.0, compute=Compute(search=False)
)


def hills(size=24, seed=1):
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(size), np.arange(size))
    return HeightField(3.0 * np.sin(x / 5) * np.cos(y / 6) + 0.3 * rng.normal(size=(size, size)))


def ball():
    shape = sphere(2)
    return Mesh(shape.noisy("iso", 0.2, 3), shape.faces)


def test_states_begin_at_the_start_and_their_area_falls():
    timeline = Session.begun(hills(), QUICK, count=6).run()
    assert len(timeline) == 6
    assert np.array_equal(timeline.at(0).z, hills().z)
    assert timeline.history[0].change == 0
    areas, changes = ([getattr(m, name) for m in timeline.history] for name in ("area", "change"))
    assert areas[0] == 1.0
    assert all(np.diff(areas) < 0)
    assert all(np.diff(changes) > 0)
    assert timeline.history[-1].time == pytest.approx(4.0)


def test_beyond_the_memory_states_are_let_go_and_computed_again():
    whole = Session.begun(hills(), QUICK, count=9).run()
    few = Session.begun(hills(), QUICK, count=9, memory=3 * hills().z.nbytes).run()
    assert whole.kept == tuple(range(9))
    assert len(few.kept) <= 3
    assert {0, 8} <= set(few.kept)
    assert few.history == whole.history
    gone = next(k for k in range(9) if k not in few.kept)
    # It takes the steps of a run that ends there, not those of one that goes on.
    assert np.abs(few.at(gone).z - whole.at(gone).z).max() < 0.05
    with pytest.raises(InputError, match="state 9: 0 to 8 expected"):
        few.at(9)


def test_no_state_is_refused():
    with pytest.raises(InputError, match="got none"):
        recorded(iter(()), lambda time: hills(), 1.0)


@pytest.mark.parametrize("kind", ["terrain.npy", "ball.ply"])
def test_the_command_line_makes_the_state_that_is_saved_to_the_last_bit(tmp_path, kind, monkeypatch):
    from typer.testing import CliRunner

    source, target = tmp_path / kind, tmp_path / f"out{kind[-4:]}"
    if kind.endswith("npy"):
        np.save(source, hills().z)
    else:
        trimesh.Trimesh(ball().points, ball().faces, process=False).export(source)
    document = meshflow.read(source)
    settings = QUICK if kind.endswith("npy") else Request.of(method="fairing", time=0.01)
    desk = Desk(Session.begun(document.data, settings, count=5), document, Saving(str(source), target))
    timeline = desk.run({}, lambda share: False)
    desk.shown(timeline)
    measurement = timeline.history[3]
    assert "written" in desk.save(measurement.time)
    again = tmp_path / f"again{kind[-4:]}"
    words = shlex.split(desk.command(measurement.time).replace(str(target), str(again)))
    done = CliRunner().invoke(app, [*words[1:], "--quiet"])
    assert done.exit_code == 0, done.output
    one, other = meshflow.read(target).data, meshflow.read(again).data
    assert np.array_equal(*(data.points if isinstance(data, Mesh) else data.z for data in (one, other)))
    with pytest.raises(InputError, match="exists"):
        desk.save(measurement.time)


def test_a_changed_control_changes_the_flow_and_only_it():
    session = Session.begun(hills(), QUICK, count=4)
    assert {control.name for control in session.controls} == {"scale", "gamma", "sharpness", "patch", "contrast"}
    far = session.turned(scale=4.0)
    assert far.run().history[-1].time == pytest.approx(8.0)
    assert session.run().history[-1].time == pytest.approx(4.0)
    steeper = session.turned(gamma=2.0).run().at(3).z
    assert not np.array_equal(steeper, session.run().at(3).z)
    with pytest.raises(InputError, match="order: no such control; there are contrast, gamma"):
        session.turned(order=3)


def test_points_of_a_mesh_may_change_their_method():
    session = Session.begun(ball(), Request.of(method="fairing", scale=0.2), count=4)
    desk = Desk(session, ball(), Saving())
    names = {control["name"]: control for control in desk.controls()}
    assert set(names) == {"method", "scale", "order"}
    timeline = desk.run({"method": "curvature", "scale": 0.2, "order": 2.0}, lambda share: False)
    desk.shown(timeline)
    assert desk.session.word == "curvature"
    assert timeline.history[-1].area < 1.0


@pytest.mark.parametrize("given", [{}, {"method": "fairing"}])
def test_the_end_of_a_mesh_is_what_smooth_makes_of_it(given):
    found = meshflow.smooth(ball(), **parts(**given), result=True)
    session = Session.begun(ball(), Request.of(**parts(**given)), count=3)
    assert found.parameters["method"].value == session.word
    if "fairing" in given.values():  # what the search found, and not what stands for no search
        chosen = session.request.method
        for name in ("order", "weights", "presmooth"):
            assert found.parameters[name].value == getattr(chosen, name)
        assert (chosen.order, chosen.weights, chosen.presmooth) != (None, None, None)
    # the states are those of one run, whose steps are others, and which keeps its offsets from the data
    end, start = session.run().at(2), ball()
    held = np.zeros(len(start.points), bool)
    away = without_offsets(end.points, start.points, start.faces, held) - found.after.points
    assert np.sqrt(np.square(away).mean()) < 0.1 * found.noise.sigma


def test_a_run_that_nobody_waits_for_is_left():
    desk = Desk(Session.begun(hills(), QUICK, count=4), hills(), Saving())
    assert desk.run({"scale": 3.0}, lambda share: True) is None
    assert desk.session.request.scale == pytest.approx(np.sqrt(8.0))


def test_what_is_saved_is_of_the_run_that_is_seen_and_of_none_that_ended_unseen():
    desk = Desk(Session.begun(hills(), QUICK, count=4), hills(), Saving())
    seen = desk.session
    timeline = desk.run({"scale": 3.0}, lambda share: False)
    assert desk.session is seen
    desk.shown(timeline)
    assert desk.session.request.scale == pytest.approx(3.0)


def test_curves_mark_the_state_that_is_shown():
    timeline = Session.begun(hills(), QUICK, count=5).run()
    marks = [curves(timeline, index).split("<line x1=")[1][:7] for index in range(5)]
    assert len(set(marks)) == 5
    assert curves(timeline, 2).count("<polyline") == 2
    assert summary(timeline, 4).startswith("time 4")


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"steps": 3}, "the slider says when to stop"),
        ({"time": 0.0}, "a time of 0 shows one state"),
        ({"mask": np.zeros((24, 24), bool)}, "nothing to show"),
    ],
)
def test_what_has_no_states_is_refused(settings, message):
    with pytest.raises(InputError, match=message):
        Session.begun(hills(), Request.of(**parts(**settings)))


def test_bad_displays_and_pages_are_refused_before_anything_is_computed(tmp_path):
    with pytest.raises(InputError, match="place: an Address, a Page, or None for a window, expected; got 'tab'"):
        view(hills(), place="tab")
    with pytest.raises(FormatError, match=r"\.html expected"):
        view(hills(), place=Page(tmp_path / "page.pdf"))
    (tmp_path / "there.html").write_text("old")
    with pytest.raises(FormatError, match="exists; name another file, or overwrite it on purpose"):
        view(hills(), place=Page(tmp_path / "there.html"))
    with pytest.raises(FormatError, match="there is no folder"):
        view(hills(), place=Page(tmp_path / "no" / "page.html"))


@pytest.mark.needs_gl
def test_without_a_display_a_window_says_what_else_there_is(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    with pytest.raises(InputError, match="a window needs a display.*--web"):
        view(hills(), request=QUICK, states=States(3))
