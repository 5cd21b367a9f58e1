"""Lengths measured in the space of patches: every sample carries its neighbourhood, and no patch is ever stored.

With a, b the differences of the channels along the legs of a triangle, the products a . a, b . b and a . b of all triangles of
its kind are filtered with a Gaussian before they enter |u|^2, |v|^2 and u . v. A mean of positive semidefinite forms is one, so
every triangle keeps a valid metric and the bound of the step holds. (Squared edge lengths filtered one by one break the triangle
inequality.) Where triangles are missing the mean is over those that are there.

A ring of rows, filtered along the row, is kept for each triangulation; the row that is asked for is their mean down the columns.
"""

import numpy as np
from numba import njit

from meshflow.grid import coupled
from meshflow.grid.cells import ALL
from meshflow.grid.compiled import EDGE, FORMULA, ROW, width
from meshflow.grid.coupled_rows import UU, UV, VV

__all__ = ["patch_buffers", "patched"]

# Rows of a ring: three products of the upper triangles, three of the lower ones, which of both are there.
UPPER, LOWER, PRESENT = 0, 3, 6


@njit(**ROW)
def patch_buffers(taps, w, kind):
    """The rings of both triangulations, rows to be filtered, rows of what the taps sum to, and the next row of each ring.

    What they sum to: along the row, with those down the columns, and one over that.
    """
    if len(taps) == 0:
        w = 0
    wide, rows = width(w), max(2 * len(taps) - 1, 1)
    ring, work = np.zeros((2, rows, 8, wide), kind), np.zeros((8, wide), kind)
    whole, next = np.ones((3, wide), kind), np.full(2, -1)
    if w > 0:
        work[0, EDGE : EDGE + w - 1] = 1
        _across(taps, work[0], w - 1, whole[0])
    return ring, work, whole, next


@njit(**ROW)
def patched(side, r, u, cells, gaps, taps, buffers, kinds, exponents, geometry, weights, thirds):
    """:func:`coupled_rows.measured` in the space of patches, for row r of cells.

    :param u: (k, h, w).
    :param cells: first, runs and codes of :class:`meshflow.grid.cells.Cells`, each of both triangulations.
    :param gaps: whether triangles are missing.
    :param taps: the Gaussian, from its middle outwards.
    :param buffers: of :func:`patch_buffers`.
    """
    ring, work, whole, next = buffers
    rows, w, far, depth = u.shape[1] - 1, u.shape[2], len(taps) - 1, ring.shape[1]
    if next[side] < 0:
        next[side] = max(r - far, 0)
    while next[side] <= min(r + far, rows - 1):
        t = next[side]
        _products(side, t, u, cells, gaps, work)
        for i in range(8 if gaps else PRESENT):
            _across(taps, work[i], w - 1, ring[side, t % depth, i])
        next[side] = t + 1
    sharp, q, scale, i, j = kinds[0], exponents[0], exponents[3], EDGE, EDGE + w - 1
    down = type(scale)(0)
    for d in range(-far, far + 1):
        if 0 <= r + d < rows:
            down += taps[abs(d)]
    share = whole[1, i:j]
    if share[0] != down * whole[0, i]:  # else that of the row above
        _scaled(down, whole[0, i:j], share)
        _inverted(share, whole[2, i:j])
    for lower in range(2):
        m, at = weights[lower], LOWER if lower else UPPER
        _down(taps, ring[side], r, rows, at + 0, w - 1, m[UU])
        _down(taps, ring[side], r, rows, at + 1, w - 1, m[VV])
        _down(taps, ring[side], r, rows, at + 2, w - 1, m[UV])
        share = whole[2, i:j]
        if gaps:
            _down(taps, ring[side], r, rows, PRESENT + lower, w - 1, work[0])
            share = work[0, i:j]
            _inverted(share, share)
        x, y, one = geometry[r + lower, 5], geometry[r, 6], type(scale)(1)
        row = (x * x, y * y, one / (x * x), one / (y * y))
        coupled.averaged(sharp, q, scale, row, share, m[UU, i:j], m[VV, i:j], m[UV, i:j], thirds[lower, i:j])


@njit(**ROW)
def _products(side, t, u, cells, gaps, work):
    """The products of the legs of row t of cells, and which of its triangles are there."""
    n = u.shape[2] - 1
    i, j, a, b = side, 1 - side, EDGE, EDGE + n
    for q in range(len(u)):
        top, bottom = u[q, t], u[q, t + 1]
        corners = top[i : i + n], top[j : j + n], bottom[i : i + n], bottom[j : j + n]
        if q == 0:
            _legs(True, corners, work[0, a:b], work[1, a:b], work[2, a:b], work[3, a:b], work[4, a:b], work[5, a:b])
        else:
            _legs(False, corners, work[0, a:b], work[1, a:b], work[2, a:b], work[3, a:b], work[4, a:b], work[5, a:b])
    if gaps:
        runs, codes = cells[1][side][cells[0][side][t] : cells[0][side][t + 1]], cells[2][side]
        for run in range(len(runs)):
            c, d, at = EDGE + runs[run, 0], EDGE + runs[run, 1], runs[run, 2]
            if at >= 0:
                _seen(codes[at : at + d - c], work[PRESENT, c:d], work[PRESENT + 1, c:d])
            else:
                work[PRESENT:, c:d] = 1 if at == ALL else 0
            if at != ALL:
                for p in range(PRESENT):
                    _kept(work[PRESENT + p // LOWER, c:d], work[p, c:d])


@njit(**FORMULA)
def _legs(first, corners, uu, vv, uv, xx, yy, xy):
    p, q, r, s = corners
    none = type(p[0])(0)
    for j in range(len(uu)):
        a, b, c, d = q[j] - p[j], r[j] - p[j], r[j] - s[j], q[j] - s[j]
        uu[j] = (none if first else uu[j]) + a * a
        vv[j] = (none if first else vv[j]) + b * b
        uv[j] = (none if first else uv[j]) + a * b
        xx[j] = (none if first else xx[j]) + c * c
        yy[j] = (none if first else yy[j]) + d * d
        xy[j] = (none if first else xy[j]) + c * d


@njit(**FORMULA)
def _seen(code, upper, lower):
    none, one = type(upper[0])(0), type(upper[0])(1)
    for j in range(len(code)):
        upper[j] = one if code[j] & 1 else none
        lower[j] = one if code[j] & 16 else none


@njit(**FORMULA)
def _kept(there, row):
    none = type(row[0])(0)
    for j in range(len(row)):
        row[j] = row[j] if there[j] > none else none


@njit(**FORMULA)
def _inverted(row, out):
    none, one = type(row[0])(0), type(row[0])(1)
    for j in range(len(row)):
        out[j] = one / row[j] if row[j] > none else none


@njit(**FORMULA)
def _scaled(by, row, out):
    for j in range(len(row)):
        out[j] = by * row[j]


@njit(**ROW)
def _across(taps, row, n, out):
    """A row of n cells filtered along itself; beside its ends there is nothing."""
    far, to = len(taps) - 1, out[EDGE : EDGE + n]
    if far == 1:
        _three(taps[0], taps[1], _shift(row, -1, n), _shift(row, 0, n), _shift(row, 1, n), to)
        return
    _five(taps[0], taps[1], taps[2], _shift(row, -2, n), _shift(row, -1, n), _shift(row, 0, n), _shift(row, 1, n),
          _shift(row, 2, n), to)  # fmt: skip
    for d in range(3, far, 2):
        _four(taps[d], taps[d + 1], _shift(row, -d - 1, n), _shift(row, -d, n), _shift(row, d, n), _shift(row, d + 1, n),
              to)  # fmt: skip
    if far % 2 == 1:
        _two(taps[far], _shift(row, -far, n), _shift(row, far, n), to)


@njit(**FORMULA)
def _shift(row, by, n):
    return row[EDGE + by : EDGE + by + n]


@njit(**ROW)
def _down(taps, ring, r, rows, which, n, out):
    """Row r of a ring filtered across its rows; above the first and below the last there is nothing."""
    far, to = len(taps) - 1, out[EDGE : EDGE + n]
    if r < far or r + far >= rows:
        _scaled(taps[0], _ringed(ring, r, which, n), to)
        for d in range(1, far + 1):
            if r - d >= 0:
                _one(taps[d], _ringed(ring, r - d, which, n), to)
            if r + d < rows:
                _one(taps[d], _ringed(ring, r + d, which, n), to)
        return
    if far == 1:
        _three(taps[0], taps[1], _ringed(ring, r - 1, which, n), _ringed(ring, r, which, n), _ringed(ring, r + 1, which, n),
               to)  # fmt: skip
        return
    _five(taps[0], taps[1], taps[2], _ringed(ring, r - 2, which, n), _ringed(ring, r - 1, which, n),
          _ringed(ring, r, which, n), _ringed(ring, r + 1, which, n), _ringed(ring, r + 2, which, n), to)  # fmt: skip
    for d in range(3, far, 2):
        _four(taps[d], taps[d + 1], _ringed(ring, r - d - 1, which, n), _ringed(ring, r - d, which, n),
              _ringed(ring, r + d, which, n), _ringed(ring, r + d + 1, which, n), to)  # fmt: skip
    if far % 2 == 1:
        _two(taps[far], _ringed(ring, r - far, which, n), _ringed(ring, r + far, which, n), to)


@njit(**FORMULA)
def _ringed(ring, r, which, n):
    return ring[r % len(ring), which, EDGE : EDGE + n]


@njit(**FORMULA)
def _three(k, m, a, b, c, out):
    for j in range(len(out)):
        out[j] = k * b[j] + m * (a[j] + c[j])


@njit(**FORMULA)
def _five(k, m, n, a, b, c, d, e, out):
    for j in range(len(out)):
        out[j] = k * c[j] + m * (b[j] + d[j]) + n * (a[j] + e[j])


@njit(**FORMULA)
def _four(k, m, a, b, c, d, out):
    for j in range(len(out)):
        out[j] += k * (b[j] + c[j]) + m * (a[j] + d[j])


@njit(**FORMULA)
def _two(k, a, b, out):
    for j in range(len(out)):
        out[j] += k * (a[j] + b[j])


@njit(**FORMULA)
def _one(k, a, out):
    for j in range(len(out)):
        out[j] += k * a[j]
