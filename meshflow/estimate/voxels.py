"""Meshes made by marching cubes from a binary volume. Their steps are not noise of a sensor, and are known exactly."""

import numpy as np

from meshflow.geometry.validation import Array

__all__ = ["voxel_edge"]

# The tolerance of a coordinate as a multiple of half an edge, in halves; the least share of vertices at the middle of an edge
# of the grid; the least number of vertices.
OFF, SHARE, FEW = 1e-3, 0.97, 50
# Levels of a coordinate closer than this share of the size count as equal.
LEAST = 1e-5


def voxel_edge(points: Array) -> float:
    """The edge of the voxels if the mesh is a level set of a binary volume, unit of the points; 0 for any other mesh.

    Each vertex of such a mesh is at the middle of an edge of a regular grid: in units of half an edge, up to a common shift, one
    coordinate is odd and two are even. If edges differ by axis, it is the shortest.

    :param points: (n, 3).
    """
    if len(points) < FEW:
        return 0.0
    x = points.astype(np.float64)
    size = float(np.ptp(x, axis=0).max())
    if size == 0:
        return 0.0
    halves, odd = np.zeros(3), np.zeros((len(x), 3), bool)
    for axis, values in enumerate(x.T):
        levels = np.unique(values)
        if len(levels) < 3 or len(levels) > len(x) / 2 or float(np.diff(levels).max()) <= LEAST * size:
            return 0.0
        steps = np.diff(levels)
        half = float(np.median(steps[steps > LEAST * size]))
        counts = (values - levels[0]) / half
        if np.mean(np.abs(counts - np.rint(counts)) > OFF + 2e-6 * size / half) > 1.0 - SHARE:
            return 0.0
        halves[axis], odd[:, axis] = half, np.rint(counts).astype(np.int64) % 2 == 1
    kinds = odd @ np.array([1, 2, 4])
    for shift in range(8):
        if np.mean(np.isin(kinds ^ shift, (1, 2, 4))) >= SHARE and len(np.unique(kinds)) >= 3:
            return 2.0 * float(halves.min())
    return 0.0
