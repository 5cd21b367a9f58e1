"""Bands of rows, worked on by threads. What comes out does not depend on how many there are."""

import os
from collections.abc import Callable, Iterable
from concurrent.futures import Executor, ThreadPoolExecutor
from functools import lru_cache
from threading import Lock
from typing import TypeVar

import numba

__all__ = ["bands", "worked"]

T = TypeVar("T")
# Samples of a band: enough that handing it to a thread costs nothing beside it.
SAMPLES = 1 << 19
# Samples of a grid for which threads are worth waking.
FEW = 1 << 15


def bands(rows: int, columns: int) -> list[tuple[int, int]]:
    """First row and the row after the last of each band; their height depends on the size of the grid alone."""
    if rows * columns <= FEW:
        return [(0, rows)]
    height = max(8, min(SAMPLES // columns, -(-rows // 2)))
    return [(first, min(first + height, rows)) for first in range(0, rows, height)]


def worked(work: Callable[..., T], parts: Iterable[tuple[int, int]], threads: int | None = None) -> list[T]:
    """``work(part)`` for every part, by as many threads as numba would use, this one among them; results in their order.

    Ctrl-C is heard between parts: none begins after it.
    """
    parts, threads = list(parts), threads or numba.get_num_threads()
    results: dict[int, T] = {}
    left, lock = iter(range(len(parts))), Lock()

    def run() -> None:
        while True:
            with lock:
                turn = next(left, None)
            if turn is None:
                return
            results[turn] = work(parts[turn])

    helpers = min(threads, len(parts)) - 1
    futures = [_pool(os.getpid(), threads).submit(run) for _ in range(helpers)]
    try:
        run()
    finally:
        with lock:
            for _ in left:  # what has not begun, when this thread was stopped, shall not begin
                pass
        for future in futures:
            future.result()
    return [results[turn] for turn in range(len(parts))]


@lru_cache(maxsize=4)
def _pool(process: int, threads: int) -> Executor:
    """Threads of this process; after a fork they are made anew."""
    return ThreadPoolExecutor(threads, thread_name_prefix="meshflow")
