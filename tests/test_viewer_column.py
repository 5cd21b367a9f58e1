"""The window of the viewer, drawn off-screen: curves with their mark, controls, and a thread that nothing waits for."""

import time as clock
from threading import Event

import numpy as np
import pytest

from meshflow.errors import InputError
from meshflow.estimate.request import Request
from meshflow.flow.compute import Compute
from meshflow.flow.methods import Beltrami
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.mesh import Mesh
from meshflow.synthetic.shapes import sphere
from meshflow.view.look import Look
from meshflow.viewer.column import COLUMN
from meshflow.viewer.curves import across, measures
from meshflow.viewer.session import Desk, Saving, Session
from meshflow.viewer.timeline import Timeline, recorded
from meshflow.viewer.worker import Background

QUICK = Request.of(
    method=Beltrami(gamma=0.0, sharpness=1.0, patch=0.0, contrast=2.0), time=4.0, compute=Compute(search=False)
)
SIZE = (800, 600)


def hills(size=24):
    x, y = np.meshgrid(np.arange(size), np.arange(size))
    noise = np.random.default_rng(1).normal(size=(size, size))
    return HeightField(3.0 * np.sin(x / 5) * np.cos(y / 6) + 0.3 * noise)


def ball():
    shape = sphere(2)
    return Mesh(shape.noisy("iso", 0.2, 3), shape.faces)


@pytest.fixture
def opened():
    from meshflow.viewer.window import Window

    windows = []

    def opening(data, settings, **options):
        desk = Desk(Session.begun(data, settings, **options), data, Saving())
        windows.append(Window(desk, desk.session.run(), Look(size=SIZE), off_screen=True))
        return windows[-1]

    yield opening
    for window in windows:
        window.screen.plotter.close()


def until(window, met):
    end = clock.time() + 60
    while not met():
        assert clock.time() < end, window.message
        clock.sleep(0.02)
        window.poll()


def column(window):
    return window.screen.picture()[:, : int(COLUMN * SIZE[0])].astype(int)


def like(picture, colour):
    """Where a picture is of a colour, #rrggbb."""
    wanted = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
    return np.abs(picture - wanted).max(axis=2) < 24


@pytest.mark.needs_gl
def test_curves_stand_beside_the_geometry_and_their_mark_goes_with_the_slider(opened):
    window = opened(hills(), QUICK, count=6)
    curves = measures(window.timeline)
    drawn = column(window)
    low, high = (int(SIZE[1] * share) for share in (0.25, 0.57))
    for curve in curves:
        assert like(drawn[low:high], curve.colour).any(axis=0).sum() > 0.5 * drawn.shape[1], curve.words
    columns = []
    for index in (1, 3, 5):
        window.move(index)
        dark = (column(window)[low:high].max(axis=2) < 160).sum(axis=0)
        dark[: int(0.12 * len(dark))] = 0  # the axis
        columns.append(int(dark.argmax()))
    marks = across(window.timeline)[[1, 3, 5]]
    steps = np.diff(columns) / np.diff(marks)
    assert steps[0] == pytest.approx(steps[1], rel=0.1), f"marks at {columns} for shares {marks}"
    assert steps[0] > 0.7 * drawn.shape[1]


@pytest.mark.needs_gl
def test_the_slider_goes_through_the_states_and_a_key_shows_what_was_removed(opened):
    window = opened(hills(), QUICK, count=4)
    pictures = [window.screen.picture()]
    window.move(0)
    pictures.append(window.screen.picture())
    window.recolour()
    pictures.append(window.screen.picture())
    assert len({picture[:, 300:].tobytes() for picture in pictures}) == 3
    slider = window._slider
    slider.GetRepresentation().SetValue(2.0)
    slider.InvokeEvent("InteractionEvent")
    assert window.index == 2


@pytest.mark.needs_gl
def test_a_changed_control_ends_the_run_that_it_makes_useless(opened):
    window = opened(hills(), QUICK, count=4)
    window.turn("scale", 6.0)
    assert like(column(window), "#2b6cb0")[: int(0.62 * SIZE[1])].any(), "no bar tells how far it is"
    window.turn("scale", 5.0)
    until(window, lambda: not window._work.kind)
    assert window.timeline.history[-1].time == pytest.approx(12.5)
    window.save()
    until(window, lambda: not window._work.kind)
    assert "only states of a file can be saved" in window.message


@pytest.mark.needs_gl
def test_the_method_control_of_a_mesh_begins_another_run_and_brings_its_own_controls(opened):
    window = opened(ball(), Request.of(method="fairing", scale=0.2), count=4)
    assert set(window.column.controls) == {"method", "scale", "order"}
    before = window.timeline
    choice = window.column.controls["method"]
    items = window.desk.controls()[0]["items"]
    places = {choice.at(x, y): (x, y) for x in np.linspace(0, COLUMN, 40) for y in np.linspace(0, 1, 400)}
    assert set(places) == {*items, None}, "each word has a place of its own"
    choice.click(*places["curvature"])
    assert choice.value == "curvature"
    assert like(column(window)[int(0.6 * SIZE[1]) :], "#2b6cb0").any(), "the chosen word is blue"
    until(window, lambda: window.timeline is not before)
    assert window.desk.session.word == "curvature"
    assert set(window.column.controls) == {"method", "scale"}


@pytest.mark.needs_gl
def test_a_state_that_was_let_go_is_computed_while_the_window_goes_on(opened):
    window = opened(hills(), QUICK, count=6)
    whole, ready, asked = window.timeline, Event(), []

    def again(time):
        asked.append(time)
        assert ready.wait(60)
        return whole.at(2)

    window.timeline = Timeline(whole.history, "", {0: whole.at(0), 5: whole.at(5)}, again)
    seen = window.screen.picture()[:, 300:]
    window.move(2)  # were it computed here, this would wait for ever
    assert (window.screen.picture()[:, 300:] == seen).mean() > 0.99  # but for the slider
    window.move(0)
    window.move(2)
    ready.set()
    until(window, lambda: not window._work.kind)
    expected = np.abs(window.screen.picture()[:, 300:].astype(int) - seen).mean()
    assert expected > 0.5, "the state came, and is not shown"


def test_of_one_kind_of_work_what_was_asked_last_counts():
    work, heard, ready = Background(), [], Event()

    def slow(gone):
        ready.wait(60)
        return "left" if gone(0.5) else "slow"

    work.ask("run", slow, heard.append, heard.append)
    work.ask("run", lambda gone: "never begun", heard.append, heard.append)
    work.ask("run", lambda gone: "last", heard.append, heard.append)
    work.ask("save", lambda gone: "saved", heard.append, heard.append)
    ready.set()
    end = clock.time() + 60
    while work.kind and clock.time() < end:
        work.poll()
    assert heard == ["last", "saved"]

    def fails(gone):
        raise InputError("no such number")

    def breaks(gone):
        raise KeyError("what nobody thought of")

    for broken, reported in ((fails, "failed: no such number"), (breaks, "failed: KeyError: 'what nobody thought of'")):
        work.ask("run", broken, heard.append, lambda message: heard.append(f"failed: {message}"))
        while work.kind and clock.time() < end:
            work.poll()
        assert not work.kind, "nobody hears of it, and the window waits for ever"
        assert heard[-1] == reported


def test_a_flow_of_one_state_has_curves_too():
    timeline = recorded([(0.0, hills())], lambda time: hills(), 0.0)
    assert across(timeline).tolist() == [0.0]
    assert measures(timeline)[1].shares.tolist() == [0.0]
