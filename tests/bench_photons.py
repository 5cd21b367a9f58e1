"""Ours by default beside peers that are told the gain and tuned on the truth: ``pytest -m bench -s -n 0 tests/bench_photons.py``.

Pictures of few photons. The peers filter the square root of Anscombe (1948) and come back by its exact unbiased inverse, as is
usual; ours is told nothing. Seeded; ``BENCH_CROP=160`` is the side of the pictures.
"""

import os
from collections.abc import Callable

import numpy as np
import pytest
from peers.grids import bm3d, gaussian, nlm_skimage, total_variation

import meshflow
from meshflow.errors import MissingPackage
from meshflow.estimate.noise_by_intensity import ByIntensity
from meshflow.estimate.stabilizer import Stabilizer

data = pytest.importorskip("skimage.data")
pytestmark = [pytest.mark.bench, pytest.mark.timeout(12 * 3600)]
NAMES = ("camera", "coins", "brick", "cell", "moon", "astronaut", "coffee", "chelsea")
MOST = (4, 30, 200)
SIDE = int(os.environ.get("BENCH_CROP", "160"))
PEERS: dict[str, list[Callable]] = {
    "Gaussian": [lambda z, s, w=w: gaussian(z, s, w) for w in (0.6, 0.9, 1.3, 1.8, 2.5)],
    "TV": [lambda z, s, w=w: total_variation(z, s, w) for w in (0.5, 0.8, 1.2, 1.8)],
    "NLM": [lambda z, s, h=h: nlm_skimage(z, s, h, 5, 9) for h in (0.4, 0.6, 0.8, 1.0)],
    "BM3D": [lambda z, s, a=a: bm3d(z, s, a) for a in (0.8, 1.0, 1.25)],
}


def picture(name):
    grey = getattr(data, name)()
    grey = (grey if grey.ndim == 2 else grey[..., 1]).astype(float)
    top, left = ((n - SIDE) // 2 for n in grey.shape)
    return grey[top : top + SIDE, left : left + SIDE] / 255.0


def decibels(found, truth, most):
    return -10.0 * np.log10(np.mean((found - truth) ** 2)) + 20.0 * np.log10(most)


def by_peer(filters, z, truth, most):
    """The best of some filters of the stabilized counts; None where the package is missing."""
    told = ByIntensity(0.0, 1.0, 0.0, 0.0, (0.0, float(z.max() or 1.0)), max(float(np.median(z)), 1.0), photons=True)
    by = Stabilizer.of((told,))
    try:
        return max(decibels(by.back(one(by.stabilized(z), told.usual)), truth, most) for one in filters)
    except MissingPackage:
        return None


def test_few_photons_beside_tuned_peers():
    print(f"\ndB, {SIDE} x {SIDE}, seed 5: ours by default | as one noise | {' | '.join(PEERS)}")
    gains = []
    for most in MOST:
        rows = []
        for name in NAMES:
            truth = most * picture(name)
            z = np.random.default_rng(5).poisson(truth).astype(float)
            ours = [decibels(meshflow.smooth(z, kind="image", domain=word), truth, most) for word in ("auto", "length")]
            theirs = [by_peer(filters, z, truth, most) for filters in PEERS.values()]
            rows.append([*ours, *(np.nan if one is None else one for one in theirs)])
            print(f"  up to {most:3d} photons, {name:10s} {' | '.join(f'{one:5.2f}' for one in rows[-1])}", flush=True)
        print(f"  up to {most:3d} photons, mean       {' | '.join(f'{one:5.2f}' for one in np.mean(rows, axis=0))}")
        gains += [row[0] - row[1] for row in rows]
    print(f"  over one noise: {np.mean(gains):.1f} dB in the mean, worst {min(gains):.1f}, best {max(gains):.1f}")
    assert np.mean(gains) > 2.0
