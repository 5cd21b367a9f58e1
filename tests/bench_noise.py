"""How well noise is found, beside Immerkaer's median of second differences: ``pytest -m bench -s tests/bench_noise.py``."""

import numpy as np
import pytest

from meshflow.estimate.noise import MAD, noise_of
from meshflow.synthetic import scenes

pytestmark = pytest.mark.bench
SIGMAS = (3, 5, 10, 20)


def subjects():
    """Smooth scenes, terrain, and the photographs of skimage.data."""
    data = pytest.importorskip("skimage.data")
    yield from ((name, getattr(scenes, name)()) for name in ("steps", "mesas", "ramps", "fractal_terrain", "jacksboro"))
    yield from ((name, getattr(data, name)().astype(float)) for name in ("camera", "grass", "brick", "coins", "moon"))
    yield "astronaut", data.astronaut()[..., 1].astype(float)


def differences(z):
    across = z[:, :-2] - 2 * z[:, 1:-1] + z[:, 2:]
    return MAD * np.median(np.abs(across[:-2] - 2 * across[1:-1] + across[2:])) / 6


def test_noise_found_over_noise_that_was_added():
    print(f"\nfound over added, by weak patches | by differences, sigma {SIGMAS}, seed 3")
    ours, theirs = {}, {}
    for name, truth in subjects():
        for sigma in SIGMAS:
            z = truth + sigma * np.random.default_rng(3).normal(size=truth.shape)
            ours[name, sigma] = noise_of(z, np.zeros(z.shape, bool)).sigma / sigma
            theirs[name, sigma] = differences(z) / sigma
        rows = (" ".join(f"{found[name, sigma]:.3f}" for sigma in SIGMAS) for found in (ours, theirs))
        print(f"  {name:16s} {' | '.join(rows)}")
    errors = [np.abs(np.log(list(found.values()))) for found in (ours, theirs)]
    print(
        f"  mean error {errors[0].mean():.1%} | {errors[1].mean():.1%}; at worst {errors[0].max():.0%} | {errors[1].max():.0%}"
    )
    calm = [abs(np.log(ratio)) for (name, _), ratio in ours.items() if name != "grass"]
    assert max(calm) < 0.2
    assert errors[0].mean() < errors[1].mean()
