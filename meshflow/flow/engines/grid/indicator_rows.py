"""The edge indicator of a row of samples with several coordinates: what it asks of their cells, and its power."""

import numpy as np
from numba import njit

from meshflow.flow.engines.grid import coupled
from meshflow.flow.engines.grid.cells import ALL, PLAIN
from meshflow.flow.engines.grid.compiled import EDGE, ROW
from meshflow.flow.engines.grid.coupled_rows import MASS, PART, RING, SEEN, TRUE, UU, UV, VORONOI, VV, WHOLE, triples
from meshflow.flow.engines.grid.sweep import counted_row, flattened_row, gathered_row, sped_row

__all__ = ["along", "indicated", "sped"]


@njit(**ROW)
def indicated(cell, kinds, weights, thirds, points, rays, buffers, counts, here, below):
    """What the edge indicator needs of a row of cells: flat areas, or the pulls of the coordinates that stay.

    :param cell: whether nothing was given below yet; the triangulation; samples of a row; geometry and the row; its runs and
        codes; whether the counts are those of the row above.
    """
    fresh, side, w, geometry, r, part, known = cell
    if kinds[4] == 1:
        if kinds[3] == 0:
            _seen(fresh, side, w, points, rays, thirds, buffers, here[SEEN, :w], below[SEEN, :w])
    elif kinds[3] == 0:
        if not known:
            counted_row(fresh, side, (0, w - 1, 0), part, buffers[4:6], counts, w)
    else:
        i, j, u, v, code = EDGE, EDGE + w - 1, weights[0], weights[1], _spread(part, w - 1)
        to_p, to_q, to_r, to_s = buffers[side], buffers[1 - side], buffers[2 + side], buffers[3 - side]
        buffers[:4] = 0
        for axis in range(2):
            # From P of the upper triangle the legs point right (left where the diagonal is backward) and down; from S, back.
            x, y, z = geometry[r, 5], geometry[r, 6], geometry[r + 1, 5]
            x, z, none = (-x if side else x), (z if side else -z), type(x)(0)
            upper, lower = ((x, none), (z, none)) if axis == 0 else ((none, y), (none, -y))
            coupled.still_corners(
                code, upper, lower, u[UU, i:j], u[VV, i:j], u[UV, i:j], v[UU, i:j], v[VV, i:j], v[UV, i:j],
                to_p[i:j], to_q[i:j], to_r[i:j], to_s[i:j],
            )  # fmt: skip
            gathered_row(fresh, buffers, here[PART + axis, :w], below[PART + axis, :w])


@njit(**ROW)
def _spread(part, columns):
    """The codes of a whole row of cells."""
    runs, codes = part
    code = np.zeros(columns, np.uint8)
    for run in range(len(runs)):
        c, d, at = runs[run, 0], runs[run, 1], runs[run, 2]
        if at >= 0:
            code[c:d] = codes[at : at + d - c]
        else:
            code[c:d] = PLAIN if at == ALL else 0
    return code


@njit(**ROW)
def _seen(fresh, side, w, points, rays, thirds, buffers, here, below):
    """Areas of triangles as their corners see them."""
    buffers[:4] = 0
    i, j = EDGE, EDGE + w - 1
    p, q, r, s = triples(side, w, points[0], points[1])
    at_p, at_q, at_r, at_s = triples(side, w, rays[0], rays[1])
    to_p, to_q, to_r, to_s = buffers[side, i:j], buffers[1 - side, i:j], buffers[2 + side, i:j], buffers[3 - side, i:j]
    coupled.seen(p, q, r, at_p, thirds[0, i:j], to_p)
    coupled.seen(p, q, r, at_q, thirds[0, i:j], to_q)
    coupled.seen(p, q, r, at_r, thirds[0, i:j], to_r)
    coupled.seen(s, r, q, at_s, thirds[1, i:j], to_s)
    coupled.seen(s, r, q, at_r, thirds[1, i:j], to_r)
    coupled.seen(s, r, q, at_q, thirds[1, i:j], to_q)
    gathered_row(fresh, buffers, here, below)


@njit(**ROW)
def along(spatial, w, here, ray):
    """The pull along the rays, in the place of the pull on x; its length and that of the whole pull in the last two rows."""
    if spatial == 0:
        return
    i, j = EDGE, EDGE + w
    x, y, z = ray[0, i:j], ray[1, i:j], ray[2, i:j]
    coupled.along(x, y, z, here[0, :w], here[1, :w], here[2, :w], here[3 + PART, :w], here[3 + WHOLE, :w])


@njit(**ROW)
def sped(k, kinds, exponents, geometry, r, counts, here, inverse):
    """The edge indicator to the power gamma."""
    inverse[:] = 1
    if kinds[1] == 0:
        return
    gamma, w = exponents[1], len(inverse)
    true = here[k + TRUE, :w] if kinds[2] == VORONOI else here[k + MASS, :w]
    if kinds[3] == 0:
        flat = here[k + SEEN, :w]
        if kinds[4] == 0:
            flattened_row(counts, geometry, r, flat)
        # A sample seen exactly edge-on has no footprint at all; it must not divide by zero where gamma < 0.
        sped_row(kinds[1], gamma, type(gamma)(1e-6 if kinds[4] == 1 else 0), flat, true, inverse)
        return
    part, whole = here[k + PART, :w], here[k + WHOLE, :w]
    if kinds[4] == 0:
        free2 = here[k + SEEN, :w]
        for q in range(k):
            if q == 0:
                coupled.summed(True, exponents[3], here[q, :w], free2)
            else:
                coupled.summed(False, exponents[3], here[q, :w], free2)
        coupled.projected(free2, part, whole)
    coupled.straight(exponents[4], type(gamma)(3 if kinds[2] == RING else 1), here[k + MASS, :w], part, whole)
    sped_row(kinds[1], gamma, exponents[2], part, whole, inverse)
