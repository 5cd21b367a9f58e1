"""In a notebook a result shows itself: pictures of before, after and what was removed, and a short table."""

from html import unescape

import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient

import meshflow

CELL = """
import meshflow
from meshflow.synthetic import mesas, noisy

meshflow.smooth(noisy(mesas(48), 2.0), spacing=10.0, unit="m", method="quick", result=True)
"""
SLIDERS = """
from meshflow.estimate.request import Request
from meshflow.viewer.controls import States
from meshflow.viewer.notebook import sliders

sliders(noisy(mesas(24), 2.0), request=Request.of("quick"), states=States(3))
"""


@pytest.mark.needs_gl
def test_a_notebook_shows_a_result_as_pictures_and_a_table_and_its_states_with_sliders(tmp_path):
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in (CELL, SLIDERS)])
    NotebookClient(notebook, timeout=120, kernel_name="python3", resources={"metadata": {"path": tmp_path}}).execute()
    shown = next(output.data for output in notebook.cells[0].outputs if output.output_type == "execute_result")
    assert shown["text/html"].count("<img") == 4  # before, after, removed, and its colours
    for word in ("before", "after", "removed", "noise"):
        assert word in shown["text/html"]
    assert len(shown["text/html"]) < 1_000_000
    frame = next(out.data for out in notebook.cells[1].outputs if out.output_type == "execute_result")["text/html"]
    assert frame.startswith('<iframe sandbox="allow-scripts"')
    page = unescape(frame.partition('srcdoc="')[2].removesuffix('"></iframe>'))
    assert page.lstrip().startswith("<!")
    assert 'type="range"' in page


def test_what_a_result_shows_is_escaped_and_has_its_warnings():
    z = np.random.default_rng(0).normal(size=(40, 40))
    z[3, 4] = -9999.0
    result = meshflow.smooth(z, spacing=1.0, unit="<m>", method="quick", result=True)
    shown = result._repr_html_()
    assert "&lt;m&gt;" in shown
    assert "<m>" not in shown
    assert "class='warning'" in shown
