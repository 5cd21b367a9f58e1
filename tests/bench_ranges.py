"""A frame of a depth camera beside OpenCV's bilateral filter: ``pytest -m bench -s tests/bench_ranges.py``.

Medians of interleaved runs in one process, of the whole call as a caller writes it: triangles, noise and control among it.
"""

import platform
import time
from importlib.metadata import version
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
from helpers.parts import parts

import meshflow
from meshflow.flow.blend import euler
from meshflow.flow.engines.grid import GridFlow
from meshflow.flow.family import Variant
from meshflow.flow.workspace import Workspace
from meshflow.surfaces.camera import Pinhole
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.range_image import RangeImage
from meshflow.synthetic.samples import depth_scene

cv2 = pytest.importorskip("cv2")
pytestmark = [pytest.mark.bench, pytest.mark.timeout(1800)]
FRAME = Path(__file__).parents[2] / "shared" / "data" / "range" / "icl_livingroom_pairs" / "noisy_00000.png"
CAMERA, SHAPE, THREADS = Pinhole(525.0, 525.0, 319.5, 239.5), (480, 640), 2
RUNS = (
    ("by default", {}),
    ("domain length", {"domain": "length"}),
    ("time 5", {"time": 5}),
    ("time 15", {"time": 15}),
    ("time 15, gamma -1", {"time": 15, "gamma": -1}),
)


def frame():
    """Depths (480, 640) in metres, float32: of the ICL living room, else of the scene of the samples."""
    if FRAME.exists():
        return FRAME.name, iio.imread(FRAME).astype(np.float32) / np.float32(1000)
    return "depth_scene", depth_scene(CAMERA, SHAPE).noisy.astype(np.float32)


def medians(calls, repeats=15):
    """Seconds of each call, the median of interleaved runs."""
    times = {name: [] for name in calls}
    for call in calls.values():
        call()  # compiles, and touches the memory
    for _ in range(repeats):
        for name, call in calls.items():
            begun = time.perf_counter()
            call()
            times[name].append(time.perf_counter() - begun)
    return {name: float(np.median(found)) for name, found in times.items()}


def test_frames_per_second_beside_the_bilateral_filter():
    name, depth = frame()
    seen, data = np.nan_to_num(depth), RangeImage(depth, CAMERA)
    cv2.setNumThreads(THREADS)
    calls = {"bilateralFilter, d 9": lambda: cv2.bilateralFilter(seen, 9, 0.05, 3)}
    calls |= {words: lambda more=more: meshflow.smooth(data, **parts(threads=THREADS, **more)) for words, more in RUNS}
    for gamma in (0.0, 1.0, -1.0):
        flow = GridFlow(data.gridded(Lift()), Variant(gamma=gamma), THREADS)
        u, out = flow.start(), Workspace(flow).take()
        calls[f"one rate, gamma {gamma:g}"] = lambda flow=flow, u=u, out=out: flow.rate(u, 0, euler(0.1), out)
        calls[f"one bound, gamma {gamma:g}"] = lambda flow=flow, u=out: flow.bound(u)  # that of the start is kept
    seconds = medians(calls)
    peer = seconds["bilateralFilter, d 9"]
    versions = ", ".join(f"{package} {version(package)}" for package in ("numpy", "opencv-contrib-python-headless"))
    print(
        f"\n{name}, {SHAPE[1]} x {SHAPE[0]}, float32, {THREADS} threads, {platform.processor() or platform.machine()}; {versions}"
    )
    for words, found in seconds.items():
        print(f"  {words:22s} {1e3 * found:8.2f} ms {1 / found:8.1f} per second {found / peer:7.2f} x bilateral")
