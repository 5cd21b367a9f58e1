"""What README and guides say is so: their Python names exist, their flags exist."""

import ast
import re

import pytest
from helpers.guides import PAGES
from typer.main import get_command

import meshflow
from meshflow.cli.commands import app

README = "\n".join(page.read_text() for page in PAGES)
COMMANDS = get_command(app).commands  # type: ignore[attr-defined]


@pytest.mark.parametrize("block", re.findall(r"```python\n(.*?)```", README, re.DOTALL), ids=lambda b: b[:30].strip())
def test_names_of_meshflow_in_python_blocks_exist(block):
    for node in ast.walk(ast.parse(block)):
        if isinstance(node, ast.ImportFrom) and node.module == "meshflow":
            assert all(hasattr(meshflow, alias.name) for alias in node.names)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "meshflow":
            assert hasattr(meshflow, node.attr), node.attr


@pytest.mark.parametrize(
    "line", sorted(set(re.findall(r"meshflow (?:smooth|fuse|info|compare|show|film|view) [^`#\n&]*", README)))
)
def test_flags_in_shell_lines_exist(line):
    command = COMMANDS[line.split()[1]]
    known = {word for p in command.params for word in (*p.opts, *p.secondary_opts)}
    assert set(re.findall(r"(?<=\s)--[a-z-]+", line)) <= known | {"--help"}
