"""Results for arrays that nobody writes to for a while, computed once: the same triangles are asked for again and again."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import numpy as np

__all__ = ["once", "unwritten"]

P = ParamSpec("P")
R = TypeVar("R")

# The number of results that are kept, the last ones.
KEPT = 8
_KNOWN: ContextVar[dict[Any, tuple[Any, Any]] | None] = ContextVar("known", default=None)


@contextmanager
def unwritten() -> Iterator[None]:
    """Context: arrays that functions of :func:`once` are called with are not written to in it. It holds for this thread."""
    before = _KNOWN.set({})
    try:
        yield
    finally:
        _KNOWN.reset(before)


def once(compute: Callable[P, R]) -> Callable[P, R]:
    """A function whose result for the same arrays, not equal ones, is computed once within :func:`unwritten`.

    Nobody may write to the result.
    """

    @wraps(compute)
    def _known_or_computed(*args: P.args, **kwargs: P.kwargs) -> R:
        known = _KNOWN.get()
        if known is None:
            return compute(*args, **kwargs)
        key = compute, _named(args), _named(tuple(kwargs.items()))
        found = known.pop(key, None) or ((args, kwargs), compute(*args, **kwargs))
        known[key] = found  # with its arrays, so that no other ones take their places in memory
        if len(known) > KEPT:
            del known[next(iter(known))]
        return found[1]

    return _known_or_computed


def _named(value: Any) -> Any:
    """An array by where it is, all else by what it is."""
    if isinstance(value, tuple):
        return tuple(_named(part) for part in value)
    return (np.ndarray, id(value)) if isinstance(value, np.ndarray) else value
