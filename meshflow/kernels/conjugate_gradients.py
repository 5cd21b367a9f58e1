"""Conjugate gradients for all columns of a sparse symmetric system at once; sums do not depend on the number of threads.

The matrix is packed first: its rows are reordered, and it is scaled to a unit diagonal, which is not stored. Entries between two
rows of the same block (``near``) are stored once per pair; all others (``far``) are stored as they are.
"""

from typing import Annotated

from meshflow.kernels.gate import kernel
from meshflow.kernels.parameters import Array, integer, read, threads, write

__all__ = ["conjugate_gradients", "matrix_product", "pack_entries", "pack_rows", "pack_vectors"]

First = Annotated[Array, read("int32", "n+1")]
Entries = Annotated[Array, read("int32", "e")]
Values = Annotated[Array, read("float64", "e")]
Order = Annotated[Array | None, read("int32", "n", optional=True)]
Numbers = Annotated[Array, read("float64", "n")]
Columns = Annotated[Array, write("float64", "n", "k")]
Sums = Annotated[Array, write("float64", "k")]
Threads = Annotated[int | None, threads]


@kernel
def matrix_product(
    first: First,
    columns: Entries,
    values: Values,
    p: Annotated[Array, read("float64", "n", "k")],
    q: Columns,
    threads: Threads = None,
) -> None:
    """q = A p, A in CSR."""


@kernel
def pack_rows(
    first: First,
    columns: Entries,
    values: Values,
    order: Order,
    where: Order,
    near: Annotated[Array, write("int32", "n+1")],
    far: Annotated[Array, write("int32", "n+1")],
    diagonal: Annotated[Array, write("float64", "n")],
    threads: Threads = None,
) -> None:
    """The start of the near and far entries of each row of a packed CSR matrix, and its diagonal.

    :param order: packed row r is row ``order[r]``; ``where`` is the inverse; None: the order is not changed.
    """


@kernel
def pack_entries(
    first: First,
    columns: Entries,
    values: Values,
    order: Order,
    where: Order,
    scale: Numbers,
    near: First,
    far: First,
    pairs: Annotated[Array, write("uint16", "a", 2)],
    near_values: Annotated[Array, write("float64", "a")],
    far_rows: Annotated[Array, write("uint16", "b")],
    far_columns: Annotated[Array, write("int32", "b")],
    far_values: Annotated[Array, write("float64", "b")],
    threads: Threads = None,
) -> None:
    """The entries of a CSR matrix, packed.

    :param scale: factors on rows and columns, in the packed order.
    :param near: from :func:`pack_rows`, like ``far``.
    """


@kernel
def pack_vectors(
    order: Order,
    scale: Numbers,
    source: Annotated[Array, read("float64", "n", "k")],
    target: Columns,
    back: Annotated[int, integer],
    threads: Threads = None,
) -> None:
    """target[r] = scale[r] source[order[r]]; or, with ``back``, target[order[r]] += scale[r] source[r].

    :param back: 0 or 1.
    """


@kernel
def conjugate_gradients(
    near: First,
    far: First,
    pairs: Annotated[Array, read("uint16", "a", 2)],
    near_values: Annotated[Array, read("float64", "a")],
    far_rows: Annotated[Array, read("uint16", "b")],
    far_columns: Annotated[Array, read("int32", "b")],
    far_values: Annotated[Array, read("float64", "b")],
    diagonal: Numbers,
    goal: Annotated[Array, read("float64", "k")],
    x: Columns,
    r: Columns,
    p: Columns,
    q: Columns,
    rho: Sums,
    size: Sums,
    most: Annotated[int, integer],
    threads: Threads = None,
) -> int:
    """Iterate from x, the residual r and the direction p of a packed system; returns the number of iterations.

    It ends after ``most`` iterations, or when ``size`` is at most ``goal`` in every column.

    :param diagonal: of the matrix before scaling, in the packed order.
    :param q: a work array.
    :param rho: r . r of each column; ``size``: r . r of the system before scaling.
    """
    raise NotImplementedError
