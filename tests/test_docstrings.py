"""Every public function has an example in its docstring, and the examples run and give what they say."""

import doctest
import inspect
import re
import shutil
from importlib import import_module
from pathlib import Path

import pytest

ROOMS = ("meshflow", "meshflow.classics", "meshflow.evaluate", "meshflow.synthetic", "meshflow.view")
DATA = Path(__file__).parents[1] / "data"


def functions():
    """Names to public functions."""
    found = {
        f"{room}.{name}": getattr(import_module(room), name) for room in ROOMS for name in import_module(room).__all__
    }
    return {name: function for name, function in found.items() if inspect.isfunction(function)}


@pytest.mark.needs_gl
@pytest.mark.parametrize("name", sorted(functions()))
def test_the_example_of_a_public_function_gives_what_it_says(name, tmp_path, monkeypatch):
    if name == "meshflow.to_open3d":
        pytest.importorskip("open3d")
    monkeypatch.chdir(tmp_path)
    shutil.copytree(DATA, "data", ignore=shutil.ignore_patterns("__pycache__"))
    function = functions()[name]
    module = import_module(function.__module__)
    examples = doctest.DocTestFinder(recurse=False).find(function, name, module, {**vars(module)})
    assert examples
    assert examples[0].examples, "an example is missing"
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    assert runner.run(examples[0]).failed == 0


def test_every_parameter_of_a_public_function_is_documented():
    missing = [
        f"{name}: {parameter}"
        for name, function in functions().items()
        for parameter in inspect.signature(function).parameters
        if not re.search(rf":param {parameter}:|``{parameter}``", inspect.getdoc(function) or "")
    ]
    assert not missing
