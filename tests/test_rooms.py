"""The table of DESIGN.md section 3: who may import whom, how long a file and a function may be, and that nothing is cyclic."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "meshflow"
# view shows what a caller has, so it asks the edge what that is: the one line beyond DESIGN.md.
MAY = {
    "geometry": set(),
    "flow": {"geometry"},
    "grid": {"geometry"},
    "io": {"geometry"},
    "study": {"geometry"},
    "view": {"geometry", "io"},
    "settings": {"flow", "geometry"},
    "choice": {"grid", "flow", "geometry"},
    "parameters": {"settings", "flow", "geometry"},
    "tuning": {"parameters", "settings", "choice", "flow", "geometry"},
    "shaping": {"tuning", "parameters", "settings", "flow", "geometry"},
    "plan": {"shaping", "tuning", "parameters", "settings", "flow", "geometry"},
    "result": {"parameters", "flow", "geometry"},
    "parts": {"result", "parameters", "io", "geometry"},
    "smoothing": {"parts", "settings", "parameters", "plan", "result", "io", "grid", "flow", "geometry"},
    "fusing": {"smoothing", "result", "parameters", "io", "flow", "geometry"},
    "accessors": {"smoothing", "result"},
    "options": {"geometry"},
    "reading": {"options", "io", "geometry"},
    "console": set(),
    "filming": {"smoothing", "settings", "parameters", "flow", "view"},
    "viewing": {"smoothing", "settings", "plan", "parameters", "result", "flow", "geometry", "io", "view"},
    "looking": {"console", "filming", "viewing", "options", "reading", "geometry", "io", "study", "view"},
    "cli": {
        "console",
        "looking",
        "options",
        "reading",
        "fusing",
        "settings",
        "parts",
        "result",
        "smoothing",
        "geometry",
        "io",
        "study",
        "view",
    },
    "__main__": {"cli"},
}
# The comparison of the flows runs them, and one of the peers of range images is a flow: two modules of the study, so that the
# measures beside them still know of no flow.
BEYOND = {"study/flows.py": {"flow"}, "study/range_peers.py": {"flow"}}
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
        may = MAY[room(path)] | BEYOND.get(path.relative_to(PACKAGE).as_posix(), set())
        assert used <= may, f"{path.name} imports {used - may}"


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_files_and_functions_stay_short_enough_to_read(path):
    text = path.read_text()
    assert text.count("\n") <= 400
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            assert node.end_lineno - node.lineno < 60, f"{node.name} has {node.end_lineno - node.lineno + 1} lines"


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
