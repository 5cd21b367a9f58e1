"""The house of DESIGN.md section 3: who may import whom, that nothing is cyclic, and the measures that hold.

Each measure stands with its limit in one place: a limit may come down, never go up.
"""

import ast
import re
import subprocess
import sys
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "meshflow"
# Who may import whom: DESIGN.md, section 3. Errors, and how names are found on first use, are open to all.
MAY = {
    "kernels": set(),
    "geometry": {"kernels"},
    "surfaces": {"geometry"},
    "flow": {"surfaces", "geometry", "kernels"},
    "estimate": {"flow", "surfaces", "geometry"},
    "results": {"estimate", "flow", "surfaces", "geometry", "io", "view"},
    "io": {"surfaces", "geometry"},
    "large": {"results", "estimate", "flow", "io", "surfaces", "geometry"},
    "smoothing": {"large", "results", "estimate", "flow", "io", "surfaces", "geometry"},
    "comparing": {"smoothing", "results", "flow", "io", "view", "surfaces", "geometry"},
    "fusing": {"smoothing", "large", "results", "estimate", "flow", "io", "surfaces", "geometry"},
    "accessors": {"smoothing", "large", "results", "estimate", "flow", "io", "surfaces", "geometry"},
    "view": {"surfaces", "geometry", "io"},
    "viewer": {"smoothing", "large", "results", "estimate", "flow", "view", "io", "surfaces", "geometry"},
    "classics": {"flow", "surfaces", "geometry"},
    "evaluate": {"flow", "surfaces", "geometry"},
    "synthetic": {"flow", "surfaces", "geometry"},
    "cli": {
        "smoothing", "comparing", "fusing", "accessors", "large", "results", "estimate", "flow", "io", "surfaces", "geometry",
        "view", "viewer", "classics", "evaluate", "synthetic", "kernels",
    },
    "__main__": {"cli"},
}  # fmt: skip
TOP = {"__init__", "__main__", "smoothing", "comparing", "fusing", "accessors", "errors", "lazy"}
FILES = sorted(PACKAGE.rglob("*.py"))
LINES_OF_A_FILE, LINES_OF_A_FUNCTION, PARAMETERS = 400, 60, 6
MANY_PARAMETERS = 6  # functions that have more, anywhere but in kernels; each says why
ANY_IN_IO = 7  # parameters annotated with `Any`
ASSERTS = 3
UNDOCUMENTED, UNTYPED = 0, 0  # public functions without a docstring, their parameters without a type
PEERS = {
    "skimage", "pywt", "SimpleITK", "cv2", "diplib", "medpy", "whitebox_workflows", "pymeshlab", "cholespy", "pyrealsense2",
}  # fmt: skip


@cache
def tree(path):
    return ast.parse(path.read_text())


@cache
def nodes(path):
    """All nodes of the tree of a file."""
    return list(ast.walk(tree(path)))


def room(path):
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


@cache
def is_module(name):
    path = PACKAGE.parent.joinpath(*name.split("."))
    return path.is_dir() or path.with_suffix(".py").exists()


@cache
def imports(path):
    return list(imported(path))


def imported(path):
    for node in nodes(path):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("meshflow"):
            named = [f"{node.module}.{alias.name}" for alias in node.names]
            modules = [name for name in named if is_module(name)]
            yield from modules or [node.module]
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name.startswith("meshflow"))


def test_a_room_imports_only_the_rooms_that_it_may():
    found = []
    for path in set(FILES) - {PACKAGE / "__init__.py"}:
        used = {name.split(".")[1] for name in imports(path)} - {"errors", "lazy", room(path)}
        may = set() if room(path) in ("errors", "lazy") else MAY[room(path)]
        found += [f"{path.relative_to(PACKAGE)} imports {used - may}"] if used - may else []
    at_most(0, found)


def test_files_and_functions_stay_short_enough_to_read():
    at_most(0, [f"{path.relative_to(PACKAGE)}" for path in FILES if path.read_text().count("\n") > LINES_OF_A_FILE])
    lengths = (
        (f"{path.relative_to(PACKAGE)}: {node.name}", node.end_lineno - node.lineno + 1 - lines_of_example(node))
        for path in FILES
        for node in nodes(path)
        if isinstance(node, ast.FunctionDef)
    )
    at_most(0, [f"{where} has {lines} lines" for where, lines in lengths if lines > LINES_OF_A_FUNCTION])


def lines_of_example(node):
    """How many lines the example in a docstring takes, which are tests and not the function: head, blank lines, doctest."""
    example = re.search(r"^Example:\n\n( {4}.*\n?)+\n?", ast.get_docstring(node) or "", re.M)
    return example.group().count("\n") if example else 0


def functions(*but):
    """Every function of the package, and where it is; rooms named in but left out."""
    for path in FILES:
        if room(path) not in but:
            for node in nodes(path):
                overloaded = any(ast.unparse(d) == "overload" for d in getattr(node, "decorator_list", ()))
                if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)) and not overloaded:
                    yield f"{path.relative_to(PACKAGE)}:{node.lineno} {node.name}", node


def parameters(node):
    """What a caller gives: positional, by keyword, the rest; self and cls left out."""
    rest = [arg for arg in (node.args.vararg, node.args.kwarg) if arg]
    named = node.args.posonlyargs + node.args.args + node.args.kwonlyargs + rest
    return [arg for arg in named if arg.arg not in ("self", "cls")]


def at_most(limit, found):
    assert len(found) <= limit, f"{len(found)} where {limit} are allowed:\n" + "\n".join(found)


def test_few_functions_have_many_parameters():
    at_most(MANY_PARAMETERS, [where for where, node in functions("kernels") if len(parameters(node)) > PARAMETERS])


def test_few_parameters_of_readers_and_writers_are_of_any_type():
    annotated = (
        (where, arg)
        for where, node in functions()
        if where.startswith("io")
        for arg in parameters(node)
        if arg.annotation is not None
    )
    at_most(ANY_IN_IO, [f"{where}({arg.arg})" for where, arg in annotated if "Any" in names_in(arg.annotation)])


def names_in(annotation):
    if isinstance(annotation, ast.Constant):
        annotation = ast.parse(str(annotation.value))
    return {node.id for node in ast.walk(annotation) if isinstance(node, ast.Name)}


def test_asserts_do_not_talk_to_the_type_checker():
    found = [
        f"{path.relative_to(PACKAGE)}:{node.lineno}"
        for path in FILES
        for node in nodes(path)
        if isinstance(node, ast.Assert)
    ]
    at_most(ASSERTS, found)


def test_public_functions_are_documented_and_typed():
    public = [(where, node) for where, node in functions() if not node.name.startswith("_")]
    at_most(UNDOCUMENTED, [where for where, node in public if not ast.get_docstring(node)])
    bare = [
        f"{where}({arg.arg})"
        for where, node in public
        for arg in parameters(node)
        if arg.annotation is None and arg not in (node.args.vararg, node.args.kwarg)
    ]
    at_most(UNTYPED, bare)


def packages_named(node):
    """The packages that a node imports."""
    if isinstance(node, ast.ImportFrom):
        return {(node.module or "").split(".")[0]}
    if isinstance(node, ast.Import):
        return {alias.name.split(".")[0] for alias in node.names}
    if isinstance(node, ast.Call) and ast.unparse(node.func) in ("need", "import_module"):
        return {ast.unparse(node.args[0]).strip("'").split(".")[0]}
    return set()


def test_nothing_that_ships_knows_a_peer():
    named = ((path, packages_named(node) & (PEERS | {"peers"})) for path in FILES for node in nodes(path))
    at_most(0, [f"{path.relative_to(PACKAGE)}: {peers}" for path, peers in named if peers])


@pytest.mark.parametrize("name", ["", ".classics", ".evaluate", ".synthetic", ".view"])
def test_every_public_name_of_a_room_is_found_and_an_unknown_one_named(name):
    package = import_module(f"meshflow{name}")
    for public in package.__all__:
        assert getattr(package, public) is not None
        assert public in dir(package)
    with pytest.raises(AttributeError, match=rf"'meshflow{name}' has no attribute 'nonsense'; it has .*{public}"):
        package.__getattr__("nonsense")


def test_no_test_file_imports_another():
    for path in Path(__file__).parent.rglob("*.py"):
        for node in nodes(path):
            if isinstance(node, ast.Import | ast.ImportFrom):
                named = [getattr(node, "module", None) or "", *(alias.name for alias in node.names)]
                assert not [name for name in named if name.split(".")[0].startswith("test_")], path.name


def test_the_top_of_the_package_holds_the_door_and_little_more():
    assert {path.stem for path in PACKAGE.glob("*.py")} == TOP


def test_no_module_is_named_for_nothing():
    assert not {path.stem for path in FILES} & {"core", "util", "utils", "common", "base", "misc", "helpers"}


def packages_above(target, name):
    """The packages that are imported on the way to a module, but for those that the importing module is in itself."""
    parts = target.split(".")
    above = (".".join(parts[:n]) for n in range(2, len(parts)))
    return [package for package in above if not f"{name}.".startswith(f"{package}.")]


def test_nothing_is_cyclic():
    names = {
        ".".join(("meshflow", *p.relative_to(PACKAGE).with_suffix("").parts)).removesuffix(".__init__"): p
        for p in FILES
    }
    edges = {
        name: {target for one in imports(path) for target in (one, *packages_above(one, name)) if target in names}
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
        calls = [ast.unparse(n.func) for n in nodes(path) if isinstance(n, ast.Call)]
        assert not {"print", "sys.exit", "exit", "quit"} & set(calls), path.name


def test_importing_the_package_costs_numpy_and_little_more():
    code = "import sys, numpy; before = set(sys.modules); import meshflow; print(*sorted(set(sys.modules) - before))"
    new = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert all(name.startswith("meshflow") or name in {"importlib", "warnings"} for name in new), new
    assert len(new) <= 4
