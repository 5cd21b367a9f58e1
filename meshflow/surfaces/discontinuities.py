"""Discontinuities of range images: edges of the grid that cross from one surface to another and are cut."""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.csgraph import connected_components

from meshflow.geometry.validation import Array

__all__ = ["Cuts", "cuts_by_noise", "small_components"]

# The tangent of 85 degrees: a surface that is tilted more against its ray is treated as a jump.
STEEPEST = 11.4
# By noise alone, neighbours differ by less than the first number of sigma, and from a continuation by less than the second.
ALONE, BESIDE = 6.0, 15.0
# A step below this number of pixel footprints (72 degrees) is never a jump.
SMALL = 3.0


@dataclass(frozen=True, eq=False)
class Cuts:
    """Edges of a grid of samples (h, w) that are cut: no triangle contains them.

    :ivar right: (h, w - 1), edges along the rows; ``down``: (h - 1, w), along the columns.
    """

    right: Array
    down: Array


def cuts_by_noise(depth: Array, missing: Array, sigma: Array | float, footprint: Array) -> Cuts:
    """Cut edges where the depth jumps by more than noise and slope explain, or where the surface turns away from the ray.

    An edge is cut in two cases. Its ends differ by more than a slope of 85 degrees plus 6 sigma. Or the step differs from the
    linear continuation of both sides by more than 3 footprints plus 15 sigma: at a crease the step continues one of the sides, at
    a jump neither.

    :param depth: (h, w).
    :param missing: (h, w).
    :param sigma: standard deviation of the depths, a number or (h, w).
    :param footprint: (h, w), the width of each pixel on the surface, unit of the depths.
    """
    z = np.where(missing, np.nan, depth)
    kind = z.dtype
    noise, width = np.broadcast_to(np.asarray(sigma, kind), z.shape), footprint.astype(kind, copy=False)
    return Cuts(_cut(z, noise, width, 1), _cut(z, noise, width, 0))


def _cut(z: Array, sigma: Array, footprint: Array, axis: int) -> Array:
    """Edges (h, w - 1) along the rows, or (h - 1, w) along the columns."""
    rows = axis == 1
    first, last = (np.s_[:, :-1], np.s_[:, 1:]) if rows else (np.s_[:-1], np.s_[1:])
    width, noise = np.minimum(footprint[first], footprint[last]), np.maximum(sigma[first], sigma[last])
    step = np.diff(z, axis=axis)
    bend = np.abs(np.diff(step, axis=axis))
    beside = np.full(step.shape, np.inf, step.dtype)  # distance from the nearer of the two continuations
    np.fmin(beside[first], bend, out=beside[first])
    np.fmin(beside[last], bend, out=beside[last])
    one = z.dtype.type  # numpy 1 would promote a Python number
    jumps = np.isfinite(beside) & (beside > np.maximum(one(SMALL) * width, one(BESIDE) * noise))
    jumps |= np.abs(step, out=step) > np.maximum(one(STEEPEST) * width, one(ALONE) * noise)
    return jumps


def small_components(missing: Array, cuts: Cuts | None, least: int) -> Array:
    """Mask (h, w) of samples in components of fewer than ``least`` samples, connected by edges that are not cut."""
    h, w = missing.shape
    number = np.arange(h * w).reshape(h, w)
    across, along = ~(missing[:, :-1] | missing[:, 1:]), ~(missing[:-1] | missing[1:])
    if cuts is not None:
        across, along = across & ~cuts.right, along & ~cuts.down
    ends = [(number[:, :-1][across], number[:, 1:][across]), (number[:-1][along], number[1:][along])]
    begin, end = (np.concatenate(parts) for parts in zip(*ends, strict=True))
    edges = sparse.coo_matrix((np.ones(len(begin), bool), (begin, end)), shape=(h * w, h * w))
    _, piece = connected_components(edges, directed=False)
    sizes = np.bincount(piece, weights=(~missing).ravel())
    return (sizes[piece].reshape(h, w) < least) & ~missing
