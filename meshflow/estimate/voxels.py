"""Meshes made by marching cubes from a binary volume. Their steps are not noise of a sensor, and are known exactly."""

from itertools import product

import numpy as np

from meshflow.geometry.validation import Array

__all__ = ["voxel_edge"]

# The tolerance of a coordinate as a multiple of half an edge, in halves; the least share of vertices at the middle of an edge
# of the grid; the least number of vertices.
OFF, SHARE, FEW = 1e-3, 0.97, 200
# The largest tolerance, where coordinates are rounded; the numbers of decimals to which they may be.
MOST_OFF, DECIMALS = 0.05, (2, 3, 4, 5)
# The largest ratio of the edges of a voxel.
THICKEST = 16.0
# The bits of odd coordinates, and the least number of vertices of each: some of a body face along each axis. Blocks along the
# axes lie in planes that are at most this share of those of the grid (boxes 0.06 to 0.1, rods 0.5, balls 0.9).
BITS, FACING, BLOCKS = np.array([1, 2, 4]), 5, 0.2
# Levels of a coordinate closer than this share of the size count as equal.
LEAST = 1e-5


def voxel_edge(points: Array) -> float:
    """The edge of the voxels if the mesh is a level set of a binary volume, unit of the points; 0 for any other mesh.

    Each vertex of such a mesh is at the middle of an edge of a regular grid: in units of half an edge, up to a common shift, one
    coordinate is odd and two are even. If edges differ by axis, it is the shortest. Coordinates may be rounded, as those of files
    in single precision or of a few decimals are.

    :param points: (n, 3).
    """
    if len(points) < FEW:
        return 0.0
    x = points.astype(np.float64)
    size = float(np.ptp(x, axis=0).max())
    if size == 0:
        return 0.0
    for lattice in product(*(_lattices(values, size) for values in x.T)):
        halves = [half for half, _ in lattice]
        if max(halves) > THICKEST * min(halves):
            continue
        counts = np.stack([count for _, count in lattice], axis=1)
        kinds = (counts % 2) @ BITS
        for shift in range(8):
            odd = kinds ^ shift
            if np.mean(np.isin(odd, BITS)) >= SHARE and all(np.sum(odd == bit) >= FACING for bit in BITS):
                return 0.0 if _of_blocks(counts, odd) else 2.0 * min(halves)
    return 0.0


def _of_blocks(counts: Array, odd: Array) -> bool:
    """Whether nearly all vertices lie in a few planes of the grid: blocks along its axes have no steps.

    :param counts: (n, 3), coordinates in halves of an edge; ``odd``: (n,), the bits of those that are odd.
    """
    planes, spanned = [], 0.0
    for axis, bit in enumerate(BITS):
        planes.append(np.unique(counts[odd == bit, axis], return_counts=True)[1])
        spanned += 0.5 * float(np.ptp(counts[:, axis]))
    fullest = np.sort(np.concatenate(planes))[::-1]
    needed = int(np.searchsorted(np.cumsum(fullest), SHARE * len(counts))) + 1
    return needed <= BLOCKS * spanned


def _lattices(values: Array, size: float) -> list[tuple[float, Array]]:
    """Halves of an edge of which a coordinate (n,) may be multiples, each with these multiples (n,).

    Along the axis of a rod nearly all levels are a whole edge apart: half of the usual distance may be meant, too.

    :param size: of the mesh.
    """
    levels = np.unique(values)
    steps = np.diff(levels)
    if len(levels) < 3 or len(levels) > len(values) / 2 or float(steps.max()) <= LEAST * size:
        return []
    found = []
    for part in (1.0, 0.5):
        half = part * float(np.median(steps[steps > LEAST * size]))
        many = np.rint((levels[-1] - levels[0]) / half)
        half = float(levels[-1] - levels[0]) / many  # the median is rounded
        counts = (values - levels[0]) / half
        off = min(OFF + (2e-6 * size + 2.0 * _rounding(levels)) / half, MOST_OFF)
        if np.mean(np.abs(counts - np.rint(counts)) > off) <= 1.0 - SHARE:
            found.append((half, np.rint(counts).astype(np.int64)))
    return found


def _rounding(levels: Array) -> float:
    """How far coordinates are off by the single precision or the few decimals with which they were stored; else 0."""
    for decimals in DECIMALS:
        if np.allclose(np.round(levels, decimals), levels, rtol=0.0, atol=2e-7 * float(np.abs(levels).max())):
            return 0.5 * 10.0**-decimals
    single = bool((levels == levels.astype(np.float32)).all())
    return float(np.spacing(np.float32(np.abs(levels).max()))) if single else 0.0
