"""One rate of a volume beside a copy of memory, and the second stage: ``pytest -m bench -s -n 0 tests/bench_volume_speed.py``.

Ratios of medians of interleaved runs, with two threads (``BENCH_THREADS``): of CPU time, so that other work on the machine does
not count. Of the second stage the CPU time per value, and the memory beside that of the volume and its first result.
"""

import os
import subprocess
import sys
import time

import numpy as np
import pytest

from meshflow.flow.blend import euler
from meshflow.flow.engines.volume import VolumeFlow
from meshflow.flow.family import Variant
from meshflow.kernels.arrays import copied
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.volume import Volume

pytestmark = [pytest.mark.bench, pytest.mark.timeout(3600)]
THREADS = int(os.environ.get("BENCH_THREADS", "2"))
SIZE, TARGET = int(os.environ.get("BENCH_SIZE", "256")), 12.0
CASES = {
    "gamma 0": (Variant(), False, 1),
    "gamma -1, q 1.5": (Variant(-1.0, 1.5), False, 1),
    "gamma -1, q 2": (Variant(-1.0, 2.0), False, 1),
    "gamma -1, q 3": (Variant(-1.0, 3.0), False, 1),
    "10 % missing": (Variant(), True, 1),
    "three channels, float64": (Variant(), False, 3),
}


@pytest.mark.parametrize("name", CASES)
def test_a_rate_costs_few_copies(name):
    variant, holes, channels = CASES[name]
    rng = np.random.default_rng(0)
    shape = (SIZE, SIZE, SIZE) if channels == 1 else (SIZE // 2, SIZE // 2, SIZE // 2, channels)
    values = 2 * rng.standard_normal(shape, np.float32)
    missing = rng.random(shape[:3]) < 0.1 if holes else np.zeros(shape[:3], bool)
    flow = VolumeFlow(Volume(values, missing=missing).gridded(Lift(0.75)), variant, THREADS)
    u, out = flow.start(), np.empty(flow.shape, flow.dtype).reshape(channels, -1).T
    flat = np.ascontiguousarray(u.T).ravel()
    target, ratios = np.empty_like(flat), []
    for _ in range(7):
        begun = time.process_time()
        copied(flat, target, THREADS)
        between = time.process_time()
        flow.rate(u, 0, euler(0.1), out)
        ratios.append(((time.process_time() - between), between - begun))
    rate, copy = np.median(ratios[1:], axis=0)
    print(f"\n{name}: {rate * 1e3:.0f} ms of CPU, {rate / copy:.1f} copies of {copy * 1e3:.1f} ms")
    assert channels > 1 or rate < TARGET * copy


FILTERED = """
import resource, sys, time
import numpy as np
from meshflow.flow.patch_groups import PatchGroups
side = int(sys.argv[1])
values, missing = np.random.default_rng(0).standard_normal((1, side, side, side), np.float32), np.zeros((side,) * 3, bool)
pilot, small = 0.1 * values, np.s_[:, :12, :12, :12]
PatchGroups.of([1.0]).filtered(values[small].copy(), pilot[small].copy(), missing[small[1:]], 2)
before, begun = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
PatchGroups.of([1.0]).filtered(values, pilot, missing, 2)
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024 / side**3, (time.process_time() - begun) / side**3)
"""


def test_the_second_stage_takes_few_bytes_and_microseconds_a_value():
    for side in (64, 96):
        ran = subprocess.run([sys.executable, "-c", FILTERED, str(side)], capture_output=True, text=True, check=True)
        bytes_each, seconds = map(float, ran.stdout.split())
        print(
            f"\nsecond stage of {side}³ values: {bytes_each:.0f} bytes and {seconds * 1e6:.1f} microseconds of CPU a value"
        )
    assert bytes_each < 24
