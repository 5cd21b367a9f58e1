"""The command wherever it is installed, and whatever happens to it: other users, strange names, full disks, signals."""

import atexit
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import pyvista
import rasterio
import trimesh
from helpers import warm_start

from meshflow.__main__ import main
from meshflow.io.files import read

ROOT = Path(__file__).parents[1]
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="processes as POSIX has them")


def run(*words, cwd=None, flags=(), limits=(), user=None, **environment):
    """The command in a process that Python starts; limits are pairs of a limit of the system and its value."""

    def before():
        import resource

        for kind, value in limits:
            resource.setrlimit(getattr(resource, kind), (value, value))
        if user is not None:
            os.setgid(user)
            os.setuid(user)

    base = {name: value for name, value in os.environ.items() if name not in environment}
    if limits:  # no file of Python's may be cut off, too
        base["PYTHONDONTWRITEBYTECODE"] = "1"
    base |= {"PYTHONPATH": str(ROOT)} | {name: value for name, value in environment.items() if value is not None}
    return subprocess.run(
        [sys.executable, *flags, "-m", "meshflow", *words],
        cwd=cwd, env=base, capture_output=True, timeout=120, preexec_fn=before,
    )  # fmt: skip


def words_of(done):
    return done.stderr.decode("utf-8", "replace")


def refused(done, *expected):
    text = words_of(done)
    assert done.returncode == 1, text
    assert len(text.strip().splitlines()) == 1, text
    for word in expected:
        assert word in text


@pytest.fixture
def heights(tmp_path):
    z = np.cumsum(np.random.default_rng(0).normal(size=(40, 50)), axis=1).astype(np.float32)
    with rasterio.open(
        tmp_path / "a.tif", "w", driver="GTiff", width=50, height=40, count=1, dtype="float32", crs="EPSG:32632",
        transform=rasterio.Affine(1, 0, 0, 0, -1, 0),
    ) as target:  # fmt: skip
        target.write(z, 1)
    return tmp_path / "a.tif"


QUICK = ("--method", "quick", "--quiet")


# --- where it is installed


@pytest.mark.long
@pytest.mark.parametrize(
    ("flags", "environment"),
    [
        (("-O",), {}),
        (("-OO",), {}),
        ((), {"LC_ALL": "C", "LANG": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}),
        ((), {"HOME": None}),
        ((), {"HOME": "/nonexistent"}),
        (("-W", "error::ResourceWarning"), {}),
    ],
)
def test_it_runs_however_python_is_started(heights, flags, environment):
    target = heights.with_name("b.tif")
    done = run("smooth", str(heights), str(target), "--method", "quick", flags=flags, **environment)
    assert done.returncode == 0, words_of(done)
    assert read(target).data.z.shape == (40, 50)
    if any("O" in flag for flag in flags):  # there are no docstrings then
        assert run("smooth", "--help", flags=flags, **environment).returncode == 0


@pytest.mark.skipif(sys.platform == "win32" or os.getuid() != 0, reason="only root becomes another user")
def test_another_user_without_a_home_runs_a_package_that_he_may_not_write_to(tmp_path, heights):
    package = tmp_path / "installed"
    shutil.copytree(ROOT / "meshflow", package / "meshflow", ignore=shutil.ignore_patterns("__pycache__"))
    for folder, _, files in os.walk(package):
        os.chmod(folder, 0o555)
        for name in files:
            os.chmod(Path(folder) / name, 0o444)
    out = tmp_path / "out"
    out.mkdir()
    os.chmod(out, 0o777)
    for folder in (tmp_path, *tmp_path.parents[:-1]):
        os.chmod(folder, os.stat(folder).st_mode | 0o555)
    try:
        subprocess.run([sys.executable, "-c", ""], preexec_fn=lambda: os.setuid(65534), check=True)
    except PermissionError:
        pytest.skip("the interpreter itself is root's alone")
    done = run(
        "smooth", str(heights), str(out / "b.tif"), *QUICK, user=65534, HOME="/nonexistent", PYTHONPATH=str(package)
    )
    assert done.returncode == 0, words_of(done)
    assert (out / "b.tif").stat().st_uid == 65534


# --- names, pipes


@pytest.mark.parametrize("locale", ["C", "C.UTF-8"])
def test_any_name_is_a_name(heights, locale):
    names = [b"two\nlines.tif", b"-n.tif", b"a b'\".tif", b"\xf0\x9f\x8f\x94.tif", b"%s.tif"]
    names += [b"caf\xe9.tif"] if locale == "C.UTF-8" else []
    folder, there = os.fsencode(heights.parent), []
    for name in names:
        os.rename(heights, folder + b"/" + name)
        before = ("--",) if name.startswith(b"-") else ()
        words = ("smooth", *QUICK, *before, name, b"out" + name)
        done = warm_start.run(*words, cwd=heights.parent, start={"LC_ALL": locale, "PYTHONCOERCECLOCALE": "0"})
        assert done.returncode == 0, words_of(done)
        there.append(b"out" + name)
        assert sorted(os.listdir(folder)) == sorted([name, *there])
        os.rename(folder + b"/" + name, heights)


def test_what_begins_with_a_dash_and_is_no_option_is_told_how_to_be_given(heights):
    os.rename(heights, heights.with_name("-n.tif"))
    done = warm_start.run("info", "-n.tif", cwd=heights.parent)
    assert done.returncode != 0
    assert "./-n.tif" in words_of(done)


def test_a_pipe_is_read_to_its_end_and_stdout_is_written_to(heights):
    ball = trimesh.creation.icosphere(subdivisions=2).export(file_type="stl")
    pipe = heights.with_name("pipe.stl")
    os.mkfifo(pipe)
    with subprocess.Popen([sys.executable, "-c", f"import sys; open({str(pipe)!r}, 'wb').write(sys.stdin.buffer.read())"],
                          stdin=subprocess.PIPE) as writer:  # fmt: skip
        writer.stdin.write(ball)
        writer.stdin.close()
        done = warm_start.run("info", str(pipe), "--json")
    assert done.returncode == 0, words_of(done)
    assert b'"points": 162' in done.stdout
    for source in ("-", "/dev/stdin"):
        done = warm_start.run("info", source, "--json", stdin=ball)
        assert done.returncode == 0, words_of(done)
        assert b'"points": 162' in done.stdout
        refused(warm_start.run("info", source, stdin=b"not anything"), "stdin")
        refused(warm_start.run("info", source, stdin=b""), "stdin is empty")
    done = warm_start.run("smooth", "-", "-", "--method", "curvature", "--time", "1e-4", stdin=ball)
    assert done.returncode == 0, words_of(done)
    assert len(done.stdout) == len(ball)
    refused(warm_start.run("smooth", "-", "-", "--json", stdin=ball), "not both")


def test_a_device_is_not_replaced(heights):
    for name in ("null", "stdout"):
        refused(warm_start.run("smooth", str(heights), f"/dev/{name}", *QUICK, "--overwrite"), "device")
    assert not Path("/dev/null").is_file()


@pytest.mark.parametrize("begin", [b"solid a\n facet normal x 0 1\n outer loop\n", b"\xff" * 84 + b"\0" * 300])
def test_a_broken_file_is_one_line_whatever_the_libraries_log(tmp_path, begin):
    (tmp_path / "a.stl").write_bytes(begin)
    refused(warm_start.run("info", str(tmp_path / "a.stl")), "a.stl")


# --- what runs out


@pytest.mark.parametrize("suffix", [".tif", ".asc", ".npy", ".npz", ".png"])
def test_a_full_disk_is_one_line_with_the_reason_and_the_old_file_stays(heights, suffix):
    target = heights.with_name(f"b{suffix}")
    words = ("--kind", "image", "--dtype", "uint8") if suffix == ".png" else ()
    assert warm_start.run("smooth", str(heights), str(target), *QUICK, *words).returncode == 0
    old, there = target.read_bytes(), sorted(os.listdir(heights.parent))
    done = warm_start.run(
        "smooth", str(heights), str(target), *QUICK, *words, "--overwrite", limits=[("RLIMIT_FSIZE", 200)]
    )
    refused(done, "File too large", target.name)
    assert target.read_bytes() == old
    assert sorted(os.listdir(heights.parent)) == there


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".stl", ".glb", ".vtp", ".npz"])  # one of each library that writes
def test_no_writer_of_meshes_ends_of_a_full_disk(tmp_path, suffix):
    trimesh.creation.icosphere(subdivisions=3).export(tmp_path / "a.ply")
    words = ("--method", "curvature", "--time", "1e-6", "--quiet")
    done = warm_start.run("smooth", "a.ply", f"b{suffix}", *words, cwd=tmp_path, limits=[("RLIMIT_FSIZE", 2000)])
    refused(done, "File too large")
    assert os.listdir(tmp_path) == ["a.ply"]


def test_blocks_on_a_full_disk_are_one_line(tmp_path):
    pyvista.MultiBlock({"one": pyvista.Icosphere(nsub=2), "two": pyvista.Icosphere(nsub=2)}).save(tmp_path / "a.vtm")
    there = sorted(os.listdir(tmp_path))
    words = ("--method", "curvature", "--time", "1e-6", "--quiet")
    done = warm_start.run("smooth", "a.vtm", "b.vtm", *words, cwd=tmp_path)
    assert done.returncode == 0, words_of(done)
    assert sorted(os.listdir(tmp_path)) == sorted([*there, "b", "b.vtm"])


def test_little_memory_is_one_line_or_enough(heights):
    done = run("smooth", str(heights), "b.tif", *QUICK, cwd=heights.parent, limits=[("RLIMIT_AS", 2_000_000_000)])
    assert done.returncode == 0, words_of(done)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "megabytes"), [("z.npy", 700), ("z.tif", 500), ("z.tif", 700), ("ball.ply", 500), ("ball.vtp", 700)]
)
def test_a_narrow_address_space_is_enough_or_one_line(tmp_path, heights, name, megabytes):
    ball = trimesh.creation.icosphere(3)
    ball.vertices += np.random.default_rng(0).normal(0, 0.01, ball.vertices.shape)
    ball.export(tmp_path / "ball.ply")
    pyvista.wrap(ball).save(tmp_path / "ball.vtp")
    np.save(
        tmp_path / "z.npy",
        np.add.outer(np.arange(60.0), np.arange(70.0)) + np.random.default_rng(1).normal(size=(60, 70)),
    )
    source = heights if name == "z.tif" else tmp_path / name
    target = tmp_path / f"o{source.suffix}"
    narrow = ("RLIMIT_AS", megabytes * 1_000_000)
    done = run("smooth", str(source), str(target), limits=[narrow], OPENBLAS_NUM_THREADS="2")
    assert done.returncode in (0, 1)
    assert b"Traceback" not in done.stderr
    if done.returncode:
        assert b"not enough memory" in done.stderr
        assert not target.exists()


@pytest.mark.parametrize("threads", [1, 3])
def test_a_pool_does_its_jobs_where_no_thread_can_be_started(monkeypatch, threads):
    from meshflow.flow.pools import Pool

    with Pool(threads) as pool:
        assert list(pool.map(abs, [-1, -2, -3])) == [1, 2, 3]

    def refused(self):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr("threading.Thread.start", refused)
    with Pool(threads) as pool:
        assert list(pool.map(abs, [-1, -2, -3])) == [1, 2, 3]
        assert pool.submit(abs, -5).result() == 5


@pytest.mark.long
@pytest.mark.parametrize("number", ["SIGTERM", "SIGHUP", "SIGINT"])
def test_a_signal_leaves_nothing_behind(tmp_path, heights, number):
    waiting = tmp_path / "site"
    waiting.mkdir()
    (waiting / "sitecustomize.py").write_text(
        "import os, signal, time\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # a job in the background of a shell ignores it,
        "signal.signal(signal.SIGHUP, signal.SIG_DFL)\n"  # and one of nohup this one
        "whole = os.replace\n"
        "def replace(*names):\n"
        "    print('writing', flush=True)\n"
        "    time.sleep(20)\n"
        "    whole(*names)\n"
        "os.replace = replace\n"
    )
    out = tmp_path / "out"
    out.mkdir()
    words = [sys.executable, "-m", "meshflow", "smooth", str(heights), str(out / "b.tif"), *QUICK]
    path = f"{waiting}{os.pathsep}{ROOT}"
    with subprocess.Popen(
        words, env=os.environ | {"PYTHONPATH": path}, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout.readline() == b"writing\n"
        assert len(os.listdir(out)) == 1
        time.sleep(0.2)
        process.send_signal(getattr(signal, number))
        said = process.communicate(timeout=30)[1].decode()
    assert process.returncode == 128 + getattr(signal, number)
    assert "OUT is complete, or as it was before" in said
    assert os.listdir(out) == []


def test_other_names_of_a_file_that_is_replaced_are_told(heights):
    target, other = heights.with_name("b.tif"), heights.with_name("c.tif")
    shutil.copy(heights, target)
    os.link(target, other)
    done = warm_start.run("smooth", str(heights), str(target), "--method", "quick", "--overwrite")
    assert done.returncode == 0
    assert "one of 2 names (hard links)" in words_of(done)
    assert other.read_bytes() == heights.read_bytes()


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (("--iterations", "5"), "--time"),
        (("--lambda", "0.5"), "--method fairing"),
        (("--sigma=2",), "--noise"),
        (("--method", "taubin"), "only for a mesh whose points move"),
        (("--method", "Bilateral"), "normal-filter"),
    ],
)
def test_words_of_other_tools_point_to_ours(heights, words, meant):
    done = warm_start.run("smooth", str(heights), str(heights.with_name("b.tif")), *words)
    assert done.returncode in (1, 2)
    assert len(words_of(done).strip().splitlines()) == 1
    assert meant in words_of(done)


def test_ctrl_c_while_the_command_is_imported_ends_it_in_one_line(monkeypatch, capsys):
    class Interrupting:
        def find_spec(self, name, *_):
            if name == "meshflow.cli.commands":
                raise KeyboardInterrupt

    monkeypatch.delitem(sys.modules, "meshflow.cli.commands", raising=False)
    monkeypatch.setattr(sys, "meta_path", [Interrupting(), *sys.meta_path])
    monkeypatch.setattr(atexit, "register", lambda function: function)  # no freeze at the end of the tests
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 130
    assert capsys.readouterr().err == "meshflow: interrupted; nothing was done\n"
