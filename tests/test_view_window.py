"""A window on a display that nobody sees (Xvfb): the divider is dragged, the surface turned, the space bar pressed."""

import shutil
import subprocess
import sys

import pytest

pytestmark = [
    pytest.mark.needs_gl,
    pytest.mark.skipif(shutil.which("xvfb-run") is None, reason="xvfb-run is not installed"),
]

SCRIPT = """
import numpy as np, pyvista as pv
from meshflow.view import compare
from pyvista.plotting import plotter as plotters

shown = pv.Plotter.show
seen = {}

def press(window):
    keys = window.iren.interactor
    keys.SetKeySym("space")
    keys.InvokeEvent("KeyPressEvent")

def drag(window, start, end):
    mouse = window.iren.interactor
    mouse.SetEventInformation(*start)
    mouse.InvokeEvent("LeftButtonPressEvent")
    for share in (0.5, 1.0):
        mouse.SetEventInformation(*(int(a + share * (b - a)) for a, b in zip(start, end)))
        mouse.InvokeEvent("MouseMoveEvent")
    mouse.InvokeEvent("LeftButtonReleaseEvent")

def picture(window):
    return window.screenshot(None, return_img=True)[60:-60].astype(int)

def show(window):
    shown(window, interactive_update=True, auto_close=False)
    wide, tall = window.window_size
    seen["start"] = picture(window)
    drag(window, (wide // 2, int(0.04 * tall)), (int(0.8 * wide), int(0.04 * tall)))
    window.render()
    seen["dragged"] = picture(window)
    press(window)
    seen["before"] = picture(window)
    place = np.array(window.camera.position)
    drag(window, (wide // 2, tall // 2), (wide // 2 + 60, tall // 2))
    assert np.linalg.norm(window.camera.position - place) > 1

pv.Plotter.show = show
rough = np.random.default_rng(0).normal(size=(40, 60))
told = compare(rough, np.zeros((40, 60)), arrange="wipe", size=(600, 400))
assert told.path is None
# Left of the divider both show what is before.
places = [np.flatnonzero(np.abs(seen["before"] - seen[name]).max(axis=(0, 2)) > 60).min() for name in ("start", "dragged")]
assert abs(places[0] - 300) < 8 and abs(places[1] - 480) < 12, f"the divider went from {places[0]} to {places[1]}"
assert not plotters._ALL_PLOTTERS, "a window is left behind"
"""


@pytest.mark.long
def test_a_window_wipes_blinks_turns_and_closes():
    done = subprocess.run(
        ["xvfb-run", "-a", sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=False, timeout=200
    )
    assert done.returncode == 0, done.stderr
