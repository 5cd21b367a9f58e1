"""What the commands say of themselves. meshflow.cli.console."""

import io

import pytest
from numba import njit
from rich.console import Console

from meshflow.cli import console


def compiled(add):
    """Two functions, compiled anew each time."""
    for _ in range(2):
        njit(lambda x: x + add)(1)


@pytest.mark.parametrize(("terminal", "quiet", "times"), [(True, False, 1), (True, True, 0), (False, False, 0)])
def test_that_loops_are_compiled_is_said_once_and_to_a_terminal_alone(monkeypatch, terminal, quiet, times):
    said = io.StringIO()
    monkeypatch.setattr(console, "err", Console(file=said, force_terminal=terminal))
    console.tell_of_compiling(quiet)
    compiled(1)
    assert said.getvalue().count("compiling for this machine") == times
