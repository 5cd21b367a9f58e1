"""Bands of rows, worked on by threads. What comes out does not depend on how many there are."""

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import lru_cache
from queue import SimpleQueue
from threading import Lock, Thread
from typing import Any, TypeVar

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

    queue = _helpers(os.getpid(), threads)
    turns = [_Turn(run) for _ in range(min(threads, len(parts)) - 1)]
    for turn in turns:
        queue.put(turn)
    try:
        run()
    finally:
        with lock:
            for _ in left:  # what has not begun, when this thread was stopped, shall not begin
                pass
        for turn in turns:
            turn.ended.acquire()
    for turn in turns:
        if turn.error is not None:
            raise turn.error
    return [results[turn] for turn in range(len(parts))]


@dataclass(eq=False)
class _Turn:
    """What a helper does once; ``ended`` is released when it has. (A Future says more, and costs a fifth of a rate of a
    640 x 480 image on every call.)
    """

    run: Callable[[], None]
    ended: Any = field(default_factory=Lock)
    error: BaseException | None = None

    def __post_init__(self) -> None:
        self.ended.acquire()

    def __call__(self) -> None:
        try:
            self.run()
        except BaseException as cause:  # noqa: BLE001 (raised again where the turn is waited for)
            self.error = cause
        finally:
            self.ended.release()


@lru_cache(maxsize=4)
def _helpers(process: int, threads: int) -> "SimpleQueue[_Turn]":
    """Where helpers of this process wait for turns; after a fork they are made anew."""
    queue: SimpleQueue[_Turn] = SimpleQueue()
    for i in range(threads - 1):
        Thread(target=_help, args=(queue,), name=f"meshflow-{i}", daemon=True).start()
    return queue


def _help(queue: "SimpleQueue[_Turn]") -> None:
    while True:
        queue.get()()
