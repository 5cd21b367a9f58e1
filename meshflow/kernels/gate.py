"""The gate between arrays of Python and loops of C++: each kernel is declared once, and what comes in is checked against it.

A kernel is a Python function without a body. The annotation of each parameter says what may come; the gate refuses all else
before anything is read. It compares the declaration with the types of the compiled function, when that is first called.
"""

import ctypes
import inspect
from collections.abc import Callable
from functools import update_wrapper
from typing import Annotated, Any, Generic, ParamSpec, TypeVar, get_args, get_origin, get_type_hints

from meshflow.kernels.arguments import Call, Parameter
from meshflow.kernels.library import library

__all__ = ["Kernel", "Stopped", "kernel"]

P = ParamSpec("P")
R = TypeVar("R")
NO_MEMORY, CANCELLED = -1, -2  # Failure of interface.h


class Stopped(RuntimeError):
    """A kernel was stopped by its caller's :class:`~meshflow.kernels.parameters.Stop` before it was done."""


class _Entry(ctypes.Structure):
    _fields_ = [("signature", ctypes.c_char_p), ("address", ctypes.c_void_p)]


class Kernel(Generic[P, R]):
    """A compiled loop as a function of Python; see :func:`kernel`.

    :ivar name: its name, in Python and in C++.
    :ivar parameters: what may come in, in the order of the call.
    """

    def __init__(self, declared: Callable[P, R]) -> None:
        update_wrapper(self, declared)
        self.name = declared.__name__
        self._given = inspect.signature(declared)
        hints = get_type_hints(declared, include_extras=True)
        self.parameters = tuple(_parameter(self.name, name, hints[name]) for name in self._given.parameters)
        self._generic = any(p.generic for p in self.parameters)
        # What an explicit size names, arrays are compared with: sizes first.
        self._order = sorted(range(len(self.parameters)), key=lambda i: not self.parameters[i].is_size)
        named = [size for p in self.parameters for size in p.sizes]
        explicit = {p.name for p in self.parameters if p.is_size}
        self._sizes = tuple(size for size in dict.fromkeys(named) if size not in explicit)
        self._compiled: dict[str, Callable[..., int]] = {}

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        """Check what came, and run the loop."""
        if kwargs or len(args) != len(self.parameters):
            bound = self._given.bind(*args, **kwargs)
            bound.apply_defaults()
            given = bound.args
        else:
            given = args
        call = Call(self.name)
        for i in self._order:
            self.parameters[i].check(given[i], call)
        call.check_whole(self._sizes)
        run = self._compiled.get(call.number) or self._found(call.number)
        values = [value for p in self.parameters for value in call.passed[p.name]]
        count = run(*[call.sizes[name] for name in self._sizes], *values)
        if count < 0:
            self._failed(count)
        return count  # pyright: ignore[reportReturnType]  # an int, which a kernel declared with None has no use for

    def _failed(self, code: int) -> None:
        if code == NO_MEMORY:
            raise MemoryError(f"{self.name}: no memory for what it needs while it works")
        if code == CANCELLED:
            raise Stopped(f"{self.name}: stopped before it was done")
        raise RuntimeError(f"{self.name}: it failed with the code {code}, which has no meaning here")

    def _found(self, number: str) -> Callable[..., int]:
        """The compiled function for a number type ("" where it has none), once its types agree with the declaration."""
        ending = {"f": "_f32", "d": "_f64", "": ""}[number]
        if self._generic and not number:
            raise TypeError(f"{self.name}: no array tells the number type: one at least must be given")
        lib = library()
        try:
            entry = getattr(lib, f"kernel_{self.name}{ending}")
        except AttributeError as cause:
            raise AttributeError(
                f"{self.name}{ending}: the library has no such kernel: MESHFLOW_KERNEL missing?"
            ) from cause
        entry.restype = _Entry
        found: _Entry = entry()
        wanted = "vq" * len(self._sizes) + "".join(p.letters(number) for p in self.parameters)
        if found.signature.decode() != wanted:
            raise TypeError(f"{self.name}{ending}: declared as {wanted}, compiled as {found.signature.decode()}")
        for p in self.parameters:
            p.check_layout(lib)
        types = [ctypes.c_int64] * len(self._sizes) + [kind for p in self.parameters for kind in p.types]
        self._compiled[number] = ctypes.CFUNCTYPE(ctypes.c_int64, *types)(found.address)
        return self._compiled[number]


def kernel(declared: Callable[P, R]) -> Kernel[P, R]:
    """Declare a kernel: its name, its parameters and what it is for; the loop of that name is in C++.

    The compiled function takes, in this order: one ``i64`` for each size that the shapes name, in the order in which they are
    first named; then each parameter: an array as a pointer (and its strides, if it has any of its own), ``integer`` and
    ``size`` as ``i64``, ``real`` as ``double``, ``threads`` as ``i32``, ``stop`` as ``const i32*``, a struct as a pointer.

    :param declared: a function without a body, each parameter annotated with :data:`typing.Annotated`; it returns None, or an
        int where the kernel counts something.
    :raises TypeError: on a call, for an array of another kind, or where declaration and compiled function differ.
    :raises ValueError: on a call, for an array of another shape or order, one that cannot be written, or that shares memory
        with another one.
    """
    return Kernel(declared)


def _parameter(kernel_name: str, name: str, hint: Any) -> Parameter:
    found = (
        [extra for extra in get_args(hint)[1:] if isinstance(extra, Parameter)] if get_origin(hint) is Annotated else []
    )
    if len(found) != 1:
        raise TypeError(f"{kernel_name}: {name}: Annotated[..., read(...)] or another parameter expected, got {hint}")
    return found[0].named(name)
