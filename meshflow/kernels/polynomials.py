"""Chebyshev polynomials of a sparse matrix, one degree at a time, and sums of them."""

from typing import Annotated

from meshflow.kernels.gate import kernel
from meshflow.kernels.parameters import Array, read, real, threads, write

__all__ = ["chebyshev_degree"]


@kernel
def chebyshev_degree(
    first: Annotated[Array, read("int32", "n+1")],
    columns: Annotated[Array, read("int32", "e")],
    values: Annotated[Array, read("float64", "e")],
    scale: Annotated[float, real],
    twice: Annotated[float, real],
    terms: Annotated[Array, read("float64", "p", 2)],
    now: Annotated[Array, read("float64", "n", "k")],
    before: Annotated[Array, write("float64", "n", "k")],
    sums: Annotated[Array, write("float64", "p", "n", "k")],
    threads: Annotated[int | None, threads] = None,
) -> None:
    """scale A now - twice now - before, A in CSR, which replaces ``before``; terms times now and it are added to sums."""
