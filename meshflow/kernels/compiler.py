"""Finds a C++ compiler and builds the library of kernels. It uses the standard library only, since it runs during builds.

Every ``*.cpp`` beside this file is compiled once per instruction set, and linked without a C++ runtime into one library per
instruction set; with a single library, common functions could be taken from the wrong instruction set.
"""

import hashlib
import importlib.util
import os
import platform
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

__all__ = ["BuildError", "Compiler", "Target", "build", "digest", "flags", "found", "sources"]

HERE = Path(__file__).parent
# Used before the capabilities of the machine are known, or not critical for speed: compiled for any machine of its kind.
FOR_ANY = ("machine.cpp", "team.cpp")
WARNINGS = ("-Wall", "-Wextra")
FLAGS = (
    "-std=c++20",
    "-O3",
    "-fvisibility=hidden",
    "-fno-exceptions",
    "-fno-rtti",
    "-fno-threadsafe-statics",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-ffp-contract=off",  # fused products and sums would differ between tilings and instruction sets
)
# Flags of a library with sanitizers, according to MESHFLOW_SANITIZE; see .ci/sanitize.
CHECKED = ("-fno-omit-frame-pointer", "-g1", "-O1")
SANITIZED = {
    "": (),
    "address": ("-fsanitize=address,undefined", "-fno-sanitize-recover=undefined", *CHECKED),
    "thread": ("-fsanitize=thread", *CHECKED),
}
MSVC_FLAGS = ("/nologo", "/std:c++20", "/O2", "/fp:precise", "/GR-", "/GS-", "/W3", "/Zc:preprocessor", "/MD")
# Systems by their name in a target: the name for zig, the wheel tag, the suffix of libraries.
SYSTEMS = {
    "linux": ("linux-gnu.2.17", "manylinux_2_17_{machine}", ".so"),
    "musl": ("linux-musl", "musllinux_1_2_{machine}", ".so"),
    "macos": ("macos.11.0", "macosx_11_0_{machine}", ".dylib"),
    "windows": ("windows-gnu", "win_{machine}", ".dll"),
}
NAMES = {"AMD64": "x86_64", "x64": "x86_64", "arm64": "aarch64", "ARM64": "aarch64"}
TAGS = {("macos", "aarch64"): "arm64", ("windows", "x86_64"): "amd64", ("windows", "aarch64"): "arm64"}


class BuildError(RuntimeError):
    """The kernels could not be compiled. The message names the compiler and contains its output."""


@dataclass(frozen=True)
class Target:
    """The machine of a library.

    :ivar machine: "x86_64", "aarch64", ...
    :ivar system: "linux", "musl", "macos" or "windows".
    """

    machine: str
    system: str

    @classmethod
    def here(cls) -> "Target":
        """This machine."""
        name = platform.machine()
        if sys.platform == "linux":
            system = "linux" if platform.libc_ver()[0] == "glibc" else "musl"
        else:
            system = {"darwin": "macos", "win32": "windows"}.get(sys.platform, sys.platform)
        return cls(NAMES.get(name, name), system)

    @staticmethod
    def named() -> str:
        """The value of ``MESHFLOW_TARGET``, empty by default."""
        return os.environ.get("MESHFLOW_TARGET", "")

    @classmethod
    def wanted(cls) -> "Target":
        """The target in ``MESHFLOW_TARGET``, for example "aarch64-linux"; by default this machine.

        :raises BuildError: for an unknown system.
        """
        text = cls.named()
        if not text:
            return cls.here()
        machine, _, system = text.partition("-")
        if system not in SYSTEMS:
            known = ", ".join(f"{machine or 'x86_64'}-{name}" for name in SYSTEMS)
            raise BuildError(f"MESHFLOW_TARGET={text!r}: a machine and a system expected, as in {known}")
        return cls(machine, system)

    @property
    def instruction_sets(self) -> tuple[str, ...]:
        """The instruction sets of the kernels, the fastest first: levels of x86-64, or the baseline."""
        return ("v3", "v2") if self.machine == "x86_64" else ("baseline",)

    @property
    def suffix(self) -> str:
        """The suffix of libraries."""
        return SYSTEMS[self.system][2] if self.system in SYSTEMS else ".so"

    @property
    def tag(self) -> str:
        """The platform tag of a wheel; for Linux, that of a library made by zig."""
        return SYSTEMS[self.system][1].format(machine=TAGS.get((self.system, self.machine), self.machine))


@dataclass(frozen=True)
class Compiler:
    """A C++ compiler and its flags.

    :ivar command: its command.
    :ivar target: the machine that it compiles for.
    """

    command: tuple[str, ...]
    target: Target

    @cached_property
    def kind(self) -> str:
        """ "gnu" (GCC, Clang), "zig" or "msvc"."""
        names = [Path(word).name.lower().removesuffix(".exe") for word in self.command]
        if "ziglang" in names or "zig" in names:
            return "zig"
        return "msvc" if names[-1] in ("cl", "clang-cl") else "gnu"

    def compile(self, source: Path, to: Path, level: str, extra: Sequence[str] = ()) -> list[str]:
        """The command that compiles a source for an instruction set ("" for any machine of its kind).

        :param extra: further flags.
        """
        digit = level[1:] if level.startswith("v") else "0"
        any_machine = source.name in FOR_ANY
        if self.kind == "msvc":
            faster = [] if any_machine or digit != "3" else ["/arch:AVX2"]
            return [
                *self.command,
                *MSVC_FLAGS,
                *faster,
                f"/DMESHFLOW_LEVEL={digit}",
                *extra,
                "/c",
                str(source),
                f"/Fo{to}",
            ]
        machine: list[str] = []
        if self.kind == "zig":
            # Without this, zig compiles traps for undefined behaviour into C++.
            machine = ["-target", self._zig_target, "-fno-sanitize=undefined"]
        if digit != "0" and not any_machine:
            machine.append(
                f"-march=x86{'_' if self.kind == 'zig' else '-'}64{'_' if self.kind == 'zig' else '-'}v{digit}"
            )
        if self.target.system != "windows":
            machine.append("-fPIC")
        machine += self._oldest
        flags = [*FLAGS, *WARNINGS, *machine, f"-DMESHFLOW_LEVEL={digit}", *extra]
        return [*self.command, *flags, "-c", str(source), "-o", str(to)]

    def link(self, objects: Sequence[Path], to: Path, extra: Sequence[str] = ()) -> list[str]:
        """The command that links objects to a library: by the C compiler, so that use of a C++ runtime is an error."""
        names = [str(o) for o in objects]
        if self.kind == "msvc":
            return [*self.command, "/nologo", "/LD", *names, f"/Fe{to}", *extra]
        command = [_c_of(word) for word in self.command]
        flags = ["-shared"]
        if self.kind == "zig":
            flags += ["-target", self._zig_target]
        flags += self._oldest
        if self.target.system in ("linux", "musl"):
            flags += ["-lm", "-lpthread", "-Wl,--as-needed"]
            flags += [] if any("sanitize" in word for word in extra) else ["-Wl,-z,defs", "-s"]
        elif self.target.system == "windows" and self.kind == "zig":
            flags += ["-s"]
        return [*command, *names, *flags, *extra, "-o", str(to)]

    @property
    def _oldest(self) -> list[str]:
        """The flag for the oldest supported macOS, as in the wheel tag."""
        return ["-mmacosx-version-min=11.0"] if self.kind == "gnu" and self.target.system == "macos" else []

    @property
    def _zig_target(self) -> str:
        system = SYSTEMS[self.target.system][0] if self.target.system in SYSTEMS else self.target.system
        return f"{self.target.machine}-{system}"

    def works(self) -> str:
        """Empty where it can compile code like that of the kernels; else its output."""
        with tempfile.TemporaryDirectory() as place:
            source = Path(place, "trial.cpp")
            source.write_text(
                '#include <atomic>\n#include <cmath>\n#include <cstdint>\nextern "C" double f(double x) '
                "{ if constexpr (requires { x; }) return std::sqrt(x); }\n"
            )
            try:
                level = self.target.instruction_sets[0]
                _run(self.compile(source, Path(place, "trial.o"), level))
                _run(self.link([Path(place, "trial.o")], Path(place, "trial" + self.target.suffix)))
            except BuildError as failed:
                return str(failed)
        return ""


def _c_of(word: str) -> str:
    """The C compiler that belongs to the name of a C++ compiler; other words unchanged."""
    folder, name = os.path.split(word)
    name = re.sub(r"\bc\+\+", "cc", re.sub(r"clang\+\+", "clang", re.sub(r"\bg\+\+", "gcc", name)))
    return os.path.join(folder, name) if name else word


def _run(command: Sequence[str], cwd: Path | None = None) -> None:
    try:
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", cwd=cwd)
    except OSError as cause:
        raise BuildError(f"the C++ compiler could not be run: {shlex.join(command)}\n{cause}") from cause
    if done.returncode:
        raise BuildError(
            f"the kernels could not be compiled (exit {done.returncode}): {shlex.join(command)}\n{done.stdout}{done.stderr}"
        )


def _zig() -> tuple[str, ...] | None:
    return (sys.executable, "-m", "ziglang", "c++") if importlib.util.find_spec("ziglang") else None


def found() -> Compiler | None:
    """The compiler to use: that of ``CXX``; else a working one on the path; else that of the package ``ziglang``.

    A compiler from the environment is not tested: its failure is reported, and no other one is used instead. For a target in
    ``MESHFLOW_TARGET`` it is zig, which needs the oldest C library.

    :return: None where there is none.
    """
    target, zig = Target.wanted(), _zig()
    named = shlex.split(os.environ.get("CXX", ""), posix=os.name != "nt")
    if named:
        return Compiler(tuple(named), target)
    if not Target.named():
        names = ("cl", "clang++", "g++") if os.name == "nt" else ("g++", "clang++", "c++")
        for name in names:
            path = shutil.which(name)
            if path and not (compiler := Compiler((path,), target)).works():
                return compiler
    return Compiler(zig, target) if zig else None


def sources() -> list[Path]:
    """The C++ files beside this one, by name; none in a package installed from a wheel."""
    return sorted(HERE.glob("*.cpp"))


def _texts(source: Path) -> dict[str, bytes]:
    """A source and all headers of this folder that it includes, by name."""
    texts, left = {}, [source]
    while left:
        path = left.pop()
        if path.name not in texts and path.exists():
            texts[path.name] = path.read_bytes()
            left += [
                HERE / name for name in re.findall(r'^\s*#\s*include\s+"([^"]+)"', texts[path.name].decode(), re.M)
            ]
    return texts


def digest(source: Path, *words: object) -> str:
    """A digest, in 16 letters, of a source, its headers, the flags, and these words."""
    made = hashlib.sha256(repr((FLAGS, FOR_ANY, *words)).encode())
    for name, text in sorted(_texts(source).items()):
        made.update(name.encode() + text)
    return made.hexdigest()[:16]


def sanitized() -> tuple[str, ...]:
    """Sanitizer flags according to ``MESHFLOW_SANITIZE``: "address" checks memory, "thread" checks threads.

    :raises BuildError: for another value.
    """
    word = os.environ.get("MESHFLOW_SANITIZE", "")
    if word not in SANITIZED:
        raise BuildError(f"MESHFLOW_SANITIZE={word!r}: address or thread expected")
    return SANITIZED[word]


def flags() -> tuple[str, ...]:
    """Additional flags: those of ``CXXFLAGS``, and of sanitizers."""
    return (*shlex.split(os.environ.get("CXXFLAGS", "")), *sanitized())


def build(compiler: Compiler | None, level: str, to: Path, objects: Path) -> None:
    """Compile the kernels for one instruction set, as many files at once as there are processors.

    :param compiler: see :func:`found`.
    :param level: the instruction set, one of the target's.
    :param to: the library.
    :param objects: a folder of objects, which are compiled again where their sources have changed.
    :raises BuildError: without a compiler, or when it fails; the message contains its output.
    """
    if compiler is None:
        raise BuildError(
            "the kernels of meshflow need a C++20 compiler, and none was found: CXX is not set, no g++, clang++, c++ or cl "
            "on the path compiles for this machine, and the package ziglang is not installed. Do: pip install ziglang"
        )
    to, objects, extra = to.resolve(), objects.resolve(), flags()
    objects.mkdir(parents=True, exist_ok=True)
    parts = [objects / f"{source.stem}-{digest(source, compiler, level, extra)}.o" for source in sources()]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for made in [pool.submit(_compiled, compiler, *pair, level) for pair in zip(sources(), parts, strict=True)]:
            made.result()
    with tempfile.TemporaryDirectory(dir=to.parent) as place:
        linked = Path(place, to.name)
        _run(compiler.link(parts, linked, sanitized()), Path(place))
        os.replace(linked, to)


def _compiled(compiler: Compiler, source: Path, part: Path, level: str) -> None:
    if part.exists():
        os.utime(part)  # in use: see library.swept
        return
    with tempfile.TemporaryDirectory(dir=part.parent) as place:
        made = Path(place, part.name)
        _run(compiler.compile(source, made, level, flags()))
        os.replace(made, part)
