"""A band of rows of a grid with several coordinates: channels that are coupled, or points on their lines in space."""

from typing import Any

import numpy as np
from numba import njit
from numba.extending import overload

from meshflow.flow.engines.grid import coupled_rows as work
from meshflow.flow.engines.grid.compiled import ROW, SWEEP
from meshflow.flow.engines.grid.coupled_rows import MASS
from meshflow.flow.engines.grid.indicator_rows import along, indicated, sped
from meshflow.flow.engines.grid.patch_rows import patch_buffers, patched
from meshflow.flow.engines.grid.sweep import moved_row, stay_row, total

__all__ = ["coupled_measured", "coupled_swept"]

_OPTIONS: Any = ROW  # numba declares them as a dictionary of its own


@njit(**SWEEP)
def coupled_swept(rows, sheets, u, out, mix, fixed, lines, pace, kinds, exponents, taps, edges, inverses):
    """One step of the samples in a band, as :func:`.sweep.swept`, of k channels or along fibres.

    :param out: as u, or of no size where the weights shall be kept instead.
    :param lines: origins and directions of :class:`meshflow.surfaces.grid.Fibres`, two triples.
    :param pace: (h, w), factors of time, squared pixel footprints; of no size where there are none.
    :param kinds: 1 where the sharpness is not 1; four times gamma as :func:`stencil.power` takes it; the kind of mass; 1 for the
        projection indicator; 1 for fibres; 1 where triangles are missing.
    :param exponents: sharpness, gamma, floor, alpha^2, and the length below which a pull is rounding.
    :param taps: the Gaussian of the patches, from its middle outwards; of two dimensions and no
        size where lengths are those of single samples.
    :param edges: (4, h, w), zeros, where the weights of the edges to the right and downwards are kept, and those of the forward
        and backward diagonals; with ``inverses`` (h, w), s / M |d|^2. Of no size where they are not.
    """
    h, w, start = u.shape[1], u.shape[2], max(rows[0] - 1, 0)
    k, held = 3 if kinds[4] == 1 else len(u), fixed[3]
    points, rays, weights, thirds, joints, sums, buffers, counts, inverse = work.buffers_for(k, w, u.dtype)
    patches = patch_buffers(taps.ravel(), w, u.dtype)
    work.placed(u, start, lines, kinds[4], points[start % 2], rays[start % 2])
    for r in range(start, rows[1]):
        here, below = sums[r % 2], sums[1 - r % 2]
        pair, sights = (points[r % 2], points[1 - r % 2]), (rays[r % 2], rays[1 - r % 2])
        if r < h - 1:
            work.placed(u, r + 1, lines, kinds[4], pair[1], sights[1])
        for side in range(sheets[0], sheets[1]):
            if r < h - 1:
                cell = _cell(side, sheets, w, fixed, r, start)
                _measured(side, u, k, pair, kinds, exponents, taps, patches, fixed, r, weights, thirds)
                _given(cell, kinds, k, pair, sights, weights, thirds, joints[side], buffers, counts, here, below)
            else:
                work.pulled_level(w, k, pair[0], joints[side], here)
                counts[0], counts[1], counts[2] = counts[3], counts[4], 0
        if r >= rows[0]:
            along(kinds[4], w, here, sights[0])
            sped(k, kinds, exponents, fixed[0], r, counts, here, inverse)
            work.inverted(kinds, exponents, here[k + MASS, :w], sights[0], pace, r, inverse)
            if out.size == 0:
                work.kept(sheets, joints, r, edges)
                inverses[r] = inverse
            else:
                stay_row(held, r, 0, inverse)
                for q in range(len(u)):
                    moved_row(mix, q, u, here[q, :w], inverse, r, 0, w, out)


@njit(**SWEEP)
def coupled_measured(rows, sheets, u, fixed, lines, pace, kinds, exponents, taps):
    """The surface measured: parameters as of :func:`coupled_swept`.

    :returns: the area of the cells that begin in the band, and the greatest bound of their triangles times the factor of time
        s pace at their corners.
    """
    h, w, start = u.shape[1], u.shape[2], max(rows[0] - 1, 0)
    k = 3 if kinds[4] == 1 else len(u)
    points, rays, weights, thirds, joints, sums, buffers, counts, speed = work.buffers_for(k, w, u.dtype)
    bounds, speeds = np.zeros((2, 4, w)), np.zeros((2, w))
    area, fastest = 0.0, 0.0
    patches = patch_buffers(taps.ravel(), w, u.dtype)
    work.placed(u, start, lines, kinds[4], points[start % 2], rays[start % 2])
    for r in range(start, min(rows[1] + 1, h)):  # the last cells end at the first row of the next band
        here, below = sums[r % 2], sums[1 - r % 2]
        pair, sights = (points[r % 2], points[1 - r % 2]), (rays[r % 2], rays[1 - r % 2])
        if r < h - 1:
            work.placed(u, r + 1, lines, kinds[4], pair[1], sights[1])
        for side in range(sheets[0], sheets[1]):
            if r < h - 1:
                cell = _cell(side, sheets, w, fixed, r, start)
                _measured(side, u, k, pair, kinds, exponents, taps, patches, fixed, r, weights, thirds)
                _given(cell, kinds, k, pair, sights, weights, thirds, joints[side], buffers, counts, here, below)
                work.bounded(w, kinds[2], weights, thirds, bounds[r % 2, 2 * side : 2 * side + 2])
                area += total(thirds, w) if rows[0] <= r < rows[1] else 0.0
            else:
                work.pulled_level(w, k, pair[0], joints[side], here)
                counts[0], counts[1], counts[2] = counts[3], counts[4], 0
        along(kinds[4], w, here, sights[0])
        sped(k, kinds, exponents, fixed[0], r, counts, here, speed)
        work.hurried(pace, r, speed, speeds[r % 2])
        if r > rows[0]:
            for side in range(sheets[0], sheets[1]):
                part = bounds[1 - r % 2, 2 * side : 2 * side + 2]
                fastest = max(fastest, work.quickest(side, part, speeds[1 - r % 2], speeds[r % 2]))
    return area, fastest


@njit(**ROW)
def _cell(side, sheets, w, fixed, r, start):
    """What is known of a row of cells beside its coordinates, as :func:`indicated` takes it."""
    geometry, cells, same, _ = fixed
    part = (cells[1][side][cells[0][side][r] : cells[0][side][r + 1]], cells[2][side])
    return side == sheets[0], side, w, geometry, r, part, r - 1 > start and same[r] and same[r - 1]


def _measured(side, u, k, pair, kinds, exponents, taps, patches, fixed, r, weights, thirds):
    """Weights and thirds of a row of cells, of single samples or of patches."""
    if taps.ndim == 2:
        work.measured(side, u.shape[2], k, pair, kinds, exponents, fixed[0], r, weights, thirds)
    else:
        patched(side, r, u, fixed[1], kinds[5] == 1, taps, patches, kinds, exponents, fixed[0], weights, thirds)


@overload(_measured, jit_options=_OPTIONS)
def _measured_by(side, u, k, pair, kinds, exponents, taps, patches, fixed, r, weights, thirds):
    """The way is chosen by the type of the taps (two dimensions: none), so that only the one that is taken is compiled."""

    def single(side, u, k, pair, kinds, exponents, taps, patches, fixed, r, weights, thirds):
        work.measured(side, u.shape[2], k, pair, kinds, exponents, fixed[0], r, weights, thirds)

    def whole(side, u, k, pair, kinds, exponents, taps, patches, fixed, r, weights, thirds):
        patched(side, r, u, fixed[1], kinds[5] == 1, taps, patches, kinds, exponents, fixed[0], weights, thirds)

    return single if taps.ndim == 2 else whole


@njit(**ROW)
def _given(cell, kinds, k, pair, sights, weights, thirds, joints, buffers, counts, here, below):
    """Pulls, masses, and what the indicator asks of a row of cells, given to the samples of the rows above and below it."""
    fresh, side, w, _, _, part, _ = cell
    work.present(part, weights, thirds)
    work.pulled(fresh, side, w, k, pair, part, weights, joints, buffers, here, below)
    work.massed(fresh, side, w, kinds, weights, thirds, buffers, here[k:], below[k:])
    if kinds[1] != 0:
        indicated(cell, kinds, weights, thirds, pair, sights, buffers, counts, here[k:], below[k:])
