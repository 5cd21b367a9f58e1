"""Lengths measured in the space of patches: every sample carries its neighbourhood, and no patch is ever stored.

With a, b the differences of the channels along the legs of a triangle, the products a . a, b . b and a . b of all triangles of
its kind are filtered with a Gaussian before they enter |u|^2, |v|^2 and u . v. A mean of positive semidefinite forms is one, so
every triangle keeps a valid metric and the bound of the step holds. (Squared edge lengths filtered one by one break the triangle
inequality.) Where triangles are missing the mean is over those that are there.

A ring of rows, filtered along the row, is kept for each triangulation; the row that is asked for is their mean down the columns.
The leg along the row of a lower triangle is that of the upper one below it, and its leg along the column that of the upper one
beside it: where all triangles are there, away from the ends of rows and columns, their means are taken from those.
"""

import numpy as np
from numba import njit

from meshflow.flow.engines.grid import coupled
from meshflow.flow.engines.grid.cells import ALL, NONE
from meshflow.flow.engines.grid.compiled import EDGE, FORMULA, ROW, width

__all__ = ["patch_buffers", "patched", "patched_cells"]

# Rows of a ring: three products of the upper triangles, three of the lower ones, which of both are there.
UPPER, LOWER, PRESENT = 0, 3, 6
# The rows of one kind of triangle.
UU, VV, UV = range(3)


@njit(**ROW)
def patch_buffers(taps, w, kind):
    """The rings of both triangulations, rows to be filtered and then their means, rows of what the taps sum to, the next row of
    each ring, the mean |u|^2 of the row after the last one of each, and which row that is.

    What they sum to: along the row, with those down the columns, and one over that.
    """
    if len(taps) == 0:
        w = 0
    wide, rows = width(w), max(2 * len(taps), 1)
    ring, work = np.zeros((2, rows, 8, wide), kind), np.zeros((8, wide), kind)
    whole, next = np.ones((3, wide), kind), np.full(2, -1)
    if w > 0:
        work[0, EDGE : EDGE + w - 1] = 1
        _across(taps, work[0], w - 1, whole[0])
    return ring, work, whole, next, np.zeros((2, wide), kind), np.full(2, -1)


@njit(**ROW)
def patched(side, r, u, cells, gaps, taps, buffers, kinds, exponents, geometry, weights, thirds):
    """:func:`coupled_rows.measured` in the space of patches, for row r of cells.

    :param u: (k, h, w).
    :param cells: first, runs and codes of :class:`.cells.Cells`, each of both triangulations.
    :param gaps: whether triangles are missing.
    :param taps: the Gaussian, from its middle outwards.
    :param buffers: of :func:`patch_buffers`.
    """
    work = buffers[1]
    rows, w = u.shape[1] - 1, u.shape[2]
    _advanced(side, r, u, cells, gaps, taps, buffers)
    _means(side, r, rows, w, gaps, taps, buffers)
    sharp, q, scale, i, j = kinds[0], exponents[0], exponents[3], EDGE, EDGE + w - 1
    for lower in range(2):
        m, at = weights[lower], LOWER if lower else UPPER
        share, row = _share(side, r, rows, w, lower, gaps, taps, buffers), _base(geometry, r, lower)
        a, b, c = work[at + UU, i:j], work[at + VV, i:j], work[at + UV, i:j]
        coupled.averaged(sharp, q, scale, row, share, a, b, c, m[UU, i:j], m[VV, i:j], m[UV, i:j], thirds[lower, i:j])


@njit(**ROW)
def patched_cells(side, r, u, cells, geometry, patches, buffers, kinds, exponents, pulls, thirds):
    """Pulls and thirds of row r of cells of one channel, in the space of patches, as those of :mod:`.sweep`.

    :param patches: the taps; alpha^2; whether triangles are missing.
    :param kinds: four times q / 2 first, 2 where the sharpness is 1; ``exponents``: q / 2 first.
    """
    taps, scale, gaps = patches
    work = buffers[1]
    rows, w = u.shape[1] - 1, u.shape[2]
    _advanced(side, r, u, cells, gaps, taps, buffers)
    _means(side, r, rows, w, gaps, taps, buffers)
    upper = _share(side, r, rows, w, 0, gaps, taps, buffers)
    lower = _share(side, r, rows, w, 1, gaps, taps, buffers)
    runs, codes = cells[1][side][cells[0][side][r] : cells[0][side][r + 1]], cells[2][side]
    bases, q = (_base(geometry, r, 0), _base(geometry, r, 1)), exponents[0] + exponents[0]
    for run in range(len(runs)):
        c, d, at = runs[run, 0], runs[run, 1], runs[run, 2]
        if at == NONE:
            pulls[:, EDGE + c : EDGE + d] = 0
            thirds[:, EDGE + c : EDGE + d] = 0
            continue
        code, shares = codes[at : at + d - c] if at >= 0 else codes[:0], (upper[c:d], lower[c:d])
        if kinds[0] == 2:
            _run(0, q, scale, bases, shares, side, u[0, r], u[0, r + 1], c, d, code, work, pulls, thirds)
        elif q == type(q)(1.5):
            q = type(q)(1.5)  # known when this is compiled
            _run(1, q, scale, bases, shares, side, u[0, r], u[0, r + 1], c, d, code, work, pulls, thirds)
        else:
            _run(1, q, scale, bases, shares, side, u[0, r], u[0, r + 1], c, d, code, work, pulls, thirds)


@njit(**FORMULA)
def _run(sharp, q, scale, bases, shares, side, top, bottom, c, d, code, sums, pulls, thirds):
    i, j, n, at = c + side, c + 1 - side, d - c, slice(EDGE + c, EDGE + d)
    corners = top[i : i + n], top[j : j + n], bottom[i : i + n], bottom[j : j + n]
    to = pulls[side, at], pulls[1 - side, at], pulls[2 + side, at], pulls[3 - side, at]
    areas = thirds[0, at], thirds[1, at]
    upper = sums[UPPER + UU, at], sums[UPPER + VV, at], sums[UPPER + UV, at]
    lower = sums[LOWER + UU, at], sums[LOWER + VV, at], sums[LOWER + UV, at]
    if len(code) == 0:
        coupled.averaged_cells(sharp, q, scale, bases[0], bases[1], shares, upper, lower, corners, to, areas)
    else:
        coupled.averaged_coded_cells(
            sharp, q, scale, bases[0], bases[1], shares, upper, lower, code, corners, to, areas
        )


@njit(**FORMULA)
def _base(geometry, r, lower):
    """The row of :func:`coupled.over_grid` of the upper or the lower triangles of row r of cells."""
    x, y = geometry[r + lower, 5], geometry[r, 6]
    one = type(x)(1)
    return x * x, y * y, one / (x * x), one / (y * y)


@njit(**ROW)
def _advanced(side, r, u, cells, gaps, taps, buffers):
    """The ring of a triangulation up to what row r of cells asks for, and what the taps sum to there."""
    ring, work, whole, next, _, _ = buffers
    rows, n, far, depth = u.shape[1] - 1, u.shape[2] - 1, len(taps) - 1, ring.shape[1]
    if next[side] < 0:
        next[side] = max(r - far, 0)
    while next[side] <= min(r + far + 1, rows - 1):
        t = next[side]
        to = ring[side, t % depth]
        own = gaps or not _wide(n, far) or t < 2 * far or t >= rows - 1 - 2 * far
        _products(side, t, u, cells, gaps, own, 2 * far + 1, work)
        for i in range(8 if gaps else PRESENT):
            if own or i % 3 == UV or i < LOWER:
                _across(taps, work[i], n, to[i])
        if not own:
            for c in (0, n - far - 1):
                _across(taps, work[LOWER + VV, c:], far + 1, to[LOWER + VV, c:])
        next[side] = t + 1
    i, j, down = EDGE, EDGE + n, type(taps[0])(0)
    for d in range(-far, far + 1):
        if 0 <= r + d < rows:
            down += taps[abs(d)]
    share = whole[1, i:j]
    if share[0] != down * whole[0, i]:  # else that of the row above
        _scaled(down, whole[0, i:j], share)
        _inverted(share, whole[2, i:j])


@njit(**FORMULA)
def _wide(n, far):
    """Whether rows of n cells are long enough to have a middle."""
    return n > 4 * far + 2


@njit(**ROW)
def _means(side, r, rows, w, gaps, taps, buffers):
    """The sums of row r of cells, in the rows that were to be filtered."""
    ring, work, kept, kept_at, far, n = buffers[0][side], buffers[1], buffers[4][side], buffers[5], len(taps) - 1, w - 1
    if kept_at[side] == r:
        _copied(kept[EDGE : EDGE + n], work[UPPER + UU, EDGE : EDGE + n])
    else:
        _down(taps, ring, r, rows, UPPER + UU, n, work[UPPER + UU])
    _down(taps, ring, r, rows, UPPER + VV, n, work[UPPER + VV])
    _down(taps, ring, r, rows, UPPER + UV, n, work[UPPER + UV])
    _down(taps, ring, r, rows, LOWER + UV, n, work[LOWER + UV])
    if gaps or not _wide(n, far) or r < far or r + far + 1 >= rows:
        _down(taps, ring, r, rows, LOWER + UU, n, work[LOWER + UU])
        _down(taps, ring, r, rows, LOWER + VV, n, work[LOWER + VV])
        return
    _down(taps, ring, r + 1, rows, UPPER + UU, n, kept)
    kept_at[side] = r + 1
    _copied(kept[EDGE : EDGE + n], work[LOWER + UU, EDGE : EDGE + n])
    _copied(_shift(work[UPPER + VV], 1 - 2 * side, n), work[LOWER + VV, EDGE : EDGE + n])
    for c in (0, n - far - 1):
        _down(taps, ring[:, :, c:], r, rows, LOWER + VV, far + 1, work[LOWER + VV, c:])


@njit(**FORMULA)
def _copied(row, out):
    for j in range(len(row)):
        out[j] = row[j]


@njit(**ROW)
def _share(side, r, rows, w, lower, gaps, taps, buffers):
    """One over the sum of the weights of the upper or the lower triangles of row r of cells."""
    ring, work, whole = buffers[0], buffers[1], buffers[2]
    if not gaps:
        return whole[2, EDGE : EDGE + w - 1]
    _down(taps, ring[side], r, rows, PRESENT + lower, w - 1, work[PRESENT + lower])
    share = work[PRESENT + lower, EDGE : EDGE + w - 1]
    _inverted(share, share)
    return share


@njit(**ROW)
def _products(side, t, u, cells, gaps, own, ends, work):
    """The products of the legs of row t of cells, and which of its triangles are there.

    :param own: for all lower triangles, |u|^2 and |v|^2 too; else |v|^2 of so many at the ``ends`` of the row.
    """
    n = u.shape[2] - 1
    i, j, a, b = side, 1 - side, EDGE, EDGE + n
    for q in range(len(u)):
        top, bottom = u[q, t], u[q, t + 1]
        corners = top[i : i + n], top[j : j + n], bottom[i : i + n], bottom[j : j + n]
        first = q == 0
        if first and own:
            _legs(True, corners, work[0, a:b], work[1, a:b], work[2, a:b], work[3, a:b], work[4, a:b], work[5, a:b])
        elif own:
            _legs(False, corners, work[0, a:b], work[1, a:b], work[2, a:b], work[3, a:b], work[4, a:b], work[5, a:b])
        elif first:
            _few_legs(True, corners, work[0, a:b], work[1, a:b], work[2, a:b], work[5, a:b])
        else:
            _few_legs(False, corners, work[0, a:b], work[1, a:b], work[2, a:b], work[5, a:b])
        if not own:
            for c in (0, n - ends):
                to = work[LOWER + VV, a + c : a + c + ends]
                _squared(first, corners[1][c : c + ends], corners[3][c : c + ends], to)
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
def _few_legs(first, corners, uu, vv, uv, xy):
    p, q, r, s = corners
    none = type(p[0])(0)
    for j in range(len(uu)):
        a, b, c, d = q[j] - p[j], r[j] - p[j], r[j] - s[j], q[j] - s[j]
        uu[j] = (none if first else uu[j]) + a * a
        vv[j] = (none if first else vv[j]) + b * b
        uv[j] = (none if first else uv[j]) + a * b
        xy[j] = (none if first else xy[j]) + c * d


@njit(**FORMULA)
def _squared(first, q, s, yy):
    none = type(q[0])(0)
    for j in range(len(yy)):
        d = q[j] - s[j]
        yy[j] = (none if first else yy[j]) + d * d


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
