"""The kernels are compiled by what is there, once for each instruction set, for any Python; what fails says what was tried."""

import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from meshflow.kernels import compiler, library
from meshflow.kernels.compiler import BuildError, Compiler, Target
from meshflow.kernels.library import KernelsMissing, environment

HOUSE = Path(__file__).parents[1]
KERNELS = HOUSE / "meshflow" / "kernels"
LEVELS = Target.here().instruction_sets
# What a tree needs to try the build with: few kernels, compiled within a second.
FEW = (
    *("__init__.py", "arguments.py", "arrays.*", "backend.py", "compiler.py", "gate.py", "interface.h", "library.py"),
    *("machine.cpp", "memory.h", "parameters.py", "team.*", "trials.*"),
)
needs_compiler = pytest.mark.skipif(
    compiler.found() is None, reason="no C++ compiler is here: the kernels came in a wheel"
)
needs_sources = pytest.mark.skipif(not compiler.sources(), reason="an installed package has no sources")
SUM = """
import numpy as np
from meshflow.kernels.trials import trial_failed, trial_sum
sums = np.zeros(1), np.zeros(1, np.float32)
for sum in sums:
    trial_sum(np.random.default_rng(1).random(5000, sum.dtype), sum, 64, 2, 1)
print(*[sum.tobytes().hex() for sum in sums], trial_failed(5, 0))
"""


def run(code, place=None, **env):
    """What a new process of Python prints, in another tree if one is given."""
    sanitizers = ("LD_PRELOAD", "MESHFLOW_SANITIZE")
    given = {key: value for key, value in os.environ.items() if place is None or key not in sanitizers}
    given |= {"PYTHONPATH": str(place or HOUSE), **env}
    done = subprocess.run([sys.executable, "-c", code], env=given, cwd=place, capture_output=True, text=True)
    return done.returncode, done.stdout, done.stderr


@pytest.fixture
def tree(tmp_path):
    """A source tree of its own, with few kernels."""
    place = tmp_path / "meshflow" / "kernels"
    place.mkdir(parents=True)
    for name in FEW:
        for path in KERNELS.glob(name):
            shutil.copy(path, place)
    for path in (HOUSE / "meshflow" / "LICENSE", *HOUSE.glob("meshflow/*.py")):
        shutil.copy(path, tmp_path / "meshflow")
    for name in ("pyproject.toml", "README.md"):
        shutil.copy(HOUSE / name, tmp_path)
    return tmp_path


def test_the_environment_says_what_the_kernels_run_with(monkeypatch):
    monkeypatch.setenv("MESHFLOW_NUM_THREADS", "3")
    found = environment()
    assert found.instruction_set in LEVELS
    assert re.match(r"(GCC|.*[Cc]lang|MSVC) ?.*\d", found.compiler)
    assert found.threads == 3
    assert found.path.exists()


@pytest.mark.parametrize("level", LEVELS)
def test_an_instruction_set_is_forced_by_the_environment(level):
    code = "from meshflow.kernels.library import environment; print(environment().instruction_set)"
    assert run(code, MESHFLOW_ISA=level) == (0, f"{level}\n", "")


def test_results_do_not_depend_on_the_instruction_set():
    assert len({run(SUM, MESHFLOW_ISA=level)[:2] for level in LEVELS}) == 1
    assert run(SUM)[0] == 0


def test_an_instruction_set_without_meaning_is_refused_with_those_that_there_are():
    code, _, said = run("from meshflow.kernels.library import loaded; loaded()", MESHFLOW_ISA="avx512")
    assert code
    assert f"KernelsMissing: MESHFLOW_ISA='avx512': one of {', '.join(LEVELS)} expected" in said


def test_a_machine_that_cannot_run_them_is_told_what_it_lacks(monkeypatch):
    class Lacking:
        @staticmethod
        def machine_missing():
            return b"avx2 fma"

    monkeypatch.delenv("MESHFLOW_ISA", raising=False)
    monkeypatch.setattr(library, "opened", lambda level: (Lacking, Path(level)))
    with pytest.raises(KernelsMissing, match=f"this machine cannot run .* {LEVELS[0]} needs avx2 fma"):
        library.loaded.__wrapped__()


@pytest.mark.skipif(sys.platform != "linux", reason="reads a library of Linux")
def test_the_library_needs_no_runtime_of_a_compiler():
    if "MESHFLOW_SANITIZE" in os.environ:
        pytest.skip("checks of memory have a runtime")
    needed = set(re.findall(rb"\0((?:lib|ld-)[\w+.-]*\.so[\w.]*)", environment().path.read_bytes()))
    assert needed <= {b"libc.so.6", b"libm.so.6", b"libpthread.so.0", b"ld-linux-x86-64.so.2", b"ld-linux-aarch64.so.1"}


@pytest.mark.long
@needs_sources
@needs_compiler
def test_a_source_tree_compiles_when_a_kernel_is_used_and_again_only_what_has_changed(tree):
    place = tree / "meshflow" / "kernels"
    code, said, _ = run(SUM, tree)
    assert code == 0
    objects = {path: path.stat().st_mtime_ns for path in place.glob("_lib/objects/*.o")}
    assert len(objects) == len(list(place.glob("*.cpp")))
    assert run(SUM, tree, PATH="") == (0, said, ""), "nothing is compiled a second time"
    header = place / "trials.h"
    header.write_text(header.read_text().replace("return code;", "return code + 1;"))
    code, again, _ = run(SUM, tree)
    assert (code, again.split()[:2], again.split()[2]) == (0, said.split()[:2], "6")
    assert len(set(place.glob("_lib/objects/*.o")) - set(objects)) == 1
    left = [
        path
        for path in place.glob("_lib/**/*")
        if path.suffix not in (".o", Target.here().suffix) and path.name not in ("objects", "lock")
    ]
    assert not left


@needs_sources
@needs_compiler
def test_processes_that_find_nothing_compiled_wait_for_one_of_them(tree):
    given = {**os.environ, "PYTHONPATH": str(tree)}
    given.pop("LD_PRELOAD", None), given.pop("MESHFLOW_SANITIZE", None)
    several = [
        subprocess.Popen([sys.executable, "-c", SUM], cwd=tree, env=given, stdout=subprocess.PIPE, text=True)
        for _ in range(4)
    ]
    assert len({one.communicate()[0] for one in several}) == 1
    assert [one.returncode for one in several] == [0] * 4
    assert len(list((tree / "meshflow" / "kernels" / "_lib").glob("meshflow-*"))) == 1


@needs_sources
@needs_compiler
def test_a_source_that_does_not_compile_is_shown_with_the_compiler_and_what_it_said(tree):
    header = tree / "meshflow" / "kernels" / "trials.h"
    header.write_text(header.read_text() + "\nint nonsense = words;\n")
    code, _, said = run(SUM, tree)
    assert code
    assert "BuildError: the kernels could not be compiled (exit 1):" in said
    assert "trials.cpp" in said
    assert "words" in said.splitlines()[-1] or "‘words’" in said or "'words'" in said


@pytest.mark.parametrize("named", ["false", "/nowhere/g++ -m64"])
def test_a_compiler_that_the_environment_names_is_used_or_its_failure_told(named, monkeypatch, tmp_path):
    monkeypatch.setenv("CXX", named)
    monkeypatch.setattr(compiler, "sources", lambda: [KERNELS / "machine.cpp"])
    chosen = compiler.found()
    assert chosen
    assert chosen.command == tuple(named.split())
    with pytest.raises(BuildError, match=re.escape(named)):
        compiler.build(chosen, LEVELS[0], tmp_path / "library.so", tmp_path / "objects")


def test_without_a_compiler_the_package_that_brings_one_is_asked_for(monkeypatch, tmp_path):
    backend = pytest.importorskip("meshflow.kernels.backend", reason="setuptools is not installed")
    monkeypatch.delenv("CXX", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(compiler, "_zig", lambda: None)
    assert backend.get_requires_for_build_wheel() == ["ziglang"]
    assert backend.get_requires_for_build_editable() == ["ziglang"]
    with pytest.raises(
        BuildError, match="CXX is not set, no g.., .* ziglang is not installed. Do: pip install ziglang"
    ):
        compiler.build(compiler.found(), LEVELS[0], tmp_path / "library.so", tmp_path / "objects")


@pytest.mark.skipif(os.name == "nt", reason="programs of a shell")
def test_a_compiler_on_the_path_that_does_not_work_is_passed_over(monkeypatch, tmp_path):
    monkeypatch.delenv("CXX", raising=False)
    for name in ("g++", "gcc"):
        (tmp_path / name).write_text("#!/bin/sh\nexit 1\n")
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(compiler, "_zig", lambda: ("zig", "c++"))
    found = compiler.found()
    assert found
    assert found.command == ("zig", "c++")


def test_each_kind_of_compiler_is_told_in_its_own_words():
    source, to = KERNELS / "arrays.cpp", Path("arrays.o")
    here = Target("x86_64", "linux")
    gcc, zig = Compiler(("g++-12",), here), Compiler(("python", "-m", "ziglang", "c++"), here)
    cl, mac = Compiler(("cl",), Target("x86_64", "windows")), Compiler(("clang++",), Target("aarch64", "macos"))
    assert "-mmacosx-version-min=11.0" in mac.compile(source, to, "baseline")
    assert not any("march" in word for word in mac.compile(source, to, "baseline"))
    assert {"-march=x86-64-v3", "-ffp-contract=off", "-fPIC", "-DMESHFLOW_LEVEL=3"} <= set(
        gcc.compile(source, to, "v3")
    )
    assert {"-march=x86_64_v2", "x86_64-linux-gnu.2.17"} <= set(zig.compile(source, to, "v2"))
    assert {"/arch:AVX2", "/fp:precise", "/DMESHFLOW_LEVEL=3"} <= set(cl.compile(source, to, "v3"))
    assert "/arch:AVX2" not in cl.compile(source, to, "v2")
    for made in (gcc, zig, cl):
        assert not any("march=" in word or "arch:" in word for word in made.compile(KERNELS / "machine.cpp", to, "v3"))
        assert not any("native" in word or "fast-math" in word for word in made.compile(source, to, "v3"))
    assert gcc.link([to], Path("x.so"))[0] == "gcc-12", "a C++ runtime would be missed"
    assert zig.link([to], Path("x.so"))[3] == "cc"
    assert Compiler(("/usr/bin/clang++-19",), here).link([to], Path("x.so"))[0] == "/usr/bin/clang-19"


def test_a_target_is_named_by_machine_and_system(monkeypatch):
    for text, tag in (
        ("aarch64-linux", "manylinux_2_17_aarch64"),
        ("x86_64-musl", "musllinux_1_2_x86_64"),
        ("x86_64-windows", "win_amd64"),
        ("aarch64-macos", "macosx_11_0_arm64"),
    ):
        monkeypatch.setenv("MESHFLOW_TARGET", text)
        assert Target.wanted().tag == tag
    assert Target.wanted().instruction_sets == ("baseline",)
    monkeypatch.setenv("MESHFLOW_TARGET", "x86_64-plan9")
    with pytest.raises(BuildError, match="MESHFLOW_TARGET='x86_64-plan9': .* x86_64-linux, x86_64-musl, x86_64-macos"):
        Target.wanted()


@needs_sources
@needs_compiler
@pytest.mark.skipif(sys.platform != "linux", reason="tags of Linux")
def test_a_wheel_is_for_any_python_holds_a_library_for_each_instruction_set_and_compiles_nothing(
    tree, tmp_path_factory
):
    pytest.importorskip("setuptools.command.bdist_wheel", reason="setuptools is not installed")
    made = tmp_path_factory.mktemp("wheel")
    code, _, said = run(f"from meshflow.kernels import backend; backend.build_wheel({str(made)!r})", tree)
    assert code == 0, said
    (wheel,) = made.glob("*.whl")
    assert re.fullmatch(r"meshflow-[\d.]+-py3-none-(many|musl)?linux_\d+_\d+_\w+\.whl", wheel.name)
    assert wheel.stat().st_size < 2e6
    place = tmp_path_factory.mktemp("installed")
    with zipfile.ZipFile(wheel) as file:
        names = file.namelist()
        file.extractall(place)
    assert {name for name in names if "_lib" in name} == {
        f"meshflow/kernels/_lib/meshflow-{level}.so" for level in LEVELS
    }
    assert not [name for name in names if name.endswith((".cpp", ".h"))]
    expected = run(SUM, tree, PATH="")
    assert expected[0] == 0, "the tree has its library, too"
    for level in LEVELS:
        assert run(SUM, place, MESHFLOW_ISA=level, PATH="") == expected
    for path in place.glob("meshflow/kernels/_lib/*"):
        path.unlink()
    code, _, said = run(SUM, place)
    assert code
    assert "KernelsMissing: the kernels of meshflow cannot be loaded" in said


@needs_sources
def test_a_source_distribution_holds_the_sources(tree, tmp_path_factory):
    pytest.importorskip("setuptools.command.bdist_wheel", reason="setuptools is not installed")
    made = tmp_path_factory.mktemp("sdist")
    code, _, said = run(f"from meshflow.kernels import backend; backend.build_sdist({str(made)!r})", tree)
    assert code == 0, said
    (archive,) = made.glob("*.tar.gz")
    shutil.unpack_archive(archive, made)
    (unpacked,) = made.glob("meshflow-*/meshflow/kernels")
    names = {path.name for ending in ("*.cpp", "*.h", "*.py") for path in (tree / "meshflow" / "kernels").glob(ending)}
    assert names <= {path.name for path in unpacked.iterdir()}
