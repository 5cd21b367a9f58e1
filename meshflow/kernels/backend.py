"""The build backend: setuptools, with compiled kernels and wheels for any Python 3.

It differs from the backend of setuptools as follows: it requires ``ziglang`` where there is no C++ compiler; the library is
compiled when modules are copied; wheels are tagged py3-none and with the platform of the library; and source distributions
contain the C++ files. An editable install compiles into the source tree, as the first use of a kernel does.
"""

import re
import shutil
from pathlib import Path
from typing import Any

from setuptools.build_meta import (
    build_editable,
    build_sdist,
    build_wheel,
    get_requires_for_build_sdist,
    prepare_metadata_for_build_editable,
    prepare_metadata_for_build_wheel,
)
from setuptools.build_meta import get_requires_for_build_editable as _required_if_editable
from setuptools.build_meta import get_requires_for_build_wheel as _required
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_py import build_py

from meshflow.kernels import compiler, library

__all__ = [
    "BuildLibrary",
    "NamedForAnyPython",
    "build_editable",
    "build_sdist",
    "build_wheel",
    "get_requires_for_build_editable",
    "get_requires_for_build_sdist",
    "get_requires_for_build_wheel",
    "prepare_metadata_for_build_editable",
    "prepare_metadata_for_build_wheel",
]

PLACE = Path("meshflow", "kernels")


def get_requires_for_build_wheel(config_settings: dict[str, Any] | None = None) -> list[str]:
    """The requirements besides setuptools: a package with a compiler, where there is none."""
    return [*_required(config_settings), *_compiler_needed()]


def get_requires_for_build_editable(config_settings: dict[str, Any] | None = None) -> list[str]:
    """The requirements besides setuptools, for an editable install."""
    return [*_required_if_editable(config_settings), *_compiler_needed()]


def _compiler_needed() -> list[str]:
    return [] if compiler.found() else ["ziglang"]


class BuildLibrary(build_py):
    """Copies the modules and compiles the kernels."""

    def run(self) -> None:
        """Copy, and compile for every instruction set of the target."""
        target = compiler.Target.wanted()
        if self.editable_mode:
            super().run()
            library.loaded()
            return
        shutil.rmtree(self.build_lib, ignore_errors=True)  # removes files of an earlier build
        super().run()
        place = Path(self.build_lib, PLACE, "_lib")
        place.mkdir(parents=True)
        for level in target.instruction_sets:
            made = place / f"meshflow-{level}{target.suffix}"
            if not compiler.Target.named():
                # Python uses the package in the source tree if it is started there, so that tree also gets the library.
                shutil.copy(library.built(level), made)
            else:
                compiler.build(compiler.found(), level, made, library.PLACE / "objects")

    def get_source_files(self) -> list[str]:
        """The files of a source distribution that this command needs."""
        kernels = [str(path) for ending in ("*.h", "*.cpp") for path in sorted(PLACE.glob(ending))]
        return [*super().get_source_files(), *kernels]

    def get_outputs(self, include_bytecode: bool = True) -> list[str]:
        """The installed files."""
        target = compiler.Target.wanted()
        made = [
            Path(self.build_lib, PLACE, "_lib", f"meshflow-{level}{target.suffix}") for level in target.instruction_sets
        ]
        return [*super().get_outputs(include_bytecode), *[str(path) for path in made if path.exists()]]


class NamedForAnyPython(bdist_wheel):
    """A wheel with a library that does not depend on the version of Python."""

    def finalize_options(self) -> None:
        """Mark the wheel as specific to a platform."""
        self.distribution.has_ext_modules = _yes
        super().finalize_options()
        self.root_is_pure = False

    def get_tag(self) -> tuple[str, str, str]:
        """Any Python 3, no ABI, and the platform of the library."""
        target, platform = compiler.Target.wanted(), super().get_tag()[2]
        if target.system == "linux":
            platform = _tag_of_linux(self.bdist_dir or "", target)
        elif target.system in compiler.SYSTEMS:
            platform = target.tag
        return "py3", "none", platform


def _yes() -> bool:
    return True


def _tag_of_linux(place: str, target: compiler.Target) -> str:
    """The platform tag of a library, from the newest symbols of the C library that it needs."""
    needed = {
        tuple(int(number) for number in version.split(b"."))
        for path in Path(place).rglob("meshflow-*.so")
        for version in re.findall(rb"\0GLIBC_(\d+\.\d+)", path.read_bytes())
    }
    major, minor = max([(2, 17), *needed])
    return f"manylinux_{major}_{minor}_{target.machine}"
