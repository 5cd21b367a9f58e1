"""Whether VTK can draw is found out without dying of it."""

import functools
import os
import subprocess
import sys

import pytest

from meshflow.view import probe

WINDOW = "VTK_DEFAULT_OPENGL_WINDOW"


@pytest.fixture
def child(monkeypatch, tmp_path):
    """A shell script in the place of the Python that the probe starts, without a display, asked afresh."""

    def pretend(script):
        program = tmp_path / "python"
        program.write_text(f"#!/bin/sh\n{script}\n")
        program.chmod(0o755)
        monkeypatch.setattr(sys, "executable", str(program))

    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(probe, "_probed", functools.cache(probe._probed.__wrapped__))
    monkeypatch.setenv(WINDOW, "")
    for name in (WINDOW, "DISPLAY", "MESHFLOW_RENDERING"):
        monkeypatch.delenv(name, raising=False)
    return pretend


def test_a_child_that_crashes_leaves_us_alive_and_told(child):
    child("kill -SEGV $$")
    answer = probe.rendering()
    assert not answer.works
    assert "killed by signal 11" in answer.why
    assert "apt-get install" in answer.why


def test_a_child_that_ends_in_an_error_is_quoted(child):
    child("echo 'no EGL here' >&2; exit 3")
    assert "code 3: no EGL here" in probe.rendering().why


def test_a_child_that_hangs_is_given_up(child, monkeypatch):
    monkeypatch.setattr(probe, "_PATIENCE", 0.2)
    child("exec sleep 60")
    assert "no picture within" in probe.rendering().why


def test_a_python_that_cannot_be_started_is_no_rendering(child, monkeypatch):
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    answer = probe.rendering()
    assert not answer.works
    assert "could be started" in answer.why


@pytest.mark.parametrize("window", ["vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow"])
def test_windows_are_tried_in_turn_and_the_one_that_draws_is_set(child, window):
    child(f'[ "${WINDOW}" = {window} ] || kill -SEGV $$')
    answer = probe.rendering()
    assert (answer.works, answer.window) == (True, window)
    answer.prepare()
    assert os.environ[WINDOW] == window


def test_without_a_window_that_works_the_choice_is_left_to_vtk(child):
    child(f'[ -z "${WINDOW}" ] || kill -SEGV $$')
    answer = probe.rendering()
    assert (answer.works, answer.window) == (True, None)
    answer.prepare()
    assert WINDOW not in os.environ


def test_the_window_that_a_user_names_is_the_only_one_tried(child, monkeypatch):
    monkeypatch.setenv(WINDOW, "vtkOSOpenGLRenderWindow")
    child(f'[ "${WINDOW}" = vtkEGLRenderWindow ] || kill -SEGV $$')
    assert not probe.rendering().works


def test_with_a_display_the_choice_of_vtk_comes_first(child, monkeypatch):
    monkeypatch.setenv("DISPLAY", ":0")
    child("exit 0")
    assert probe.displayed()
    assert probe.rendering().window is None


def test_the_question_is_asked_once(child, tmp_path):
    child(f"echo asked >> {tmp_path}/log; exit 0")
    assert probe.rendering() is probe.rendering()
    assert (tmp_path / "log").read_text().split() == ["asked"]


def test_rendering_can_be_switched_off_without_asking(child, monkeypatch, tmp_path):
    child(f"touch {tmp_path}/asked")
    monkeypatch.setenv("MESHFLOW_RENDERING", "off")
    answer = probe.rendering()
    assert not answer.works
    assert "MESHFLOW_RENDERING" in answer.why
    assert not (tmp_path / "asked").exists()


@pytest.mark.needs_gl
def test_a_machine_with_opengl_is_recognised():
    answer = probe.rendering()
    assert answer.works, answer.why


def test_importing_the_room_imports_nothing_that_draws():
    code = "import sys, meshflow.view; print(*({'pyvista', 'vtk', 'vtkmodules', 'matplotlib'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == ""
