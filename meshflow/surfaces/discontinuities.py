"""Where a range image shows two surfaces, one before the other: edges of its grid that no triangle may have."""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.csgraph import connected_components

from meshflow.geometry.validation import Array

__all__ = ["Cuts", "cuts_by_noise", "small_components"]

# A surface that turns so far away from its ray is not seen as one: tan of 85 degrees.
STEEPEST = 11.4
# Two neighbours differ by noise alone by less than so many sigma, and from the slope beside them by less than so many.
ALONE, BESIDE = 6.0, 15.0
# What is no jump whatever the noise: a step of so many pixel footprints, 72 degrees.
SMALL = 3.0


@dataclass(frozen=True, eq=False)
class Cuts:
    """Edges of a grid of samples (h, w) that no triangle has.

    :ivar right: (h, w - 1), edges along the rows; ``down``: (h - 1, w), along the columns.
    """

    right: Array
    down: Array


def cuts_by_noise(depth: Array, missing: Array, sigma: Array | float, footprint: Array) -> Cuts:
    """Edges where depth jumps beyond what noise and slope explain, or the surface turns away from the ray.

    An edge is cut where its ends differ by more than a slope of 85 degrees and 6 sigma make, or by more from what its
    continuation on either side says than 3 footprints and 15 sigma: the slope of a crease is that of one of its sides, the slope
    of a jump of none.

    :param depth: (h, w).
    :param missing: (h, w).
    :param sigma: of the depths, a number or (h, w).
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
    beside = np.full(step.shape, np.inf, step.dtype)  # from the continuation on the side that says less
    np.fmin(beside[first], bend, out=beside[first])
    np.fmin(beside[last], bend, out=beside[last])
    one = z.dtype.type  # a number of Python would do, but not of numpy 1
    jumps = np.isfinite(beside) & (beside > np.maximum(one(SMALL) * width, one(BESIDE) * noise))
    jumps |= np.abs(step, out=step) > np.maximum(one(STEEPEST) * width, one(ALONE) * noise)
    return jumps


def small_components(missing: Array, cuts: Cuts | None, least: int) -> Array:
    """Samples (h, w) of pieces of fewer than ``least`` samples; pieces hang together by edges that are not cut."""
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
