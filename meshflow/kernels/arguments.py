"""One call of a kernel: what may come in as an array, and what is checked when it has come."""

import ctypes
import re
from collections.abc import Callable
from copy import copy
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshflow.kernels.library import library

__all__ = ["Array", "ArrayParameter", "Call", "Parameter"]

Array = NDArray[Any]

# The number type that a kernel is compiled for twice, by its letter in interface.h.
NUMBERS = {np.dtype(np.float32): "f", np.dtype(np.float64): "d"}
LETTERS = {
    np.dtype(np.bool_): "B",
    np.dtype(np.int8): "b",
    np.dtype(np.uint8): "B",
    np.dtype(np.int16): "h",
    np.dtype(np.uint16): "H",
    np.dtype(np.int32): "i",
    np.dtype(np.uint32): "I",
    np.dtype(np.int64): "q",
    np.dtype(np.uint64): "Q",
    **NUMBERS,
}


class Call:
    """One call of a kernel, while what came is checked.

    :ivar kernel: its name.
    :ivar number: the letter of the number type, "" until an array has told it.
    :ivar sizes: what the names in shapes stand for, as far as is known.
    :ivar passed: what is handed over for each parameter.
    :ivar spans: name, first address, address after the last, and parameter of each array that is not empty.
    """

    __slots__ = ("indices", "kernel", "number", "passed", "sizes", "spans", "written")

    def __init__(self, kernel: str) -> None:
        self.kernel, self.number = kernel, ""
        self.sizes: dict[str, int] = {}
        self.passed: dict[str, tuple[Any, ...]] = {}
        self.spans: list[tuple[int, int, ArrayParameter]] = []
        self.written: list[tuple[int, int, ArrayParameter]] = []
        self.indices: list[tuple[Array, ArrayParameter]] = []

    def check_whole(self, sizes: tuple[str, ...]) -> None:
        """What can be said only when all is there: that every size is known, that nothing written is read elsewhere, indices."""
        for name in sizes:
            if name not in self.sizes:
                raise ValueError(f"{self.kernel}: no array tells the size {name}: one at least must be given")
        for first, last, one in self.written:
            for begin, end, other in self.spans:
                if first < end and begin < last and other is not one and not one.may_share(other, first == begin):
                    raise ValueError(
                        f"{self.kernel}: {one.name} is written and shares memory with {other.name}: give an array of its own"
                    )
        for array, parameter in self.indices:
            parameter.check_indices(array, self)


class Parameter:
    """What may come in as one parameter of a kernel.

    :ivar name: as the function of Python has it.
    :ivar generic: whether it is of the kernel's number type.
    :ivar is_size: whether it is a size that is given as a number.
    :ivar sizes: the names of sizes that it tells.
    :ivar types: what ctypes hands over.
    """

    name: str = ""
    generic: bool = False
    is_size: bool = False
    sizes: tuple[str, ...] = ()
    types: tuple[Any, ...] = ()
    letter: str = ""

    def named(self, name: str) -> "Parameter":
        """The same with its name."""
        made = copy(self)
        made.name = name
        return made

    def letters(self, number: str) -> str:
        """Its types as interface.h writes them, for a number type."""
        del number
        return self.letter

    def check(self, value: Any, call: Call) -> None:
        """Put what is handed over into the call, or refuse it."""
        raise NotImplementedError

    def check_layout(self, lib: ctypes.CDLL) -> None:
        """Compare what is declared in Python with what was compiled."""


class ArrayParameter(Parameter):
    """An array; see :func:`read` and :func:`write`."""

    def __init__(
        self,
        dtype: Any,
        shape: tuple[str | int, ...],
        *,
        written: bool,
        optional: bool,
        strided: bool,
        over: str,
        below: str,
    ) -> None:
        self.generic = dtype == "T"
        self.dtypes = tuple(NUMBERS) if self.generic else (np.dtype(dtype),)
        if self.dtypes[0] not in LETTERS:
            raise TypeError(f"an array of {dtype} cannot be handed to a kernel")
        self.axes = tuple(_axis(entry) for entry in shape)
        self.written, self.optional, self.strided, self.over, self.below = written, optional, strided, over, below
        self.sizes = tuple(name for name, _ in self.axes if name)
        self.types = (ctypes.c_void_p, *[ctypes.c_int64] * (len(shape) - 1 if strided else 0))

    def letters(self, number: str) -> str:
        """A pointer to its type, and its steps."""
        letter = number if self.generic else LETTERS[self.dtypes[0]]
        return ("w" if self.written else "r") + letter + "vq" * (len(self.types) - 1)

    def check(self, value: Any, call: Call) -> None:
        """Refuse what is not as declared; put its address into the call."""
        if value is None and self.optional:
            call.passed[self.name] = (None, *[0] * (len(self.types) - 1))
            return
        if not isinstance(value, np.ndarray):
            raise TypeError(f"{call.kernel}: {self.name}: {self._wanted()} expected, got {type(value).__name__}")
        self._check_kind(value, call)
        self._check_shape(value, call)
        self._check_order(value, call)
        start: int = value.ctypes.data
        if value.size:
            if start % value.itemsize:
                raise ValueError(f"{call.kernel}: {self.name}: its address is no multiple of {value.itemsize}: copy it")
            extent = value.nbytes
            if self.strided:
                extent = sum((n - 1) * s for n, s in zip(value.shape, value.strides, strict=True)) + value.itemsize
            span = (start, start + extent, self)
            call.spans.append(span)
            if self.written:
                call.written.append(span)
            if self.below:
                call.indices.append((value, self))
        call.passed[self.name] = (start, *self._steps(value)) if self.strided else (start,)

    def may_share(self, other: "ArrayParameter", same_start: bool) -> bool:
        """Whether this array, which is written, may share memory with another one: only with that which it is written over."""
        return same_start and (self.over == other.name or other.over == self.name)

    def check_indices(self, array: Array, call: Call) -> None:
        """Whether all numbers of an array of indices are 0 or more and below a size."""
        bound = call.sizes.get(self.below, 0)
        count = _outside(array.dtype.name)(array.size, array.ctypes.data, bound)
        if count:
            raise ValueError(
                f"{call.kernel}: {self.name}: indices from 0 to {self.below} - 1 = {bound - 1} expected, "
                f"got {array.min()} to {array.max()}"
            )

    def _wanted(self) -> str:
        shape = ", ".join(
            f"{name}{offset:+d}" if name and offset else name or str(offset) for name, offset in self.axes
        )
        kinds = " or ".join(d.name for d in self.dtypes)
        return f"an array ({shape}{',' if len(self.axes) == 1 else ''}) of {kinds}"

    def _check_kind(self, value: Array, call: Call) -> None:
        dtype = value.dtype
        if dtype not in self.dtypes:
            raise TypeError(f"{call.kernel}: {self.name}: {self._wanted()} expected, got {dtype}")
        if self.generic:
            letter = NUMBERS[dtype]
            if call.number and letter != call.number:
                other = "float64" if letter == "f" else "float32"
                raise TypeError(f"{call.kernel}: {self.name}: {other} expected, as the arrays before it, got {dtype}")
            call.number = letter

    def _check_shape(self, value: Array, call: Call) -> None:
        shape, sizes = value.shape, call.sizes
        if len(shape) != len(self.axes):
            raise ValueError(f"{call.kernel}: {self.name}: {self._wanted()} expected, got the shape {shape}")
        for length, (name, offset) in zip(shape, self.axes, strict=True):
            if name and name not in sizes:
                sizes[name] = length - offset
            if length != (sizes[name] + offset if name else offset) or (name and sizes[name] < 0):
                known = ", ".join(f"{n} = {sizes[n]}" for n in self.sizes if n in sizes)
                raise ValueError(
                    f"{call.kernel}: {self.name}: {self._wanted()} expected{', ' * bool(known)}{known}, got the shape {shape}"
                )

    def _check_order(self, value: Array, call: Call) -> None:
        flags = value.flags
        if self.strided:
            if not self._rows_in_order(value):
                raise ValueError(
                    f"{call.kernel}: {self.name}: rows that are contiguous and stand one after the other expected, got the "
                    f"strides {value.strides} of {value.itemsize} bytes each: np.ascontiguousarray"
                )
        elif not flags.c_contiguous:
            raise ValueError(
                f"{call.kernel}: {self.name}: C order expected (the last axis contiguous), got the strides {value.strides}: "
                "np.ascontiguousarray"
            )
        if self.written and not flags.writeable:
            raise ValueError(f"{call.kernel}: {self.name}: it is written, but the array is read-only: give a copy")

    def _rows_in_order(self, value: Array) -> bool:
        least = value.itemsize
        for length, step in zip(reversed(value.shape), reversed(value.strides), strict=True):
            if length > 1 and (step < least or step % value.itemsize):
                return False
            if length > 1:
                least = step * length if self.written else value.itemsize
        return value.shape[-1] <= 1 or value.strides[-1] == value.itemsize

    def _steps(self, value: Array) -> tuple[int, ...]:
        return tuple(step // value.itemsize for step in value.strides[:-1])


@cache
def _outside(dtype: str) -> Callable[[int, int, int], int]:
    """How many of n numbers of a type, at an address, are no indices below a bound."""
    count = library()[f"outside_{dtype}"]
    count.argtypes, count.restype = (ctypes.c_int64, ctypes.c_void_p, ctypes.c_int64), ctypes.c_int64
    return count


def _axis(entry: str | int) -> tuple[str, int]:
    """The length of an axis, "n", "n+1" or 3, as a name ("" for none) and what is added to it."""
    if isinstance(entry, int):
        return "", entry
    found = re.fullmatch(r"([A-Za-z_]\w*)\s*([+-]\s*\d+)?", entry)
    if not found:
        raise ValueError(f"the length of an axis is a number, a name, or a name and a number, 'n+1'; got {entry!r}")
    return found[1], int((found[2] or "0").replace(" ", ""))
