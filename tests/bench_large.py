"""Larger than memory: ``pytest -m bench -s -n 0 tests/bench_large.py``.

Each measurement is of processes of their own: wall and processor seconds, and the largest resident memory. Files lie in the
temporary folder of pytest and are deleted. From the environment: BENCH_SIDE=20000 is the side of the raster under a limit,
BENCH_SIDES=4096,8192,16384 those of the growth, BENCH_MESH=2000000 the vertices of the mesh, BENCH_LAZY=8192 the side of what
dask computes (at 4096 a third of the time is what a cluster takes to start tasks and to move what they need).
"""

import os
import subprocess
import sys
import time

import numpy as np
import pytest
import rasterio
from rasterio.transform import from_origin
from rasterio.windows import Window

pytestmark = [pytest.mark.bench, pytest.mark.timeout(3600)]
FIXED = ("--method", "beltrami", "--contrast", "5", "--time", "900", "--noise", "2", "--outliers", "include")
COMMAND = """
import os, resource, sys
limit = int(sys.argv.pop(1))
from meshflow.cli.commands import main
if limit:
    resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
code = 0
try:
    main()
except SystemExit as end:
    code = end.code or 0
status = open("/proc/self/status").read()
print(int(status.split("VmHWM:")[1].split()[0]) * 1024, sum(os.times()[:4]))
sys.exit(code)
"""


def made(path, side, *, top=0, left=0, step=10):
    """A raster of hills, plateaus and noise of deviation 2, written by bands; a part of one infinite surface."""
    x = (left + np.arange(side)) / 37.0
    place = from_origin(376000 + left * step, 3808000 - top * step, step, step)
    with rasterio.open(
        path, "w", driver="GTiff", count=1, height=side, width=side, dtype="float32", crs="EPSG:32611", transform=place,
        tiled=True, blockxsize=256, blockysize=256, BIGTIFF="IF_SAFER",
    ) as target:  # fmt: skip
        for row in range(0, side, 256):
            rng = np.random.default_rng((top + row, left))
            high = min(256, side - row)
            y = (top + row + np.arange(high))[:, None]
            z = 30 * np.sin(y / 90) * np.cos(x / 3) + 20 * ((y // 300) % 2) + 8 * np.sin(x / 11 + y / 50)
            z = z + 2 * rng.standard_normal((high, side), dtype=np.float32)
            target.write(z.astype("float32")[None], window=Window(0, row, side, high))
    return path


def run(*words, limit=0):
    """Runs the command; returns wall seconds, processor seconds, and the largest resident bytes."""
    begun = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", COMMAND, str(limit), *map(str, words)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    peak, seconds = done.stdout.split()[-2:]
    return time.perf_counter() - begun, float(seconds), int(peak)


def said(name, side, wall, seconds, peak):
    each = 1e9 / side**2
    print(
        f"\n{name}: {side}^2, {wall:.1f} s, {seconds:.1f} CPU s ({each * wall:.0f} and {each * seconds:.0f} ns a sample), "
        f"{peak / 1e6:.0f} MB ({peak / side**2:.1f} bytes a sample)"
    )


def test_a_raster_is_smoothed_in_two_gigabytes(tmp_path):
    side = int(os.environ.get("BENCH_SIDE", "20000"))
    path, target = made(tmp_path / "in.tif", side), tmp_path / "out.tif"
    found = run("smooth", path, target, "-q", "--memory", "2GB", *FIXED, limit=int(1.25 * 2e9))
    said("by windows in 2 GB", side, *found)
    assert found[2] <= 2e9


def test_in_little_memory_the_bits_are_those_of_the_whole(tmp_path):
    path = made(tmp_path / "in.tif", 4000)
    for memory, limit in (("12GB", 0), ("500MB", int(1.25 * 5e8))):
        target = tmp_path / f"{memory}.tif"
        said(f"--memory {memory}", 4000, *run("smooth", path, target, "-q", "--memory", memory, *FIXED, limit=limit))
    with rasterio.open(tmp_path / "12GB.tif") as one, rasterio.open(target) as two:
        assert one.read(1).tobytes() == two.read(1).tobytes()


def test_the_time_of_a_sample_does_not_grow(tmp_path):
    each = []
    for side in map(int, os.environ.get("BENCH_SIDES", "4096,8192,16384").split(",")):
        path = made(tmp_path / "in.tif", side)
        wall, seconds, peak = min(
            run("smooth", path, tmp_path / "out.tif", "-q", "--overwrite", "--memory", "600MB", *FIXED)
            for _ in range(2)
        )
        said("by windows in 600 MB", side, wall, seconds, peak)
        each.append(seconds / side**2)
    print(f"growth of processor time a sample {each[-1] / each[0]:.2f}")
    assert each[-1] <= 1.2 * each[0]


@pytest.mark.parametrize("words", [FIXED, ()], ids=["fixed", "default"])
def test_windows_take_the_time_of_the_whole(words, tmp_path):
    side = 8192
    path, found = made(tmp_path / "in.tif", side), {}
    for name, memory in (("in memory", "12GB"), ("by windows in 1 GB", "1GB")):
        found[name] = run("smooth", path, tmp_path / f"{memory}.tif", "-q", "--memory", memory, *words)
        said(name, side, *found[name])
    (whole, *_), (windows, *_) = found.values()
    print(f"by windows over in memory {windows / whole:.2f}")
    assert windows <= 1.25 * whole
    if words:
        with rasterio.open(tmp_path / "12GB.tif") as one, rasterio.open(tmp_path / "1GB.tif") as two:
            for row in range(0, side, 1024):
                window = Window(0, row, side, 1024)
                assert one.read(1, window=window).tobytes() == two.read(1, window=window).tobytes()


def test_a_long_flow_by_legs_takes_the_time_of_the_whole(tmp_path):
    side, found = int(os.environ.get("BENCH_LONG", "4096")), {}
    path, words = made(tmp_path / "in.tif", side), (*FIXED[:4], "--steps", "300", "--stepper", "explicit", *FIXED[6:])
    for name, memory in (("300 steps in memory", "12GB"), ("300 steps by windows in 400 MB", "400MB")):
        found[name] = run("smooth", path, tmp_path / f"{memory}.tif", "-q", "--memory", memory, *words)
        said(name, side, *found[name])
    (whole, *_), (windows, *_) = found.values()
    print(f"by windows over in memory {windows / whole:.2f}")
    with rasterio.open(tmp_path / "12GB.tif") as one, rasterio.open(tmp_path / "400MB.tif") as two:
        assert one.read(1).tobytes() == two.read(1).tobytes()
    assert windows <= 1.25 * whole


def test_tiles_together_take_the_time_of_the_mosaic(tmp_path):
    count, size = 10, 512
    whole = made(tmp_path / "whole.tif", count * size)
    (tmp_path / "tiles").mkdir()
    with rasterio.open(whole) as source:
        for top in range(0, count * size, size):
            for left in range(0, count * size, size):
                window = Window(left, top, size, size)
                profile = {
                    **source.profile,
                    "height": size,
                    "width": size,
                    "transform": source.window_transform(window),
                }
                with rasterio.open(tmp_path / "tiles" / f"{top}_{left}.tif", "w", **profile) as tile:
                    tile.write(source.read(window=window))
    one = run("smooth", whole, tmp_path / "out.tif", "-q", "--memory", "600MB", *FIXED)
    said("mosaic", count * size, *one)
    words = ("--output", tmp_path / "done", "--together", "--memory", "600MB")
    two = run("smooth", tmp_path / "tiles", "-q", *words, *FIXED)
    said("100 tiles together", count * size, *two)
    print(f"tiles over mosaic {two[0] / one[0]:.2f}")
    with rasterio.open(tmp_path / "out.tif") as done:
        for path in (tmp_path / "done").iterdir():
            top, left = map(int, path.stem.split("_"))
            with rasterio.open(path) as tile:
                assert tile.read(1).tobytes() == done.read(1, window=Window(left, top, size, size)).tobytes()
    assert two[0] <= 1.3 * one[0]


DASK = """
import sys, time
import dask.array as da, numpy as np, meshflow
from meshflow import Beltrami, Compute
def main():
    side = int(sys.argv[2])
    chunk = side // 4
    def part(block_info=None):
        (top, bottom), (left, right) = block_info[None]["array-location"]
        y, x = np.mgrid[top:bottom, left:right]
        rng = np.random.default_rng((top, left))
        return (30 * np.sin(y / 90) * np.cos(x / 110) + 2 * rng.standard_normal(y.shape)).astype("float32")
    z = da.map_blocks(part, chunks=((chunk,) * (side // chunk),) * 2, dtype="float32", meta=np.zeros((0, 0), "float32"))
    options = dict(method=Beltrami(contrast=5.0), time=8.0, noise=2.0, outliers="include")
    if sys.argv[1] == "cluster":
        import distributed
        with distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
        ) as cluster, distributed.Client(cluster):
            meshflow.smooth(z[: 2 * chunk, : 2 * chunk], **options).sum().compute()
            begun = time.perf_counter()
            meshflow.smooth(z, **options).sum().compute()
    else:
        import dask
        with dask.config.set(scheduler="threads", num_workers=2):
            meshflow.smooth(z[: 2 * chunk, : 2 * chunk], **options).sum().compute()
            begun = time.perf_counter()
            meshflow.smooth(z, **options).sum().compute()
    print(time.perf_counter() - begun)
if __name__ == "__main__":
    main()
"""


def test_two_processes_of_dask_take_the_time_of_two_threads(tmp_path):
    script = tmp_path / "lazy.py"
    script.write_text(DASK)
    found = {}
    side = os.environ.get("BENCH_LAZY", "8192")
    for way in ("threads", "cluster", "threads", "cluster"):
        done = subprocess.run([sys.executable, script, way, side], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        found.setdefault(way, []).append(float(done.stdout.split()[-1]))
    threads, cluster = min(found["threads"]), min(found["cluster"])
    print(
        f"\n{side}^2 of dask, 16 chunks: two threads {threads:.1f} s, two processes {cluster:.1f} s, {cluster / threads:.2f}"
    )
    assert cluster <= 1.4 * threads


MESH = """
import os, sys
import numpy as np
import meshflow
from meshflow import CurvatureFlow
def peak():
    return int(open("/proc/self/status").read().split("VmHWM:")[1].split()[0]) * 1024
n = int(int(sys.argv[1]) ** 0.5)
y, x = np.mgrid[0:n, 0:n]
rng = np.random.default_rng(0)
points = np.stack([x, y, 9 * np.sin(x / 50) * np.cos(y / 60) + 0.2 * rng.standard_normal(x.shape)], -1).reshape(-1, 3)
a = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
faces = np.concatenate([np.stack([a, a + 1, a + n], 1), np.stack([a + 1, a + n + 1, a + n], 1)]).astype(np.int32)
del x, y, a
base = peak()
options = {"default": {}, "curvature": {"method": "curvature", "time": 4.0}, "quick": {"method": "quick"}}[sys.argv[2]]
meshflow.smooth((points, faces), **options)
print(peak() - base, n * n, len(faces), sum(os.times()[:2]))
"""


@pytest.mark.parametrize("way", ["curvature", "quick", "default"])
def test_a_mesh_of_twenty_million_triangles_fits(way, tmp_path):
    """Bytes per vertex on a smaller one; 20 million triangles are 10 million vertices."""
    script = tmp_path / "mesh.py"
    script.write_text(MESH)
    done = subprocess.run(
        [sys.executable, script, os.environ.get("BENCH_MESH", "2000000"), way],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    more, vertices, triangles, seconds = map(float, done.stdout.split()[-4:])
    each = more / vertices
    print(
        f"\n{way}: {triangles:.3g} triangles, {each:.0f} bytes per vertex, {seconds:.0f} CPU s; 10 million {each / 100:.1f} GB"
    )
    assert each * 1e7 <= 24e9


VOLUME = """
import sys
import numpy as np
path, side = sys.argv[1], int(sys.argv[2])
out = np.lib.format.open_memmap(path, "w+", np.float32, (side,) * 3)
y, x = np.mgrid[:side, :side]
for z in range(side):
    ball = (x - side / 2) ** 2 + (y - side / 2) ** 2 + (z - side / 2) ** 2 < (side / 3) ** 2
    rng = np.random.default_rng(z)
    out[z] = 100 + 20 * np.sin(z / 40) * np.cos(y / 50) + 60 * ball + 5 * rng.standard_normal((side, side), np.float32)
"""


def test_a_volume_is_smoothed_by_default_in_four_gigabytes(tmp_path):
    side, path = int(os.environ.get("BENCH_VOLUME", "512")), tmp_path / "in.npy"
    subprocess.run([sys.executable, "-c", VOLUME, path, str(side)], check=True)
    memory = float(os.environ.get("BENCH_MEMORY", "4e9"))
    words = ("-q", "--kind", "volume", "--memory", f"{memory / 1e9:g}GB")
    wall, seconds, peak = run("smooth", path, tmp_path / "out.npy", *words, limit=int(1.25 * memory))
    print(f"\n{side}^3 by default in {memory / 1e9:g} GB: {wall:.0f} s, {seconds:.0f} CPU s, {peak / 1e9:.2f} GB")
    assert peak <= memory
