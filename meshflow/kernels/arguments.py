"""Array arguments of kernels, and their checks."""

import ctypes
import re
from collections.abc import Callable
from copy import copy
from functools import cache
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from meshflow.kernels.library import library

__all__ = ["Array", "ArrayParameter", "Call", "Parameter", "PlainParameter", "address"]

Array = NDArray[Any]

# The number types that a kernel is compiled for, by their letters in interface.h.
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
# The object of an array starts with the address of its samples, after the header of every object.
HEAD = object.__basicsize__


def _read_from_object(array: Array) -> int:
    return ctypes.c_size_t.from_address(id(array) + HEAD).value


def _asked(array: Array) -> int:
    return array.ctypes.data


_SAMPLES = np.zeros(4)
# The address of the samples of an array; ``array.ctypes.data`` takes longer than all other checks together.
address: Callable[[Array], int] = (
    _read_from_object
    if all(_read_from_object(a) == _asked(a) for a in (_SAMPLES, _SAMPLES[1:], _SAMPLES[::-2]))
    else _asked
)


class Call:
    """A call of a kernel, while its arrays are checked.

    :ivar kernel: the name of the kernel.
    :ivar number: the letter of the number type, "" until an array determines it.
    :ivar sizes: the values of the names in shapes, as far as known.
    """

    def __init__(self, kernel: str) -> None:
        self.kernel, self.number = kernel, ""
        self.sizes: dict[str, int] = {}


class Parameter:
    """One parameter of a kernel.

    :ivar name: in the Python function.
    :ivar types: the ctypes that are passed.
    :ivar letter: the types in the notation of interface.h.
    """

    name: str = ""
    types: tuple[Any, ...] = ()
    letter: str = ""

    def named(self, name: str) -> Self:
        """The parameter with a name."""
        made = copy(self)
        made.name = name
        return made

    def letters(self, number: str) -> str:
        """Its types in the notation of interface.h, for a number type."""
        del number
        return self.letter


class PlainParameter(Parameter):
    """A parameter that is no array.

    :ivar is_size: whether shapes of arrays are compared with it.
    """

    is_size: bool = False

    def taken(self, value: Any, kernel: str) -> Any:
        """The value that is passed; invalid values are refused."""
        raise NotImplementedError

    def check_layout(self, lib: ctypes.CDLL) -> None:
        """Compare the declaration in Python with the compiled code."""


class ArrayParameter(Parameter):
    """An array; see :func:`~meshflow.kernels.parameters.read` and :func:`~meshflow.kernels.parameters.write`.

    :ivar sizes: the names in its shape.
    :ivar wanted: a description of valid arrays.
    """

    def __init__(
        self,
        dtype: Any,
        shape: tuple[str | int, ...],
        *,
        written: bool,
        optional: bool,
        strided: bool,
        over: tuple[str, ...],
        below: str,
    ) -> None:
        self.generic = isinstance(dtype, str) and dtype == "T"
        self.dtypes = tuple(NUMBERS) if self.generic else (np.dtype(dtype),)
        if self.dtypes[0] not in LETTERS:
            raise TypeError(f"an array of {dtype} cannot be handed to a kernel")
        if below and self.dtypes[0] not in (np.dtype(np.int32), np.dtype(np.int64)):
            raise TypeError(f"indices are int32 or int64, not {dtype}")
        self.axes = tuple(_axis(entry) for entry in shape)
        self.written, self.optional, self.strided, self.over, self.below = written, optional, strided, over, below
        self.below_size = _axis(below) if below else ("", 0)
        self.sizes = tuple(name for name, _ in self.axes if name)
        self.types = (ctypes.c_void_p, *[ctypes.c_int64] * (len(shape) - 1 if strided else 0))
        lengths = ", ".join(
            f"{name}{offset:+d}" if name and offset else name or str(offset) for name, offset in self.axes
        )
        kinds = " or ".join(d.name for d in self.dtypes)
        self.wanted = f"an array ({lengths}{',' if len(shape) == 1 else ''}) of {kinds}"

    def letters(self, number: str) -> str:
        """A pointer to its type, and its steps."""
        letter = number if self.generic else LETTERS[self.dtypes[0]]
        return ("w" if self.written else "r") + letter + "vq" * (len(self.types) - 1)

    def check(self, value: Array, call: Call) -> tuple[int, ...]:
        """Refuse arrays that differ from the declaration, and determine sizes and number type.

        :return: the strides of all axes but the last, in samples, where rows need not be adjacent.
        """
        self._check_kind(value, call)
        self._check_shape(value, call)
        self._check_order(value, call)
        return tuple(step // value.itemsize for step in value.strides[:-1]) if self.strided else ()

    def extent(self, value: Array) -> int:
        """The number of bytes from its first to its last sample."""
        if not value.size or not self.strided:
            return value.nbytes
        return sum((n - 1) * step for n, step in zip(value.shape, value.strides, strict=True)) + value.itemsize

    def check_indices(self, array: Any, bound: int, kernel: str) -> None:
        """Refuse indices that are negative, or not below a bound."""
        if _outside(array.dtype)(array.size, address(array), bound):
            raise ValueError(
                f"{kernel}: {self.name}: indices of 0 or more and below {self.below} = {bound} expected, "
                f"got {array.min()} to {array.max()}"
            )

    def _check_kind(self, value: Array, call: Call) -> None:
        dtype = value.dtype
        if dtype not in self.dtypes:
            raise TypeError(f"{call.kernel}: {self.name}: {self.wanted} expected, got {dtype}")
        if self.generic:
            letter = NUMBERS[dtype]
            if call.number and letter != call.number:
                other = "float64" if letter == "f" else "float32"
                raise TypeError(f"{call.kernel}: {self.name}: {other} expected, as the arrays before it, got {dtype}")
            call.number = letter

    def _check_shape(self, value: Array, call: Call) -> None:
        shape, sizes = value.shape, call.sizes
        if len(shape) != len(self.axes):
            raise ValueError(f"{call.kernel}: {self.name}: {self.wanted} expected, got the shape {shape}")
        for length, (name, offset) in zip(shape, self.axes, strict=True):
            if name and name not in sizes:
                sizes[name] = length - offset
            if length != (sizes[name] + offset if name else offset) or (name and sizes[name] < 0):
                known = "".join(f", {n} = {sizes[n]}" for n in dict.fromkeys(self.sizes) if n in sizes)
                raise ValueError(f"{call.kernel}: {self.name}: {self.wanted} expected{known}, got the shape {shape}")

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
        if not flags.aligned:
            raise ValueError(
                f"{call.kernel}: {self.name}: its address is no multiple of {value.itemsize} bytes: copy it"
            )
        if self.written and not flags.writeable:
            raise ValueError(f"{call.kernel}: {self.name}: it is written, but the array is read-only: give a copy")

    def _rows_in_order(self, value: Array) -> bool:
        if not value.size:
            return True
        least = value.itemsize
        for length, step in zip(reversed(value.shape), reversed(value.strides), strict=True):
            if length > 1 and (step < least or step % value.itemsize):
                return False
            if length > 1:
                least = step * length if self.written else value.itemsize
        return value.shape[-1] <= 1 or value.strides[-1] == value.itemsize


@cache
def _outside(dtype: np.dtype) -> Callable[[int, int, int], int]:
    """A function that counts the numbers at an address that are no indices below a bound."""
    count = library()[f"outside_{dtype.name}"]
    count.argtypes, count.restype = (ctypes.c_int64, ctypes.c_void_p, ctypes.c_int64), ctypes.c_int64
    return count


def _axis(entry: str | int) -> tuple[str, int]:
    """The length of an axis, "n", "n+1" or 3, as a name ("" for none) and an offset."""
    if isinstance(entry, int):
        return "", entry
    found = re.fullmatch(r"([A-Za-z_]\w*)\s*([+-]\s*\d+)?", entry)
    if not found:
        raise ValueError(f"the length of an axis is a number, a name, or a name and a number, 'n+1'; got {entry!r}")
    return found[1], int((found[2] or "0").replace(" ", ""))
