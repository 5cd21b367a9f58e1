"""Kernels that run for seconds: Python hears of Ctrl-C between its own instructions only, so they run beside the caller."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from threading import current_thread, main_thread
from typing import TypeVar

from meshflow.kernels.parameters import Stop

__all__ = ["interruptible"]

R = TypeVar("R")
# Seconds between two looks; where waiting for a lock cannot be interrupted (Windows), Ctrl-C is heard in between.
LOOK = 0.1


def interruptible(call: Callable[[Stop], R]) -> R:
    """The result of a call, which runs in a thread of its own.

    An exception of the waiting thread, as KeyboardInterrupt, sets the flag that the call was given, and is raised when the call
    has ended. Only the main thread hears of Ctrl-C; in any other one the call runs there.

    :param call: takes the flag, and hands it to its kernel.
    """
    flag = Stop()
    if current_thread() is not main_thread():
        return call(flag)
    with ThreadPoolExecutor(1) as pool:
        try:
            running = pool.submit(call, flag)
        except RuntimeError as cause:
            if "start new thread" not in str(cause):
                raise
            return call(flag)  # a limit of the system; Ctrl-C is heard when it has ended
        try:
            while True:
                try:
                    return running.result(LOOK)
                except TimeoutError:
                    if running.done():  # it is the call's own
                        raise
        except BaseException:
            flag.set()
            raise
