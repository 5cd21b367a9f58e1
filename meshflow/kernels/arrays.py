"""Arrays as they are, copied: what loops over memory are measured against."""

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
    """Copy an array by several threads: the speed of memory, beside which that of a rate is told.

    :param source: (n,), float32 or float64.
    :param target: (n,), of the same type.
    :param threads: how many threads; None: see :func:`meshflow.kernels.library.default_threads`.
    """
