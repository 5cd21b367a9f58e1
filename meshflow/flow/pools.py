"""Jobs in several threads: as many as the system starts, or none, where its address space or their number is limited."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from threading import Event
from types import TracebackType
from typing import ParamSpec, TypeVar

__all__ = ["Pool"]

R = TypeVar("R")
P = ParamSpec("P")
T = TypeVar("T")


class Pool:
    """Threads for jobs; where none can be started, a job runs while it is submitted. Used in a ``with`` statement.

    An error, as Ctrl-C, ends the statement when the jobs that run have ended; the others are not begun.

    :param threads: how many are wanted.
    """

    def __init__(self, threads: int) -> None:
        pools = (_started(count) for count in range(threads, 0, -1))
        self._pool = next((pool for pool in pools if pool is not None), None)

    def __enter__(self) -> "Pool":
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=kind is not None)

    def submit(self, fn: Callable[P, R], /, *args: P.args, **kwargs: P.kwargs) -> "Future[R]":
        """Run a job in a thread, or now."""
        if self._pool is not None:
            return self._pool.submit(fn, *args, **kwargs)
        done: Future[R] = Future()
        done.set_result(fn(*args, **kwargs))
        return done

    def map(self, fn: Callable[[T], R], of: Iterable[T]) -> Iterator[R]:
        """The results of a job for each of several things, in their order."""
        waiting = [self.submit(fn, one) for one in of]
        return (one.result() for one in waiting)


def _started(count: int) -> ThreadPoolExecutor | None:
    """A pool of which all threads run; None where they cannot be started."""
    pool, gate = ThreadPoolExecutor(count), Event()
    try:
        for _ in range(count):
            pool.submit(gate.wait)
    except RuntimeError:  # can't start new thread
        gate.set()
        pool.shutdown(wait=True, cancel_futures=True)
        return None
    gate.set()
    return pool
