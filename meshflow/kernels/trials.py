"""Kernels that test the gate and the threads: every kind of parameter, every kind of failure."""

import ctypes
from typing import Annotated, ClassVar

import numpy as np

from meshflow.kernels.gate import kernel
from meshflow.kernels.parameters import Array, Stop, Struct, integer, read, real, size, stop, struct, threads, write

__all__ = [
    "TrialOptions",
    "trial_census",
    "trial_endless",
    "trial_failed",
    "trial_gathered",
    "trial_options",
    "trial_over",
    "trial_rows",
    "trial_sum",
]


class TrialOptions(Struct):
    """Numbers of several types."""

    _fields_: ClassVar = [
        ("factor", ctypes.c_double),
        ("shift", ctypes.c_int32),
        ("flag", ctypes.c_uint8),
        ("pair", ctypes.c_double * 2),
    ]


@kernel
def trial_rows(
    source: Annotated[Array, read("T", "h", "w", strided=True)],
    target: Annotated[Array, write("T", "h", "w", strided=True)],
    mask: Annotated[Array | None, read(bool, "h", "w", optional=True)] = None,
    factor: Annotated[float, real] = 1.0,
    shift: Annotated[int, integer] = 0,
) -> int:
    """``target = source * factor + shift`` where the mask is; (h, w) each."""
    ...


@kernel
def trial_gathered(
    begin: Annotated[Array, read(np.int64, "m+1", below="k+1")],
    index: Annotated[Array, read(np.int32, "k", below="n")],
    source: Annotated[Array, read("T", "n")],
    target: Annotated[Array, write("T", "m")],
) -> int:
    """Sums of the samples that an index names, from one beginning to the next."""
    ...


@kernel
def trial_over(
    source: Annotated[Array, read("T", "n")],
    target: Annotated[Array, write("T", "n", over="source")],
) -> None:
    """``target = -source``, (n,) each, which may be one array."""


@kernel
def trial_options(
    options: Annotated[TrialOptions, struct(TrialOptions)],
    count: Annotated[int, size],
    seen: Annotated[Array, write(np.float64, "count")],
) -> int:
    """The first members of the options, as the kernel sees them."""
    ...


@kernel
def trial_failed(code: Annotated[int, integer], bytes: Annotated[int, integer]) -> int:
    """Return a code; or fail for want of so many bytes."""
    ...


@kernel
def trial_census(
    who: Annotated[Array, write(np.int32, "parts")],
    threads: Annotated[int | None, threads] = None,
) -> int:
    """Which thread does which part (parts,) while all are there; how many threads the team has beside its callers."""
    ...


@kernel
def trial_sum(
    x: Annotated[Array, read("T", "n")],
    sum: Annotated[Array, write("T", 1)],
    block: Annotated[int, integer],
    threads: Annotated[int | None, threads] = None,
    inner: Annotated[int | None, threads] = None,
) -> int:
    """The sum of squares by blocks, each of two halves; by threads, and by threads within them."""
    ...


@kernel
def trial_endless(
    parts: Annotated[int, integer],
    stop: Annotated[Stop | None, stop] = None,
    threads: Annotated[int | None, threads] = None,
) -> None:
    """So many parts of some 10^-5 s; stopped."""
