"""How much what was removed is correlated: found by bands of rows, it is that of all of them."""

import numpy as np
import pytest

import meshflow
from meshflow.results import result as module
from meshflow.results.result import SHIFTS, SHIFTS_OF_VOLUMES


def naive(removed, there, shifts):
    planes = removed.reshape(*there.shape, -1)
    planes = planes - planes[there].mean(axis=0)
    found = []
    for shift in shifts:
        products = []
        for at in np.argwhere(there):
            to = tuple(at + shift)
            if all(0 <= i < size for i, size in zip(to, there.shape, strict=True)) and there[to]:
                products.append(planes[tuple(at)] * planes[to])
        if products:
            found.append(np.mean(products))
    return np.sqrt(np.mean(np.square(found))) / np.mean(planes[there] ** 2)


@pytest.mark.parametrize("at_once", [1, 40, 1 << 20])
@pytest.mark.parametrize("shape", [(9, 13), (11, 7, 2), (6, 5, 7)], ids=["heights", "channels", "volume"])
def test_the_correlation_of_bands_is_that_of_all_samples(shape, at_once, monkeypatch):
    monkeypatch.setattr(module, "AT_ONCE", at_once)
    rng = np.random.default_rng(2)
    z, volume = 5 + rng.normal(size=shape).cumsum(axis=0), shape == (6, 5, 7)
    there = rng.random(shape if volume else shape[:2]) > 0.2
    z[~there] = np.nan
    kind = {"kind": "volume"} if volume else {"outliers": "include"}
    found = meshflow.smooth(z, method="heat", time=1.5, noise=1.0, result=True, **kind)
    expected = naive(found.removed, there, SHIFTS_OF_VOLUMES if volume else SHIFTS)
    assert found.correlation == pytest.approx(expected, rel=1e-9)
