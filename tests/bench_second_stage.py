"""The gain of a second stage on photographs, and BM3D with known sigma: ``pytest -m bench -s -n 0 tests/bench_second_stage.py``.

Crops of ``BENCH_CROP`` x ``BENCH_CROP`` (256: a quarter of an hour, most of it BM3D's; see the guide of benchmarks), of
``BENCH_NAMES=camera,coins`` alone, if given. BM3D (the package bm3d 4.0.3, free for research only) is told sigma, as ours is.
"""

import importlib.util
import os
import time

import numpy as np
import pytest

from meshflow import Search, smooth
from meshflow.flow.patch_groups import PatchGroups

pytestmark = [pytest.mark.bench, pytest.mark.timeout(3600)]
SIDE = int(os.environ.get("BENCH_CROP", "256"))
NAMES = tuple(name for name in os.environ.get("BENCH_NAMES", "").split(",") if name)
GREY = (
    "camera",
    "coffee",
    "chelsea",
    "rocket",
    "brick",
    "grass",
    "gravel",
    "coins",
    "page",
    "moon",
    "text",
    "astronaut",
)
COLOUR = ("astronaut", "coffee", "chelsea")


def photograph(name, colour):
    """The middle of a photograph of scikit-image, at most SIDE x SIDE, 0 to 255."""
    data = pytest.importorskip("skimage.data")
    image = np.asarray(getattr(data, name)(), np.float32)
    if not colour and image.ndim == 3:
        image = image[..., :3] @ np.float32([0.2125, 0.7154, 0.0721])
    top, left = (max(0, (size - SIDE) // 2) for size in image.shape[:2])
    return np.ascontiguousarray(image[top : top + SIDE, left : left + SIDE])


def decibel(found, truth):
    return 10 * np.log10(255**2 / np.mean((np.asarray(found, np.float64) - truth) ** 2))


def peer(noisy, sigma):
    """BM3D, told sigma; not a number where the package is not there."""
    if importlib.util.find_spec("bm3d") is None:
        return np.full_like(noisy, np.nan)
    import bm3d

    return (bm3d.bm3d if noisy.ndim == 2 else bm3d.bm3d_rgb)(noisy.astype(np.float64), sigma)


@pytest.mark.parametrize(
    ("names", "sigmas"), [(GREY, (5.0, 15.0, 30.0)), (COLOUR, (10.0, 25.0, 50.0))], ids=["grey", "colour"]
)
def test_photographs_with_white_noise(names, sigmas):
    print(f"\nflow | default | BM3D, dB, {SIDE} x {SIDE}, sigma {sigmas}, seed 7")
    coloured, names = names is COLOUR, [name for name in names if name in (NAMES or names)]
    if not names:
        pytest.skip("BENCH_NAMES has none of these")
    rows = np.zeros((len(names), len(sigmas), 3))
    for i, name in enumerate(names):
        truth = photograph(name, coloured)
        for j, sigma in enumerate(sigmas):
            noisy = (truth + np.random.default_rng(7).normal(0, sigma, truth.shape)).astype(np.float32)
            for k, found in enumerate(
                (
                    smooth(noisy, kind="image", noise=sigma, method=Search(second_stage=False)),
                    smooth(noisy, kind="image", noise=sigma),
                    peer(noisy, sigma),
                )
            ):
                rows[i, j, k] = decibel(found, truth)
        print(f"  {name:12s} {'   '.join(' | '.join(f'{x:.2f}' for x in row) for row in rows[i])}", flush=True)
    mean = rows.mean(axis=0)
    print(f"  {'mean':12s} {'   '.join(' | '.join(f'{x:.2f}' for x in row) for row in mean)}")
    assert (rows[..., 1] > rows[..., 0] - 0.02).all()
    assert (mean[:, 1] > mean[:, 0] + 0.2).all()


@pytest.mark.parametrize("k", [1, 3])
def test_time_for_a_sample(k):
    truth = np.moveaxis(np.atleast_3d(photograph("astronaut" if k == 3 else "camera", k == 3)), 2, 0)
    noisy = (truth + np.random.default_rng(7).normal(0, 15, truth.shape)).astype(np.float32)
    groups, missing = PatchGroups.of(np.full(k, 15.0)), np.zeros(truth.shape[1:], bool)
    groups.filtered(noisy, truth, missing)
    for threads in (1, 2):
        began, spent = time.perf_counter(), time.process_time()
        groups.filtered(noisy, truth, missing, threads)
        wall, cpu = time.perf_counter() - began, time.process_time() - spent
        print(
            f"\n  {k} channels, {threads} threads: {1e9 * wall / missing.size:.0f} ns, {1e9 * cpu / missing.size:.0f} ns of CPU"
        )
