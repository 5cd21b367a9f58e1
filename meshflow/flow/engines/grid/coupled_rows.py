"""The work on one row with several coordinates: which loops of :mod:`.coupled`, on which rows."""

import numpy as np
from numba import njit

from meshflow.flow.engines.grid import coupled, stencil
from meshflow.flow.engines.grid.cells import NONE
from meshflow.flow.engines.grid.compiled import EDGE, ROW, width
from meshflow.flow.engines.grid.sweep import beside, gathered_row, gathered_thirds_row
from meshflow.geometry import triangle

__all__ = [
    "MASS",
    "PART",
    "RING",
    "SEEN",
    "TRUE",
    "UU",
    "UV",
    "VORONOI",
    "VV",
    "WHOLE",
    "bounded",
    "buffers_for",
    "hurried",
    "inverted",
    "kept",
    "massed",
    "measured",
    "placed",
    "present",
    "pulled",
    "pulled_level",
    "quickest",
    "triples",
]

# The rows that are kept of each kind of triangle, upper and lower, and of each triangulation.
UU, VV, UV, SQUARES = range(4)
LEVEL, ONWARD, SLANT, UPRIGHT = range(4)
VORONOI, RING = 1, 2
# Rows of sums after those of the k pulls.
MASS, TRUE, SEEN, PART, WHOLE = range(5)


@njit(**ROW)
def buffers_for(k, w, kind):
    """Rows for a band: points and rays of two rows of samples; weights and thirds of the upper and the lower triangles; the edges
    of both triangulations; the sums of two rows of samples; corners, counts, s / M.
    """
    wide = width(w)
    points, rays, sums = (
        np.zeros((2, max(k, 3), wide), kind),
        np.zeros((2, 3, wide), kind),
        np.zeros((2, k + 5, wide), kind),
    )
    weights, thirds, joints = np.zeros((2, 4, wide), kind), np.zeros((2, wide), kind), np.zeros((2, 4, wide), kind)
    buffers, counts, inverse = np.zeros((6, wide), kind), np.zeros((5, wide), kind), np.zeros(wide, kind)[:w]
    return points, rays, weights, thirds, joints, sums, buffers, counts, inverse


@njit(**ROW)
def placed(u, r, lines, spatial, points, rays):
    """The coordinates of a row of samples, and the directions of their lines; what is not there stays zero."""
    w = u.shape[2]
    if spatial == 0:
        for q in range(len(u)):
            _copied(u[q, r], points[q, EDGE : EDGE + w])
        return
    for c in range(3):
        origin, direction = lines[0][c], lines[1][c]
        o, d = origin[r if len(origin) > 1 else 0], direction[r if len(direction) > 1 else 0]
        ray = rays[c, EDGE : EDGE + w]
        if len(d) > 1:
            _copied(d, ray)
        else:
            ray[:] = d[0]
        if len(o) > 1:
            _reached(u[0, r], o, ray, points[c, EDGE : EDGE + w])
        else:
            _reached_from(u[0, r], o[0], ray, points[c, EDGE : EDGE + w])


@njit(**ROW)
def _copied(row, to):
    for j in range(len(row)):
        to[j] = row[j]


@njit(**ROW)
def _reached(u, origin, ray, to):
    for j in range(len(u)):
        to[j] = origin[j] + u[j] * ray[j]


@njit(**ROW)
def _reached_from(u, origin, ray, to):
    for j in range(len(u)):
        to[j] = origin + u[j] * ray[j]


@njit(**ROW)
def _corners(side, w, top, bottom, q):
    """Coordinate q at P, Q, R, S of a row of cells."""
    # P stands on the left of the cell where the diagonal is forward, else on its right.
    i, j, n = EDGE + side, EDGE + 1 - side, w - 1
    return top[q, i : i + n], top[q, j : j + n], bottom[q, i : i + n], bottom[q, j : j + n]


@njit(**ROW)
def triples(side, w, top, bottom):
    """Three coordinates at P, Q, R, S each."""
    x, y, z = _corners(side, w, top, bottom, 0), _corners(side, w, top, bottom, 1), _corners(side, w, top, bottom, 2)
    return (x[0], y[0], z[0]), (x[1], y[1], z[1]), (x[2], y[2], z[2]), (x[3], y[3], z[3])


@njit(**ROW)
def measured(side, w, k, pair, kinds, exponents, geometry, r, weights, thirds):
    """Weights and thirds of area of the triangles of row r of cells; ``pair``: the coordinates of the rows above and below."""
    top, bottom = pair
    sharp, q, scale, i, j = kinds[0], exponents[0], exponents[3], EDGE, EDGE + w - 1
    x, y, z = geometry[r, 5], geometry[r, 6], geometry[r + 1, 5]
    one = type(x)(1)
    above, below = (x * x, y * y, one / (x * x), one / (y * y)), (z * z, y * y, one / (z * z), one / (y * y))
    u, v = weights[0], weights[1]
    if k <= 3:
        a, b, c, d = triples(side, w, top, bottom)
        uu, vv, uv, third = u[UU, i:j], u[VV, i:j], u[UV, i:j], thirds[0, i:j]
        xx, yy, xy, other = v[UU, i:j], v[VV, i:j], v[UV, i:j], thirds[1, i:j]
        if kinds[4] == 1:
            coupled.measured_three(True, 0, q, scale, above, below, a, b, c, d, uu, vv, uv, third, xx, yy, xy, other)
        elif sharp == 0:
            coupled.measured_three(False, 0, q, scale, above, below, a, b, c, d, uu, vv, uv, third, xx, yy, xy, other)
        elif q == type(q)(1.5):
            q = type(q)(1.5)  # known when this is compiled
            coupled.measured_three(False, 1, q, scale, above, below, a, b, c, d, uu, vv, uv, third, xx, yy, xy, other)
        elif q == type(q)(2):
            q = type(q)(2)
            coupled.measured_three(False, 1, q, scale, above, below, a, b, c, d, uu, vv, uv, third, xx, yy, xy, other)
        else:
            coupled.measured_three(False, 1, q, scale, above, below, a, b, c, d, uu, vv, uv, third, xx, yy, xy, other)
        return
    for lower in range(2):
        u = weights[lower]
        _summed(side, lower, w, k, top, bottom, u)
        row = below if lower else above
        coupled.measured(sharp, q, scale, row, u[UU, i:j], u[VV, i:j], u[UV, i:j], u[SQUARES, i:j], thirds[lower, i:j])


@njit(**ROW)
def _summed(side, lower, w, k, top, bottom, u):
    """Products of the legs and squared minors of any number of coordinates."""
    i, j = EDGE, EDGE + w - 1
    u[:] = 0
    for q in range(k):
        p, o, r, s = _corners(side, w, top, bottom, q)
        p, o, r = (s, r, o) if lower else (p, o, r)
        coupled.legs(p, o, r, u[UU, i:j], u[VV, i:j], u[UV, i:j])
        for e in range(q):
            a, b, c, d = _corners(side, w, top, bottom, e)
            a, b, c = (d, c, b) if lower else (a, b, c)
            coupled.minors(a, b, c, p, o, r, u[SQUARES, i:j])


@njit(**ROW)
def present(part, weights, thirds):
    """Nothing where a triangle is not there."""
    runs, codes = part
    for run in range(len(runs)):
        c, d, at = EDGE + runs[run, 0], EDGE + runs[run, 1], runs[run, 2]
        if at == NONE:
            weights[:, :, c:d] = 0
            thirds[:, c:d] = 0
        elif at >= 0:
            code = codes[at : at + d - c]
            for lower in range(2):
                u = weights[lower]
                coupled.present(code, 16 if lower else 1, u[UU, c:d], u[VV, c:d], u[UV, c:d], thirds[lower, c:d])


@njit(**ROW)
def pulled(fresh, side, w, k, pair, part, weights, joints, buffers, here, below):
    """The pulls of a row of cells on each coordinate, given to the samples they touch."""
    top, bottom = pair
    i, j, u, v = EDGE, EDGE + w - 1, weights[0], weights[1]
    coupled.edges(
        u[VV, i:j], u[UV, i:j], v[VV, i:j], v[UV, i:j], joints[LEVEL, i:j], joints[ONWARD, i:j], joints[SLANT, i:j]
    )
    near, far = beside(side, w)
    coupled.upright(u[UU, near], u[UV, near], v[UU, far], v[UV, far], joints[UPRIGHT, :w])
    right, left = beside(0, w)
    here_at, lefter, righter = slice(EDGE, EDGE + w), slice(EDGE - 1, EDGE - 1 + w), slice(EDGE + 1, EDGE + 1 + w)
    t_far, b_far = (righter, lefter) if side == 0 else (lefter, righter)
    a, b, c, d, e = (
        joints[LEVEL, left],
        joints[LEVEL, right],
        joints[UPRIGHT, :w],
        joints[SLANT, far],
        joints[SLANT, near],
    )
    for q in range(k):
        t, g = top[q], bottom[q]
        if fresh:
            coupled.pulled(
                True,
                a,
                b,
                c,
                d,
                e,
                t[here_at],
                t[lefter],
                t[righter],
                t[t_far],
                g[here_at],
                g[b_far],
                here[q, :w],
                below[q, :w],
            )
        else:
            coupled.pulled(
                False,
                a,
                b,
                c,
                d,
                e,
                t[here_at],
                t[lefter],
                t[righter],
                t[t_far],
                g[here_at],
                g[b_far],
                here[q, :w],
                below[q, :w],
            )
    _bordered(side, w, k, top, bottom, part, weights, buffers, here, below)


@njit(**ROW)
def _bordered(side, w, k, top, bottom, part, weights, buffers, here, below):
    """The pull of the conormals of borders taken out."""
    runs, codes = part
    u, v = weights[0], weights[1]
    for run in range(len(runs)):
        c, d, at = runs[run, 0], runs[run, 1], runs[run, 2]
        if at < 0 or not _any_border(codes[at : at + d - c]):
            continue
        i, j = EDGE + c, EDGE + d
        buffers[:4, i - 1] = 0
        buffers[:4, j] = 0
        to_p, to_q, to_r, to_s = buffers[side], buffers[1 - side], buffers[2 + side], buffers[3 - side]
        for q in range(k):
            p, o, r, s = _corners(side, w, top, bottom, q)
            coupled.bordered_corners(
                codes[at : at + d - c], p[c:d], o[c:d], r[c:d], s[c:d], u[UU, i:j], u[VV, i:j], u[UV, i:j],
                v[UU, i:j], v[VV, i:j], v[UV, i:j], to_p[i:j], to_q[i:j], to_r[i:j], to_s[i:j],
            )  # fmt: skip
            stencil.gathered(
                False, buffers[0, i : j + 1], buffers[1, i - 1 : j], buffers[2, i : j + 1], buffers[3, i - 1 : j],
                here[q, c : d + 1], below[q, c : d + 1],
            )  # fmt: skip


@njit(**ROW)
def _any_border(code):
    """Whether a cell has an edge that is a border."""
    for j in range(len(code)):  # noqa: SIM110
        if code[j] & 238:
            return True
    return False


@njit(**ROW)
def pulled_level(w, k, top, joints, here):
    """The pulls along the last row of samples."""
    right, left = beside(0, w)
    at, lefter, righter = slice(EDGE, EDGE + w), slice(EDGE - 1, EDGE - 1 + w), slice(EDGE + 1, EDGE + 1 + w)
    for q in range(k):
        t = top[q]
        coupled.pulled_level(joints[ONWARD, left], joints[ONWARD, right], t[at], t[lefter], t[righter], here[q, :w])


@njit(**ROW)
def kept(sheets, joints, r, edges):
    """The weights of the edges that begin in a row of samples."""
    last, w = r == edges.shape[1] - 1, edges.shape[2]
    for side in range(sheets[0], sheets[1]):
        edges[0, r] += joints[side, ONWARD if last else LEVEL, EDGE : EDGE + w]
        if not last:
            edges[1, r] += joints[side, UPRIGHT, :w]
            edges[2 + side, r] = joints[side, SLANT, EDGE : EDGE + w]


@njit(**ROW)
def massed(fresh, side, w, kinds, weights, thirds, buffers, here, below):
    """The masses of the samples of a row of cells; thirds of areas go to the row after it where the mass is not made of them."""
    if kinds[2] != VORONOI:
        gathered_thirds_row(fresh, side, thirds, here[MASS, :w], below[MASS, :w])
        return
    buffers[:4] = 0
    i, j = EDGE, EDGE + w - 1
    for lower in range(2):
        u, (p, q, r) = weights[lower], _places(side, lower)
        coupled.shares(
            VORONOI,
            u[UU, i:j],
            u[VV, i:j],
            u[UV, i:j],
            thirds[lower, i:j],
            buffers[p, i:j],
            buffers[q, i:j],
            buffers[r, i:j],
        )
    gathered_row(fresh, buffers, here[MASS, :w], below[MASS, :w])
    gathered_thirds_row(fresh, side, thirds, here[TRUE, :w], below[TRUE, :w])


@njit(**ROW)
def _places(side, lower):
    """Which of the rows for the four corners of a cell are those of P, Q, R of a triangle."""
    if lower:
        return 3 - side, 2 + side, 1 - side
    return side, 1 - side, 2 + side


@njit(**ROW)
def inverted(kinds, exponents, mass, ray, pace, r, inverse):
    """s / M |d|^2 of a row of samples, from s."""
    coupled.over_mass(type(exponents[0])(3 if kinds[2] == RING else 1), mass, inverse)
    if kinds[4] == 1:
        i, j = EDGE, EDGE + len(inverse)
        coupled.shortened(ray[0, i:j], ray[1, i:j], ray[2, i:j], inverse)
    if len(pace) > 0:
        coupled.paced(pace[r], inverse)


@njit(**ROW)
def bounded(w, kind, weights, thirds, bounds):
    """:func:`meshflow.geometry.triangle.bound` (2, w - 1) of the triangles of a row of cells; the last number stays zero."""
    for lower in range(2):
        u = weights[lower]
        for c in range(w - 1):
            uu, vv, uv, area = u[UU, EDGE + c], u[VV, EDGE + c], u[UV, EDGE + c], 3.0 * thirds[lower, EDGE + c]
            a, b, d = 2.0 * uv, 2.0 * (uu - uv), 2.0 * (vv - uv)
            least = min(
                triangle.share(kind, a, b, d, area),
                triangle.share(kind, b, d, a, area),
                triangle.share(kind, d, a, b, area),
            )
            bounds[lower, c] = triangle.bound(a, b, d, area, least) if area > 0.0 else 0.0


@njit(**ROW)
def hurried(pace, r, speed, to):
    """The factor of time of a row of samples: s, times the squared footprint where time is counted in those."""
    for j in range(len(to)):
        to[j] = speed[j] * pace[r, j] if len(pace) > 0 else speed[j]


@njit(**ROW)
def quickest(side, bounds, above, below):
    """The greatest bound of a row of triangles times the factor of time at their corners, of the rows above and below them."""
    greatest = 0.0
    for c in range(bounds.shape[1] - 1):
        # The two triangles share the corners Q and R.
        p, q = c + side, c + 1 - side
        shared = max(above[q], below[p])
        greatest = max(greatest, bounds[0, c] * max(shared, above[p]), bounds[1, c] * max(shared, below[q]))
    return greatest
