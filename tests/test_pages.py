"""README, guides and the reference of public names build as pages; no link leads nowhere, no name is missing."""

import subprocess
import sys
from pathlib import Path

import pytest

import meshflow

ROOT = Path(__file__).parents[1]


@pytest.mark.long
def test_the_pages_build_and_the_reference_has_every_public_name(tmp_path):
    built = subprocess.run(
        [sys.executable, ROOT / ".ci" / "pages.py", tmp_path], capture_output=True, text=True, check=False
    )
    assert built.returncode == 0, built.stdout + built.stderr
    page = (tmp_path / "site" / "reference" / "meshflow.html").read_text()
    for name in meshflow.__all__:
        assert f".{name}" in page, name
    assert "&gt;&gt;&gt;" in page  # the examples are there
