"""The noise of an image from its weakly textured patches, after Liu, Tanaka and Okutomi (2013).

A patch of noise alone has a covariance of sigma^2 in every direction; what the data draws into it fills few directions, so the
smallest eigenvalue of the covariance of many patches is that of the noise. It is biased low by the finite number of patches and
high by texture. Against the second, patches are taken whose second differences are no larger than noise would make them, and
sigma is estimated again from those until it stays. Against the first (ours), the same eigenvalue is found for white noise of
deviation 1 at the same places, and divides it.
"""

from functools import lru_cache

import numpy as np
import scipy.special
from numpy.lib.stride_tricks import sliding_window_view

from meshflow.geometry.validation import Array

__all__ = ["patch_noise"]

# Of sides 5, 6 and 7 and confidences of 0.97, 0.99 and 0.998, these err least over twelve scenes and four levels of noise: 3 % in
# the mean, 9 % at worst on all but a photograph of grass (tests/bench_noise.py).
SIDE, CONFIDENCE = 7, 0.99
# Patches looked at, and how often the choice is made anew.
PATCHES, ROUNDS = 60_000, 6
# Fewer patches than these say nothing of a covariance.
LEAST = 4 * SIDE * SIDE


def patch_noise(parts: list[tuple[Array, Array]]) -> float | None:
    """Standard deviation of the noise of one channel.

    :param parts: tiles of the data (h, w), and which of their samples are there.
    :returns: None for too few patches of which all samples are there.
    """
    found = [_energies(z, there) for z, there in parts if min(z.shape) >= SIDE + 2]
    energy = np.concatenate([e[ok] for e, ok in found]) if found else np.zeros(0)
    if energy.size < LEAST:
        return None
    textured = energy > 0
    if textured.mean() < 0.5:
        return 0.0  # most of it is constant: there is no noise
    chosen = np.flatnonzero(textured)  # what is clipped or filled has none to show
    if chosen.size > PATCHES:
        chosen = chosen[np.random.default_rng(0).choice(chosen.size, PATCHES, replace=False)]
    if chosen.size < LEAST:
        return None
    energy = energy[chosen]
    patches, unit = _cut([z for z, _ in parts if min(z.shape) >= SIDE + 2], [ok for _, ok in found], np.sort(chosen))
    return _iterated(energy[np.argsort(chosen)], patches, unit)


def _iterated(energy: Array, patches: Array, unit: Array) -> float:
    """sigma from the patches (n, d d) that are weak enough for the one before; ``unit``: noise of deviation 1 in their place."""
    variance = _least(patches) / _least(unit)
    for _ in range(ROUNDS):
        weak = energy < _threshold() * variance
        if weak.sum() < LEAST:
            weak = np.zeros(len(energy), bool)
            weak[np.argsort(energy)[:LEAST]] = True
        again = _least(patches[weak]) / _least(unit[weak])
        if abs(again - variance) <= 1e-3 * variance:
            return float(np.sqrt(max(again, 0.0)))
        variance = again
    return float(np.sqrt(max(variance, 0.0)))


def _least(patches: Array) -> float:
    """The smallest eigenvalue of the covariance of patches (n, d d)."""
    centred = patches - patches.mean(axis=0)
    return float(np.linalg.eigvalsh(centred.T @ centred / len(patches))[0])


def _energies(z: Array, there: Array) -> tuple[Array, Array]:
    """Sum of squared second differences along rows and columns over each patch, and where the patch and its rim are there."""
    gone = ~there
    clean = np.where(there, z, 0.0)
    across = clean[1:-1, :-2] - 2.0 * clean[1:-1, 1:-1] + clean[1:-1, 2:]
    down = clean[:-2, 1:-1] - 2.0 * clean[1:-1, 1:-1] + clean[2:, 1:-1]
    return _boxed(across * across + down * down, SIDE), _boxed(gone.astype(np.float64), SIDE + 2) == 0


def _boxed(a: Array, side: int) -> Array:
    """Sums over all windows of a side, each its own: no rounding of one window reaches another."""
    h, w = a.shape[0] - side + 1, a.shape[1] - side + 1
    rows, sums = np.zeros((h, a.shape[1])), np.zeros((h, w))
    for r in range(side):
        rows += a[r : h + r]
    for c in range(side):
        sums += rows[:, c : w + c]
    return sums


def _cut(tiles: list[Array], ok: list[Array], chosen: Array) -> tuple[Array, Array]:
    """The patches (n, d d) of the chosen among those that are there, counted over all tiles, and white noise in their places."""
    patches, unit, before = [], [], 0
    draw = np.random.default_rng(1)
    for z, whole in zip(tiles, ok, strict=True):
        places = np.flatnonzero(whole.ravel())
        mine = places[chosen[(chosen >= before) & (chosen < before + len(places))] - before]
        before += len(places)
        inner = z[1:-1, 1:-1]
        rows, columns = np.divmod(mine, whole.shape[1])
        for field, kept in ((inner, patches), (draw.normal(size=inner.shape), unit)):
            kept.append(sliding_window_view(field, (SIDE, SIDE))[rows, columns].reshape(len(mine), SIDE * SIDE))
    return np.concatenate(patches), np.concatenate(unit)


@lru_cache(maxsize=1)
def _threshold() -> float:
    """What the energy of a patch of noise of deviation 1 stays below with the confidence asked for.

    A quadratic form of normal numbers, z A z: a gamma distribution of its mean tr A and variance 2 tr A^2.
    """
    second = np.eye(SIDE, SIDE + 2) - 2.0 * np.eye(SIDE, SIDE + 2, 1) + np.eye(SIDE, SIDE + 2, 2)
    same = np.eye(SIDE, SIDE + 2, 1)
    form = np.kron(same.T @ same, second.T @ second) + np.kron(second.T @ second, same.T @ same)
    mean, variance = np.trace(form), 2.0 * np.sum(form * form)
    return float(scipy.special.gammaincinv(mean**2 / variance, CONFIDENCE) * variance / mean)
