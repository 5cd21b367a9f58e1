"""The table of DESIGN.md section 3: who may import whom, how long a file and a function may be, and that nothing is cyclic."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "meshflow"
# Who may import whom: DESIGN.md, section 3. Errors are open to all.
MAY = {
    "kernels": set(),
    "geometry": {"kernels"},
    "surfaces": {"geometry"},
    "flow": {"surfaces", "geometry", "kernels"},
    "estimate": {"flow", "surfaces", "geometry"},
    "results": {"estimate", "flow", "surfaces", "geometry", "io"},
    "io": {"surfaces", "geometry"},
    "smoothing": {"results", "estimate", "flow", "io", "surfaces", "geometry"},
    "fusing": {"smoothing", "results", "estimate", "flow", "io", "surfaces", "geometry"},
    "accessors": {"smoothing", "results", "estimate", "flow", "io", "surfaces", "geometry"},
    "view": {"surfaces", "geometry", "io"},
    "viewer": {"smoothing", "results", "estimate", "flow", "view", "io", "surfaces", "geometry"},
    "classics": {"flow", "surfaces", "geometry"},
    "evaluate": {"flow", "surfaces", "geometry"},
    "synthetic": {"flow", "surfaces", "geometry"},
    "cli": {
        "smoothing", "fusing", "accessors", "results", "estimate", "flow", "io", "surfaces", "geometry", "view", "viewer",
        "classics", "evaluate", "synthetic",
    },
    "__main__": {"cli"},
}  # fmt: skip
TOP = {"__init__", "__main__", "smoothing", "fusing", "accessors", "errors"}
FILES = sorted(PACKAGE.rglob("*.py"))


def room(path):
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


def is_module(name):
    path = PACKAGE.parent.joinpath(*name.split("."))
    return path.is_dir() or path.with_suffix(".py").exists()


def imports(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("meshflow"):
            named = [f"{node.module}.{alias.name}" for alias in node.names]
            modules = [name for name in named if is_module(name)]
            yield from modules or [node.module]
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name.startswith("meshflow"))


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_a_room_imports_only_the_rooms_that_it_may(path):
    if path == PACKAGE / "__init__.py":
        return
    used = {name.split(".")[1] for name in imports(path)} - {"errors", room(path)}
    if room(path) == "errors":
        assert not used
    else:
        may = MAY[room(path)]
        assert used <= may, f"{path.name} imports {used - may}"


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_files_and_functions_stay_short_enough_to_read(path):
    text = path.read_text()
    assert text.count("\n") <= 400
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            assert node.end_lineno - node.lineno < 60, f"{node.name} has {node.end_lineno - node.lineno + 1} lines"


def test_the_top_of_the_package_holds_the_door_and_little_more():
    assert {path.stem for path in PACKAGE.glob("*.py")} == TOP


def test_nothing_is_cyclic():
    names = {
        ".".join(("meshflow", *p.relative_to(PACKAGE).with_suffix("").parts)).removesuffix(".__init__"): p
        for p in FILES
    }
    edges = {
        name: {target for target in imports(path) if target in names}
        for name, path in names.items()
        if name != "meshflow"
    }
    done = set()

    def visit(name, trail):
        assert name not in trail, f"cycle: {' -> '.join([*trail, name])}"
        if name not in done:
            for target in edges.get(name, ()):
                visit(target, [*trail, name])
            done.add(name)

    for name in edges:
        visit(name, [])


def test_the_library_neither_prints_nor_exits():
    for path in FILES:
        if room(path) in ("cli", "__main__"):
            continue
        calls = [ast.unparse(n.func) for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.Call)]
        assert not {"print", "sys.exit", "exit", "quit"} & set(calls), path.name


def test_importing_the_package_costs_numpy_and_little_more():
    code = "import sys, numpy; before = set(sys.modules); import meshflow; print(*sorted(set(sys.modules) - before))"
    new = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert all(name.startswith("meshflow") or name in {"importlib", "warnings"} for name in new), new
    assert len(new) <= 4
