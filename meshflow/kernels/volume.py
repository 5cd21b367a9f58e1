"""Kernels of the flow of a volume: rate, volume, bound, and the weights of an implicit step."""

import ctypes
from typing import Annotated, ClassVar

import numpy as np

from meshflow.kernels.gate import kernel
from meshflow.kernels.grid import GridBlend
from meshflow.kernels.parameters import Array, Struct, integer, read, real, struct, threads, write

__all__ = [
    "AREA",
    "BOUND",
    "DIRECTIONS",
    "MOST_CHANNELS",
    "VolumeOptions",
    "volume_measured",
    "volume_multiplied",
    "volume_rate",
    "volume_weights",
]

# What volume_measured computes, the largest number of channels, and where the other end of an edge lies, (x, y, z)
# (volume_tiles.h): of one channel the first three.
AREA, BOUND = 1, 2
MOST_CHANNELS = 256
DIRECTIONS = (
    *((1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 1, 1), (0, -1, 1), (1, 0, 1), (-1, 0, 1)),
    *((1, 1, 0), (-1, 1, 0), (1, 1, 1), (-1, 1, 1), (1, -1, 1), (-1, -1, 1)),
)


class VolumeOptions(Struct):
    """Which flow: exponents, alpha^2, the spacing, and the main diagonals that are averaged, last not included: bit 0 of one says
    that it runs against y, bit 1 against z. ``ring``: masses are whole rings. ``by_forms``: one channel as several are.
    """

    _fields_: ClassVar = [
        *((name, ctypes.c_double) for name in ("sharpness", "gamma", "scale", "x", "y", "z")),
        *((name, ctypes.c_int64) for name in ("first_diagonal", "last_diagonal", "ring", "by_forms")),
    ]


@kernel
def volume_rate(
    u: Annotated[Array, read("T", "k", "d", "h", "w")],
    there: Annotated[Array | None, read(np.uint8, "d", "h", "w", optional=True)],
    held: Annotated[Array | None, read(np.uint8, "d", "h", "w", optional=True)],
    options: Annotated[VolumeOptions, struct(VolumeOptions)],
    out: Annotated[Array, write("T", "k", "d", "h", "w", over=("one", "two", "three"))],
    one: Annotated[Array | None, read("T", "k", "d", "h", "w", optional=True)],
    two: Annotated[Array | None, read("T", "k", "d", "h", "w", optional=True)],
    three: Annotated[Array | None, read("T", "k", "d", "h", "w", optional=True)],
    blend: Annotated[GridBlend, struct(GridBlend)],
    threads: Annotated[int | None, threads] = None,
) -> None:
    """Write keep u + dt rate + one (a - u) + two (b - u) + three c, in one pass.

    :param u: the channels, (k, d, h, w), finite.
    :param there: samples that are present, not zero; None: all.
    :param held: samples that stay, not zero.
    :param options: which flow.
    :param out: where to write; it may be a, b or c.
    :param one: a, ``two`` b, ``three`` c.
    :param blend: the factors.
    :param threads: number of threads.
    """


@kernel
def volume_measured(
    u: Annotated[Array, read("T", "k", "d", "h", "w")],
    there: Annotated[Array | None, read(np.uint8, "d", "h", "w", optional=True)],
    held: Annotated[Array | None, read(np.uint8, "d", "h", "w", optional=True)],
    options: Annotated[VolumeOptions, struct(VolumeOptions)],
    asked: Annotated[int, integer],
    found: Annotated[Array, write(np.float64, 3)],
    threads: Annotated[int | None, threads] = None,
) -> None:
    """Measure the lifted volume; parameters as in :func:`volume_rate`.

    :param asked: AREA or BOUND.
    :param found: AREA: the sum of the volumes of the tetrahedra. BOUND: second the largest s M_flat / M of a sample, third, of
        several channels, the largest volume of a tetrahedron over that of its ground.
    """


@kernel
def volume_weights(
    u: Annotated[Array, read("T", "k", "d", "h", "w")],
    there: Annotated[Array | None, read(np.uint8, "d", "h", "w", optional=True)],
    held: Annotated[Array | None, read(np.uint8, "d", "h", "w", optional=True)],
    options: Annotated[VolumeOptions, struct(VolumeOptions)],
    edges: Annotated[Array, write("T", "e", "d", "h", "w")],
    inverses: Annotated[Array, write("T", "d", "h", "w")],
    threads: Annotated[int | None, threads] = None,
) -> None:
    """The weights of an implicit step; parameters as in :func:`volume_rate`.

    :param edges: (3 or 13, d, h, w), initially zero: minus the stiffness between a sample and those in DIRECTIONS. Three, of one
        channel: the flow along an edge over its difference.
    :param inverses: s / M.
    """


@kernel
def volume_multiplied(
    p: Annotated[Array, read("T", "k", "d", "h", "w")],
    q: Annotated[Array, write("T", "k", "d", "h", "w")],
    weight: Annotated[Array, read("T", "d", "h", "w")],
    edges: Annotated[Array, read("T", "e", "d", "h", "w")],
    dt: Annotated[float, real],
    dots: Annotated[Array, write(np.float64, "k")],
    threads: Annotated[int | None, threads] = None,
) -> None:
    """Write (mass + dt stiffness) p.

    :param p: (k, d, h, w).
    :param q: the result.
    :param weight: the diagonal.
    :param edges: of :func:`volume_weights`; times -dt they are the off-diagonal entries.
    :param dt: the step.
    :param dots: p . q of each channel.
    :param threads: number of threads.
    """
