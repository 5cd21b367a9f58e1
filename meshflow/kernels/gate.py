"""The gate between arrays of Python and loops of C++: each kernel is declared once, and its arguments are checked.

A kernel is a Python function without a body. The annotation of each parameter describes valid arguments; the gate refuses all
others before anything is read. On the first call it compares the declaration with the types of the compiled function. Arrays of
the same types, shapes and order as in an earlier call are not checked again, except for their addresses, so that a call costs
microseconds.
"""

import ctypes
import inspect
from collections.abc import Callable
from dataclasses import dataclass
from functools import update_wrapper
from typing import Annotated, Any, ClassVar, Generic, ParamSpec, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from meshflow.kernels.arguments import ArrayParameter, Call, Parameter, PlainParameter, address
from meshflow.kernels.library import library

__all__ = ["Kernel", "Stopped", "kernel"]

P = ParamSpec("P")
R = TypeVar("R")
NO_MEMORY, CANCELLED, OUT_OF_RANGE, BAD_SIZES = -1, -2, -3, -4  # Failure of interface.h
ENDINGS = {"f": "_f32", "d": "_f64", "": ""}
REMEMBERED = 512  # the largest number of kinds of calls per kernel


class Stopped(RuntimeError):
    """A kernel was stopped by a :class:`~meshflow.kernels.parameters.Stop` of its caller before it finished."""


class _Entry(ctypes.Structure):
    _fields_: ClassVar = [("signature", ctypes.c_char_p), ("address", ctypes.c_void_p)]


@dataclass(frozen=True)
class _Checked:
    """A kind of call whose array types, shapes and orders have been checked.

    :ivar run: the compiled function.
    :ivar values: the passed values, without those that differ from call to call.
    :ivar extents: the extent of each array in bytes, 0 for a missing one.
    :ivar indices: arrays of indices, their positions in the call, and their bounds.
    """

    run: Callable[..., int]
    values: list[Any]
    extents: tuple[int, ...]
    indices: tuple[tuple[ArrayParameter, int, int], ...]


class Kernel(Generic[P, R]):
    """A compiled loop as a function of Python; see :func:`kernel`.

    :ivar name: its name, in Python and in C++.
    :ivar parameters: in the order of the call.
    """

    def __init__(self, declared: Callable[P, R]) -> None:
        update_wrapper(self, declared)
        self.name = declared.__name__
        self._given = inspect.signature(declared)
        self._names = tuple(self._given.parameters)
        self._defaults = {n: p.default for n, p in self._given.parameters.items() if p.default is not p.empty}
        hints = get_type_hints(declared, include_extras=True)
        self.parameters = tuple(_parameter(self.name, name, hints[name]) for name in self._names)
        explicit = {p.name for p in self.parameters if isinstance(p, PlainParameter) and p.is_size}
        named = [size for p in self.parameters if isinstance(p, ArrayParameter) for size in p.sizes]
        self._sizes = tuple(size for size in dict.fromkeys(named) if size not in explicit)
        for p in self.parameters:
            if isinstance(p, ArrayParameter) and p.below and p.below_size[0] not in {*self._sizes, *explicit}:
                raise TypeError(f"{self.name}: {p.name}: no array has the size {p.below}")
        # The positions of the parameters in the Python call and in the C++ call.
        self._plain: list[tuple[int, int, PlainParameter]] = []
        self._arrays: list[tuple[int, int, ArrayParameter]] = []
        at = len(self._sizes)
        for i, p in enumerate(self.parameters):
            if isinstance(p, ArrayParameter):
                self._arrays.append((i, at, p))
            elif isinstance(p, PlainParameter):
                self._plain.append((i, at, p))
            at += len(p.types)
        self._handed = at
        # Pairs of arrays that must not share memory, the first of which is written; whether they may be identical.
        self._apart = [
            (k, m, other.name in one.over or one.name in other.over)
            for k, (_, _, one) in enumerate(self._arrays)
            for m, (_, _, other) in enumerate(self._arrays)
            if one.written and one is not other and not (other.written and m < k)
        ]
        self._compiled: dict[str, Callable[..., int]] = {}
        self._checked: dict[tuple[Any, ...], _Checked] = {}

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        """Check the arguments, and run the loop."""
        given: tuple[Any, ...] = args
        if kwargs or len(args) != len(self.parameters):
            given = self._ordered(args, kwargs)
        plain = [p.taken(given[i], self.name) for i, _, p in self._plain]
        kind: list[Any] = [value for value, (_, _, p) in zip(plain, self._plain, strict=True) if p.is_size]
        for i, _, p in self._arrays:
            a = given[i]
            if isinstance(a, np.ndarray):
                kind.append((a.dtype, a.shape, a.strides, a.flags.num))
            elif a is None and p.optional:
                kind.append(None)
            else:
                raise TypeError(f"{self.name}: {p.name}: {p.wanted} expected, got {type(a).__name__}")
        key = tuple(kind)
        checked = self._checked.get(key) or self._looked_at(given, key)
        values = checked.values.copy()
        for value, (_, at, _) in zip(plain, self._plain, strict=True):
            values[at] = value
        starts = []
        for i, at, _ in self._arrays:
            a = given[i]
            starts.append(address(a) if isinstance(a, np.ndarray) else None)
            values[at] = starts[-1]
        self._refuse_shared(starts, checked.extents)
        for p, i, bound in checked.indices:
            p.check_indices(given[i], bound, self.name)
        count = checked.run(*values)
        if count < 0:
            self._failed(count)
        return count  # pyright: ignore[reportReturnType]  # an int, for which a kernel declared with None has no use

    def _ordered(self, args: tuple[Any, ...], named: dict[str, Any]) -> tuple[Any, ...]:
        """All arguments in the order of the parameters."""
        values = {**self._defaults, **named}
        rest = self._names[len(args) :]
        if len(args) > len(self._names) or not (named.keys() <= set(rest) and values.keys() >= set(rest)):
            self._given.bind(*args, **named)  # raises the error
        return (*args, *[values[name] for name in rest])

    def _looked_at(self, given: tuple[Any, ...], key: tuple[Any, ...]) -> _Checked:
        """Check a new kind of call, and remember it."""
        call = Call(self.name)
        for i, _, p in self._plain:
            if p.is_size:
                call.sizes[p.name] = int(given[i])
        values: list[Any] = [None] * self._handed
        extents = []
        for i, at, p in self._arrays:
            a = given[i]
            steps = p.check(a, call) if a is not None else (0,) * (len(p.types) - 1)
            values[at + 1 : at + 1 + len(steps)] = steps
            extents.append(p.extent(a) if a is not None else 0)
        for at, name in enumerate(self._sizes):
            if name not in call.sizes:
                raise ValueError(f"{self.name}: no array tells the size {name}: one at least must be given")
            values[at] = call.sizes[name]
        indices = tuple(
            (p, i, call.sizes[p.below_size[0]] + p.below_size[1])
            for i, _, p in self._arrays
            if p.below and given[i] is not None
        )
        checked = _Checked(self._compiled.get(call.number) or self._found(call.number), values, tuple(extents), indices)
        if len(self._checked) >= REMEMBERED:
            self._checked.clear()
        self._checked[key] = checked
        return checked

    def _refuse_shared(self, starts: list[Any], extents: tuple[int, ...]) -> None:
        for k, m, may_be_same in self._apart:
            if extents[k] and extents[m]:
                first, other = starts[k], starts[m]
                if first < other + extents[m] and other < first + extents[k] and not (may_be_same and first == other):
                    one, two = self._arrays[k][2].name, self._arrays[m][2].name
                    raise ValueError(
                        f"{self.name}: {one} is written and shares memory with {two}: give an array of its own"
                    )

    def _failed(self, code: int) -> None:
        if code == NO_MEMORY:
            raise MemoryError(f"{self.name}: not enough memory for its work arrays")
        if code == CANCELLED:
            raise Stopped(f"{self.name}: stopped before it was done")
        if code == OUT_OF_RANGE:
            raise ValueError(f"{self.name}: an index is out of range: the arrays do not belong to each other")
        if code == BAD_SIZES:
            raise ValueError(f"{self.name}: the sizes or options that it was given do not belong together")
        raise RuntimeError(f"{self.name}: it failed with the code {code}, which has no meaning here")

    def _found(self, number: str) -> Callable[..., int]:
        """The compiled function for a number type ("" where it has none), if its types agree with the declaration."""
        if not number and any(p.generic for _, _, p in self._arrays):
            raise TypeError(f"{self.name}: no array tells the number type: one at least must be given")
        lib, name = library(), f"{self.name}{ENDINGS[number]}"
        if not hasattr(lib, f"kernel_{name}"):
            raise AttributeError(
                f"{name}: the library has no such kernel: MESHFLOW_KERNEL({self.name}) missing in a .cpp?"
            )
        entry = getattr(lib, f"kernel_{name}")
        entry.restype = _Entry
        found: _Entry = entry()
        wanted = "vq" * len(self._sizes) + "".join(p.letters(number) for p in self.parameters)
        if found.signature.decode() != wanted:
            raise TypeError(f"{name}: declared as {wanted}, compiled as {found.signature.decode()}")
        for _, _, p in self._plain:
            p.check_layout(lib)
        types = [ctypes.c_int64] * len(self._sizes) + [kind for p in self.parameters for kind in p.types]
        self._compiled[number] = ctypes.CFUNCTYPE(ctypes.c_int64, *types)(found.address)
        return self._compiled[number]


def kernel(declared: Callable[P, R]) -> Kernel[P, R]:
    """Declare a kernel: its name, parameters and description; the loop of that name is in C++.

    The compiled function takes, in this order: one ``i64`` for each named size of the shapes, in the order in which they are
    first named; then each parameter: an array as a pointer (and its strides, if rows need not be adjacent), ``integer`` and
    ``size`` as ``i64``, ``real`` as ``double``, ``threads`` as ``i32``, ``stop`` as ``const i32*``, a struct as a pointer.

    :param declared: a function without a body, each parameter annotated with :data:`typing.Annotated`; it returns None, or an
        int where the kernel counts.
    :raises TypeError: on a call, for an array of another kind, or where declaration and compiled function differ.
    :raises ValueError: on a call, for an array of another shape or order, one that cannot be written, or one that is written and
        shares memory with another.
    """
    return Kernel(declared)


def _parameter(kernel_name: str, name: str, hint: Any) -> Parameter:
    found = (
        [extra for extra in get_args(hint)[1:] if isinstance(extra, Parameter)] if get_origin(hint) is Annotated else []
    )
    if len(found) != 1:
        raise TypeError(f"{kernel_name}: {name}: Annotated[..., read(...)] or another parameter expected, got {hint}")
    return found[0].named(name)
