"""One rate of the grid beside a copy of memory, beside itself on other data, and beside the release before.

``BENCH_BEFORE=/path/to/release-0.5 pytest -m bench -s tests/bench_kernels.py``: a clone of that release (loops by numba),
run by another process of the same Python (or of ``BENCH_BEFORE_PYTHON``). Ratios of medians of interleaved runs. With
``BENCH_THREADS=1`` what is measured is the time of the processor, whoever else is at work.
"""

import json
import os
import subprocess
import sys
import textwrap
import time
from importlib.metadata import version

import numpy as np
import pytest

from meshflow.flow.blend import euler
from meshflow.flow.engines.grid import GridFlow
from meshflow.flow.family import Variant
from meshflow.geometry.validation import nowhere
from meshflow.kernels.arrays import copied
from meshflow.kernels.library import environment
from meshflow.surfaces.camera import Pinhole
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.range_image import RangeImage

pytestmark = [pytest.mark.bench, pytest.mark.timeout(3600)]
THREADS = int(os.environ.get("BENCH_THREADS", "2"))
CLOCK = time.thread_time if THREADS == 1 else time.perf_counter
# Name: kind, gamma, sharpness, patch. Each is measured beside "one channel" of its size.
CASES = {
    "one channel": ("one", 0.0, 1.0, 0.0),
    "gamma -1, q 2": ("one", -1.0, 2.0, 0.0),
    "gamma -1, q 3": ("one", -1.0, 3.0, 0.0),
    "gamma -1, q 4": ("one", -1.0, 4.0, 0.0),
    "patches of 0.7": ("one", 0.0, 1.0, 0.7),
    "patches of 1.5": ("one", 0.0, 1.0, 1.5),
    "three channels": ("three", 0.0, 1.0, 0.0),
    "pinhole": ("pinhole", 0.0, 1.0, 0.0),
    "10 % missing": ("holes", 0.0, 1.0, 0.0),
}
# At most, of the release before, by number type and size.
TARGETS = {"float32": {256: 0.6, 512: 0.6, 1024: 0.8, 4096: 0.9}, "float64": {256: 0.8, 512: 0.8, 1024: 0.9, 4096: 1.0}}
WORKER = """
    import json, sys, time
    import numba, numpy as np
    numba.set_num_threads({threads})
    from meshflow.geometry.camera import Pinhole
    from meshflow.geometry.lift import HeightField, Image, Lift, RangeImage
    from meshflow.geometry.member import Member
    from meshflow.grid.rate import GridFlow
    calls = {{}}
    for line in sys.stdin:
        name, kind, gamma, q, patch, n, dtype, inner = json.loads(line)
        if name not in calls:
            calls.clear()
            rng = np.random.default_rng(0)
            z = (2 * rng.standard_normal((n, n, 3) if kind == "three" else (n, n), np.float32)).astype(dtype)
            noun = Image(z) if kind == "three" else RangeImage(
                (2 + 0.005 * z).astype(dtype), Pinhole(n, n, n / 2, n / 2)) if kind == "pinhole" else HeightField(
                z, missing=rng.random(z.shape) < 0.1 if kind == "holes" else np.zeros(z.shape, bool))
            flow = GridFlow(noun.gridded(Lift(1.0 if kind == "pinhole" else 0.75)), Member(gamma=gamma, sharpness=q, patch=patch))
            u, out = flow.start(), flow.spare()
            calls[name] = lambda: flow.advance(u, 0.1, 0, out=out)
            calls[name]()
        clock = time.thread_time if {threads} == 1 else time.perf_counter
        begun = clock()
        for _ in range(inner):
            calls[name]()
        print((clock() - begun) / inner, flush=True)
"""


def call(kind, gamma, sharpness, patch, n, dtype):
    """An explicit step: one rate, and what it moves."""
    rng = np.random.default_rng(0)
    z = (2 * rng.standard_normal((n, n, 3) if kind == "three" else (n, n), np.float32)).astype(dtype)
    data = (
        Image(z)
        if kind == "three"
        else HeightField(z, missing=rng.random((n, n)) < 0.1 if kind == "holes" else nowhere())
    )
    if kind == "pinhole":
        data = RangeImage((2 + 0.005 * z).astype(dtype), Pinhole(n, n, n / 2, n / 2))
    grid = data.gridded(Lift(1.0 if kind == "pinhole" else 0.75))
    flow = GridFlow(grid, Variant(gamma=gamma, sharpness=sharpness, patch=patch), THREADS)
    u, step = flow.start(), euler(0.1)
    out = np.empty_like(u)
    return lambda: flow.rate(u, 0, step, out)


def timed(run, inner):
    begun = CLOCK()
    for _ in range(inner):
        run()
    return (CLOCK() - begun) / inner


@pytest.fixture(scope="module")
def before():
    """Seconds of the release before for a case, or None where there is none."""
    place = os.environ.get("BENCH_BEFORE")
    if not place:
        yield lambda *_: None
        return
    process = subprocess.Popen(
        [os.environ.get("BENCH_BEFORE_PYTHON", sys.executable), "-c", textwrap.dedent(WORKER.format(threads=THREADS))],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=place,
        env={**os.environ, "PYTHONPATH": place, "NUMBA_NUM_THREADS": str(THREADS)},
    )  # fmt: skip

    def ask(*case):
        process.stdin.write(json.dumps(case) + "\n")
        process.stdin.flush()
        return float(process.stdout.readline())

    yield ask
    process.kill()
    process.wait()


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("n", [256, 512, 1024, 4096])
def test_one_rate_beside_a_copy_and_the_release_before(before, dtype, n):
    here = environment()
    print(
        f"\n{n} x {n} {dtype}, {THREADS} threads, {here.instruction_set}, {here.compiler}, numpy {version('numpy')}: "
        "ms, copies, x one channel, of before"
    )
    source, found = (
        np.ones(n * n, dtype),
        {},
    )  # zeros that nobody has written are one page of memory, read again and again
    target = np.empty_like(source)
    repeats = int(os.environ.get("BENCH_REPEATS", "9"))
    copy = np.median([timed(lambda: copied(source, target, THREADS), max(1, 2**22 // n**2)) for _ in range(repeats)])
    one = call(*CASES["one channel"], n, dtype)
    for name, case in CASES.items():
        run, inner = call(*case, n, dtype), max(1, 2**21 // n**2)
        run()
        ours, theirs, ones = [], [], []
        for _ in range(repeats):
            ours.append(timed(run, inner))
            ones.append(timed(one, inner))
            took = before(f"{name} {n} {dtype}", *case, n, dtype, inner)
            theirs += [] if took is None else [took]
        found[name] = float(np.median(ours))
        ratio = found[name] / float(np.median(theirs)) if theirs else float("nan")
        beside = found[name] / float(np.median(ones))
        print(f"  {name:16s} {1e3 * found[name]:8.3f} {found[name] / copy:6.2f} {beside:6.2f} {ratio:6.2f}")
        if name == "one channel" and theirs:
            print(f"  {'':16s} at most {TARGETS[dtype][n]} of before is asked for")
