"""Regions of a mesh without noise, where other regions plainly have it: of a scan of which a part was smoothed or filled."""

from typing import Any

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.csgraph import connected_components

from meshflow.geometry.laplacians import neighbour_means
from meshflow.geometry.normals import normals_at
from meshflow.geometry.validation import Array

__all__ = ["clean_region"]

# Rounds of neighbour means of the squared residuals, the quantile of its root that is the noise, the share of that below which
# vertices are quiet, and the one up to which they are between.
LOCAL, LOUD, QUIET, BETWEEN = 8, 0.9, 0.25, 0.6
# The least share of quiet and of loud vertices. Vertices between are no more than MIXED of the fewer of both: they are beside the
# edge of a region; detail of a shape is of every size.
SHARE, MIXED = 0.1, 0.6
# Regions are as wide as this number of rings on either side, and have so many vertices; of the loud vertices at least INNER are
# within theirs: creases and spikes are lines and points.
RINGS, FEW, INNER = 5, 200, 0.3


def clean_region(points: Array, faces: Array) -> tuple[Array, Array]:
    """The masks (n,) of vertices without noise, and of those with it; none where noise, or its absence, is everywhere.

    :param points: (n, 3).
    :param faces: (m, 3).
    """
    x, n = points.astype(np.float64), len(points)
    nothing, mean = np.zeros(n, bool), neighbour_means(faces, n, "free")
    used = np.zeros(n, bool)
    used[faces] = True
    if used.sum() < 2 * FEW:
        return nothing, nothing
    bend = np.einsum("ij,ij->i", x - mean @ x, normals_at(x, faces))
    power = np.square(bend - mean @ bend)
    for _ in range(LOCAL):
        power = 0.5 * (power + mean @ power)
    loud = float(np.quantile(power[used], LOUD))
    quiet, noisy = used & (power < QUIET**2 * loud), used & (power >= BETWEEN**2 * loud)
    fewer, both = min(int(quiet.sum()), int(noisy.sum())), used.sum()
    if fewer < SHARE * both or both - quiet.sum() - noisy.sum() > MIXED * fewer:
        return nothing, nothing
    wide = _large(mean, _within(mean, quiet))
    if not wide.any() or _within(mean, noisy).sum() < INNER * noisy.sum():
        return nothing, nothing
    for _ in range(RINGS):
        wide = quiet & (wide | (mean @ wide.astype(np.float64) > 0))
    return wide, noisy


def _within(mean: Any, region: Array) -> Array:
    """The vertices (n,) of a region that are RINGS rings from its edge."""
    for _ in range(RINGS):
        region = region & ~(mean @ (~region).astype(np.float64) > 0)
    return region


def _large(mean: Any, region: Array) -> Array:
    """The vertices (n,) of the connected parts of a region that have many."""
    at = np.flatnonzero(region)
    if not len(at):
        return region
    _, label = connected_components(sparse.csr_matrix(mean[at][:, at]), directed=False)
    found = np.zeros_like(region)
    found[at] = np.bincount(label)[label] >= FEW
    return found
