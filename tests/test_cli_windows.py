"""The command smooths a raster by windows in a bounded memory, is interrupted without a trace, and refuses in one line."""

import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from helpers import warm_start
from helpers.raster_files import make

from meshflow import Beltrami
from meshflow.estimate.request import Request
from meshflow.io.files import read
from meshflow.io.metadata import ReadOptions
from meshflow.large.memory import needed
from meshflow.large.rasters import form_of
from meshflow.smoothing import smooth_object
from meshflow.surfaces.data import array_of


def large(path, n=3000):
    """A raster whose samples in memory take eight times the file."""
    rng = np.random.default_rng(0)
    z = 30 * np.sin(np.arange(n) / 90)[:, None] + 2 * rng.normal(size=(n, n))
    return make(path, z.astype("float32"), tiled=True, blockxsize=256, blockysize=256)


LIMITED = """
import resource, sys
limit = int(sys.argv.pop(1))
from meshflow.cli.commands import main
resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
try:
    main()
finally:
    status = open("/proc/self/status").read()  # ru_maxrss would be that of the process that started this one, if larger
    print(int(status.split("VmHWM:")[1].split()[0]) * 1024)
"""
FIXED = ("--method", "beltrami", "--contrast", "5", "--time", "900", "--noise", "2", "--outliers", "include")


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="the limit is that of Linux")
def test_a_process_that_may_take_less_memory_than_the_raster_needs_writes_the_same_bits(tmp_path):
    path, memory = large(tmp_path / "in.tif"), 450e6
    assert needed(form_of(path, ReadOptions())) > 1.25 * memory
    # What is reserved and never touched counts here, too: stacks of threads, rooms of the allocator.
    limited = [
        sys.executable,
        "-c",
        LIMITED,
        str(int(1.25 * memory)),
        "smooth",
        path,
        tmp_path / "out.tif",
        "--memory",
        "450MB",
    ]
    done = subprocess.run([*map(str, limited), *FIXED], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "windows with a halo of" in done.stderr
    assert int(done.stdout.split()[-1]) < memory
    asked = Request.of(Beltrami(contrast=5.0), time=900.0, noise=2.0, outliers="include")
    whole, _ = smooth_object(read(path), asked, record=None)
    assert array_of(read(tmp_path / "out.tif").data).tobytes() == array_of(whole.data).tobytes()


@pytest.mark.skipif(sys.platform == "win32", reason="sends a signal")
def test_ctrl_c_half_way_leaves_nothing(tmp_path):
    path = large(tmp_path / "in.tif")
    words = [sys.executable, "-m", "meshflow", "smooth", path, tmp_path / "out.tif", "--memory", "300MB", *FIXED]
    # A shell that starts pytest in the background lets it, and what it starts, ignore the signal.
    heed = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    environment = {**os.environ, "COLUMNS": "200"}
    with subprocess.Popen(list(map(str, words)), stderr=subprocess.PIPE, env=environment, preexec_fn=heed) as run:
        until = time.monotonic() + 60
        while time.monotonic() < until and not list(tmp_path.glob(".meshflow-*")):
            time.sleep(0.02)
        run.send_signal(signal.SIGINT)
        _, said = run.communicate(timeout=60)
    assert run.returncode == 130
    assert b"interrupted" in said
    assert [file.name for file in tmp_path.iterdir()] == ["in.tif"]


def smoothed(path: Path, *words):
    done = warm_start.run("smooth", str(path), str(path.parent / "out.tif"), *words, COLUMNS="200")
    return done.returncode, done.stderr.decode()


@pytest.mark.skipif(sys.platform == "win32", reason="forks")
@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("--report", "r.html"), "--report: it needs the whole data, which does not fit into 300 MB"),
        (("--displacement", "0.9"), "stop: not in windows, any single sample may meet it"),
        (("--memory", "0"), "memory: a size such as 2GB"),
        (("--moves", "points"), "moves: no option of a raster"),
    ],
)
def test_a_refusal_is_one_line(words, why, tmp_path):
    path = large(tmp_path / "in.tif", 2500)
    code, said = smoothed(path, "--memory", "300MB", *words)
    assert code == 1
    assert why in said
    assert said.count("\n") == 1
    assert [file.name for file in tmp_path.iterdir()] == ["in.tif"]


@pytest.mark.skipif(sys.platform == "win32", reason="forks")
def test_a_raster_that_fits_is_smoothed_as_a_whole(tmp_path):
    path = large(tmp_path / "in.tif", 150)
    code, said = smoothed(path, "--memory", "1GB", *FIXED)
    assert code == 0
    assert "window" not in said
