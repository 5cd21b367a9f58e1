"""Tests once, in a child process, whether VTK can draw on this machine, since VTK may crash where it cannot."""

import os
import subprocess
import sys
from dataclasses import dataclass
from functools import cache

__all__ = ["Rendering", "displayed", "rendering"]

_CHOICE = "VTK_DEFAULT_OPENGL_WINDOW"
_SWITCH = "MESHFLOW_RENDERING"
_MEND = "on Debian or Ubuntu: apt-get install libegl1 libgl1 libgl1-mesa-dri libx11-6"
_PATIENCE = 180.0  # seconds; the first import of VTK from a cold disk is slow
_CHILD = """
import pyvista
plotter = pyvista.Plotter(off_screen=True, window_size=(32, 32))
plotter.add_mesh(pyvista.Sphere(), color="black")
picture = plotter.screenshot(None, return_img=True)
plotter.close()
raise SystemExit(0 if picture.std() > 0 else "VTK drew nothing")
"""


@dataclass(frozen=True)
class Rendering:
    """Whether VTK can draw here.

    :param works: a child process drew a picture.
    :param window: the window class that worked, for ``VTK_DEFAULT_OPENGL_WINDOW``; None: VTK chooses.
    :param why: a sentence for the user; where it does not work, it says what to do.
    """

    works: bool
    window: str | None
    why: str

    def prepare(self) -> None:
        """Make this process use the window that worked; call it before a plotter is made."""
        if self.window is not None:
            os.environ[_CHOICE] = self.window


def rendering() -> Rendering:
    """Whether VTK can draw here; the first call takes a few seconds, later calls are cached.

    With ``MESHFLOW_RENDERING=off`` in the environment the answer is no, without a test.

    Example:

        >>> type(rendering()).__name__
        'Rendering'
    """
    if os.environ.get(_SWITCH, "").lower() == "off":
        return Rendering(False, None, f"drawing with VTK is switched off by {_SWITCH}=off in the environment; unset it")
    return _probed()


def displayed() -> bool:
    """Whether a window can be opened; on Linux VTK needs an X server."""
    return sys.platform in ("win32", "darwin") or bool(os.environ.get("DISPLAY"))


@cache
def _probed() -> Rendering:
    """Try window classes in child processes, the likeliest first."""
    failures = []
    for window in _candidates():
        failure = _failure(window)
        if failure is None:
            return Rendering(True, window, f"VTK draws with {window or 'the window it chooses itself'}")
        failures.append(f"{window or 'its own choice of window'}: {failure}")
    return Rendering(False, None, f"VTK cannot draw here ({'; '.join(failures)}); {_MEND}")


def _candidates() -> tuple[str | None, ...]:
    """The window classes to try; without an X server EGL first, which VTK would also choose, with warnings on stderr."""
    if sys.platform in ("win32", "darwin") or os.environ.get(_CHOICE):
        return (None,)
    headless = ("vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow")
    return (None, *headless) if displayed() else (*headless, None)


def _failure(window: str | None) -> str | None:
    """The failure of a child that drew with this window; None when it succeeded."""
    surroundings = dict(os.environ)
    if window is not None:
        surroundings[_CHOICE] = window
    try:
        child = subprocess.run(
            [sys.executable, "-c", _CHILD],
            env=surroundings,
            timeout=_PATIENCE,
            check=False,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
        )
    except subprocess.TimeoutExpired:
        return f"no picture within {_PATIENCE:.0f} s"
    except OSError as cause:
        return f"no child process could be started ({cause})"
    if child.returncode == 0:
        return None
    if child.returncode < 0:
        return f"it was killed by signal {-child.returncode}"
    last = child.stderr.strip().splitlines()[-1:] or ["no message"]
    return f"it ended with code {child.returncode}: {last[0]}"
