"""The noise of an image from its weakly textured patches, after Liu, Tanaka and Okutomi (2013).

A patch of pure noise has the covariance sigma^2 in every direction, while the data contributes to few directions. Therefore the
smallest eigenvalue of the covariance of many patches is that of the noise. It is biased low by the finite number of patches and
high by texture. Against the bias by texture, only patches are used whose second differences are no larger than those of noise,
and sigma is estimated again from them until it converges. Against the bias by the number of patches (our addition), it is
divided by the same eigenvalue for white noise of deviation 1 at the same places. Planes are subtracted from the patches first
(also ours), so that single precision is sufficient for the rest.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy.special
from numpy.lib.stride_tricks import sliding_window_view

from meshflow.geometry.validation import Array

__all__ = ["patch_noise"]

# Among sides 5, 6 and 7 and confidences 0.97, 0.99 and 0.998, these have the lowest error over twelve scenes and four levels of
# noise: 3 % on average, at most 9 % on all but a photograph of grass (tests/bench_noise.py).
SIDE, CONFIDENCE = 7, 0.99
# The numbers of patches for the covariance, in the first rounds and in the last, and the largest number of selections.
SOME, PATCHES, ROUNDS = 8_000, 20_000, 6
# The number of patches in a product of matrices: larger ones are shared among threads by the library of linear algebra, which
# takes several times the processor time, and whose sums depend on their number.
BLOCK = 100
# The least number of patches for a covariance.
LEAST = 4 * SIDE * SIDE
# The number of repetitions of the white noise for few patches (ALIKE for half of SOME), and their distance in the field.
ALIKE, SHIFT = 2, 131
# Tiles take their white noise from places of the field that are so far apart, so many in a row: no two have the same.
APART, ABREAST = 76, 10
# The side of the field of white noise.
FIELD = 768


@dataclass(frozen=True, eq=False)
class _Places:
    """Patches of a tile z (h, w): their row-major positions (n,), and the energy of each."""

    z: Array
    at: Array
    energy: Array


def patch_noise(parts: list[tuple[Array, Array]]) -> float | None:
    """Standard deviation of the noise of one channel.

    :param parts: tiles of the data (h, w), and masks of their present samples.
    :returns: None for too few patches without missing samples.
    """
    places = [_places(z, there) for z, there in parts if min(z.shape) >= SIDE + 2]
    energy = np.concatenate([place.energy for place in places]) if places else np.zeros(0)
    if energy.size < LEAST:
        return None
    textured = np.flatnonzero(energy > 0)
    if textured.size < 0.5 * energy.size:
        return 0.0  # mostly constant: no noise
    if textured.size < LEAST:
        return None
    return float(np.sqrt(max(_iterated(places, energy, textured), 0.0)))


def _iterated(places: list[_Places], energy: Array, textured: Array) -> float:
    """The variance from weak patches, which are selected again with each estimate.

    :param energy: of all patches of all tiles.
    :param textured: (m,), indices of the patches that are not constant.
    """
    weak, variance = textured, _variance(places, textured, SOME)
    for _ in range(ROUNDS):
        weak = textured[energy[textured] < _threshold() * variance]
        if weak.size < LEAST:
            weak = np.sort(textured[np.argpartition(energy[textured], LEAST - 1)[:LEAST]])
        before, variance = variance, _variance(places, weak, SOME)
        if variance > 0.996 * before:  # it decreases from one selection to the next, except by chance
            break
    return _variance(places, weak, PATCHES) if weak.size > SOME else variance


def _variance(places: list[_Places], chosen: Array, most: int) -> float:
    """The smallest eigenvalue of the covariance of patches, divided by that of white noise at the same positions.

    :param chosen: (m,), increasing, indices over all patches; at most ``most`` of them are used, evenly spread.
    """
    if chosen.size > most:
        chosen = chosen[(np.arange(most) * (chosen.size / most)).astype(np.intp)]
    patches, before, field = [], 0, sliding_window_view(_field(), (SIDE, SIDE))
    # Few overlapping patches are correlated: the eigenvalue of noise is then the mean over several positions in the field.
    again = range(max(1, ALIKE * SOME // max(chosen.size, SOME // 4))) if chosen.size < SOME else range(1)
    unit: list[list[Array]] = [[] for _ in again]
    for i, place in enumerate(places):
        first, last = np.searchsorted(chosen, (before, before + place.at.size))
        at = place.at[chosen[first:last] - before]
        before += place.at.size
        rows, columns = np.divmod(at, place.z.shape[1] - SIDE - 1)
        patches.append(sliding_window_view(place.z, (SIDE, SIDE))[rows + 1, columns + 1].reshape(-1, SIDE * SIDE))
        for k in again:
            down, across = k * SHIFT + i // ABREAST * APART, 2 * k * SHIFT + i % ABREAST * APART
            there = (rows + down) % len(field), (columns + across) % len(field)
            unit[k].append(field[there].reshape(-1, SIDE * SIDE))
    return _least(np.concatenate(patches)) / float(np.mean([_least(np.concatenate(one)) for one in unit]))


def _least(patches: Array) -> float:
    """The smallest eigenvalue of the covariance of patches (n, d d) without their planes."""
    basis = _planes()
    level = (patches - patches[:, :1]).astype(np.float32)
    whole = len(level) // BLOCK * BLOCK
    parts = level[:whole].reshape(-1, BLOCK, SIDE * SIDE), level[whole:]
    for part in parts:
        part -= (part @ basis) @ basis.T
    level -= level.mean(axis=0)
    products = [np.swapaxes(part, -1, -2) @ part for part in parts]
    covariance = products[0].sum(axis=0, dtype=np.float64) + products[1]
    return float(np.linalg.eigvalsh(covariance / len(level))[3])


@lru_cache(maxsize=1)
def _planes() -> Array:
    """An orthonormal basis (d d, 3) of the planes over a patch."""
    rows, columns = np.mgrid[0:SIDE, 0:SIDE]
    return np.linalg.qr(np.stack([np.ones(SIDE * SIDE), rows.ravel(), columns.ravel()], axis=1))[0].astype(np.float32)


def _places(z: Array, there: Array) -> _Places:
    """The patches without missing samples on them and their rim, and the sums of their squared second differences."""
    clean = z if there.all() else np.where(there, z, 0.0)
    middle = 2.0 * clean[1:-1, 1:-1]
    squares = (clean[1:-1, :-2] - middle + clean[1:-1, 2:]).astype(np.float32) ** 2
    squares += (clean[:-2, 1:-1] - middle + clean[2:, 1:-1]).astype(np.float32) ** 2
    energy = _boxed(squares).ravel()
    if clean is z:
        return _Places(z, np.arange(energy.size), energy)
    side = SIDE + 2
    gone = np.zeros((z.shape[0] + 1, z.shape[1] + 1), np.int64)
    gone[1:, 1:] = (~there).cumsum(axis=0).cumsum(axis=1)
    whole = gone[side:, side:] - gone[:-side, side:] - gone[side:, :-side] + gone[:-side, :-side] == 0
    at = np.flatnonzero(whole)
    return _Places(z, at, energy[at])


def _boxed(a: Array) -> Array:
    """Sums over all patches, each computed separately, so that rounding errors do not spread."""
    h, w = a.shape[0] - SIDE + 1, a.shape[1] - SIDE + 1
    rows = a[:h].copy()
    for r in range(1, SIDE):
        rows += a[r : h + r]
    sums = rows[:, :w].copy()
    for c in range(1, SIDE):
        sums += rows[:, c : w + c]
    return sums


@lru_cache(maxsize=1)
def _field() -> Array:
    """White noise of deviation 1, in single precision."""
    return np.random.default_rng(1).standard_normal((FIELD, FIELD), dtype=np.float32)


@lru_cache(maxsize=1)
def _threshold() -> float:
    """The quantile, at the chosen confidence, of the energy of a patch of noise of deviation 1.

    The energy is a quadratic form z A z of normal numbers; it is approximated by a gamma distribution with mean tr A and variance
    2 tr A^2.
    """
    second = np.eye(SIDE, SIDE + 2) - 2.0 * np.eye(SIDE, SIDE + 2, 1) + np.eye(SIDE, SIDE + 2, 2)
    same = np.eye(SIDE, SIDE + 2, 1)
    form = np.kron(same.T @ same, second.T @ second) + np.kron(second.T @ second, same.T @ same)
    mean, variance = np.trace(form), 2.0 * np.sum(form * form)
    return float(scipy.special.gammaincinv(mean**2 / variance, CONFIDENCE) * variance / mean)
