"""Kinds of parameters of kernels: arrays that are read or written, sizes, numbers, options, threads, a stop flag."""

import ctypes
import operator
from typing import Any, ClassVar

from meshflow.kernels.arguments import Array, ArrayParameter, PlainParameter
from meshflow.kernels.library import default_threads

__all__ = [
    "Array",
    "Stop",
    "Struct",
    "integer",
    "read",
    "real",
    "size",
    "stop",
    "struct",
    "threads",
    "write",
]

THREADS = 1024
LARGEST = 2**63


class Stop:
    """A flag with which another thread stops a kernel; no further part of its work is started then."""

    def __init__(self) -> None:
        self._flag = ctypes.c_int32(0)

    def set(self) -> None:
        """Stop the kernel."""
        self._flag.value = 1

    def is_set(self) -> bool:
        """Whether the flag is set."""
        return self._flag.value != 0

    @property
    def address(self) -> int:
        """The address of the flag."""
        return ctypes.addressof(self._flag)


class Struct(ctypes.Structure):
    """Options of a kernel, as a struct of C++ of the same name, whose ``MESHFLOW_LAYOUT`` names the same members."""


def read(
    dtype: Any, *shape: str | int, optional: bool = False, strided: bool = False, below: str = ""
) -> ArrayParameter:
    """An array that is read, in C order; const A* in C++.

    :param dtype: "T" for the kernel's number type, float32 or float64, one for all of its arrays; else a dtype.
    :param shape: the length of each axis: a number, or a name that has one value in the whole call, or "n+1".
    :param optional: None is allowed and passed as a null pointer.
    :param strided: rows need not be adjacent, but each is contiguous. The strides of all axes but the last are passed after
        the pointer, as i64, in samples.
    :param below: for int32 and int64: all numbers must be indices, 0 or more and below this size, "n" or
        "n+1" (one pass over the array).
    """
    return ArrayParameter(dtype, shape, written=False, optional=optional, strided=strided, over=(), below=below)


def write(
    dtype: Any, *shape: str | int, optional: bool = False, strided: bool = False, over: str | tuple[str, ...] = ()
) -> ArrayParameter:
    """An array that is written, or read and written; A* in C++. It must not share memory with another one.

    :param dtype: as in :func:`read`.
    :param shape: as in :func:`read`.
    :param optional: as in :func:`read`.
    :param strided: as in :func:`read`.
    :param over: the name, or names, of arrays that it may be identical to, which are then overwritten.
    """
    names = (over,) if isinstance(over, str) else over
    return ArrayParameter(dtype, shape, written=True, optional=optional, strided=strided, over=names, below="")


class _Integer(PlainParameter):
    types, letter = (ctypes.c_int64,), "vq"

    def taken(self, value: Any, kernel: str) -> Any:
        """An integer of 64 bits."""
        try:
            number = operator.index(value)
        except TypeError as cause:
            raise TypeError(f"{kernel}: {self.name}: an integer expected, got {value!r}") from cause
        if not -LARGEST <= number < LARGEST:
            raise ValueError(f"{kernel}: {self.name}: an integer of 64 bits expected, got {number}")
        return number


class _Size(_Integer):
    is_size = True

    def taken(self, value: Any, kernel: str) -> Any:
        """A size, with which arrays are compared."""
        number = super().taken(value, kernel)
        if number < 0:
            raise ValueError(f"{kernel}: {self.name}: a size of 0 or more expected, got {value}")
        return number


class _Real(PlainParameter):
    types, letter = (ctypes.c_double,), "vd"

    def taken(self, value: Any, kernel: str) -> Any:
        """A number, as float64."""
        try:
            return float(value)
        except (TypeError, ValueError) as cause:
            raise TypeError(f"{kernel}: {self.name}: a number expected, got {value!r}") from cause


class _Threads(PlainParameter):
    types, letter = (ctypes.c_int32,), "vi"

    def taken(self, value: Any, kernel: str) -> Any:
        """The number of threads; None: as many as the process may use."""
        if value is None:
            return min(default_threads(), THREADS)
        try:
            number = operator.index(value)
        except TypeError as cause:
            raise TypeError(f"{kernel}: {self.name}: a number of threads expected, or None, got {value!r}") from cause
        if not 1 <= number <= THREADS:
            raise ValueError(f"{kernel}: {self.name}: 1 to {THREADS} threads expected, got {number}")
        return number


class _Stop(PlainParameter):
    types, letter = (ctypes.c_void_p,), "ri"

    def taken(self, value: Any, kernel: str) -> Any:
        """The address of its flag, or null."""
        if value is not None and not isinstance(value, Stop):
            raise TypeError(f"{kernel}: {self.name}: a Stop or None expected, got {value!r}")
        return value.address if value is not None else None


class _Struct(PlainParameter):
    types, letter = (ctypes.c_void_p,), "rx"

    def __init__(self, kind: type[Struct]) -> None:
        self.kind = kind

    def taken(self, value: Any, kernel: str) -> Any:
        """The address of the options."""
        if not isinstance(value, self.kind):
            raise TypeError(f"{kernel}: {self.name}: {self.kind.__name__} expected, got {type(value).__name__}")
        return ctypes.addressof(value)

    def check_layout(self, lib: ctypes.CDLL) -> None:
        """Compare the members of the options."""
        compare_layout(self.kind, lib)


class _Layout(ctypes.Structure):
    _fields_: ClassVar = [("members", ctypes.c_char_p), ("at", ctypes.POINTER(ctypes.c_int64))]


def compare_layout(kind: type[Struct], lib: ctypes.CDLL) -> None:
    """Compare the members of a struct and their offsets in Python and in the library.

    :raises TypeError: where they differ; the message shows both.
    """
    ask = getattr(lib, f"layout_{kind.__name__}")
    ask.restype = _Layout
    found: _Layout = ask()
    members = found.members.decode().split(", ")
    compiled = [found.at[i] for i in range(2 * len(members) + 1)]
    fields = [getattr(kind, name) for name, *_ in kind._fields_]
    declared = [ctypes.sizeof(kind), *[number for field in fields for number in (field.offset, field.size)]]
    if [name for name, *_ in kind._fields_] != members or declared != compiled:
        raise TypeError(
            f"{kind.__name__}: declared with {[name for name, *_ in kind._fields_]}, size, offsets and sizes {declared}; "
            f"compiled with {members}, {compiled}"
        )


def struct(kind: type[Struct]) -> PlainParameter:
    """Options in a struct, const S* in C++; its layout is compared with the compiled one."""
    return _Struct(kind)


integer: PlainParameter = _Integer()
size: PlainParameter = _Size()
real: PlainParameter = _Real()
threads: PlainParameter = _Threads()
stop: PlainParameter = _Stop()
