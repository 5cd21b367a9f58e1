"""One channel on a grid: the formula of a triangle, and the loops over a row of cells or samples that compile it.

A triangle of a grid has its right angle at P, a leg h_x along the row to Q and a leg h_y along the column to R. With a, b the
differences of the channel along the legs, its area is h_x h_y W^q / 2, W^2 = 1 + (alpha a / h_x)^2 + (alpha b / h_y)^2, and the
gradient of the area, (13) summed up, is (h_y / 2 h_x) a / W^q at Q, (h_x / 2 h_y) b / W^q at R, and minus their sum at P: what
the cotangents say, with nothing left to cancel. (``meshflow.geometry.triangle`` says the same of any triangle; tests compare.)

Rows of cells are given by the samples at their corners, ``p``, ``q`` of the upper and ``r``, ``s`` of the lower row: P, Q, R of
the upper triangle, and S, opposite to P. Where the diagonal is backward the row is read from the other side, P and Q swapped.
"""

import math

from numba import njit

from meshflow.flow.engines.grid.compiled import FORMULA

__all__ = [
    "blended",
    "cells",
    "coded_cells",
    "counted",
    "counted_cells",
    "flattened",
    "gathered",
    "gathered_thirds",
    "inverse_mass",
    "power",
    "sped",
]


@njit(**FORMULA)
def power(x, quarters, exponent):
    """x ** exponent for x >= 0; ``quarters`` is four times the exponent where roots reach it, else 99."""
    if quarters == 0:
        return type(x)(1)
    if quarters == 4:
        return x
    if quarters == 2:
        return math.sqrt(x)
    if quarters == 3:
        root = math.sqrt(x)
        return root * math.sqrt(root)
    if quarters == 8:
        return x * x
    if quarters == -2:
        return type(x)(1) / math.sqrt(x)
    if quarters == -4:
        return type(x)(1) / x
    if quarters == -8:
        return type(x)(1) / (x * x)
    return x**exponent


@njit(**FORMULA)
def expansion(quarters, half, a, b, row):
    """W^q of a triangle with differences a, b along its legs.

    :param quarters: four times q / 2 as :func:`power` takes it, and ``half`` q / 2.
    :param row: of the row of the leg h_x: (alpha / h_x)^2, (alpha / h_y)^2, h_y / 2 h_x, h_x / 2 h_y, h_x h_y / 6.
    """
    return power(type(a)(1) + (row[0] * a * a + row[1] * b * b), quarters, half)


@njit(**FORMULA)
def inverses(w, v):
    """1 / w and 1 / v for one division, the slowest of all operations here."""
    inverse = type(w)(1) / (w * v)
    return v * inverse, w * inverse


@njit(**FORMULA)
def cells(quarters, half, p, q, r, s, upper, lower, pull_p, pull_q, pull_r, pull_s, third_upper, third_lower):
    """Pulls (n,) of the two triangles of plain cells on the four corners, and their thirds of area.

    :param upper: ``row`` of :func:`expansion` for the upper triangles; ``lower`` for the lower ones.
    """
    for j in range(len(p)):
        a, b, c, d = q[j] - p[j], r[j] - p[j], r[j] - s[j], q[j] - s[j]
        w, v = expansion(quarters, half, a, b, upper), expansion(quarters, half, c, d, lower)
        over_w, over_v = inverses(w, v)
        on_q, on_r = upper[2] * a * over_w, upper[3] * b * over_w
        and_r, and_q = lower[2] * c * over_v, lower[3] * d * over_v
        pull_p[j] = -(on_q + on_r)
        pull_q[j] = on_q + and_q
        pull_r[j] = on_r + and_r
        pull_s[j] = -(and_r + and_q)
        third_upper[j] = upper[4] * w
        third_lower[j] = lower[4] * v


@njit(**FORMULA)
def coded_cells(
    quarters, half, code, p, q, r, s, upper, lower, pull_p, pull_q, pull_r, pull_s, third_upper, third_lower
):
    """:func:`cells` where triangles may be missing and edges may be borders (:mod:`.cells`).

    At a border edge the pull of its conormal is taken out at both its ends (plane-preserving): half of it is minus the pull
    on the corner opposite to the edge.
    """
    none = type(upper[4])(0)
    for j in range(len(p)):
        x = code[j]
        a, b, c, d = q[j] - p[j], r[j] - p[j], r[j] - s[j], q[j] - s[j]
        w, v = expansion(quarters, half, a, b, upper), expansion(quarters, half, c, d, lower)
        over_w, over_v = inverses(w, v)
        over_w, over_v = (over_w if x & 1 else none), (over_v if x & 16 else none)
        on_q, on_r = upper[2] * a * over_w, upper[3] * b * over_w
        and_r, and_q = lower[2] * c * over_v, lower[3] * d * over_v
        p_to, q_to, r_to = (-(on_q + on_r) if x & 2 else none), (on_q if x & 4 else none), (on_r if x & 8 else none)
        s_to, r_on, q_on = (
            (-(and_r + and_q) if x & 32 else none),
            (and_r if x & 64 else none),
            (and_q if x & 128 else none),
        )
        pull_p[j] = -(on_q + on_r) + (q_to + r_to)
        pull_q[j] = (on_q + and_q) + ((p_to + r_to) + (s_to + r_on))
        pull_r[j] = (on_r + and_r) + ((p_to + q_to) + (s_to + q_on))
        pull_s[j] = -(and_r + and_q) + (r_on + q_on)
        third_upper[j] = upper[4] * w if x & 1 else none
        third_lower[j] = lower[4] * v if x & 16 else none


@njit(**FORMULA)
def counted_cells(code, upper, lower):
    """One where a triangle of coded cells is there, zero elsewhere."""
    none, one = type(upper[0])(0), type(upper[0])(1)
    for j in range(len(code)):
        upper[j] = one if code[j] & 1 else none
        lower[j] = one if code[j] & 16 else none


@njit(**FORMULA)
def gathered(begins, p, q, r, s, here, below):
    """What cells give to the samples of their upper row, added to ``here`` (n,), and of their lower row, to ``below``.

    :param begins: nothing has been given to ``below`` yet.
    """
    none = type(p[0])(0)
    for j in range(len(here)):
        here[j] += p[j] + q[j]
        below[j] = (none if begins else below[j]) + (r[j] + s[j])


@njit(**FORMULA)
def gathered_thirds(begins, upper_p, lower_p, upper_q, lower_q, here, below):
    """:func:`gathered` for thirds of areas: the upper triangle gives to P, Q, R, the lower one to Q, R, S."""
    none = type(upper_p[0])(0)
    for j in range(len(here)):
        here[j] += upper_p[j] + (upper_q[j] + lower_q[j])
        below[j] = (none if begins else below[j]) + (lower_q[j] + (upper_p[j] + lower_p[j]))


@njit(**FORMULA)
def counted(begins, upper_p, lower_p, upper_q, lower_q, last, here, next, onward_here, onward_next):
    """How many triangles with a leg in the last, in this and in the next row of samples touch each sample (n,).

    The ``onward`` ones, what the cells give to the samples below, are ``last`` and part of ``here`` there.
    """
    none = type(upper_p[0])(0)
    for j in range(len(here)):
        last[j] = onward_here[j] if begins else last[j]
        here[j] = (onward_next[j] if begins else here[j]) + (upper_p[j] + upper_q[j])
        next[j] = (none if begins else next[j]) + lower_q[j]
        onward_here[j] = (none if begins else onward_here[j]) + upper_p[j]
        onward_next[j] = (none if begins else onward_next[j]) + (lower_p[j] + lower_q[j])


@njit(**FORMULA)
def flattened(last, here, next, third_last, third_here, third_next, flat):
    """The flat mass (n,) of samples from the counts of their triangles and a third of the area of each."""
    for j in range(len(flat)):
        flat[j] = (last[j] * third_last + here[j] * third_here) + next[j] * third_next


@njit(**FORMULA)
def inverse_mass(thirds, true, out):
    """1 / M (n,), M = thirds * true: 1 for a third of the area around, 3 for the whole ring; zero where there is no triangle."""
    none, one = type(true[0])(0), type(true[0])(1)
    for j in range(len(out)):
        out[j] = one / (thirds * true[j]) if true[j] > none else none


@njit(**FORMULA)
def sped(quarters, gamma, least, part, whole, out):
    """Times (part / whole)^gamma, the edge indicator, held between ``least`` and 1; in place.

    :param quarters: four times gamma as :func:`power` takes it.
    """
    none, one = type(whole[0])(0), type(whole[0])(1)
    for j in range(len(out)):
        ratio = part[j] / whole[j] if whole[j] > none else one
        ratio = one if ratio > one else ratio
        out[j] *= power(least if ratio < least else ratio, quarters, gamma)


@njit(**FORMULA)
def blended(second, keep, dt, one, two, three, u, pull, inverse, a, b, drift, out):
    """keep u - dt s pull / M + one (a - u), and where there is a ``second`` term, + two (b - u) + three drift.

    Differences, so that what rests keeps its bits; keep is 1, or 0 for the rate alone.
    """
    for j in range(len(out)):
        moved = one * (a[j] - u[j]) - dt * inverse[j] * pull[j]
        if second:
            moved += two * (b[j] - u[j]) + three * drift[j]
        out[j] = keep * u[j] + moved
