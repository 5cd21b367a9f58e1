"""What .ci/run reads before it runs: the test command of the README, and the lower bounds of pyproject.toml."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def script(name):
    spec = importlib.util.spec_from_file_location(name, ROOT / ".ci" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_readme_of_this_repository_has_a_test_command():
    assert script("readme").command((ROOT / "README.md").read_text(encoding="utf-8")) == "python -m pytest --long"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("# Tests\n\n```bash\npython -m pytest\n```\n", "one line '<!-- tests -->' expected, got 0"),
        ("<!-- tests -->\n```bash\na\n```\n<!-- tests -->\n```bash\nb\n```\n", "got 2"),
        ("<!-- tests -->\nrun pytest\n", "a bash block with a test command"),
        ("<!-- tests -->\n```bash\n```\n", "a bash block with a test command"),
        ("<!-- tests -->\n```bash\n# nothing\n\n```\n", "a bash block with a test command"),
    ],
)
def test_a_readme_without_a_test_command_fails_the_run(tmp_path, text, message):
    (tmp_path / "README.md").write_text(text)
    reported = subprocess.run(
        [sys.executable, ROOT / ".ci" / "readme.py", tmp_path / "README.md"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert reported.returncode == 1
    assert message in reported.stderr
    assert reported.stdout == ""


def test_the_run_stops_where_the_readme_names_no_command(tmp_path):
    (tmp_path / ".ci").mkdir()
    for name in ("run", "readme.py"):
        (tmp_path / ".ci" / name).write_text((ROOT / ".ci" / name).read_text())
    (tmp_path / "README.md").write_text("nothing\n")
    reported = subprocess.run(["bash", tmp_path / ".ci" / "run"], capture_output=True, text=True, check=False)
    assert reported.returncode != 0
    assert "'<!-- tests -->' expected" in reported.stderr


def test_every_requirement_has_a_lower_bound_that_can_be_installed():
    pins = script("oldest").pins()
    assert len(pins) > 5
    assert all("==" in pin for pin in pins)
