"""Arrays that steps write to and give back: a run needs two or three, whatever its number of steps."""

import numpy as np

from meshflow.flow.contract import Flow
from meshflow.geometry.validation import Array

__all__ = ["Workspace"]


class Workspace:
    """Arrays (n, k) in the number type and the layout of the states of a flow.

    A run makes one; its memory goes when the run does.

    :param flow: whose states are written.
    """

    def __init__(self, flow: Flow) -> None:
        self._like = flow.start()
        self._free: list[Array] = []

    def take(self) -> Array:
        """An array (n, k) to write to; what it holds means nothing."""
        return self._free.pop() if self._free else np.empty_like(self._like)

    def give(self, *arrays: Array) -> None:
        """Arrays that nobody needs any more: :meth:`take` hands them out again."""
        self._free.extend(arrays)
