"""Several coordinates on a grid, channels or points in space: the formulas of a triangle, looped over rows of cells.

With u, v the legs of a triangle from its right angle P on the grid to Q and R, in whatever space lengths are measured, and 2T
twice its area, its cotangents are u . v / 2T at P, (|u|^2 - u . v) / 2T at Q, (|v|^2 - u . v) / 2T at R: |u|^2, |v|^2 and u . v
over 4T, called its weights, are all that a row keeps of it. (2T)^2 is the sum of the squared minors u_i v_j - u_j v_i (Lagrange),
where |u|^2 |v|^2 - (u . v)^2 would lose its digits. Over a grid the base h_x, h_y is written out, and the rest stretched for
sharpness.

All rows (n,) are those of one row of cells; ``p``, ``q``, ``r``, ``s`` hold one coordinate at P, Q, R of the upper triangles
and at S opposite to P, as in :mod:`.stencil`.
"""

import math

from numba import njit

from meshflow.flow.engines.grid.compiled import FORMULA
from meshflow.geometry.triangle import FLAT, share, stretch

__all__ = [
    "along",
    "averaged",
    "averaged_cells",
    "averaged_coded_cells",
    "bordered_corners",
    "edges",
    "legs",
    "measured",
    "measured_three",
    "minors",
    "over_mass",
    "paced",
    "present",
    "projected",
    "pulled",
    "pulled_level",
    "seen",
    "shares",
    "shortened",
    "still_corners",
    "straight",
    "summed",
    "upright",
]


@njit(**FORMULA)
def over_grid(sharp, q, scale, row, uu, vv, uv, minors):
    """|u|^2, |v|^2, u . v over 4T, and T / 3, of a triangle over the grid.

    :param sharp: 0 where the sharpness q is 1, which stretches nothing.
    :param scale: alpha^2: the free part of lengths is multiplied by it and by :func:`meshflow.geometry.triangle.stretch`.
    :param row: h_x^2, h_y^2 of the row of the leg h_x, and their inverses.
    :param uu: with ``vv``, ``uv`` and the sum of squared minors, of the channels alone.
    """
    by = scale
    if sharp != 0:
        by *= stretch(scale * (uu * row[2] + vv * row[3]), q)
    doubled = math.sqrt(row[0] * row[1] + by * ((row[0] * vv + row[1] * uu) + by * minors))
    half = type(by)(0.5) / doubled
    return half * (row[0] + by * uu), half * (row[1] + by * vv), half * (by * uv), doubled / type(by)(6)


@njit(**FORMULA)
def in_space(uu, vv, uv, minors):
    """:func:`over_grid` for points in space; a triangle without area gives nothing."""
    none = type(uu)(0)
    doubled = math.sqrt(minors)
    longest = max(max(uu, vv), uu + vv - (uv + uv))
    half = type(uu)(0.5) / doubled
    half, doubled = (half, doubled) if doubled > type(uu)(FLAT) * longest else (none, none)
    return half * uu, half * vv, half * uv, doubled / type(uu)(6)


@njit(**FORMULA)
def threefold(a, b, c, d, e, f):
    """|u|^2, |v|^2, u . v and the sum of squared minors of the legs (a, b, c) and (d, e, f)."""
    x, y, z = b * f - c * e, c * d - a * f, a * e - b * d
    return a * a + b * b + c * c, d * d + e * e + f * f, a * d + b * e + c * f, x * x + y * y + z * z


@njit(**FORMULA)
def measured_three(spatial, sharp, q, scale, above, below, p, o, r, s, uu, vv, uv, third, xx, yy, xy, fourth):
    """Weights and thirds of area of cells with three coordinates, of the upper triangles and (xx, ..., fourth) of the lower ones.

    :param above: the row of :func:`over_grid` for the upper triangles; ``below`` for the lower ones.
    :param p: the coordinates at P; ``o`` at Q, ``r`` at R, ``s`` at S; triples.
    """
    for j in range(len(uu)):
        a, b, c = o[0][j] - p[0][j], o[1][j] - p[1][j], o[2][j] - p[2][j]
        d, e, f = r[0][j] - p[0][j], r[1][j] - p[1][j], r[2][j] - p[2][j]
        g, h, i = r[0][j] - s[0][j], r[1][j] - s[1][j], r[2][j] - s[2][j]
        k, m, n = o[0][j] - s[0][j], o[1][j] - s[1][j], o[2][j] - s[2][j]
        one, two = threefold(a, b, c, d, e, f), threefold(g, h, i, k, m, n)
        if spatial:
            w, v = in_space(one[0], one[1], one[2], one[3]), in_space(two[0], two[1], two[2], two[3])
        else:
            w = over_grid(sharp, q, scale, above, one[0], one[1], one[2], one[3])
            v = over_grid(sharp, q, scale, below, two[0], two[1], two[2], two[3])
        uu[j], vv[j], uv[j], third[j] = w[0], w[1], w[2], w[3]
        xx[j], yy[j], xy[j], fourth[j] = v[0], v[1], v[2], v[3]


@njit(**FORMULA)
def legs(p, q, r, uu, vv, uv):
    """Squares and product of the legs, one coordinate added."""
    for j in range(len(p)):
        a, b = q[j] - p[j], r[j] - p[j]
        uu[j] += a * a
        vv[j] += b * b
        uv[j] += a * b


@njit(**FORMULA)
def minors(p, q, r, o, s, t, squares):
    """The squared minor of two coordinates, (p, q, r) and (o, s, t), added."""
    for j in range(len(p)):
        m = (q[j] - p[j]) * (t[j] - o[j]) - (s[j] - o[j]) * (r[j] - p[j])
        squares[j] += m * m


@njit(**FORMULA)
def measured(sharp, q, scale, row, uu, vv, uv, squares, third):
    """:func:`over_grid` in the place of the sums of the legs."""
    for j in range(len(uu)):
        w = over_grid(sharp, q, scale, row, uu[j], vv[j], uv[j], squares[j])
        uu[j], vv[j], uv[j], third[j] = w[0], w[1], w[2], w[3]


@njit(**FORMULA)
def mean_over_grid(sharp, q, scale, row, share, uu, vv, uv):
    """:func:`over_grid` of weighted sums of the products of legs, ``share`` being one over the sum of the weights.

    The squared minors of a mean are no longer a sum of squares: the difference is taken, and held above zero.
    """
    none = type(share)(0)
    a, b, c = uu * share, vv * share, uv * share
    squares = a * b - c * c
    return over_grid(sharp, q, scale, row, a, b, c, squares if squares > none else none)


@njit(**FORMULA)
def averaged(sharp, q, scale, row, share, a, b, c, uu, vv, uv, third):
    """:func:`mean_over_grid` of the sums a, b, c."""
    for j in range(len(uu)):
        w = mean_over_grid(sharp, q, scale, row, share[j], a[j], b[j], c[j])
        uu[j], vv[j], uv[j], third[j] = w[0], w[1], w[2], w[3]


@njit(**FORMULA)
def averaged_cells(sharp, q, scale, above, below, shares, upper, lower, corners, pulls, thirds):
    """Pulls of cells of one channel on their corners P, Q, R, S, and thirds of area, of means as :func:`mean_over_grid`.

    :param above: the row of :func:`over_grid` for the upper triangles; ``below`` for the lower ones.
    :param shares: of the upper and the lower triangles; ``upper`` and ``lower`` their sums of products, triples of rows.
    """
    p, o, r, s = corners
    to_p, to_q, to_r, to_s = pulls
    for j in range(len(p)):
        m = mean_over_grid(sharp, q, scale, above, shares[0][j], upper[0][j], upper[1][j], upper[2][j])
        n = mean_over_grid(sharp, q, scale, below, shares[1][j], lower[0][j], lower[1][j], lower[2][j])
        on_q, on_r = on_ends(o[j] - p[j], r[j] - p[j], m[0], m[1], m[2])
        and_r, and_q = on_ends(r[j] - s[j], o[j] - s[j], n[0], n[1], n[2])
        to_p[j], to_q[j], to_r[j], to_s[j] = -(on_q + on_r), on_q + and_q, on_r + and_r, -(and_r + and_q)
        thirds[0][j], thirds[1][j] = m[3], n[3]


@njit(**FORMULA)
def averaged_coded_cells(sharp, q, scale, above, below, shares, upper, lower, code, corners, pulls, thirds):
    """:func:`averaged_cells` where triangles may be missing and edges may be borders."""
    p, o, r, s = corners
    to_p, to_q, to_r, to_s = pulls
    none = type(p[0])(0)
    for j in range(len(p)):
        x = code[j]
        m = mean_over_grid(sharp, q, scale, above, shares[0][j], upper[0][j], upper[1][j], upper[2][j])
        n = mean_over_grid(sharp, q, scale, below, shares[1][j], lower[0][j], lower[1][j], lower[2][j])
        on_q, on_r = on_ends(o[j] - p[j], r[j] - p[j], m[0], m[1], m[2])
        and_r, and_q = on_ends(r[j] - s[j], o[j] - s[j], n[0], n[1], n[2])
        on_q, on_r = (on_q if x & 1 else none), (on_r if x & 1 else none)
        and_r, and_q = (and_r if x & 16 else none), (and_q if x & 16 else none)
        at_p, at_q, at_r, at_s = bordered(x, on_q, on_r, and_r, and_q)
        to_p[j], to_q[j] = -(on_q + on_r) + at_p, (on_q + and_q) + at_q
        to_r[j], to_s[j] = (on_r + and_r) + at_r, -(and_r + and_q) + at_s
        thirds[0][j], thirds[1][j] = (m[3] if x & 1 else none), (n[3] if x & 16 else none)


@njit(**FORMULA)
def present(code, bit, uu, vv, uv, third):
    """Nothing where a triangle of coded cells is not there."""
    none = type(uu[0])(0)
    for j in range(len(code)):
        uu[j] = uu[j] if code[j] & bit else none
        vv[j] = vv[j] if code[j] & bit else none
        uv[j] = uv[j] if code[j] & bit else none
        third[j] = third[j] if code[j] & bit else none


@njit(**FORMULA)
def edges(vv, uv, yy, xy, level, onward, slant):
    """Half the cotangents opposite to the edges of a row of cells: along the row above, ``onward`` below, and the diagonals.

    :param level: in: what the cells above this row gave to the same edges; out: their weights.
    """
    for j in range(len(level)):
        level[j] = onward[j] + (vv[j] - uv[j])
        onward[j] = yy[j] - xy[j]
        slant[j] = uv[j] + xy[j]


@njit(**FORMULA)
def upright(uu, uv, xx, xy, out):
    """Half the cotangents opposite to the edges along the columns.

    :param uu: with ``uv``, of the upper triangles with a leg there; ``xx``, ``xy`` of the lower ones.
    """
    for j in range(len(out)):
        out[j] = (uu[j] - uv[j]) + (xx[j] - xy[j])


@njit(**FORMULA)
def pulled(begins, left, right, up, over, under, t, t_left, t_right, t_far, b, b_far, here, below):
    """sum of w (x_i - x_j) over the edges of a row of cells and of the row of samples above it, added at their ends.

    :param left: weights of the edges to the left and ``right`` of each sample of the upper row, ``up`` down to the lower row;
        ``over`` of the diagonal that ends at it, and ``under`` of the one that ends at the sample below it.
    :param t: the coordinate there, ``t_left`` and ``t_right`` beside it, ``t_far`` at the other end of ``under``; ``b`` below it,
        ``b_far`` at the other end of ``over``.
    """
    none = type(t[0])(0)
    for j in range(len(t)):
        fall = up[j] * (t[j] - b[j])
        here[j] += (left[j] * (t[j] - t_left[j]) + right[j] * (t[j] - t_right[j])) + (
            fall + over[j] * (t[j] - b_far[j])
        )
        below[j] = (none if begins else below[j]) + (under[j] * (b[j] - t_far[j]) - fall)


@njit(**FORMULA)
def pulled_level(left, right, t, t_left, t_right, here):
    """:func:`pulled` along the last row of samples, below which there is no cell."""
    for j in range(len(t)):
        here[j] += left[j] * (t[j] - t_left[j]) + right[j] * (t[j] - t_right[j])


@njit(**FORMULA)
def on_ends(a, b, uu, vv, uv):
    """The pulls of a triangle on Q and R, of a coordinate whose differences along the legs are a and b."""
    return vv * a - uv * b, uu * b - uv * a


@njit(**FORMULA)
def bordered(x, on_q, on_r, and_r, and_q):
    """What a cell of code x gives its corners P, Q, R, S, for the conormals of its borders, beside the pulls on Q, R and R, Q.

    See :func:`.stencil.coded_cells`.
    """
    none = type(on_q)(0)
    p_to, q_to, r_to = (-(on_q + on_r) if x & 2 else none), (on_q if x & 4 else none), (on_r if x & 8 else none)
    s_to, r_on, q_on = (-(and_r + and_q) if x & 32 else none), (and_r if x & 64 else none), (and_q if x & 128 else none)
    return q_to + r_to, (p_to + r_to) + (s_to + r_on), (p_to + q_to) + (s_to + q_on), r_on + q_on


@njit(**FORMULA)
def bordered_corners(code, p, q, r, s, uu, vv, uv, xx, yy, xy, pull_p, pull_q, pull_r, pull_s):
    """:func:`bordered` for coded cells."""
    for j in range(len(code)):
        on_q, on_r = on_ends(q[j] - p[j], r[j] - p[j], uu[j], vv[j], uv[j])
        and_r, and_q = on_ends(r[j] - s[j], q[j] - s[j], xx[j], yy[j], xy[j])
        pull_p[j], pull_q[j], pull_r[j], pull_s[j] = bordered(code[j], on_q, on_r, and_r, and_q)


@njit(**FORMULA)
def still_corners(code, upper, lower, uu, vv, uv, xx, yy, xy, pull_p, pull_q, pull_r, pull_s):
    """Pulls on the corners of cells of a coordinate that stays, whose differences along the legs are ``upper`` and ``lower``."""
    for j in range(len(uu)):
        on_q, on_r = on_ends(upper[0], upper[1], uu[j], vv[j], uv[j])
        and_r, and_q = on_ends(lower[0], lower[1], xx[j], yy[j], xy[j])
        at_p, at_q, at_r, at_s = bordered(code[j], on_q, on_r, and_r, and_q)
        pull_p[j] = -(on_q + on_r) + at_p
        pull_q[j] = on_q + and_q + at_q
        pull_r[j] = on_r + and_r + at_r
        pull_s[j] = -(and_r + and_q) + at_s


@njit(**FORMULA)
def shares(kind, uu, vv, uv, third, at_p, at_q, at_r):
    """The masses of the corners of a triangle (:func:`meshflow.geometry.triangle.share`), added."""
    two, three = type(uu[0])(2), type(uu[0])(3)
    for j in range(len(uu)):
        cot_p, cot_q, cot_r = two * uv[j], two * (uu[j] - uv[j]), two * (vv[j] - uv[j])
        area = three * third[j]
        at_p[j] += share(kind, cot_p, cot_q, cot_r, area)
        at_q[j] += share(kind, cot_q, cot_r, cot_p, area)
        at_r[j] += share(kind, cot_r, cot_p, cot_q, area)


@njit(**FORMULA)
def seen(p, q, r, rays, third, at):
    """A third of a triangle's area as seen along the ray of one of its corners, added; all are triples."""
    none, six = type(third[0])(0), type(third[0])(6)
    for j in range(len(at)):
        a, b, c = q[0][j] - p[0][j], q[1][j] - p[1][j], q[2][j] - p[2][j]
        d, e, f = r[0][j] - p[0][j], r[1][j] - p[1][j], r[2][j] - p[2][j]
        x, y, z = rays[0][j], rays[1][j], rays[2][j]
        length = math.sqrt(x * x + y * y + z * z)
        area = abs(x * (b * f - c * e) + y * (c * d - a * f) + z * (a * e - b * d)) / (six * length)
        at[j] += area if third[j] > none and length > none else none


@njit(**FORMULA)
def along(x, y, z, pull_x, pull_y, pull_z, part, whole):
    """The pull times the ray (x, y, z), in the place of ``pull_x``; the pull along the ray and the whole pull, lengths."""
    none = type(x[0])(0)
    for j in range(len(x)):
        a, b, c = pull_x[j], pull_y[j], pull_z[j]
        length = math.sqrt(x[j] * x[j] + y[j] * y[j] + z[j] * z[j])
        product = x[j] * a + y[j] * b + z[j] * c
        pull_x[j] = product
        part[j] = abs(product) / length if length > none else none
        whole[j] = math.sqrt(a * a + b * b + c * c)


@njit(**FORMULA)
def projected(free2, part, whole):
    """|P B| and |B|, times the mass, of samples whose channels pull with free2 squared.

    :param part: in: the pull of their places along x; out: the first. ``whole``: likewise, along y; the second.
    """
    for j in range(len(free2)):
        x, y = part[j], whole[j]
        part[j] = math.sqrt(free2[j])
        whole[j] = math.sqrt(free2[j] + (x * x + y * y))


@njit(**FORMULA)
def straight(small, thirds, mass, part, whole):
    """The indicator 1 where the pull is rounding: |B| h is below ``small``, h = sqrt M."""
    one = type(small)(1)
    for j in range(len(part)):
        curved = whole[j] > small * math.sqrt(thirds * mass[j])
        part[j] = part[j] if curved else one
        whole[j] = whole[j] if curved else one


@njit(**FORMULA)
def paced(pace, inverse):
    """Times the squared footprint of each pixel, in place."""
    for j in range(len(inverse)):
        inverse[j] *= pace[j]


@njit(**FORMULA)
def shortened(x, y, z, inverse):
    """Over the squared length of the ray (x, y, z), in place: the coordinate along it is counted in rays."""
    none, one = type(x[0])(0), type(x[0])(1)
    for j in range(len(inverse)):
        square = x[j] * x[j] + y[j] * y[j] + z[j] * z[j]
        inverse[j] *= one / square if square > none else none


@njit(**FORMULA)
def over_mass(thirds, mass, inverse):
    """Over the mass, in place; zero where there is none."""
    none, one = type(mass[0])(0), type(mass[0])(1)
    for j in range(len(inverse)):
        inverse[j] *= one / (thirds * mass[j]) if mass[j] > none else none


@njit(**FORMULA)
def summed(begins, scale, x, squares):
    """scale x^2, added."""
    none = type(x[0])(0)
    for j in range(len(x)):
        squares[j] = (none if begins else squares[j]) + scale * (x[j] * x[j])
