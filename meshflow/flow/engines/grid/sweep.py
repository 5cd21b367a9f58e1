"""A band of rows of a grid with one channel: down the rows of cells, each cell once, into the rows of samples they touch."""

from typing import Any

import numpy as np
from numba import njit
from numba.extending import overload

from meshflow.flow.engines.grid import stencil
from meshflow.flow.engines.grid.cells import ALL, NONE
from meshflow.flow.engines.grid.compiled import EDGE, FORMULA, ROW, SWEEP, width
from meshflow.flow.engines.grid.patch_rows import patch_buffers, patched_cells

__all__ = [
    "beside",
    "counted_row",
    "flattened_row",
    "gathered_row",
    "gathered_thirds_row",
    "moved_row",
    "sped_row",
    "stay_row",
    "swept",
    "total",
]

_OPTIONS: Any = ROW  # numba declares them as a dictionary of its own


@njit(**SWEEP)
def swept(rows, columns, sheets, u, out, mix, fixed, kinds, exponents, patches):
    """One step of the samples in a band.

    :param rows: the band, from the first row to the one after the last; ``columns`` likewise.
    :param sheets: the triangulations to take together, likewise: 0 forward, 1 backward.
    :param u: (1, h, w); ``out`` likewise, or of no size where nothing shall move.
    :param mix: of :func:`stencil.blended`: keep, dt, one, two, three; whether there is a second term; a, b, drift (1, h, w).
    :param fixed: (h, 7), what :func:`stencil.expansion` and :func:`coupled.over_grid` ask of a triangle with a leg in each
        row; first, runs and codes of :class:`.cells.Cells`, each of both triangulations; (h - 1,), rows of cells
        that are like the one above them; (h, w) of uint8, samples that stay, or of no size.
    :param kinds: four times q / 2 and gamma as :func:`stencil.power` takes them; 3 where the mass is the whole ring, else 1.
    :param exponents: q / 2 and gamma.
    :param patches: of :func:`.patch_rows.patched_cells`; taps of two dimensions and no size where lengths are those
        of single samples. With patches all columns are taken.
    :returns: the area of the cells below the band's rows, and the greatest s M_flat / M; only where ``out`` has no size.
    """
    h, w, left, right = u.shape[1], u.shape[2], columns[0], columns[1]
    geometry, cells, same, held = fixed
    # Cell c stands at EDGE + c - left; those that are not there stay zero.
    n, wide, where = right - left, width(right - left), (max(left - 1, 0), min(right, w - 1), left)
    pulls, thirds, there = np.zeros((4, wide), u.dtype), np.zeros((2, wide), u.dtype), np.zeros((2, wide), u.dtype)
    sums, counts, kept = np.zeros((4, wide), u.dtype), np.zeros((5, wide), u.dtype), np.zeros((2, wide), u.dtype)
    around = patch_buffers(patches[0].ravel(), u.shape[2], u.dtype)
    flat, inverse, measuring, start = kept[0, :n], kept[1, :n], out.size == 0, max(rows[0] - 1, 0)
    area, fastest = 0.0, 0.0
    for r in range(start, rows[1]):
        pull, mass = sums[r % 2, :n], sums[2 + r % 2, :n]
        # Flat masses are counted again only where the cells are others than in the row above.
        counting = kinds[1] != 0 and not (r - 1 > start and r < h - 1 and same[r] and same[r - 1])
        for side in range(sheets[0], sheets[1] if r < h - 1 else sheets[0]):
            fresh, part = side == sheets[0], (cells[1][side][cells[0][side][r] : cells[0][side][r + 1]], cells[2][side])
            _celled(kinds, exponents, side, u, where, part, cells, geometry, r, patches, around, pulls, thirds)
            gathered_row(fresh, pulls, pull, sums[1 - r % 2, :n])
            if measuring or not _light(kinds):
                gathered_thirds_row(fresh, side, thirds, mass, sums[3 - r % 2, :n])
            if counting:
                counted_row(fresh, side, where, part, there, counts, n)
            if measuring and r >= rows[0]:
                area += total(thirds, n)
        if r == h - 1:
            counts[0], counts[1], counts[2] = counts[3], counts[4], 0
        if r >= rows[0]:
            # Where s / M is one over a flat mass like that of the row above, it stands already.
            if counting or measuring or not _light(kinds) or len(held) > 0 or not _level(geometry, r):
                if kinds[1] != 0:
                    flattened_row(counts, geometry, r, flat)
                _inverted(_light(kinds) and not measuring, kinds, exponents[1], mass, flat, inverse)
            if measuring:
                fastest = max(fastest, greatest(inverse, flat))
            else:
                stay_row(held, r, left, inverse)
                moved_row(mix, 0, u, pull, inverse, r, left, right, out)
    return area, fastest


@njit(**FORMULA)
def _level(geometry, r):
    """Whether the triangles around row r are as large as those around the row above it."""
    third = geometry[r, 4]
    return (
        third == geometry[r - 1, 4]
        and third == geometry[max(r - 2, 0), 4]
        and third == geometry[min(r + 1, len(geometry) - 1), 4]
    )


@njit(**FORMULA)
def _light(kinds):
    """Whether s / M is one over the flat mass: gamma = -1, and the barycentric mass."""
    return kinds[1] == -4 and kinds[2] == 1


@njit(**FORMULA)
def _row(geometry, r):
    return geometry[r, 0], geometry[r, 1], geometry[r, 2], geometry[r, 3], geometry[r, 4]


@njit(**ROW)
def _cells(quarters, half, side, top, bottom, where, part, geometry, r, pulls, thirds):
    """The pulls and thirds of row r of cells, each run with the exponent as a constant."""
    begin, end, left = where
    runs, codes = part
    upper, lower = _row(geometry, r), _row(geometry, r + 1)
    for run in range(len(runs)):
        c, d, at = max(runs[run, 0], begin), min(runs[run, 1], end), runs[run, 2]
        if c < d and at == NONE:
            pulls[:, EDGE + c - left : EDGE + d - left] = 0
            thirds[:, EDGE + c - left : EDGE + d - left] = 0
        elif c < d:
            code = codes[at + c - runs[run, 0] : at + d - runs[run, 0]] if at >= 0 else codes[:0]
            # P stands on the left of the cell where the diagonal is forward, else on its right.
            i, j, n = c + side, c + 1 - side, d - c
            p, q, r, s = top[i : i + n], top[j : j + n], bottom[i : i + n], bottom[j : j + n]
            i, j = EDGE + c - left, EDGE + d - left
            to_p, to_q, to_r, to_s = pulls[side, i:j], pulls[1 - side, i:j], pulls[2 + side, i:j], pulls[3 - side, i:j]
            t, v = thirds[0, i:j], thirds[1, i:j]
            if quarters == 2:
                _run(2, half, code, p, q, r, s, upper, lower, to_p, to_q, to_r, to_s, t, v)
            elif quarters == 3:
                _run(3, half, code, p, q, r, s, upper, lower, to_p, to_q, to_r, to_s, t, v)
            elif quarters == 4:
                _run(4, half, code, p, q, r, s, upper, lower, to_p, to_q, to_r, to_s, t, v)
            else:
                _run(99, half, code, p, q, r, s, upper, lower, to_p, to_q, to_r, to_s, t, v)


def _celled(kinds, exponents, side, u, where, part, cells, geometry, r, patches, around, pulls, thirds):
    """The pulls and thirds of row r of cells, of single samples or of patches."""
    if patches[0].ndim == 2:
        _cells(kinds[0], exponents[0], side, u[0, r], u[0, r + 1], where, part, geometry, r, pulls, thirds)
    else:
        patched_cells(side, r, u, cells, geometry, patches, around, kinds, exponents, pulls, thirds)


@overload(_celled, jit_options=_OPTIONS)
def _celled_by(kinds, exponents, side, u, where, part, cells, geometry, r, patches, around, pulls, thirds):
    """The way is chosen by the type of the taps, so that only the one that is taken is compiled."""

    def single(kinds, exponents, side, u, where, part, cells, geometry, r, patches, around, pulls, thirds):
        _cells(kinds[0], exponents[0], side, u[0, r], u[0, r + 1], where, part, geometry, r, pulls, thirds)

    def whole(kinds, exponents, side, u, where, part, cells, geometry, r, patches, around, pulls, thirds):
        patched_cells(side, r, u, cells, geometry, patches, around, kinds, exponents, pulls, thirds)

    return single if patches[0].ndim == 2 else whole


@njit(**FORMULA)
def _run(quarters, half, code, p, q, r, s, upper, lower, to_p, to_q, to_r, to_s, t, v):
    if len(code) == 0:
        stencil.cells(quarters, half, p, q, r, s, upper, lower, to_p, to_q, to_r, to_s, t, v)
    else:
        stencil.coded_cells(quarters, half, code, p, q, r, s, upper, lower, to_p, to_q, to_r, to_s, t, v)


@njit(**ROW)
def counted_row(fresh, side, where, part, there, counts, n):
    """The triangles of a row of cells counted at the n samples they touch."""
    begin, end, left = where
    runs, codes = part
    for run in range(len(runs)):
        c, d, at = max(runs[run, 0], begin), min(runs[run, 1], end), runs[run, 2]
        if c < d:
            upper, lower = there[0, EDGE + c - left : EDGE + d - left], there[1, EDGE + c - left : EDGE + d - left]
            if at >= 0:
                stencil.counted_cells(codes[at + c - runs[run, 0] : at + d - runs[run, 0]], upper, lower)
            else:
                upper[:] = 1 if at == ALL else 0
                lower[:] = 1 if at == ALL else 0
    p, q = beside(side, n)
    u, v, x, y = there[0, p], there[1, p], there[0, q], there[1, q]
    a, b, c, d, e = counts[0, :n], counts[1, :n], counts[2, :n], counts[3, :n], counts[4, :n]
    if fresh:
        stencil.counted(True, u, v, x, y, a, b, c, d, e)
    else:
        stencil.counted(False, u, v, x, y, a, b, c, d, e)


@njit(**ROW)
def flattened_row(counts, geometry, r, flat):
    """The flat mass of a row of samples."""
    last, next, n = geometry[max(r - 1, 0), 4], geometry[min(r + 1, len(geometry) - 1), 4], len(flat)
    stencil.flattened(counts[0, :n], counts[1, :n], counts[2, :n], last, geometry[r, 4], next, flat)


@njit(**FORMULA)
def beside(side, n):
    """Where the cells stand of which n samples are P, and those of which they are Q: the cells on their right and on their left,
    and the other way round where the diagonal is backward.
    """
    return slice(EDGE - side, EDGE - side + n), slice(EDGE - 1 + side, EDGE - 1 + side + n)


@njit(**ROW)
def gathered_row(fresh, pulls, here, below):
    """The pulls of a row of cells, given to the samples of the rows above and below it."""
    p, q = beside(0, len(here))
    if fresh:
        stencil.gathered(True, pulls[0, p], pulls[1, q], pulls[2, p], pulls[3, q], here, below)
    else:
        stencil.gathered(False, pulls[0, p], pulls[1, q], pulls[2, p], pulls[3, q], here, below)


@njit(**ROW)
def gathered_thirds_row(fresh, side, thirds, here, below):
    """The thirds of area of a row of cells, given likewise."""
    p, q = beside(side, len(here))
    if fresh:
        stencil.gathered_thirds(True, thirds[0, p], thirds[1, p], thirds[0, q], thirds[1, q], here, below)
    else:
        stencil.gathered_thirds(False, thirds[0, p], thirds[1, p], thirds[0, q], thirds[1, q], here, below)


@njit(**ROW)
def _inverted(light, kinds, gamma, mass, flat, inverse):
    """s / M of a row of samples."""
    if light:
        stencil.inverse_mass(type(gamma)(1), flat, inverse)
        return
    stencil.inverse_mass(type(gamma)(kinds[2]), mass, inverse)
    if kinds[1] != 0:
        sped_row(kinds[1], gamma, type(gamma)(0), flat, mass, inverse)


@njit(**ROW)
def sped_row(quarters, gamma, least, part, whole, out):
    """:func:`stencil.sped` with the exponent as a constant."""
    if quarters == -4:
        stencil.sped(-4, gamma, least, part, whole, out)
    elif quarters == -2:
        stencil.sped(-2, gamma, least, part, whole, out)
    elif quarters == 4:
        stencil.sped(4, gamma, least, part, whole, out)
    elif quarters == -8:
        stencil.sped(-8, gamma, least, part, whole, out)
    else:
        stencil.sped(99, gamma, least, part, whole, out)


@njit(**ROW)
def stay_row(held, r, left, inverse):
    """No motion where a sample of row r is held."""
    if len(held) > 0:
        row = held[r, left : left + len(inverse)]
        for j in range(len(inverse)):
            inverse[j] = type(inverse[j])(0) if row[j] else inverse[j]


@njit(**ROW)
def moved_row(mix, q, u, pull, inverse, r, left, right, out):
    """Channel q of a row of samples, moved."""
    blend, second, others = mix
    here, there = u[q, r, left:right], out[q, r, left:right]
    a, b, drift = others[0][q, r, left:right], others[1][q, r, left:right], others[2][q, r, left:right]
    keep, dt, one, two, three = blend[0], blend[1], blend[2], blend[3], blend[4]
    if second:
        stencil.blended(True, keep, dt, one, two, three, here, pull, inverse, a, b, drift, there)
    else:
        stencil.blended(False, keep, dt, one, two, three, here, pull, inverse, a, b, drift, there)


@njit(**ROW)
def total(thirds, n):
    """Area of the triangles whose thirds these are, summed in double precision."""
    area = 0.0
    for i in range(2):
        for j in range(EDGE, EDGE + n):
            area += thirds[i, j]
    return 3.0 * area


@njit(**ROW)
def greatest(inverse, flat):
    greatest = 0.0
    for j in range(len(inverse)):
        greatest = max(greatest, float(inverse[j] * flat[j]))
    return greatest
