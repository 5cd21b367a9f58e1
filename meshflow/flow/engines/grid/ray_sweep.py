"""A band of rows of samples on lines in space: down the rows of cells, each cell once, scalars alone given to the samples."""

import numpy as np
from numba import njit

from meshflow.flow.engines.grid import ray_rows
from meshflow.flow.engines.grid.cells import NONE
from meshflow.flow.engines.grid.compiled import EDGE, FORMULA, ROW, SWEEP, width
from meshflow.flow.engines.grid.coupled_rows import RING, placed
from meshflow.flow.engines.grid.sweep import gathered_row, gathered_thirds_row, moved_row, sped_row, stay_row, total

__all__ = ["rays_measured", "rays_swept"]

# Rows of sums.
PULL, MASS, SEEN = range(3)
# A sample seen exactly edge-on has no footprint at all; it must not divide by zero where gamma < 0.
LEAST = 1e-6


@njit(**SWEEP)
def rays_swept(rows, sheets, u, out, mix, fixed, lines, pace, kinds, exponents, pitch):
    """One step of the samples in a band: parameters as of :func:`.coupled_sweep.coupled_swept`.

    The mass is barycentric or the ring, the indicator ``metric``.

    :param pitch: one over the differences of x along the rows and of y along the columns where lines are u (x, y, 1) on an even
        grid; zeros where they are others.
    """
    h, w, start, held = u.shape[1], u.shape[2], max(rows[0] - 1, 0), fixed[3]
    points, rays, sums, buffers, inverse = _buffers(w, u.dtype)
    placed(u, start, lines, 1, points[start % 2], rays[start % 2])
    for r in range(start, rows[1]):
        here, below = sums[r % 2], sums[1 - r % 2]
        pair, sights = (points[r % 2], points[1 - r % 2]), (rays[r % 2], rays[1 - r % 2])
        if r < h - 1:
            placed(u, r + 1, lines, 1, pair[1], sights[1])
            for side in range(sheets[0], sheets[1]):
                _celled(kinds[1] != 0, side, pitch, _part(fixed, side, r), pair, sights, buffers)
                _gathered(side == sheets[0], side, w, kinds[1] != 0, buffers, here, below)
        if r >= rows[0]:
            _sped(kinds, exponents, sights[0], pace, r, here, inverse)
            stay_row(held, r, 0, inverse)
            moved_row(mix, 0, u, here[PULL, :w], inverse, r, 0, w, out)


@njit(**SWEEP)
def rays_measured(rows, sheets, u, fixed, lines, pace, kinds, exponents, pitch, bounding):
    """The surface measured: parameters as of :func:`rays_swept`.

    Where gamma >= 0 the indicator is at most 1, and is not asked for.

    :param bounding: 1 for the bound, 0 for the area.
    :returns: the area of the cells that begin in the band, and the greatest bound of their triangles times the factor of time
        s pace at their corners; zero where it was not asked for.
    """
    h, w, start = u.shape[1], u.shape[2], max(rows[0] - 1, 0)
    points, rays, sums, buffers, _ = _buffers(w, u.dtype)
    bounds, speeds, most = np.zeros((2, 4, w), u.dtype), np.ones((2, w), u.dtype), np.zeros(w - 1, u.dtype)
    area, slowed = 0.0, exponents[1] < 0
    placed(u, start, lines, 1, points[start % 2], rays[start % 2])
    for r in range(start, min(rows[1] + bounding, h)):  # the last cells end at the first row of the next band
        here, below = sums[r % 2], sums[1 - r % 2]
        pair, sights = (points[r % 2], points[1 - r % 2]), (rays[r % 2], rays[1 - r % 2])
        if r < h - 1:
            placed(u, r + 1, lines, 1, pair[1], sights[1])
        for side in range(sheets[0], sheets[1] if r < h - 1 else sheets[0]):
            part = _part(fixed, side, r)
            if slowed or bounding == 0:
                _celled(slowed, side, pitch, part, pair, sights, buffers)
                _gathered(side == sheets[0], side, w, slowed, buffers, here, below)
                area += total(buffers[4:6], w) if bounding == 0 and r >= rows[0] else 0.0
            if bounding != 0:
                _decaying(side, part, pair, bounds[r % 2, 2 * side], bounds[r % 2, 2 * side + 1])
        if bounding != 0:
            _hurried(slowed, kinds, exponents, sights[0], pace, r, here, speeds[r % 2])
            if r > rows[0]:
                for side in range(sheets[0], sheets[1]):
                    _foremost(side, bounds[1 - r % 2], speeds[1 - r % 2], speeds[r % 2], most)
    return area, float(most.max())


@njit(**ROW)
def _buffers(w, kind):
    """Rows for a band: points and rays of two rows of samples; their sums; corners, thirds and what is seen; s / M."""
    wide = width(w)
    points, rays, sums = np.zeros((2, 3, wide), kind), np.zeros((2, 3, wide), kind), np.zeros((2, 3, wide), kind)
    return points, rays, sums, np.zeros((10, wide), kind), np.zeros(wide, kind)[:w]


@njit(**ROW)
def _part(fixed, side, r):
    """Runs and codes of a row of cells."""
    cells = fixed[1]
    return cells[1][side][cells[0][side][r] : cells[0][side][r + 1]], cells[2][side]


@njit(**FORMULA)
def _samples(pair, c, d):
    """Rows of the samples at cells c to d, above and below."""
    i, j, top, bottom = EDGE + c, EDGE + d + 1, pair[0], pair[1]
    return (top[0, i:j], top[1, i:j], top[2, i:j]), (bottom[0, i:j], bottom[1, i:j], bottom[2, i:j])


@njit(**FORMULA)
def _corners(side, buffers, c, d):
    """Rows of four corners, of cells c to d."""
    i, j = EDGE + c, EDGE + d
    return buffers[side, i:j], buffers[1 - side, i:j], buffers[2 + side, i:j], buffers[3 - side, i:j]


@njit(**ROW)
def _celled(seeing, side, pitch, part, pair, sights, buffers):
    """Pulls (rows 0 to 3 of ``buffers``), thirds (4, 5) and seen areas (6 to 9) of a row of cells."""
    runs, codes = part
    for run in range(len(runs)):
        c, d, start = runs[run, 0], runs[run, 1], runs[run, 2]
        code = codes[start : start + d - c] if start >= 0 else codes[:0]
        if start == NONE:
            buffers[:, EDGE + c : EDGE + d] = 0
        elif side == 0:
            _run(0, seeing, pitch, code, c, d, pair, sights, buffers)
        else:
            _run(1, seeing, pitch, code, c, d, pair, sights, buffers)


@njit(**FORMULA)
def _run(side, seeing, pitch, code, c, d, pair, sights, buffers):
    points, rays, pulls = _samples(pair, c, d), _samples(sights, c, d), _corners(side, buffers, c, d)
    thirds, seen = (buffers[4, EDGE + c : EDGE + d], buffers[5, EDGE + c : EDGE + d]), _corners(side, buffers[6:], c, d)
    across, down = pitch
    if across != 0:
        depths, x, heights = (points[0][2], points[1][2]), rays[0][0], (rays[0][1][0], rays[1][1][0])
        if len(code) > 0:
            ray_rows.pinhole_cells(side, True, code, depths, x, heights, across, down, pulls, thirds)
        else:
            ray_rows.pinhole_cells(side, False, code, depths, x, heights, across, down, pulls, thirds)
        if seeing:
            ray_rows.pinhole_seen(side, depths, across, down, thirds, seen)
    else:
        if len(code) > 0:
            ray_rows.ray_cells(side, True, code, points, rays, pulls, thirds)
        else:
            ray_rows.ray_cells(side, False, code, points, rays, pulls, thirds)
        if seeing:
            ray_rows.seen_cells(side, points, rays, thirds, seen)
    ray_rows.border_cells(side, code, points, rays, pulls)


@njit(**ROW)
def _gathered(fresh, side, w, seeing, buffers, here, below):
    """What a row of cells gives to the samples of the rows above and below it."""
    gathered_row(fresh, buffers, here[PULL, :w], below[PULL, :w])
    gathered_thirds_row(fresh, side, buffers[4:6], here[MASS, :w], below[MASS, :w])
    if seeing:
        gathered_row(fresh, buffers[6:], here[SEEN, :w], below[SEEN, :w])


@njit(**ROW)
def _sped(kinds, exponents, ray, pace, r, here, inverse):
    """s pace / M |d|^2 of a row of samples."""
    i, j, w, number = EDGE, EDGE + len(inverse), len(inverse), type(exponents[0])
    x, y, z, mass = ray[0, i:j], ray[1, i:j], ray[2, i:j], here[MASS, :w]
    thirds = number(3 if kinds[2] == RING else 1)
    if len(pace) > 0:
        ray_rows.over_rays(True, thirds, x, y, z, mass, pace[r], inverse)
    else:
        ray_rows.over_rays(False, thirds, x, y, z, mass, mass, inverse)
    if kinds[1] != 0:
        ray_rows.lone(x, y, z, here[SEEN, :w])
        sped_row(kinds[1], exponents[1], number(LEAST), here[SEEN, :w], mass, inverse)


@njit(**ROW)
def _decaying(side, part, pair, upper, lower):
    """What the triangles of a row of cells decay by."""
    runs, codes = part
    for run in range(len(runs)):
        c, d, start = runs[run, 0], runs[run, 1], runs[run, 2]
        code, points = codes[start : start + d - c] if start >= 0 else codes[:0], _samples(pair, c, d)
        if start == NONE:
            upper[c:d], lower[c:d] = 0, 0
        elif side == 0:
            _decay(0, code, points, upper[c:d], lower[c:d])
        else:
            _decay(1, code, points, upper[c:d], lower[c:d])


@njit(**FORMULA)
def _decay(side, code, points, upper, lower):
    if len(code) > 0:
        ray_rows.decays(side, True, code, points, upper, lower)
    else:
        ray_rows.decays(side, False, code, points, upper, lower)


@njit(**ROW)
def _hurried(slowed, kinds, exponents, ray, pace, r, here, speed):
    """The factor of time of a row of samples: s, times the squared footprint where time is counted in those."""
    w, number = len(speed), type(exponents[0])
    speed[:] = 1
    if len(pace) > 0:
        speed[:] = pace[r]
    if kinds[2] == RING:
        speed /= number(3)
    if slowed:
        x, y, z = ray[0, EDGE : EDGE + w], ray[1, EDGE : EDGE + w], ray[2, EDGE : EDGE + w]
        ray_rows.lone(x, y, z, here[SEEN, :w])
        sped_row(kinds[1], exponents[1], number(LEAST), here[SEEN, :w], here[MASS, :w], speed)


@njit(**ROW)
def _foremost(side, bounds, above, below, most):
    """The greatest bound of a row of triangles times the factor of time at their corners."""
    n = len(most)
    p, q = slice(side, side + n), slice(1 - side, 1 - side + n)
    upper, lower = bounds[2 * side, :n], bounds[2 * side + 1, :n]
    ray_rows.foremost(upper, lower, above[p], above[q], below[p], below[q], most)
