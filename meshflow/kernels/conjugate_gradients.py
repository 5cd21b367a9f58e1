"""Conjugate gradients for all columns of a sparse system at once; sums do not depend on the number of threads."""

from typing import Annotated

from meshflow.kernels.gate import kernel
from meshflow.kernels.parameters import Array, integer, read, threads, write

__all__ = ["conjugate_gradients", "matrix_product"]

First = Annotated[Array, read("int32", "n+1")]
Entries = Annotated[Array, read("int32", "e")]
Values = Annotated[Array, read("float64", "e")]
Column = Annotated[Array, write("float64", "n", "k")]
Sums = Annotated[Array, write("float64", "k")]
Threads = Annotated[int | None, threads]


@kernel
def matrix_product(
    first: First,
    columns: Entries,
    values: Values,
    p: Annotated[Array, read("float64", "n", "k")],
    q: Column,
    threads: Threads = None,
) -> None:
    """q = A p, A in CSR."""


@kernel
def conjugate_gradients(
    first: First,
    columns: Entries,
    values: Values,
    jacobi: Annotated[Array, read("float64", "n")],
    goal: Annotated[Array, read("float64", "k")],
    x: Column,
    r: Column,
    p: Annotated[Array, write("float64", "n", "wide")],
    q: Column,
    rho: Sums,
    size: Sums,
    most: Annotated[int, integer],
    threads: Threads = None,
) -> int:
    """Go on from x, the residual r and the direction p; how many iterations it took.

    Ends after ``most`` of them, or where ``size`` is at most ``goal`` in every column.

    :param jacobi: one over the diagonal.
    :param p: may have more columns than k, which are not used: vectors of three stand better in four.
    :param q: room to work in.
    :param rho: r . D^-1 r of each column, and ``size``, r . r.
    """
    raise NotImplementedError
