"""Kernels of the flow on a grid: rate, area, bound, the weights of an implicit step, and the layout of the triangles."""

import ctypes
from typing import Annotated, ClassVar

import numpy as np

from meshflow.kernels.gate import kernel
from meshflow.kernels.parameters import Array, Struct, integer, read, real, struct, threads, write

__all__ = [
    "AREA",
    "BLOCK",
    "BOUND",
    "CHANNELS",
    "LINES",
    "PINHOLE",
    "GridBlend",
    "GridOptions",
    "grid_descended",
    "grid_measured",
    "grid_multiplied",
    "grid_rate",
    "grid_size",
    "grid_turned",
    "grid_weights",
    "laid_out",
]

# Elements that are processed together (grid_cells.h).
BLOCK = 16
# What grid_measured computes, and the kinds of free directions (grid_rays.h, grid_rows.h).
AREA, BOUND = 1, 2
CHANNELS, LINES, PINHOLE = range(3)


class GridOptions(Struct):
    """Which flow: exponents, floor of the projection indicator, alpha^2, the length below which a pull is rounding, one over the
    pitch of a pinhole's even grid, the triangulations taken together, and what is of which kind (grid_rows.h).
    """

    _fields_: ClassVar = [
        *((name, ctypes.c_double) for name in ("sharpness", "gamma", "floor", "scale", "small", "across", "down")),
        *(
            (name, ctypes.c_int64)
            for name in ("first_sheet", "last_sheet", "mass", "projection", "lines", "gaps", "by_forms", "evened")
        ),
    ]


class GridBlend(Struct):
    """The factors of keep u + dt rate + one (a - u) + two (b - u) + three c."""

    _fields_: ClassVar = [(name, ctypes.c_double) for name in ("keep", "dt", "one", "two", "three")]


@kernel
def laid_out(
    there: Annotated[Array, read(np.uint8, "m", "n")],
    which: Annotated[int, integer],
    borders: Annotated[int, integer],
    codes: Annotated[Array, write(np.uint8, "m", "w")],
    kinds: Annotated[Array, write(np.uint8, "m", "b")],
    threads: Annotated[int | None, threads] = None,
) -> None:
    """Lay out the triangles that exist, and which of their edges are borders (grid_cells.h).

    :param there: (m, n), the bits of :func:`meshflow.surfaces.triangles.triangles_there`.
    :param which: the triangulation, 0 forward, 1 backward.
    :param borders: 1 to mark border edges, else 0.
    :param codes: (m, n + 1), of each element.
    :param kinds: (m, blocks), of each block of BLOCK elements.
    :param threads: number of threads.
    """


@kernel
def grid_rate(
    u: Annotated[Array, read("T", "k", "h", "w")],
    geometry: Annotated[Array, read("T", "h", 7)],
    codes: Annotated[Array, read(np.uint8, "m", "w")],
    kinds: Annotated[Array, read(np.uint8, "m", "b")],
    row_of: Annotated[Array, read(np.int32, 2, "h-1", below="m")],
    held: Annotated[Array | None, read(np.uint8, "h", "w", optional=True)],
    lines: Annotated[Array, read("T", "l")],
    where: Annotated[Array, read(np.int64, 6, 3)],
    time_factor: Annotated[Array | None, read("T", "h", "w", optional=True)],
    taps: Annotated[Array, read("T", "p")],
    options: Annotated[GridOptions, struct(GridOptions)],
    out: Annotated[Array, write("T", "k", "h", "w", over=("one", "two", "three"))],
    one: Annotated[Array | None, read("T", "k", "h", "w", optional=True)],
    two: Annotated[Array | None, read("T", "k", "h", "w", optional=True)],
    three: Annotated[Array | None, read("T", "k", "h", "w", optional=True)],
    blend: Annotated[GridBlend, struct(GridBlend)],
    threads: Annotated[int | None, threads] = None,
) -> None:
    """Write keep u + dt rate + one (a - u) + two (b - u) + three c, in one pass.

    :param u: the planes, (k, h, w).
    :param geometry: (h, 7), of triangles with a leg in a row: (alpha / x)^2, (alpha / y)^2, y / 2x, x / 2y, x y / 6, x, y.
    :param codes: of :func:`laid_out`, each distinct row once; ``kinds`` likewise.
    :param row_of: (2, h - 1), the distinct row of each row of cells, forward and backward.
    :param held: samples that stay, not zero.
    :param lines: origins (three coordinates) and directions, one after the other, each (h or 1, w or 1); empty for channels.
    :param where: (6, 3), for each coordinate its first index and the steps down and to the right, 0 where it is constant.
    :param time_factor: factors of time.
    :param taps: the Gaussian of patches, from its centre outwards; empty without patches.
    :param options: which flow.
    :param out: where to write; it may be a, b or c.
    :param one: a, ``two`` b, ``three`` c.
    :param blend: the factors.
    :param threads: number of threads.
    """


@kernel
def grid_measured(
    u: Annotated[Array, read("T", "k", "h", "w")],
    geometry: Annotated[Array, read("T", "h", 7)],
    codes: Annotated[Array, read(np.uint8, "m", "w")],
    kinds: Annotated[Array, read(np.uint8, "m", "b")],
    row_of: Annotated[Array, read(np.int32, 2, "h-1", below="m")],
    held: Annotated[Array | None, read(np.uint8, "h", "w", optional=True)],
    lines: Annotated[Array, read("T", "l")],
    where: Annotated[Array, read(np.int64, 6, 3)],
    time_factor: Annotated[Array | None, read("T", "h", "w", optional=True)],
    taps: Annotated[Array, read("T", "p")],
    options: Annotated[GridOptions, struct(GridOptions)],
    asked: Annotated[int, integer],
    window: Annotated[Array, read(np.int64, 4)],
    found: Annotated[Array, write(np.float64, 2)],
    threads: Annotated[int | None, threads] = None,
) -> None:
    """Measure the surface in a window; parameters as in :func:`grid_rate`.

    :param asked: AREA or BOUND.
    :param window: its first row, that after the last one, and its columns likewise.
    :param found: the area; and for one channel without patches the largest s M_flat / M, else the largest bound of a triangle
        times the factor of time at its corners.
    """


@kernel
def grid_weights(
    u: Annotated[Array, read("T", "k", "h", "w")],
    geometry: Annotated[Array, read("T", "h", 7)],
    codes: Annotated[Array, read(np.uint8, "m", "w")],
    kinds: Annotated[Array, read(np.uint8, "m", "b")],
    row_of: Annotated[Array, read(np.int32, 2, "h-1", below="m")],
    held: Annotated[Array | None, read(np.uint8, "h", "w", optional=True)],
    lines: Annotated[Array, read("T", "l")],
    where: Annotated[Array, read(np.int64, 6, 3)],
    time_factor: Annotated[Array | None, read("T", "h", "w", optional=True)],
    taps: Annotated[Array, read("T", "p")],
    options: Annotated[GridOptions, struct(GridOptions)],
    edges: Annotated[Array, write("T", 4, "h", "w")],
    inverses: Annotated[Array, write("T", "h", "w")],
    threads: Annotated[int | None, threads] = None,
) -> None:
    """The weights of an implicit step; parameters as in :func:`grid_rate`.

    :param edges: (4, h, w), initially zero: half the cotangents opposite to the edges that start at a sample: to the right, down,
        down left, and down right.
    :param inverses: s / M |d|^2.
    """


@kernel
def grid_multiplied(
    p: Annotated[Array, read("T", "k", "h", "w")],
    q: Annotated[Array, write("T", "k", "h", "w")],
    weight: Annotated[Array, read("T", "h", "w")],
    edges: Annotated[Array, read("T", 4, "h", "w")],
    dt: Annotated[float, real],
    dots: Annotated[Array, write(np.float64, "k")],
    threads: Annotated[int | None, threads] = None,
) -> None:
    """Write (mass + dt stiffness) p.

    :param p: (k, h, w).
    :param q: the result.
    :param weight: the diagonal.
    :param edges: of :func:`grid_weights`; times -dt they are the off-diagonal entries.
    :param dt: the step.
    :param dots: p . q of each channel.
    :param threads: number of threads.
    """


@kernel
def grid_descended(
    alpha: Annotated[Array, read(np.float64, "k")],
    p: Annotated[Array, read("T", "k", "h", "w")],
    q: Annotated[Array, read("T", "k", "h", "w")],
    x: Annotated[Array, write("T", "k", "h", "w")],
    r: Annotated[Array, write("T", "k", "h", "w")],
    weight: Annotated[Array, read("T", "h", "w")],
    dots: Annotated[Array, write(np.float64, 2, "k")],
    threads: Annotated[int | None, threads] = None,
) -> None:
    """Add alpha p to x and subtract alpha q from r, in place.

    :param alpha: one per channel.
    :param p: (k, h, w), as ``q``, ``x`` and ``r``.
    :param weight: the preconditioner.
    :param dots: (2, k): r . r and r . (r / weight).
    :param threads: number of threads.
    """


@kernel
def grid_turned(
    beta: Annotated[Array, read(np.float64, "k")],
    r: Annotated[Array, read("T", "k", "h", "w")],
    weight: Annotated[Array, read("T", "h", "w")],
    p: Annotated[Array, write("T", "k", "h", "w")],
    threads: Annotated[int | None, threads] = None,
) -> None:
    """Replace p by r / weight + beta p; parameters as in :func:`grid_descended`."""


@kernel
def grid_size(
    factors: Annotated[Array, read(np.float64, 4)],
    a: Annotated[Array | None, read("T", "k", "h", "w", optional=True)],
    b: Annotated[Array | None, read("T", "k", "h", "w", optional=True)],
    c: Annotated[Array | None, read("T", "k", "h", "w", optional=True)],
    d: Annotated[Array | None, read("T", "k", "h", "w", optional=True)],
    every: Annotated[int, integer],
    found: Annotated[Array, write(np.float64, 2)],
    threads: Annotated[int | None, threads] = None,
) -> None:
    """Sum of squares and largest square of the samples of a sum of factors times arrays.

    :param factors: of a, b, c and d.
    :param a: (k, h, w), as ``b``, ``c`` and ``d``; None where there is none.
    :param every: use every ``every``-th row.
    :param found: the sum and the largest; NaN where a sample is NaN.
    :param threads: number of threads.
    """
