"""Copies of arrays, with which loops over memory are compared."""

from typing import Annotated

from meshflow.kernels.gate import kernel
from meshflow.kernels.parameters import Array, read, threads, write

__all__ = ["copied"]


@kernel
def copied(
    source: Annotated[Array, read("T", "n")],
    target: Annotated[Array, write("T", "n")],
    threads: Annotated[int | None, threads] = None,
) -> None:
    """Copy an array with several threads, which measures the speed of memory.

    :param source: (n,), float32 or float64.
    :param target: (n,), of the same type.
    :param threads: number of threads; None: see :func:`meshflow.kernels.library.default_threads`.
    """
