"""One channel in the space of patches, measured: what area and bounds ask for, and no pulls.

The sweep of several coordinates would tell it, too; but it is compiled with all that channels, rays and borders ask for, which
is a quarter of the first call on a machine.
"""

import numpy as np
from numba import njit

from meshflow.flow.engines.grid.compiled import SWEEP, width
from meshflow.flow.engines.grid.coupled_rows import bounded, hurried, present, quickest
from meshflow.flow.engines.grid.patch_rows import patch_buffers, patched
from meshflow.flow.engines.grid.sweep import counted_row, flattened_row, gathered_thirds_row, sped_row, total

__all__ = ["patched_measured"]


@njit(**SWEEP)
def patched_measured(rows, sheets, u, fixed, pace, kinds, exponents, taps):
    """As :func:`.coupled_sweep.coupled_measured`, whose parameters it takes, of one channel over a plane:
    the mass is not Voronoi's, and the edge indicator is the metric's.

    :returns: the area of the cells that begin in the band, and the greatest bound of their triangles times s at their corners.
    """
    h, w, start, wide = u.shape[1], u.shape[2], max(rows[0] - 1, 0), width(u.shape[2])
    geometry, cells, same, _ = fixed
    weights, thirds, there = np.zeros((2, 4, wide), u.dtype), np.zeros((2, wide), u.dtype), np.zeros((2, wide), u.dtype)
    masses, counts = np.zeros((2, wide), u.dtype), np.zeros((5, wide), u.dtype)
    flat, speed = np.zeros(wide, u.dtype)[:w], np.empty(wide, u.dtype)[:w]
    bounds, speeds = np.zeros((2, 4, w)), np.zeros((2, w))
    patches, gamma, area, fastest = patch_buffers(taps.ravel(), w, u.dtype), exponents[1], 0.0, 0.0
    for r in range(start, min(rows[1] + 1, h)):  # the last cells end at the first row of the next band
        mass, below = masses[r % 2, :w], masses[1 - r % 2, :w]
        counting = kinds[1] != 0 and not (r - 1 > start and r < h - 1 and same[r] and same[r - 1])
        for side in range(sheets[0], sheets[1] if r < h - 1 else sheets[0]):
            fresh, part = side == sheets[0], (cells[1][side][cells[0][side][r] : cells[0][side][r + 1]], cells[2][side])
            patched(side, r, u, cells, kinds[5] == 1, taps, patches, kinds, exponents, geometry, weights, thirds)
            present(part, weights, thirds)
            gathered_thirds_row(fresh, side, thirds, mass, below)
            if counting:
                counted_row(fresh, side, (0, w - 1, 0), part, there, counts, w)
            bounded(w, kinds[2], weights, thirds, bounds[r % 2, 2 * side : 2 * side + 2])
            area += total(thirds, w) if rows[0] <= r < rows[1] else 0.0
        if r == h - 1:
            counts[0], counts[1], counts[2] = counts[3], counts[4], 0
        speed[:] = 1
        if kinds[1] != 0:
            flattened_row(counts, geometry, r, flat)
            sped_row(kinds[1], gamma, type(gamma)(0), flat, mass, speed)
        hurried(pace, r, speed, speeds[r % 2])
        if r > rows[0]:
            for side in range(sheets[0], sheets[1]):
                part = bounds[1 - r % 2, 2 * side : 2 * side + 2]
                fastest = max(fastest, quickest(side, part, speeds[1 - r % 2], speeds[r % 2]))
    return area, fastest
