"""Samples on lines in space, p = o + u d: the formula of a triangle, and the loops over a row of cells that compile it.

Only what acts along the lines leaves a triangle: with e, g its legs from its right angle P on the grid to Q and R, and
n = e x g / |e x g|, the gradient of its area is g x n / 2 at Q, n x e / 2 at R, and minus their sum at P; each corner takes
the part along the direction d of its own line. (|e x g|^2 is the sum of squared minors of :mod:`.coupled`, with
no digits lost.) The area as a corner sees it along its line is |d . (e x g)| / 2 |d|. Through a pinhole on an even grid the same
is said shorter, in two fifths of the time: :func:`facing`.

All rows (n,) are those of one row of cells, with corners P, Q, R, S as in :mod:`.stencil`. Places and directions
are triples of rows of samples, read at two places each: of more rows LLVM would not ask whether they overlap, and no loop would
become SIMD.
"""

import math

from numba import njit

from meshflow.flow.engines.grid.compiled import FORMULA
from meshflow.flow.engines.grid.coupled import bordered
from meshflow.geometry.triangle import FLAT

__all__ = [
    "border_cells",
    "decays",
    "foremost",
    "lone",
    "over_rays",
    "pinhole_cells",
    "pinhole_seen",
    "ray_cells",
    "seen_cells",
]


@njit(**FORMULA)
def spanned(p, q, r):
    """Legs e and g of a triangle and e x g, triples; |e x g|^2, zero where the triangle has no area; |e|^2 + |g|^2 - e . g."""
    a, b, c = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    d, e, f = r[0] - p[0], r[1] - p[1], r[2] - p[2]
    x, y, z = b * f - c * e, c * d - a * f, a * e - b * d
    uu, vv, uv = a * a + b * b + c * c, d * d + e * e + f * f, a * d + b * e + c * f
    square, longest = x * x + y * y + z * z, type(a)(FLAT) * max(max(uu, vv), uu + vv - (uv + uv))
    square = square if square > longest * longest else type(a)(0)
    return (a, b, c), (d, e, f), (x, y, z), square, uu + vv - uv


@njit(**FORMULA)
def pulls_of(e, g, n, doubled):
    """The gradient of the area at Q and at R, triples; nothing where there is no area."""
    none = type(doubled)(0)
    half = type(doubled)(0.5) / doubled if doubled > none else none
    x, y, z = half * n[0], half * n[1], half * n[2]
    on_q = g[1] * z - g[2] * y, g[2] * x - g[0] * z, g[0] * y - g[1] * x
    on_r = y * e[2] - z * e[1], z * e[0] - x * e[2], x * e[1] - y * e[0]
    return on_q, on_r


@njit(**FORMULA)
def dot(a, b):
    """a . b of triples."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(**FORMULA)
def plus(a, b):
    """a + b of triples."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@njit(**FORMULA)
def at(rows, j):
    """The triple at j."""
    return rows[0][j], rows[1][j], rows[2][j]


@njit(**FORMULA)
def corners(side, j, top, bottom):
    """The triples at P, Q, R, S of cell j, of the rows of samples above and below it."""
    return at(top, j + side), at(top, j + 1 - side), at(bottom, j + side), at(bottom, j + 1 - side)


@njit(**FORMULA)
def ray_cells(side, coded, code, points, rays, pulls, thirds):
    """What the two triangles of cells give their corners P, Q, R, S: pulls along their lines, and thirds of areas.

    :param side: 1 where the diagonal is backward, else 0.
    :param coded: triangles may be missing, as ``code`` says.
    :param points: triples of rows (n + 1,) of samples, above and below the cells; ``rays`` likewise, the directions of lines.
    :param thirds: of the upper and of the lower triangles.
    """
    to_p, to_q, to_r, to_s = pulls
    third, fourth = thirds
    none = type(third[0])(0)
    for j in range(len(third)):
        p, q, r, s = corners(side, j, points[0], points[1])
        d, e, f, g = corners(side, j, rays[0], rays[1])
        upper, lower = spanned(p, q, r), spanned(s, r, q)
        twice, again = math.sqrt(upper[3]), math.sqrt(lower[3])
        if coded:
            twice, again = (twice if code[j] & 1 else none), (again if code[j] & 16 else none)
        on_q, on_r = pulls_of(upper[0], upper[1], upper[2], twice)
        and_r, and_q = pulls_of(lower[0], lower[1], lower[2], again)
        to_p[j], to_q[j] = -dot(plus(on_q, on_r), d), dot(plus(on_q, and_q), e)
        to_r[j], to_s[j] = dot(plus(on_r, and_r), f), -dot(plus(and_r, and_q), g)
        third[j], fourth[j] = twice / type(none)(6), again / type(none)(6)


@njit(**FORMULA)
def seen_cells(side, points, rays, thirds, seen):
    """The areas of the triangles of cells as their corners see them, times 6 |d|; parameters as of :func:`ray_cells`."""
    at_p, at_q, at_r, at_s = seen
    third, fourth = thirds
    none = type(third[0])(0)
    for j in range(len(third)):
        p, q, r, s = corners(side, j, points[0], points[1])
        d, e, f, g = corners(side, j, rays[0], rays[1])
        n, m, above, below = spanned(p, q, r)[2], spanned(s, r, q)[2], third[j] > none, fourth[j] > none
        at_p[j] = abs(dot(d, n)) if above else none
        at_q[j] = (abs(dot(e, n)) if above else none) + (abs(dot(e, m)) if below else none)
        at_r[j] = (abs(dot(f, n)) if above else none) + (abs(dot(f, m)) if below else none)
        at_s[j] = abs(dot(g, m)) if below else none


@njit(**FORMULA)
def facing(p, q, r, x, y, across, down, half):
    """:func:`pulls_of` along the rays and |e x g|, of a triangle of depths p, q, r seen through a pinhole on an even grid.

    Its points are u (x, y, 1). With a = (q - p) / X and b = (r - p) / Y, X and Y the signed differences of x along the row and of
    y along the column, e x g = X Y (-a r, -b q, q r + x a r + y b q): no differences of points, so even less is lost.

    :param x: of P, as ``y``.
    :param across: 1 / X, and ``down`` 1 / Y; ``half`` |X Y| / 2.
    """
    a, b = (q - p) * across, (r - p) * down
    m, n = a * r, b * q
    k = q * r + x * m + y * n
    length = math.sqrt(m * m + n * n + k * k)
    over = half / length
    k, m, n = k * over, (m + x * k) * over, (n + y * k) * over
    return -(m * r * across + n * q * down), m * r * across + n * b + k * r, m * a + n * q * down + k * q, length


@njit(**FORMULA)
def pinhole_cells(side, coded, code, depths, x, heights, across, down, pulls, thirds):
    """:func:`ray_cells` seen through a pinhole on an even grid, by :func:`facing`.

    :param depths: rows (n + 1,) of samples, above and below the cells; ``x`` (n + 1,) of their rays, ``heights`` the y of both.
    """
    to_p, to_q, to_r, to_s = pulls
    third, fourth = thirds
    none, two = type(across)(0), type(across)(2)
    across = -across if side == 1 else across
    half = type(across)(1) / (two * abs(across * down))
    part = half / type(across)(3)
    top, bottom = depths
    for j in range(len(third)):
        p, q, r, s = top[j + side], top[j + 1 - side], bottom[j + side], bottom[j + 1 - side]
        on_p, on_q, on_r, w = facing(p, q, r, x[j + side], heights[0], across, down, half)
        on_s, and_r, and_q, v = facing(s, r, q, x[j + 1 - side], heights[1], -across, -down, half)
        if coded:
            above, below = code[j] & 1 != 0, code[j] & 16 != 0
            on_p, on_q, on_r = (on_p if above else none), (on_q if above else none), (on_r if above else none)
            on_s, and_r, and_q = (on_s if below else none), (and_r if below else none), (and_q if below else none)
            w, v = (w if above else none), (v if below else none)
        to_p[j], to_q[j], to_r[j], to_s[j] = on_p, on_q + and_q, on_r + and_r, on_s
        third[j], fourth[j] = part * w, part * v


@njit(**FORMULA)
def pinhole_seen(side, depths, across, down, thirds, seen):
    """:func:`seen_cells` seen through a pinhole on an even grid: d . (e x g) is X Y times the depths of the other two corners."""
    at_p, at_q, at_r, at_s = seen
    third, fourth = thirds
    none, area = type(across)(0), type(across)(1) / abs(across * down)
    top, bottom = depths
    for j in range(len(third)):
        p, q, r, s = top[j + side], top[j + 1 - side], bottom[j + side], bottom[j + 1 - side]
        by, above, below = abs(q * r) * area, third[j] > none, fourth[j] > none
        at_p[j], at_s[j] = (by if above else none), (by if below else none)
        at_q[j] = (abs(p * r) * area if above else none) + (abs(s * r) * area if below else none)
        at_r[j] = (abs(p * q) * area if above else none) + (abs(s * q) * area if below else none)


@njit(**FORMULA)
def border_cells(side, code, points, rays, pulls):
    """The pull of the conormals of borders taken out of the ``pulls`` of coded cells (:func:`.coupled.bordered`)."""
    to_p, to_q, to_r, to_s = pulls
    none = type(to_p[0])(0)
    j = 0
    while True:  # no SIMD: few cells of a row are at a border
        while j < len(code) and not code[j] & 238:
            j += 1
        if j >= len(code):
            return
        x = code[j]
        p, q, r, s = corners(side, j, points[0], points[1])
        d, e, f, g = corners(side, j, rays[0], rays[1])
        upper, lower = spanned(p, q, r), spanned(s, r, q)
        on_q, on_r = pulls_of(upper[0], upper[1], upper[2], math.sqrt(upper[3]) if x & 1 else none)
        and_r, and_q = pulls_of(lower[0], lower[1], lower[2], math.sqrt(lower[3]) if x & 16 else none)
        one = bordered(x, on_q[0], on_r[0], and_r[0], and_q[0])
        two = bordered(x, on_q[1], on_r[1], and_r[1], and_q[1])
        three = bordered(x, on_q[2], on_r[2], and_r[2], and_q[2])
        to_p[j] += dot((one[0], two[0], three[0]), d)
        to_q[j] += dot((one[1], two[1], three[1]), e)
        to_r[j] += dot((one[2], two[2], three[2]), f)
        to_s[j] += dot((one[3], two[3], three[3]), g)
        j += 1


@njit(**FORMULA)
def fastest(square, spread):
    """:func:`meshflow.geometry.triangle.bound` of barycentric masses, without cotangents: 3 (N + sqrt(N^2 - 3 D)) / D.

    D = |e x g|^2, N = |e|^2 + |g|^2 - e . g = (a + b + c) / 2 of the squared lengths. Zero where there is no area.
    """
    none, three = type(square)(0), type(square)(3)
    rest = spread * spread - three * square
    return three * (spread + math.sqrt(rest if rest > none else none)) / square if square > none else none


@njit(**FORMULA)
def decays(side, coded, code, points, upper, lower):
    """:func:`fastest` of the two triangles of cells; parameters as of :func:`ray_cells`."""
    none = type(upper[0])(0)
    for j in range(len(upper)):
        p, q, r, s = corners(side, j, points[0], points[1])
        one, two = spanned(p, q, r), spanned(s, r, q)
        v, w = fastest(one[3], one[4]), fastest(two[3], two[4])
        if coded:
            v, w = (v if code[j] & 1 else none), (w if code[j] & 16 else none)
        upper[j], lower[j] = v, w


@njit(**FORMULA)
def foremost(upper, lower, p, q, r, s, most):
    """The greatest of ``most`` and what the triangles of cells decay by, times the greatest factor of time at their corners."""
    for j in range(len(most)):
        shared = q[j] if q[j] > r[j] else r[j]
        a, b = (p[j] if p[j] > shared else shared) * upper[j], (s[j] if s[j] > shared else shared) * lower[j]
        a = a if a > b else b
        most[j] = a if a > most[j] else most[j]


@njit(**FORMULA)
def over_rays(paced, thirds, x, y, z, mass, pace, inverse):
    """pace / M |d|^2, M = thirds * mass; zero where there is no triangle. The coordinate along d is counted in d."""
    none, one = type(x[0])(0), type(x[0])(1)
    for j in range(len(inverse)):
        square = (x[j] * x[j] + y[j] * y[j] + z[j] * z[j]) * (thirds * mass[j])
        inverse[j] = (pace[j] if paced else one) / square if square > none else none


@njit(**FORMULA)
def lone(x, y, z, seen):
    """Thirds of areas from what :func:`ray_cells` has ``seen``, in place."""
    none, six = type(x[0])(0), type(x[0])(6)
    for j in range(len(seen)):
        length = math.sqrt(x[j] * x[j] + y[j] * y[j] + z[j] * z[j])
        seen[j] = seen[j] / (six * length) if length > none else none
